# SPDX-License-Identifier: Apache-2.0
"""Ring buffer of the observer: every sample in the slot of its time of validity (tick mod size)."""

import math

from heli_math.jit import njit
from heli_observer import layout as L
from heli_observer.arrays import copy_part, fill, fill_matrix


@njit
def _imu_usable(y, j, k):
    """Whether IMU component j of the measurement row is finite and within the sensor's range."""
    limit = k.accel_limit_mps2 if j < 3 else k.rate_limit_radps
    return abs(y[j]) <= limit


@njit
def _store_imu(state, tick, last, y, k):
    """Put the IMU sample into its slot; a component that is unusable keeps its last value."""
    imu, count = state.imu, state.count
    size = imu.shape[0]
    slot = tick % size
    complete = True
    for j in range(L.N_IMU):
        if _imu_usable(y, j, k):
            imu[slot, j] = y[j]
        else:
            imu[slot, j] = imu[last % size, j]
            count[L.C_IMU_DROPPED] += 1
            complete = False
    if complete:
        count[L.C_IMU_OK] = tick
    # ticks that never came: linear between their neighbours
    for t in range(last + 1, tick):
        part = (t - last) / (tick - last)
        for j in range(L.N_IMU):
            imu[t % size, j] = (1.0 - part) * imu[last % size, j] + part * imu[slot, j]


@njit
def store_mag_baro(state, tick, y):
    """Put magnetometer and barometer of this tick into their slot, if finite."""
    aid, count = state.aid, state.count
    row = aid[tick % aid.shape[0]]
    fill(row, 0.0)
    if y[L.Y_MAG_VALID] > 0.5:
        bad = 0
        for i in range(3):
            if not math.isfinite(y[L.Y_MAG + i]):
                bad += 1
        count[L.C_MAG_DROPPED] += bad
        if bad == 0:
            row[L.AID_MAG_VALID] = 1.0
            copy_part(row, L.AID_MAG, y, L.Y_MAG, 3)
    if y[L.Y_BARO_VALID] > 0.5:
        if math.isfinite(y[L.Y_BARO]) and y[L.Y_BARO] > 0.0:
            row[L.AID_BARO_VALID] = 1.0
            row[L.AID_BARO] = y[L.Y_BARO]
        else:
            count[L.C_BARO_DROPPED] += 1


@njit
def store_gps(state, tick, y, horizon_ticks):
    """Put a fix into the slot of its stamp; too old, in the future, not finite: count and drop."""
    if not y[L.Y_GPS_VALID] > 0.5:
        return
    aid, count = state.aid, state.count
    if not abs(y[L.Y_GPS_STAMP]) < 1e15:
        count[L.C_GPS_DROPPED] += 1
        return
    stamp = int(round(y[L.Y_GPS_STAMP]))
    if stamp > tick:
        count[L.C_GPS_FUTURE] += 1
        return
    if stamp < tick - horizon_ticks:
        count[L.C_GPS_LATE] += 1
        return
    row = aid[stamp % aid.shape[0]]
    finite = 0
    for i in range(6):
        row[L.AID_GPS + i] = y[L.Y_GPS_POS + i]
        if math.isfinite(y[L.Y_GPS_POS + i]):
            finite += 1
    count[L.C_GPS_DROPPED] += 6 - finite
    row[L.AID_GPS_VALID] = 1.0 if finite > 0 else 0.0


@njit
def _restart(state, tick, y, k):
    """Begin at this tick: fill the IMU ring with its sample. False if that is not usable."""
    fill_matrix(state.aid, 0.0)
    state.count[L.C_ALIGNED] = 0
    state.count[L.C_TICK] = L.NO_TICK
    for j in range(L.N_IMU):
        if not _imu_usable(y, j, k.ekf):
            state.count[L.C_IMU_DROPPED] += 1
            return False
    for slot in range(state.imu.shape[0]):
        copy_part(state.imu[slot], 0, y, 0, L.N_IMU)
    state.count[L.C_TICK] = tick
    state.count[L.C_IMU_OK] = tick
    return True


@njit
def take_tick(state, tick, y, k):
    """Store the IMU sample of a tick.

    Parameters
    ----------
    state : ObserverState
        In place.
    tick : int
    y : ndarray (>= 20,)
        Measurement row.
    k : ObserverKernel

    Returns
    -------
    int
        Ticks gone by since the newest one before: 1 usually, more after lost ticks (which are
        filled in), 0 for a tick that is not new or a first sample that is not usable.
    """
    count = state.count
    last = count[L.C_TICK]
    if tick <= last:
        count[L.C_TICK_REPEATED] += 1
        return 0
    if tick - last > k.max_gap_ticks:
        if last != L.NO_TICK:
            count[L.C_REALIGNED] += 1
        return 1 if _restart(state, tick, y, k) else 0
    count[L.C_TICK_GAPS] += tick - last > 1
    for t in range(last + 1, tick):
        fill(state.aid[t % state.aid.shape[0]], 0.0)
    _store_imu(state, tick, last, y, k.ekf)
    count[L.C_TICK] = tick
    return tick - last
