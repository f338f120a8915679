# SPDX-License-Identifier: Apache-2.0
"""The path of a scored manoeuvre: from its published table to the trajectory that is flown."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_guidance.curves import Circle, Slalom
from heli_guidance.flight_path import FlightPath
from heli_handling.definitions import FULL, MANOEUVRES, Manoeuvre, Scale, froude, manoeuvre
from heli_math.rows import REFERENCE
from heli_math.trajectory import Trajectory
from heli_parameters.parameters import Parameter, ParameterError

FROUDE = "froude"
_OBLIQUE_RAD = math.radians(45.0)
_APPROACH_S = 4.0
"""Flown at the approach's speed before the hover, at full size."""
_PLENTY = 1.1
"""Of what has to be reached at least: to be sure that it is."""
LEAD_IN_S = 3.0
"""Scored from so long before the path begins: what drifts in the hover before it is no part."""
_TURNS = 4
_BEYOND = 0.5
"""Of the room beyond a slalom's gates: how far its turns reach into it."""

MTE_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "path.manoeuvre", "string", "Manoeuvre that path.kind manoeuvre flies",
        choices=tuple(MANOEUVRES),
    ),
    Parameter(
        "path.scale", "string",
        "Size of the manoeuvre: as published, or by the Froude number for path.rotor_diameter_m",
        choices=(FULL.name, FROUDE),
    ),
    Parameter(
        "path.rotor_diameter_m", "double", "Main rotor's diameter, for the scale froude", "m",
        lower=0.05, upper=50.0,
    ),
)  # fmt: skip
"""Rows of the `scenario` node."""


def scale_flown(p: Mapping[str, Any]) -> Scale:
    """The size of a scenario's manoeuvre."""
    return FULL if p["path.scale"] == FULL.name else froude(p["path.rotor_diameter_m"])


def table_of(p: Mapping[str, Any]) -> Manoeuvre:
    """The table of a scenario's manoeuvre, at its scale."""
    return manoeuvre(p["path.manoeuvre"], scale_flown(p))


def target_of(reference: Trajectory, p: Mapping[str, Any]) -> NDArray[np.float64]:
    """What the manoeuvre is scored by (3,), NED, m: its end, or the centre of its circle."""
    table = table_of(p)
    if table.name == "pirouette":
        start, psi = reference.points[0, REFERENCE.pos], reference.points[0, REFERENCE.psi]
        nose = np.array([math.cos(psi), math.sin(psi), 0.0])
        return np.asarray(start + table["radius_m"] * nose)
    return np.asarray(reference.points[-1, REFERENCE.pos])


def fly_manoeuvre(path: FlightPath, p: Mapping[str, Any]) -> Trajectory:
    """A manoeuvre from where a path stands; at its end it stands still for as long as is scored.

    Raises
    ------
    ParameterError
        Within the limits of the path the manoeuvre's speed is not reached.
    PathError
        As the path's pieces raise it.
    """
    table = table_of(p)
    {
        "hover": _hover,
        "vertical": _vertical,
        "pirouette": _pirouette,
        "slalom": _slalom,
        "lateral-reposition": _lateral_reposition,
        "depart-abort": _depart_abort,
    }[table.name](path, table)
    held = table.geometry.get("hold_s", table.geometry.get("still_for_s"))
    path.stay((0.0 if held is None else held[1]) + p["path.stay_s"])
    reference = path.trajectory()
    level = reference.points[:, REFERENCE.vel][:, :2]
    _check_speed(table, float(np.hypot(level[:, 0], level[:, 1]).max()), p)
    return reference


def _least_mps(table: Manoeuvre) -> float:
    """Speed over ground without which it is not the manoeuvre, or not even adequate."""
    if table.name == "pirouette":
        return 2.0 * math.pi * table["radius_m"] / table.bounds("time").adequate
    if table.name == "slalom":
        return table.bounds("speed").adequate
    names = {"approach", "peak"}
    return max((c.low for c in table.conditions if c.name in names), default=0.0)


def _aim_mps(table: Manoeuvre) -> float:
    """Speed to fly at: where there is a range its middle, else what is desired, and a little."""
    if table.name == "pirouette":
        return _PLENTY * 2.0 * math.pi * table["radius_m"] / table.bounds("time").desired
    if table.name == "slalom":
        return 1.03 * table.bounds("speed").desired
    (fastest,) = (c for c in table.conditions if c.name in ("approach", "peak"))
    return 0.5 * (fastest.low + fastest.high)


def _check_speed(table: Manoeuvre, reached_mps: float, p: Mapping[str, Any]) -> None:
    least = _least_mps(table)
    if reached_mps < least:
        raise ParameterError(
            f"scenario: path.manoeuvre {table.name}, path.scale {p['path.scale']}: takes at least "
            f"{least:.1f} m/s over ground (ADS-33E-PRF {table.paragraph}); {reached_mps:.1f} m/s "
            f"are reached within path.speed_mps {p['path.speed_mps']:g}, path.acceleration_mps2 "
            f"{p['path.acceleration_mps2']:g} and path.jerk_mps3 {p['path.jerk_mps3']:g}"
        )


def _goal(path: FlightPath, course_rad: float, length_m: float) -> NDArray[np.float64]:
    """Where a level way in a direction ends (3,), NED, m."""
    way = np.array([math.cos(course_rad), math.sin(course_rad), 0.0])
    return np.asarray(path.pos_ned_m) + length_m * way


def _limit(path: FlightPath, speed_mps: float) -> None:
    """Fly no faster from here on."""
    speed = min(speed_mps, path.limits.speed_mps)
    path.limits = replace(path.limits, speed_mps=speed)


def _hover(path: FlightPath, table: Manoeuvre) -> None:
    """Obliquely, forward and to the right, to the hover point."""
    speed, time = _aim_mps(table), table["still_for_s"]
    _limit(path, speed)
    run_m = speed * _APPROACH_S * time + speed**2 / path.limits.acceleration_mps2
    run_m += speed * path.limits.acceleration_mps2 / path.limits.jerk_mps3
    path.go_to(_goal(path, path.psi_rad + _OBLIQUE_RAD, run_m))


def _vertical(path: FlightPath, table: Manoeuvre) -> None:
    """Up, a stay, and down."""
    first = np.asarray(path.pos_ned_m).copy()
    (top,) = (c for c in table.conditions if c.name == "top")
    path.go_to(first - np.array([0.0, 0.0, table["ascent_m"]])).stay(_PLENTY * top.low)
    path.go_to(first)


def _pirouette(path: FlightPath, table: Manoeuvre) -> None:
    """Around a centre ahead, to the left."""
    course = path.psi_rad - 0.5 * math.pi
    circle = Circle(path.pos_ned_m, course, table["radius_m"])
    path.along(circle, _aim_mps(table), 1.0, "centre")


def _slalom(path: FlightPath, table: Manoeuvre) -> None:
    """Along the nose, turning between the gates and as far beyond them as they may be missed."""
    speed = min(_aim_mps(table), path.limits.speed_mps)
    run_in = speed**2 / path.limits.acceleration_mps2
    run_in += speed * path.limits.acceleration_mps2 / path.limits.jerk_mps3
    aside = table["gate_m"] + _BEYOND * table.bounds("error").desired
    weave = Slalom(path.pos_ned_m, path.psi_rad, table["apart_m"], aside, _TURNS, run_in)
    path.along(weave, speed, 1.0, "fixed")


def _lateral_reposition(path: FlightPath, table: Manoeuvre) -> None:
    """To the right."""
    _limit(path, _aim_mps(table))
    path.go_to(_goal(path, path.psi_rad + 0.5 * math.pi, table["course_m"]))


def _depart_abort(path: FlightPath, table: Manoeuvre) -> None:
    """Along the nose."""
    _limit(path, _aim_mps(table))
    path.go_to(_goal(path, path.psi_rad, table["course_m"]))
