# SPDX-License-Identifier: Apache-2.0
"""Hovers with faults of the actuators: lost or not, how far off, landed; both receivers; JSON.

Usage: ./heli python scripts/actuator_fault_table.py [--seeds 1..10]
"""

import json
from functools import cache
from typing import Any

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.settings import Settings, resolve
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
    over = {"plant": {"faults": (text,)}, "scenario": _STAYS}
    return resolve("hover", gps, seed, END_S, world=WORLD, overrides=over)


@cache
def sound(gps: str, seed: int) -> FlightRecord:
    """The flight without a fault."""
    return simulate(settings("none", gps, seed)).record


def flown(given: Settings) -> dict[str, Any]:
    """Figures of a flight."""
    flight = simulate(given)
    record, begun = flight.record, round(BEGIN_S * TICKS_PER_S)
    pos = record.truth_pos_ned_m
    off = np.linalg.norm((pos - sound(given.gps, given.seed).truth_pos_ned_m[: len(pos)]), axis=1)
    found: dict[str, Any] = {
        "lost": bool(flight.status),
        "cause": flight.sentence if flight.status else "",
        "lost_s": len(record) / TICKS_PER_S - BEGIN_S if flight.status else None,
        "off_m": float(off[begun:].max()),
        "landing_s": None, "down_s": None, "sink_mps": None,
    }  # fmt: skip
    if record.mode is not None and (record.mode == "land").any():
        lands = np.flatnonzero(record.mode == "land")
        found["landing_s"] = lands[0] / TICKS_PER_S - BEGIN_S
        found["off_m"] = float(off[begun : max(lands[0], begun + 1)].max())
        if record.mode[-1] == "standing":
            before = lands[-1] - TICKS_PER_S
            found["down_s"] = lands[-1] / TICKS_PER_S - BEGIN_S
            found["sink_mps"] = float(np.abs(record.truth_vel_ned_mps[before : lands[-1], 2]).max())
    return found


def row(what: str, told: tuple[str, str, float | None, float | None], gps: str,
        seeds: list[int]) -> dict[str, Any]:  # fmt: skip
    """Figures of a fault with a receiver."""
    words, kind, duration_s, value = told
    text = fault(what, kind, duration_s, value)
    found = [flown(settings(text, gps, seed)) for seed in seeds]

    def of(key: str) -> list[float]:
        return [one[key] for one in found if one[key] is not None]

    kept = [one["off_m"] for one in found if not one["lost"]]
    return {
        "what": what,
        "fault": words,
        "gps": gps,
        "text": text,
        "lost": sum(one["lost"] for one in found),
        "causes": sorted({one["cause"] for one in found if one["lost"]}),
        "down": len(of("down_s")),
        "median": {"off_m": float(np.median(kept)) if kept else None},
        "min": {"lost_s": min(of("lost_s"), default=None)},
        "max": {
            "off_m": max(kept, default=None),
            **{key: max(of(key), default=None) for key in ("landing_s", "down_s", "sink_mps")},
        },
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..10").parse_args().seeds
    rows = [row(what, told, gps, seeds) for what in CHANNELS for told in KINDS for gps in RECEIVERS]
    content = {"seeds": seeds, "world": WORLD, "begin_s": BEGIN_S, "end_s": END_S}
    print(json.dumps(content | {"rows": rows}, indent=2))


if __name__ == "__main__":
    main()
