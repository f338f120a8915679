# SPDX-License-Identifier: Apache-2.0
"""Samples that come late or not at all, put into the ring buffers before the filter reads them."""

import math

from heli_math.arrays import copy_part, fill, scratch
from heli_math.jit import njit
from heli_math.rows import IMU, MEAS
from heli_observer import layout as L
from heli_observer.buffers import judge_imu

_N_IMU = L.N_IMU  # a length of what lies on the stack
BRIDGED, BRIDGE_FROM = 6, 5
"""Longest gap, ticks, over which the filter takes a straight line; samples on each side of it."""
LATE_S = 0.2
"""By so much a fix may be older than the filter's horizon, s."""


@njit
def _side(imu, tick, step, newest, row):
    """Mean of the next samples that a sensor said from a tick on, going by step, into row (7,).

    Returns
    -------
    count, middle, force, rate
        How many, their mean tick, and how they scatter: sums of squares about the mean, all axes.
    """
    size, n, middle, force, rate = imu.shape[0], 0, 0.0, 0.0, 0.0
    nearest = scratch(_N_IMU)
    fill(row, 0.0)
    for back in range(2 * BRIDGE_FROM):
        t = tick + step * back
        if n == BRIDGE_FROM or t > newest or t <= newest - size:
            break
        sample = imu[t % size]
        if sample[L.I_REPLACED] > 0.0:
            continue
        if n == 0:
            copy_part(nearest, 0, sample, 0, IMU.size)
        n += 1
        middle += t
        for j in range(IMU.size):
            off = sample[j] - nearest[j]
            row[j] += off
            if j < IMU.rate.start:
                force += off * off
            else:
                rate += off * off
    if n == 0:
        return 0, 0.0, 0.0, 0.0
    for j in range(IMU.size):
        off = row[j] / n
        row[j] = nearest[j] + off
        if j < IMU.rate.start:
            force -= n * off * off
        else:
            rate -= n * off * off
    return n, middle / n, max(force, 0.0), max(rate, 0.0)


@njit
def bridge(imu, tick, newest, dt_s, P):
    """Put into the slot of a tick that no sensor said, in a short gap, what both its sides say.

    Between the mean of the samples before and that of those behind on a straight line: vibration,
    which a held sample repeats at a wrong phase, is left out. What that costs by the scatter of
    these samples is added to P (20, 20), in place.

    Parameters
    ----------
    imu : (slots, 7) array
        Ring of samples, in place.
    tick, newest : int
        That of the slot; the newest one in the ring.
    dt_s : float
    P : (20, 20) array

    Returns
    -------
    bool
        False where there was nothing to do, or the gap is too long.
    """
    size = imu.shape[0]
    if imu[tick % size, L.I_REPLACED] == 0.0:
        return False
    first = last = tick
    while first > tick - BRIDGED and imu[(first - 1) % size, L.I_REPLACED] > 0.0:
        first -= 1
    while last < min(newest, tick + BRIDGED) and imu[(last + 1) % size, L.I_REPLACED] > 0.0:
        last += 1
    if last - first + 1 > BRIDGED or last == newest:
        return False
    before, after = scratch(_N_IMU), scratch(_N_IMU)
    n, t0, force, rate = _side(imu, first - 1, -1, newest, before)
    m, t1, force_after, rate_after = _side(imu, last + 1, 1, newest, after)
    if min(n, m) == 0 or n + m < 3:
        return False
    part = (tick - t0) / (t1 - t0)
    for j in range(IMU.size):
        imu[tick % size, j] = before[j] + part * (after[j] - before[j])
    share = dt_s * dt_s / (3.0 * (n + m - 2))
    for i in range(3):
        P[L.E_VEL + i, L.E_VEL + i] += share * (force + force_after)
        P[L.E_ATT + i, L.E_ATT + i] += share * (rate + rate_after)
    return True


@njit
def _mend_imu(state, stamp, sample, k):
    """Put a sample (6,) that came late into its slot, and hold it on until now.

    The filter, at its horizon, then reads it as if it had come in time.
    """
    imu, count = state.imu, state.count
    size, now = imu.shape[0], count[L.C_TICK]
    slot = stamp % size
    if not now - k.horizon_ticks < stamp <= now or stamp <= count[L.C_BEGUN]:
        return
    force, rate = judge_imu(state, sample, k.ekf)
    if not (force and rate) or imu[slot, L.I_REPLACED] == 0.0:
        return
    copy_part(imu[slot], 0, sample, 0, IMU.size)
    imu[slot, L.I_REPLACED] = 0.0
    for t in range(stamp + 1, now + 1):
        if imu[t % size, L.I_REPLACED] == 0.0:
            break
        copy_part(imu[t % size], 0, sample, 0, IMU.size)
    count[L.C_IMU_OK] = max(count[L.C_IMU_OK], stamp)
    count[L.C_IMU_LATE] = now + 1
    count[L.C_IMU_MENDED] += 1


@njit
def hear_imu(state, tick, stamp, sample, k, y):
    """Take an IMU's sample, of this tick or of an earlier one, before `observe`.

    Parameters
    ----------
    state : ObserverState
        In place.
    tick, stamp : int
        The next one of `observe`; that of the sample.
    sample : (6,) array
        Places of `rows.IMU`.
    k : ObserverKernel
    y : (>= 20,) array
        Measurement row of the tick; its IMU is written, NaN for a sample of an earlier tick.
    """
    if stamp == tick or state.count[L.C_TICK] == L.NO_TICK:
        copy_part(y, MEAS.imu.start, sample, 0, IMU.size)
        return
    fill(y[MEAS.imu], math.nan)
    _mend_imu(state, stamp, sample, k)


@njit
def hear_fix(tick, k, y):
    """Bring a fix of a measurement row y that came too late for the filter to its horizon.

    By its own velocity, over `LATE_S` at most; one that has none stays too late.
    """
    horizon = tick - k.horizon_ticks
    late = horizon - y[MEAS.gps_tick]
    if y[MEAS.gps_valid] > 0.5 and 0.0 < late <= LATE_S / k.ekf.dt_s:
        pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
        if math.isfinite(vel[0] + vel[1] + vel[2]):
            for i in range(pos.shape[0]):
                pos[i] += late * k.ekf.dt_s * vel[i]
            y[MEAS.gps_tick] = float(horizon)
