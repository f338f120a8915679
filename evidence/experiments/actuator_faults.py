# SPDX-License-Identifier: Apache-2.0
"""Hovers with faults of the actuators: lost or not, how far off and turned; both receivers; JSON.

Usage: ./heli python -m evidence.experiments.actuator_faults [--seeds 11..20]
"""

import sys
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rotations import euler_from_quat
from heli_core.ticks import TICKS_PER_S
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.settings import Settings, resolve

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
_KINDS = {words: (kind, duration_s, value) for words, kind, duration_s, value in KINDS}


def text_of(what: str, fault: str) -> str:
    """The parameter's text of a fault of a channel from `BEGIN_S` on."""
    kind, duration_s, value = _KINDS[fault]
    words = f"what: {what}, kind: {kind}, start_s: {BEGIN_S}"
    words += "" if duration_s is None else f", duration_s: {duration_s}"
    return f"{{{words}{'' if value is None else f', value: {value}'}}}"


def settings(text: str, gps: str, seed: int) -> Settings:
    """A hover at its place."""
    watched = {"failsafe.unfollowed_deg": [8.0, 5.5]}
    over: dict[str, dict[str, Any]] = {
        "plant": {"faults": (text,)},
        "scenario": _STAYS,
        "outer_loop": watched,
    }
    return resolve("hover", gps, seed, END_S, world=WORLD, overrides=over)


@cache
def sound(gps: str, seed: int) -> FlightRecord:
    """The flight without a fault."""
    return simulate(settings("none", gps, seed)).record


@over(what=CHANNELS, fault=tuple(_KINDS), gps=RECEIVERS)
def flown(what: str, fault: str, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight."""
    flight, whole = simulate(settings(text_of(what, fault), gps, seed)), sound(gps, seed)
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


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a fault with a receiver; off and turned are of the flights that were not lost."""
    flights = place.flights
    lost, kept = ([one for one in flights if one["lost"] is is_lost] for is_lost in (True, False))

    def most(key: str) -> float | None:
        return max((one[key] for one in kept), default=None)

    return {
        **place.point,
        "text": text_of(place.point["what"], place.point["fault"]),
        "lost": len(lost),
        "causes": sorted({one["cause"] for one in lost}),
        "median": {"off_m": float(np.median([one["off_m"] for one in kept])) if kept else None},
        "min": {"lost_s": min((one["lost_s"] for one in lost), default=None)},
        "max": {"off_m": most("off_m"), "turned_deg": most("turned_deg")},
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    content = {"seeds": options.seeds, "world": WORLD, "begin_s": BEGIN_S, "end_s": END_S}
    return content | {"rows": [row(place) for place in flown.places(options)]}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "actuator_faults",
    "./heli python -m evidence.experiments.actuator_faults --seeds 11..20",
    "Hovers with faults of the actuators, with both receivers.",
    tuple(range(11, 21)),
    # An aircraft that is not held keeps no difference small.
    MARGIN,
)


@table("actuator_faults")
def actuator_faults(results: Results) -> str:
    """Faults of actuators in the hover: who survives, how far off, how far turned."""
    record = results["actuator_faults"]
    channels = {"delta_lat": "lateral cyclic", "delta_lon": "longitudinal cyclic",
                "delta_ped": "pedal", "delta_col": "collective"}  # fmt: skip
    n = len(record["seeds"])
    rows = []
    for row in record["rows"]:
        lost_s, most = row["min"]["lost_s"], row["max"]
        rows.append([
            channels[row["what"]], row["fault"], row["gps"], f"{n - row['lost']} of {n}",
            "" if lost_s is None else f"{lost_s:.1f}",
            "–" if most["off_m"] is None else f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}",
            "–" if most["turned_deg"] is None else f"{most['turned_deg']:.0f}",
        ])  # fmt: skip
    head = ["channel", "fault", "receiver", "survived", "first lost after, s",
            "off, m: median / worst", "turned, deg: worst"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nSeeds {record['seeds'][0]} to {record['seeds'][-1]}, none of "
        "those on which the degraded mode was made: hover at 10 m, "
        f"world {record['world']}, default controllers, "
        f"`failsafe.unfollowed_deg: [8.0, 5.5]`, the fault from {record['begin_s']:g} s on, flown "
        f"to {record['end_s']:g} s; where the attitude does not follow, "
        "it flies softly. Off and turned: largest distance and "
        "change of heading from the same flight without the fault, of those that survived, from "
        "truth: survived is not held. Behind a stuck pedal the yaw gyro goes on: the heading "
        "drifts and does not spin."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "11..20"))
