# SPDX-License-Identifier: Apache-2.0
"""Another goal in mid-way: a trajectory is left without a jump, and ends elsewhere."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_guidance.errors import Cause, PathError
from heli_guidance.flight_path import STEP_S, FlightPath
from heli_guidance.limits import MotionLimits
from heli_math.rotations import wrap_pi
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import MAX_POINTS, Trajectory

Array = NDArray[np.float64]

_STEP_NS = round(STEP_S * NS_PER_S)
_NEAR_M = 1.0
"""Closer than this no direction to the goal is taken."""


@dataclass(frozen=True)
class Goal:
    """Where to go.

    Attributes
    ----------
    pos_ned_m : (3,) array
    psi_rad : float or None
        Heading there, 0 is north; None: the one at which the old way is left.
    facing : bool
        The nose turns to the goal on the way, and to `psi_rad` there; else on the way.
    """

    pos_ned_m: Array
    psi_rad: float | None = None
    facing: bool = False


@dataclass(frozen=True)
class Cruise:
    """How to go on for a time, s; then it halts.

    Attributes
    ----------
    vel_ned_mps : (3,) array
    psi_rate_radps : float
    duration_s : float
        The change to it included.
    """

    vel_ned_mps: Array
    psi_rate_radps: float
    duration_s: float


def divert(
    before: Trajectory,
    leave_ns: int,
    past_ns: int,
    goal: Goal | Cruise | None,
    limits: MotionLimits,
) -> Trajectory:
    """A trajectory up to a moment, from there to a goal, at a velocity, or to a halt.

    It is left with the position, velocity and acceleration that it has then (differences over
    `STEP_S`, exact at way points so far apart), and so is its heading. An acceleration beyond the
    limits, as at a corner, is brought down to them.

    Parameters
    ----------
    before : Trajectory
    leave_ns : int
        Stamp from which on it changes; up to `STEP_S` later if there it has a way point.
    past_ns : int
        What is older than so much before that is dropped.
    goal : Goal or Cruise or None
        None: stop as soon as the limits allow.
    limits : MotionLimits

    Returns
    -------
    Trajectory
        Stamped as `before`, so times count from the same moment.

    Raises
    ------
    PathError
        A number is not finite, the motion cannot be brought within the limits, or it takes too
        many way points.
    """
    times_ns = before.times_ns
    at_ns = _way_point_near(times_ns, leave_ns - before.start_ns)
    path = _path_from(before, before.start_ns + at_ns, limits)
    if goal is None:
        path.stop()
    elif isinstance(goal, Cruise):
        path.cruise(goal.vel_ned_mps, goal.psi_rate_radps, goal.duration_s).stop()
    else:
        _fly_to(path, goal)
    leg = path.trajectory()
    first = max(int(np.searchsorted(times_ns, at_ns - past_ns, side="right")) - 1, 0)
    kept = slice(first, int(np.searchsorted(times_ns, at_ns)))
    points = np.concatenate([before.points[kept], leg.points])
    if len(points) > MAX_POINTS:
        raise PathError(
            Cause.TOO_LONG,
            f"{len(points)} way points for {path.duration_s:.0f} s and what went before; allowed: "
            f"{MAX_POINTS}",
        )
    return Trajectory(
        before.start_ns, np.concatenate([times_ns[kept], at_ns + leg.times_ns]), points
    )


def _fly_to(path: FlightPath, goal: Goal) -> None:
    north, east = (np.asarray(goal.pos_ned_m, float) - path.pos_ned_m)[:2]
    last_psi = path.psi_rad if goal.psi_rad is None else goal.psi_rad
    if goal.facing and np.hypot(north, east) > _NEAR_M:
        path.go_to(goal.pos_ned_m, math.atan2(east, north)).turn_to(last_psi)
    else:
        path.go_to(goal.pos_ned_m, last_psi)


def _way_point_near(times_ns: NDArray[np.int64], leave_ns: int) -> int:
    """Time of the next way point if it comes soon, where differences are exact; else as given."""
    following = times_ns[np.searchsorted(times_ns, leave_ns) :]
    soon = following.size > 0 and following[0] - leave_ns < _STEP_NS
    return int(following[0]) if soon else leave_ns


def _path_from(before: Trajectory, at_ns: int, limits: MotionLimits) -> FlightPath:
    """A path that goes on as a trajectory moves at a stamp, ns."""
    rows = np.array([before.at(at_ns + step * _STEP_NS) for step in (-1, 0, 1)])
    pos, psi = rows[:, REFERENCE.pos], rows[:, REFERENCE.psi]
    behind, ahead = np.diff(pos, axis=0) / STEP_S
    acc = (ahead - behind) / STEP_S
    size = float(np.linalg.norm(acc))
    if size > limits.acceleration_mps2:
        acc *= limits.acceleration_mps2 / size
    turn_behind, turn_ahead = (wrap_pi(step) / STEP_S for step in np.diff(psi))
    # A step of the heading is on one side only: no rate.
    turns = turn_behind * turn_ahead > 0.0
    rate = 0.5 * (turn_behind + turn_ahead) if turns else 0.0
    turn_acc = (turn_ahead - turn_behind) / STEP_S if turns else 0.0
    most, most_acc = limits.yaw_rate_radps, limits.yaw_acceleration_radps2
    return FlightPath(
        pos[1],
        float(psi[1]),
        limits,
        0.5 * (behind + ahead),
        acc,
        min(max(rate, -most), most),
        min(max(turn_acc, -most_acc), most_acc),
    )
