# SPDX-License-Identifier: Apache-2.0
"""Tilt and biases solved again over the last seconds, where the inertial sensors are doubted.

A bias that jumps shows only after a while, as tilt that has grown and as velocity that grew with
it: three errors that belong together. Widening each for itself lets the next fixes share them out
wrongly, and far too much of it. So the filter keeps what it knew at each of the last fixes, and all
that it took since; when doubted it goes back to before the first refusal and takes the same samples
and fixes again, once with gyro biases that may have jumped, once with those of the accelerometers,
once with the attitude itself: two do not fail at once, and all together explain anything. What
surprised least on the way is believed, and with it the tilt and velocity that follow from it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.arrays import copy_matrix, copy_part, fill
from heli_math.jit import njit
from heli_observer import layout as L
from heli_observer.buffers import replaced_for_long
from heli_observer.doubt import ACCEL_MPS2, ATT_RAD, GYRO_RADPS, widen
from heli_observer.ins_ekf import fuse_baro, fuse_gps, fuse_mag, predict

MOST = 30.0
"""Of one innovation squared that counts."""
HANDICAP = 60.0
"""Of a tilt from nowhere: it explains a bias, too, until that tilts it again."""
FIXES = 32
"""So many fixes back at most."""
TICKS = 700
"""And so many ticks."""
BEFORE_S = 1.0
"""The jump may have been so long before the first refusal: the gate sees a velocity error late,
as it grows with the square of that time."""


class Window(NamedTuple):
    """What the filter took lately, slot = tick mod TICKS, and what it knew at its last fixes."""

    imu: NDArray[np.float64]  # (TICKS, 7) as the ring of the observer
    aid: NDArray[np.float64]  # (TICKS, 13)
    nominal: NDArray[np.float64]  # (FIXES + 1, 21) and one to spare
    P: NDArray[np.float64]  # (FIXES + 1, 20, 20)
    tick: NDArray[np.int64]  # (FIXES + 1,) of these, NO_TICK: none; then the newest one's place


def empty_window() -> Window:
    """Nothing was taken yet."""
    tick = np.full(FIXES + 1, L.NO_TICK, dtype=np.int64)
    tick[FIXES] = 0
    return Window(
        np.zeros((TICKS, L.N_IMU)),
        np.zeros((TICKS, L.N_AID)),
        np.zeros((FIXES + 1, L.N_NOMINAL)),
        np.zeros((FIXES + 1, L.N_ERROR, L.N_ERROR)),
        tick,
    )


@njit
def forget(window):
    """What was taken so far no longer leads to what the filter knows."""
    for slot in range(FIXES):
        window.tick[slot] = L.NO_TICK


@njit
def remember(state, horizon, sample, aid):
    """Keep what the filter takes at its horizon; what it knows, too, where a fix (aid row) is."""
    window = state.window
    copy_part(window.imu[horizon % TICKS], 0, sample, 0, L.N_IMU)
    copy_part(window.aid[horizon % TICKS], 0, aid, 0, L.N_AID)
    if aid[L.AID_GPS_VALID] > 0.0:
        newest = (window.tick[FIXES] + 1) % FIXES
        copy_part(window.nominal[newest], 0, state.nominal, 0, L.N_NOMINAL)
        copy_matrix(window.P[newest], state.P)
        window.tick[newest], window.tick[FIXES] = horizon, newest


@njit
def from_where(window, horizon, wanted):
    """Place of the newest knowledge that is not after a tick; else of the oldest, else -1."""
    best, oldest = -1, -1
    for slot in range(FIXES):
        tick = window.tick[slot]
        if tick == L.NO_TICK or horizon - tick >= TICKS:
            continue
        if oldest < 0 or tick < window.tick[oldest]:
            oldest = slot
        if tick <= wanted and (best < 0 or tick > window.tick[best]):
            best = slot
    return best if best >= 0 else oldest


@njit
def _take_again(state, row, k):
    """Fuse what the filter took at a tick (aid row), each by its gate; innovations squared."""
    x, P, trial, dx, diag = state.nominal, state.P, state.trial, state.dx, state.diag
    surprise = 0.0
    if row[L.AID_GPS_VALID] > 0.0:
        _, velocity = fuse_gps(x, P, trial, dx, diag, row, k)
        surprise += min(diag[L.D_NIS_VEL], MOST) if velocity >= 0 else 0.0
    if row[L.AID_BARO_VALID] > 0.0:
        fuse_baro(x, P, trial, dx, diag, row, k)
    if row[L.AID_MAG_VALID] > 0.0:
        diag[L.D_NIS_MAG] = 0.0  # stays so where the field is none
        fuse_mag(x, P, trial, dx, diag, row, k)
        surprise += min(diag[L.D_NIS_MAG], MOST)
    return surprise


@njit
def _from_there(state, slot, refused, horizon, at, sigma, k):
    """Take all again from a fix on, three errors from `at` on wandering until the refusal.

    Returns the sum of what surprised on the way: normalised innovations squared.
    """
    window, x, P = state.window, state.nominal, state.P
    first = window.tick[slot]
    copy_part(x, 0, window.nominal[slot], 0, L.N_NOMINAL)
    copy_matrix(P, window.P[slot])
    fill(state.dx[0], 0.0)
    steps, surprise = max(refused - first, 1), 0.0
    for tick in range(first, horizon + 1):
        if tick > first:
            predict(x, P, window.imu[(tick - 1) % TICKS], window.imu[tick % TICKS], k)
            if replaced_for_long(window.imu, tick):
                widen(P, k.dt_s)
        if tick < first + steps:
            for i in range(at, at + 3):
                P[i, i] += sigma * sigma / steps
        surprise += _take_again(state, window.aid[tick % TICKS], k)
    return surprise


@njit
def take_again_from(state, slot, horizon, k):
    """Take all again from a fix on, as it was taken; nominal and P in place."""
    _from_there(state, slot, 0, horizon, 0, 0.0, k)


@njit
def solve_again(state, horizon, k):
    """Take the last seconds again with biases that may have jumped; nominal and P in place.

    Parameters
    ----------
    state : ObserverState
        A line through refused velocities is in `heard` (`doubt.refuse`).
    horizon : int
        Tick that the filter is at, its fix among what is taken again.
    k : EkfKernel
    """
    window, count, x, P = state.window, state.count, state.nominal, state.P
    count[L.C_IMU_DOUBTS] += 1
    count[L.C_GPS_OFFSET] = 0
    count[L.C_GPS_GROWS] = 0
    refused = int(round(state.heard[L.H_FIT_BEGAN] / k.dt_s))
    slot = from_where(window, horizon, refused - int(round(BEFORE_S / k.dt_s)))
    if slot < 0:
        return
    least = math.inf
    for at, sigma, handicap in (
        (L.E_GYRO_BIAS, GYRO_RADPS, 0.0),
        (L.E_ACCEL_BIAS, ACCEL_MPS2, 0.0),
        (L.E_ATT, ATT_RAD, HANDICAP),
    ):
        surprise = handicap + _from_there(state, slot, refused, horizon, at, sigma, k)
        if surprise < least:
            least = surprise
            copy_part(window.nominal[FIXES], 0, x, 0, L.N_NOMINAL)
            copy_matrix(window.P[FIXES], P)
    copy_part(x, 0, window.nominal[FIXES], 0, L.N_NOMINAL)
    copy_matrix(P, window.P[FIXES])
    # What was kept belongs to what was believed before.
    forget(window)
