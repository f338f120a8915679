# SPDX-License-Identifier: Apache-2.0
"""Flights whose sensors are wrong from the first sample: lost, told, how far off; JSON.

Usage: ./heli python -m evidence.experiments.wrong_from_start [--seeds 1..1]
"""

import math
import sys
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rotations import euler_angles
from heli_flight.loop import build, fly, fly_loop, simulate
from heli_flight.settings import Settings, resolve
from heli_observer.layout import YAW_COUNT, ObserverStatus
from heli_observer.observer import status

WORLD, RECEIVERS, SCENARIOS = "honest", ("rtk", "standalone"), ("hover", "figure_eight")
_LOOKS = 20
"""Ticks from one look at the observer's status to the next."""


def _turned(degrees: float, field: tuple[float, float, float]) -> list[float]:
    """A field, NED, turned about the vertical."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    north, east, down = field
    return [c * north - s * east, s * north + c * east, down]


def _askew(degrees: float) -> dict[str, Any]:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {"plant": {"sensors.mag.soft_iron": [c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0]}}


def _fault(what: str, *value: float) -> dict[str, Any]:
    words = f"{{what: {what}, kind: bias, start_s: 0.0, value: {list(value)}}}"
    return {"plant": {"faults": (words,)}}


_FIELD = (3.53e-5, -2.7e-6, 3.31e-5)
WRONG: dict[str, dict[str, Any]] = {
    "nothing": {},
    "compass askew, 10 deg": _askew(10.0),
    "compass askew, 30 deg": _askew(30.0),
    "compass askew, 90 deg": _askew(90.0),
    "hard iron, 15 uT to the right": {"plant": {"sensors.mag.hard_iron_t": [0.0, 1.5e-5, 0.0]}},
    "declination told 10 deg wrong": {
        "observer": {"ekf.mag.field_ned_t": _turned(10.0, _FIELD)}
    },
    "accelerometers, 0.5 m/s2 forward (3 deg of level)": _fault("accel", 0.5, 0.0, 0.0),
    "gyros, 0.02 rad/s in roll": _fault("gyro", 0.02, 0.0, 0.0),
    "barometer, 500 Pa": _fault("baro", 500.0),
    "GPS position, 30 m north": _fault("gps", 30.0, 0.0, 0.0),
    "GPS velocity, 1 m/s north": _fault("gps_velocity", 1.0, 0.0, 0.0),
}  # fmt: skip
"""What is wrong, and the parameters that make it so."""


def settings(wrong: str, scenario: str, gps: str, seed: int) -> Settings:
    """A flight with it."""
    return resolve(scenario, gps, seed, world=WORLD, overrides=WRONG[wrong])


@cache
def sound(scenario: str, gps: str, seed: int) -> np.ndarray:
    """Positions, NED, m, of the flight with sound sensors."""
    return simulate(settings("nothing", scenario, gps, seed)).record.truth_pos_ned_m


@over(wrong=tuple(WRONG), scenario=SCENARIOS, gps=RECEIVERS)
def flown(wrong: str, scenario: str, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight."""
    order = settings(wrong, scenario, gps, seed)
    loop, told = build(order), set()

    def ticks(loop: Any, first: int, n: int, rows: Any, *rest: Any) -> tuple[int, int]:
        done = 0
        while done < n:
            part = min(_LOOKS, n - done)
            some, state = fly(loop, first + done, part, rows[done : done + part], *rest)
            done += some
            told.add(ObserverStatus(status(loop.observer_s, loop.observer_k)).name)
            if state != 0 or some < part:
                return done, state
        return n, 0

    flight = fly_loop(loop, order, ticks=ticks)
    record, bank = flight.record, loop.observer_s.yaw.count
    pos = record.truth_pos_ned_m
    off = (pos - sound(scenario, gps, seed)[: len(pos)])[:, :2]
    psi = euler_angles(record.nav_q_nb)[-1, 2] - euler_angles(record.truth_q_nb)[-1, 2]
    return {
        "lost": bool(flight.status),
        "told": sorted(told - {"OK", "ALIGNING"}),
        "left": bool(bank[YAW_COUNT.left]),
        "off_m": float(np.linalg.norm(off, axis=1).max()),
        "heading_deg": abs(math.degrees(math.remainder(psi, 2.0 * math.pi))),
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Figures of what is wrong, with a receiver."""
    flights = place.flights
    back = [one for one in flights if not one["lost"]]
    return {
        **place.point,
        "lost": sum(one["lost"] for one in flights),
        "left": sum(one["left"] for one in flights),
        "told": sorted({name for one in flights for name in one["told"]}),
        "max": {
            key: max((one[key] for one in back), default=None) for key in ("off_m", "heading_deg")
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    rows = [row(place) for place in flown.places(options)]
    return {"seeds": options.seeds, "world": WORLD, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "wrong_from_start",
    "./heli python -m evidence.experiments.wrong_from_start --seeds 1..1",
    "Flights whose sensors are wrong from the first sample, with both receivers.",
    (1,),
    # As of a flight that tumbles before it is caught.
    MARGIN,
)


@table("wrong_from_start")
def wrong_from_start(results: Results) -> str:
    """Sensors wrong from the first sample: what flies, what is told."""
    record = results["wrong_from_start"]
    head = ["wrong from the start", "flight", "receiver", "lost", "compass left", "told",
            "off, m", "heading at the end, deg"]  # fmt: skip
    rows = []
    for row in record["rows"]:
        most = row["max"]
        figures = [
            "–" if most[key] is None else f"{most[key]:.1f}" for key in ("off_m", "heading_deg")
        ]
        told = ", ".join(row["told"]) or "nothing"
        rows.append([row["wrong"], row["scenario"], row["gps"], str(row["lost"]),
                     str(row["left"]), told, *figures])  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nFlights each: {len(record['seeds'])}, begun in the air, world "
        f"{record['world']}, default controllers. Told: states of the observer at any time of any "
        "of them. Off: largest distance from the same flight with sound sensors, worst; heading: "
        "error of the estimate, worst; both of flights that are not lost."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..1"))
