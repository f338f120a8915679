# SPDX-License-Identifier: Apache-2.0
"""Hovers with faults of the sensors: how far off, lost, landed; both receivers; JSON.

Usage: ./heli python -m evidence.experiments.failsafes [--seeds 1..10]
"""

import sys
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.ticks import TICKS_PER_S
from heli_flight.loop import simulate
from heli_flight.settings import Settings, resolve

WORLD, RECEIVERS = "honest", ("rtk", "standalone")
BEGIN_S, END_S = 12.0, 60.0
LANDED_S = 110.0
"""Duration of a flight that should land by itself."""
_STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}
_BEFORE_S = 1.0


def _fault(what: str, kind: str, duration_s: float | None = None, *value: float) -> str:
    words = f"what: {what}, kind: {kind}, start_s: {BEGIN_S}"
    words += "" if duration_s is None else f", duration_s: {duration_s}"
    return f"{{{words}{f', value: {list(value)}' if value else ''}}}"


_AWAY = (2.0, 0.0, 0.0)
ROWS: tuple[tuple[str, tuple[str, ...], float | None, bool], ...] = (
    ("GPS silent for 10 s", (_fault("gps", "loss", 10.0),), 3.0, False),
    ("GPS silent for 30 s", (_fault("gps", "loss", 30.0),), 10.0, False),
    ("GPS silent", (_fault("gps", "loss"),), None, True),
    ("GPS and barometer silent", (_fault("gps", "loss"), _fault("baro", "loss")), None, True),
    ("GPS stuck for 10 s", (_fault("gps", "freeze", 10.0),), 10.0, False),
    ("GPS stuck", (_fault("gps", "freeze"),), 10.0, True),
    ("GPS drifts, 2 m/s", (_fault("gps", "drift", None, *_AWAY),), 10.0, False),
    ("GPS drifts, 2 m/s, its velocity, too",
     (_fault("gps", "drift", None, *_AWAY), _fault("gps_velocity", "bias", None, *_AWAY)),
     10.0, True),
    ("GPS 30 m off", (_fault("gps", "bias", None, 30.0, 0.0, 0.0),), 10.0, False),
    ("IMU zero for 0.2 s", (_fault("imu", "zero", 0.2),), 1.0, False),
    ("IMU frozen for 0.2 s", (_fault("imu", "freeze", 0.2),), 1.0, False),
    ("IMU not a number for 0.2 s", (_fault("imu", "nan", 0.2),), 1.0, False),
    ("IMU frozen for 1 s", (_fault("imu", "freeze", 1.0),), None, False),
    ("gyro bias 0.1 rad/s", (_fault("gyro", "bias", None, 0.1, 0.0, 0.0),), None, False),
    ("accelerometer bias 1 m/s2", (_fault("accel", "bias", None, 1.0, 0.0, 0.0),), None, False),
    ("magnetometer silent", (_fault("mag", "loss"),), None, False),
    ("magnetometer zero", (_fault("mag", "zero"),), None, False),
    ("barometer silent", (_fault("baro", "loss"),), None, False),
)  # fmt: skip
"""Words, faults, goal in m, whether it should land by itself."""
TWO: tuple[tuple[str, tuple[str, ...], float | None, bool], ...] = (
    ("of two IMUs one not a number", (_fault("imu", "nan"),), 2.0, False),
    ("of two IMUs one zero", (_fault("imu2", "zero"),), 2.0, False),
    ("of two IMUs one frozen", (_fault("imu", "freeze"),), 2.0, False),
    ("of two gyros one biased, 0.1 rad/s", (_fault("gyro", "bias", None, 0.1, 0.0, 0.0),), 2.0,
     False),
    ("of two gyros one drifts, 0.01 rad/s2", (_fault("gyro2", "drift", None, 0.0, 0.01, 0.0),), 2.0,
     False),
    ("of two accelerometers one biased, 1 m/s2", (_fault("accel", "bias", None, 1.0, 0.0, 0.0),),
     2.0, False),
)  # fmt: skip
"""The same with a second IMU."""
_TOLD = {words: (faults, goal_m, lands) for words, faults, goal_m, lands in (*ROWS, *TWO)}
_WITH_TWO: dict[str, dict[str, Any]] = {
    "plant": {"sensors.imu2.enabled": True},
    "observer": {"imu2.enabled": True},
}


def settings(
    faults: tuple[str, ...], lands: bool, gps: str, seed: int, two: bool = False
) -> Settings:
    """A hover at its place, with faults from `BEGIN_S` on, with one IMU or two."""
    more: dict[str, dict[str, Any]] = _WITH_TWO if two else {"plant": {}, "observer": {}}
    with_faults = {**more["plant"], "faults": faults}
    over = {**more, "plant": with_faults, "scenario": _STAYS}
    return resolve("hover", gps, seed, LANDED_S if lands else END_S, world=WORLD, overrides=over)


@cache
def sound(gps: str, seed: int, two: bool = False) -> np.ndarray:
    """Positions, NED, m, of the flight without a fault."""
    return simulate(settings(("none",), True, gps, seed, two)).record.truth_pos_ned_m


@over(fault=tuple(_TOLD), gps=RECEIVERS)
def flown(fault: str, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight."""
    faults, _, lands = _TOLD[fault]
    two = fault in {words for words, *_ in TWO}
    flight = simulate(settings(faults, lands, gps, seed, two))
    record, begun = flight.record, round(BEGIN_S * TICKS_PER_S)
    pos = record.truth_pos_ned_m
    off = np.linalg.norm((pos - sound(gps, seed, two)[: len(pos)])[begun:], axis=1)
    outcome: dict[str, Any] = {"lost": bool(flight.status), "landing_s": None, "down_s": None,
                             "sink_mps": None}  # fmt: skip
    if record.mode is not None and (record.mode == "land").any():
        first = int(np.flatnonzero(record.mode == "land")[0])
        outcome["landing_s"] = first / TICKS_PER_S - BEGIN_S
        off = off[: max(first - begun, 1)]
        if record.mode[-1] == "standing":
            down = int(np.flatnonzero(record.mode == "land")[-1])
            before = down - round(_BEFORE_S * TICKS_PER_S)
            outcome["down_s"] = down / TICKS_PER_S - BEGIN_S
            outcome["sink_mps"] = float(np.abs(record.truth_vel_ned_mps[before:down, 2]).max())
            outcome["away_m"] = float(np.linalg.norm((pos[down] - pos[begun])[:2]))
    outcome["off_m"] = float(off.max())
    return outcome


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a fault with a receiver."""
    flights = place.flights
    faults, goal_m, lands = _TOLD[place.point["fault"]]

    def of(key: str) -> list[float]:
        return [one[key] for one in flights if one.get(key) is not None]

    return {
        **place.point,
        "faults": list(faults),
        "goal_m": goal_m,
        "lands": lands,
        "lost": sum(one["lost"] for one in flights),
        "down": len(of("down_s")),
        "median": {"off_m": float(np.median(of("off_m")))},
        "max": {
            key: max(of(key), default=None)
            for key in ("off_m", "landing_s", "down_s", "sink_mps", "away_m")
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    rows = [row(place) for place in flown.places(options)]
    content = {"seeds": options.seeds, "world": WORLD, "begin_s": BEGIN_S, "end_s": END_S}
    return content | {"landed_s": LANDED_S, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "failsafes",
    "./heli python -m evidence.experiments.failsafes --seeds 1..10",
    "Hovers with faults of the sensors, with both receivers.",
    tuple(range(1, 11)),
    # As of a landing without a place to hold.
    MARGIN,
)


@table("failsafes")
def failsafes(results: Results) -> str:
    """Faults of sensors in the hover: off, lost, landed."""
    record = results["failsafes"]
    head = ["fault", "receiver", "lost", "off, m: median / worst", "goal, m", "down",
            "after, s", "at, m/s", "away, m"]  # fmt: skip
    rows = []
    for row in record["rows"]:
        most = row["max"]
        off = f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}"
        goal = "" if row["goal_m"] is None else f"{row['goal_m']:g}"
        down = ["", "", "", ""]
        if row["lands"]:
            down = [str(row["down"])]
            for key, form in (("down_s", ".0f"), ("sink_mps", ".2f"), ("away_m", ".0f")):
                down.append("–" if most[key] is None else f"{most[key]:{form}}")
        rows.append([row["fault"], row["gps"], str(row["lost"]), off, goal, *down])
    return (
        f"{grid(head, rows)}\n\nOf {len(record['seeds'])} flights each (seeds {record['seeds'][0]} "
        f"to {record['seeds'][-1]}): hover at 10 m, world {record['world']}, default controllers, "
        f"the fault from {record['begin_s']:g} s on, {record['end_s']:g} s long, "
        f"{record['landed_s']:g} s where it should land by itself. Off: largest "
        "distance from the same flight without the fault, from truth, until the landing begins. "
        "Down: flights that came to stand by themselves; "
        f"time from the fault, speed of the touch-down and distance from the place: worst."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
