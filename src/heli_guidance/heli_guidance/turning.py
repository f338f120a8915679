# SPDX-License-Identifier: Apache-2.0
"""A turn of the nose put into a trajectory: the same places, another heading from then on."""

import math

import numpy as np
from numpy.typing import NDArray

from heli_guidance.errors import Cause, PathError
from heli_guidance.flight_path import STEP_S
from heli_guidance.limits import MotionLimits
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import MAX_POINTS, Trajectory

Array = NDArray[np.float64]

_STEP_NS = round(STEP_S * NS_PER_S)


def turn_duration_s(angle_rad: float, limits: MotionLimits) -> float:
    """How long `turned` takes: the cubic's largest rate is 3/2 angle/T, its acceleration 6 a/T^2.

    Parameters
    ----------
    angle_rad : float
    limits : MotionLimits
        Rate and acceleration of the heading.
    """
    size = abs(angle_rad)
    by_rate = 1.5 * size / limits.yaw_rate_radps
    return max(by_rate, math.sqrt(6.0 * size / limits.yaw_acceleration_radps2))


def turned(
    way: Trajectory, leave_ns: int, past_ns: int, angle_rad: float, limits: MotionLimits
) -> Trajectory:
    """A trajectory with the heading turned by an angle from a moment on, smoothly (3 s^2 - 2 s^3).

    Parameters
    ----------
    way : Trajectory
    leave_ns : int
        Stamp at which the turn begins.
    past_ns : int
        What is older than so much before that is dropped.
    angle_rad : float
        To the right.
    limits : MotionLimits

    Returns
    -------
    Trajectory
        Stamped as `way`.

    Raises
    ------
    PathError
        The angle is not finite, or it takes too many way points.
    """
    if not math.isfinite(angle_rad):
        raise PathError(Cause.NOT_FINITE, f"a turn by {angle_rad}: not finite")
    begins_ns = leave_ns - way.start_ns
    lasts_ns = max(round(turn_duration_s(angle_rad, limits) * NS_PER_S), 1)
    steps = begins_ns + np.arange(-(-lasts_ns // _STEP_NS) + 1, dtype=np.int64) * _STEP_NS
    first = max(int(np.searchsorted(way.times_ns, begins_ns - past_ns, side="right")) - 1, 0)
    times_ns = np.union1d(way.times_ns[first:], steps)
    if times_ns.size > MAX_POINTS:
        raise PathError(Cause.TOO_LONG, f"{times_ns.size} way points; allowed: {MAX_POINTS}")
    points = np.array([way.at(way.start_ns + int(time_ns)) for time_ns in times_ns])
    share = np.clip((times_ns - begins_ns) / lasts_ns, 0.0, 1.0)
    points[:, REFERENCE.psi] += angle_rad * share**2 * (3.0 - 2.0 * share)
    return Trajectory(way.start_ns, times_ns, points)
