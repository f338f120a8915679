# SPDX-License-Identifier: Apache-2.0
"""What the law follows: the reference, begun where the aircraft is and averaged so that its
velocity has no jumps.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heli_math.jit import njit
from heli_math.rows import REFERENCE, SHAPED
from heli_math.trajectory import Trajectory, reference_at

_SHAPING_SAMPLES = 32


@njit
def offset_to(pos_ned_m, time_ns, times_ns, points):
    """Offset (3,), NED, m, from the trajectory at time_ns to a position (3,)."""
    now = np.empty(REFERENCE.size)
    reference_at(time_ns, times_ns, points, now)
    offset = np.empty(3)
    for j in range(3):
        offset[j] = pos_ned_m[j] - now[j]
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
def shaped_reference_at(time_ns, window_ns, times_ns, points, out):
    """Reference (10,) averaged over the window that ends at time_ns; written to out.

    A step of the reference's velocity becomes a ramp over the window, with its acceleration, and
    the aircraft arrives where the reference stops without overshoot: the average is exact there.

    Parameters
    ----------
    time_ns, window_ns : int
        Time after the trajectory's start and length of the window; 0 for no shaping.
    times_ns, points : ndarray
        The trajectory.
    out : (10,) ndarray
        Position NED m, velocity NED m/s, acceleration NED m/s2, heading rad.
    """
    now = np.empty(REFERENCE.size)
    reference_at(time_ns, times_ns, points, now)
    out[SHAPED.pos], out[SHAPED.vel] = now[REFERENCE.pos], now[REFERENCE.vel]
    out[SHAPED.acc] = 0.0
    out[SHAPED.psi] = now[REFERENCE.psi]
    if window_ns <= 0:
        return
    window_s = window_ns * 1e-9
    before = np.empty(REFERENCE.size)
    reference_at(time_ns - window_ns, times_ns, points, before)
    pos, vel, acc = out[SHAPED.pos], out[SHAPED.vel], out[SHAPED.acc]
    pos_now, pos_before = now[REFERENCE.pos], before[REFERENCE.pos]
    vel_now, vel_before = now[REFERENCE.vel], before[REFERENCE.vel]
    for j in range(3):
        vel[j] = (pos_now[j] - pos_before[j]) / window_s
        acc[j] = (vel_now[j] - vel_before[j]) / window_s
    # Mid-point rule: exact where the reference is linear, second order over a corner.
    sample = np.empty(REFERENCE.size)
    total = np.zeros(3)
    for i in range(_SHAPING_SAMPLES):
        back_ns = window_ns * (2 * i + 1) // (2 * _SHAPING_SAMPLES)
        reference_at(time_ns - back_ns, times_ns, points, sample)
        total += sample[REFERENCE.pos]
    for j in range(3):
        pos[j] = total[j] / _SHAPING_SAMPLES
