# SPDX-License-Identifier: Apache-2.0
"""The path of a scenario: from its rows to the trajectory that is flown."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_flight.loop.scenario_mte import MTE_ROWS, fly_manoeuvre
from heli_guidance.curves import Circle, Lemniscate
from heli_guidance.errors import PathError
from heli_guidance.flight_path import FlightPath
from heli_guidance.limits import MotionLimits
from heli_math.trajectory import Trajectory
from heli_parameters.parameters import Parameter, ParameterError

CLIMB, WAYPOINTS, ORBIT, FIGURE_EIGHT = "climb", "waypoints", "orbit", "figure_eight"
MANOEUVRE = "manoeuvre"
FIXED, ALONG, CENTRE = "fixed", "along", "centre"

PATH_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "path.kind",
        "string",
        "What is flown: hover with the climb of climb.*, or from path.start_s on legs between way "
        "points, laps of a circle, or of a figure eight; or a manoeuvre that `heli score` scores",
        choices=(CLIMB, WAYPOINTS, ORBIT, FIGURE_EIGHT, MANOEUVRE),
    ),
    Parameter("path.start_s", "double", "Start of the path", "s", lower=0.0, upper=86400.0),
    Parameter(
        "path.speed_mps", "double", "Speed over ground of legs and laps", "m/s",
        lower=0.1, upper=20.0,
    ),
    Parameter("path.climb_mps", "double", "Vertical speed of legs", "m/s", lower=0.1, upper=5.0),
    Parameter(
        "path.acceleration_mps2", "double", "Largest acceleration: along a leg, across a bend",
        "m/s2", lower=0.05, upper=8.0,
    ),
    Parameter("path.jerk_mps3", "double", "Largest jerk along the way", "m/s3", lower=0.05,
              upper=50.0),
    Parameter("path.yaw_rate_degps", "double", "Largest rate of the heading", "deg/s", lower=1.0,
              upper=180.0),
    Parameter(
        "path.yaw_acceleration_degps2", "double", "Largest angular acceleration of the heading, "
        "reached in half a second", "deg/s2", lower=1.0, upper=720.0,
    ),
    Parameter(
        "path.heading",
        "string",
        "The nose: as at the start; in the direction of flight; in laps of a circle to its centre. "
        "Where it is elsewhere at first it turns on the spot",
        choices=(FIXED, ALONG, CENTRE),
    ),
    Parameter(
        "path.waypoints_ned_m", "double[]", "Way points, NED, each flown to straight and stood "
        "still at", "m", shape=(None, 3), upper=1e5,
    ),
    Parameter("path.stay_s", "double", "Stay at each way point; after a manoeuvre beyond what is "
        "scored", "s", lower=0.0, upper=3600.0),
    Parameter(
        "path.size_m", "double", "Diameter of the circle, or the figure eight from tip to tip", "m",
        lower=0.5, upper=1000.0,
    ),
    Parameter("path.laps", "double", "Laps", lower=0.01, upper=1000.0),
    *MTE_ROWS,
)  # fmt: skip
"""Rows of the `scenario` node."""


def path_of(start_ned_m: NDArray[np.float64], psi_rad: float, p: Mapping[str, Any]) -> Trajectory:
    """Trajectory of a path from a start (3,), NED, m, and a heading, rad.

    Raises
    ------
    ParameterError
        It cannot be flown within its limits; the sentence names the numbers.
    """
    kind, heading = p["path.kind"], p["path.heading"]
    if heading == CENTRE and kind != ORBIT:
        raise ParameterError(
            f"scenario: path.heading is {CENTRE}, path.kind {kind}; only an {ORBIT} has a centre"
        )
    try:
        limits = MotionLimits.from_parameters(p, "path")
        path = FlightPath(start_ned_m, psi_rad, limits).stay(p["path.start_s"])
        if kind == MANOEUVRE:
            return fly_manoeuvre(path, p)
        if kind == WAYPOINTS:
            for goal in np.reshape(p["path.waypoints_ned_m"], (-1, 3)):
                _leg(path, goal, heading).stay(p["path.stay_s"])
        elif kind == ORBIT:
            circle = Circle(start_ned_m, psi_rad, 0.5 * p["path.size_m"])
            path.along(circle, p["path.speed_mps"], p["path.laps"], heading)
        else:
            eight = Lemniscate(start_ned_m, psi_rad, p["path.size_m"])
            path.along(eight, p["path.speed_mps"], p["path.laps"], heading)
        return path.trajectory()
    except PathError as error:
        raise ParameterError(f"scenario: path: {error}") from error


def _leg(path: FlightPath, goal: NDArray[np.float64], heading: str) -> FlightPath:
    north, east = (goal - path.pos_ned_m)[:2]
    if heading == ALONG and np.hypot(north, east) > 0.0:
        path.turn_to(float(np.arctan2(east, north)))
    return path.go_to(goal)
