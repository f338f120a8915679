# SPDX-License-Identifier: Apache-2.0
"""Hovers with faults of the actuators: lost or not, how far off and turned; both receivers; JSON.

Usage: ./heli python scripts/actuator_fault_table.py [--seeds 11..20]
"""

import json
from functools import cache
from typing import Any

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.settings import Settings, resolve
from heli_math.rotations import euler_from_quat
from heli_math.ticks import TICKS_PER_S

WORLD, RECEIVERS = "honest", ("rtk", "standalone")
BEGIN_S, END_S = 12.0, 60.0
_STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}
CHANNELS = ("delta_lat", "delta_lon", "delta_ped", "delta_col")
KINDS: tuple[tuple[str, str, float | None, float | None], ...] = (
    ("stuck for 0.5 s", "stuck", 0.5, None),
    ("stuck for 2 s", "stuck", 2.0, None),
    ("stuck", "stuck", None, None),
    ("off by 0.05", "offset", None, 0.05),
    ("off by 0.2", "offset", None, 0.2),
    ("slow, 0.5 /s", "slow", None, 0.5),
    ("slow, 0.1 /s", "slow", None, 0.1),
    ("dead zone 0.02", "dead_zone", None, 0.02),
    ("dead zone 0.1", "dead_zone", None, 0.1),
    ("runs away, 0.1 /s", "runaway", None, 0.1),
)
"""Words, kind, duration in s (None: to the end), value."""


def fault(what: str, kind: str, duration_s: float | None, value: float | None) -> str:
    """The parameter's text of a fault from `BEGIN_S` on."""
    words = f"what: {what}, kind: {kind}, start_s: {BEGIN_S}"
    words += "" if duration_s is None else f", duration_s: {duration_s}"
    return f"{{{words}{'' if value is None else f', value: {value}'}}}"


def settings(text: str, gps: str, seed: int) -> Settings:
    """A hover at its place."""
    watched = {"failsafe.unfollowed_deg": [8.0, 5.5]}
    over = {"plant": {"faults": (text,)}, "scenario": _STAYS, "outer_loop": watched}
    return resolve("hover", gps, seed, END_S, world=WORLD, overrides=over)


@cache
def sound(gps: str, seed: int) -> FlightRecord:
    """The flight without a fault."""
    return simulate(settings("none", gps, seed)).record


def flown(given: Settings) -> dict[str, Any]:
    """Figures of a flight."""
    flight, whole = simulate(given), sound(given.gps, given.seed)
    record, begun = flight.record, round(BEGIN_S * TICKS_PER_S)
    n = len(record)
    off = np.linalg.norm(record.truth_pos_ned_m - whole.truth_pos_ned_m[:n], axis=1)
    psi = [
        np.array([euler_from_quat(quat)[2] for quat in one.truth_q_nb[begun:n]])
        for one in (record, whole)
    ]
    return {
        "lost": bool(flight.status),
        "cause": flight.sentence if flight.status else "",
        "lost_s": n / TICKS_PER_S - BEGIN_S if flight.status else None,
        "off_m": float(off[begun:].max()),
        "turned_deg": float(np.degrees(np.abs(np.unwrap(psi[0]) - np.unwrap(psi[1]))).max()),
    }


def row(what: str, told: tuple[str, str, float | None, float | None], gps: str,
        seeds: list[int]) -> dict[str, Any]:  # fmt: skip
    """Figures of a fault with a receiver; off and turned are of the flights that were not lost."""
    words, kind, duration_s, value = told
    text = fault(what, kind, duration_s, value)
    found = [flown(settings(text, gps, seed)) for seed in seeds]
    lost, kept = ([one for one in found if one["lost"] is is_lost] for is_lost in (True, False))

    def most(key: str) -> float | None:
        return max((one[key] for one in kept), default=None)

    return {
        "what": what,
        "fault": words,
        "gps": gps,
        "text": text,
        "lost": len(lost),
        "causes": sorted({one["cause"] for one in lost}),
        "median": {"off_m": float(np.median([one["off_m"] for one in kept])) if kept else None},
        "min": {"lost_s": min((one["lost_s"] for one in lost), default=None)},
        "max": {"off_m": most("off_m"), "turned_deg": most("turned_deg")},
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "11..20").parse_args().seeds
    rows = [row(what, told, gps, seeds) for what in CHANNELS for told in KINDS for gps in RECEIVERS]
    content = {"seeds": seeds, "world": WORLD, "begin_s": BEGIN_S, "end_s": END_S}
    print(json.dumps(content | {"rows": rows}, indent=2))


if __name__ == "__main__":
    main()
