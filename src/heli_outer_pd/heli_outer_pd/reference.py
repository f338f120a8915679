# SPDX-License-Identifier: Apache-2.0
"""What the law follows: the reference, averaged so that its velocity has no jumps."""

import numpy as np

from heli_math.jit import njit
from heli_math.rows import REFERENCE, SHAPED
from heli_math.trajectory import reference_at

_SHAPING_SAMPLES = 32


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
