# SPDX-License-Identifier: Apache-2.0
"""What the law follows: the reference, begun where the aircraft is and averaged so that its
velocity has no jumps.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heli_math.arrays import copy, fill, scratch
from heli_math.jit import njit, njit_counted
from heli_math.rotations import wrap_pi
from heli_math.rows import REFERENCE, SHAPED
from heli_math.trajectory import Trajectory, reference_at

_SHAPING_SAMPLES = 32
_N_REFERENCE = REFERENCE.size
_TURN_NS = 120_000_000  # three periods of the law
_CATCH_UP = 10  # one second of a trajectory's late start is caught up in so many


@njit
def fill_offset(pos_ned_m, time_ns, times_ns, points, offset):
    """As `offset_to`, into offset (3,)."""
    now = scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, now)
    for j in range(3):
        offset[j] = pos_ned_m[j] - now[j]


@njit_counted
def offset_to(pos_ned_m, time_ns, times_ns, points):
    """Offset (3,), NED, m, from the trajectory at time_ns to a position (3,)."""
    offset = np.empty(3)
    fill_offset(pos_ned_m, time_ns, times_ns, points, offset)
    return offset


@njit
def move(points, offset_ned_m):
    """Move the positions of way points (N, 7), in place, by an offset (3,), NED, m."""
    for i in range(points.shape[0]):
        for j in range(3):
            points[i, j] += offset_ned_m[j]


def moved(way: Trajectory, offset_ned_m: NDArray[np.float64]) -> Trajectory:
    """The trajectory with all positions moved by an offset (3,), NED, m; headings stay."""
    points = way.points.copy()
    move(points, np.asarray(offset_ned_m, float))
    return replace(way, points=points)


@njit
def turn_rate_at(time_ns, times_ns, points):
    """Rate of the reference's heading just ahead of time_ns, rad/s; 0 about a step.

    The smaller of the rates over the next two stretches, 0 if they differ in sign (minmod): a
    heading that turns is in both, a step in one at most.
    """
    here, near, far = scratch(_N_REFERENCE), scratch(_N_REFERENCE), scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, here)
    reference_at(time_ns + _TURN_NS, times_ns, points, near)
    reference_at(time_ns + 2 * _TURN_NS, times_ns, points, far)
    psi = REFERENCE.psi
    first, second = wrap_pi(near[psi] - here[psi]), wrap_pi(far[psi] - near[psi])
    if first * second <= 0.0:
        return 0.0
    least = first if abs(first) < abs(second) else second
    return least / (_TURN_NS * 1e-9)


def foreseen_ns(window_ns: int) -> int:
    """From so much after now on `shaped_reference_at` does not look at the trajectory, ns."""
    return max(window_ns // 2, 2 * _TURN_NS) + 1


@njit
def shaped_reference_at(time_ns, window_ns, heading_lead_s, times_ns, points, out):
    """Reference (10,) averaged over the window about time_ns; written to out.

    A step of the reference's velocity becomes a ramp, half of it before the step, with its
    acceleration; where the reference stands or moves steadily, the average is exact. A trajectory
    may begin with a step that nobody knew of, so its first average ends at its start: half a
    window late, which is caught up a tenth faster than commanded.

    Parameters
    ----------
    time_ns, window_ns : int
        Time after the trajectory's start and length of the window; 0 for no shaping.
    heading_lead_s : float
        The heading is led by so much times its rate.
    times_ns, points : ndarray
        The trajectory.
    out : (10,) ndarray
        Position NED m, velocity NED m/s, acceleration NED m/s2, heading rad.
    """
    now = scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, now)
    pos, vel, acc = out[SHAPED.pos], out[SHAPED.vel], out[SHAPED.acc]
    copy(pos, now[REFERENCE.pos])
    copy(vel, now[REFERENCE.vel])
    fill(acc, 0.0)
    out[SHAPED.psi] = now[REFERENCE.psi] + heading_lead_s * turn_rate_at(time_ns, times_ns, points)
    if window_ns <= 0:
        return
    window_s = window_ns * 1e-9
    late_ns = max(window_ns // 2 - max(time_ns, 0) // _CATCH_UP, 0)
    pace = 1.0 + 1.0 / _CATCH_UP if late_ns > 0 and time_ns > 0 else 1.0
    end_ns = time_ns + window_ns // 2 - late_ns
    end, begin = scratch(_N_REFERENCE), scratch(_N_REFERENCE)
    reference_at(end_ns, times_ns, points, end)
    reference_at(end_ns - window_ns, times_ns, points, begin)
    pos_end, pos_begin = end[REFERENCE.pos], begin[REFERENCE.pos]
    vel_end, vel_begin = end[REFERENCE.vel], begin[REFERENCE.vel]
    for j in range(3):
        vel[j] = pace * (pos_end[j] - pos_begin[j]) / window_s
        acc[j] = pace * pace * (vel_end[j] - vel_begin[j]) / window_s
    # Mid-point rule: exact where the reference is linear, second order over a corner.
    sample, total = scratch(_N_REFERENCE), scratch(3)
    fill(total, 0.0)
    for i in range(_SHAPING_SAMPLES):
        back_ns = window_ns * (2 * i + 1) // (2 * _SHAPING_SAMPLES)
        reference_at(end_ns - back_ns, times_ns, points, sample)
        for j in range(3):
            total[j] += sample[j]
    for j in range(3):
        pos[j] = total[j] / _SHAPING_SAMPLES
