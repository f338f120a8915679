# SPDX-License-Identifier: Apache-2.0
"""Ring buffer of the observer: every sample in the slot of its time of validity (tick mod size)."""

import math

from heli_math.arrays import copy_part, fill, fill_matrix
from heli_math.jit import njit
from heli_math.rows import IMU, MEAS
from heli_observer import layout as L


@njit
def _imu_usable(y, j, k):
    """Whether component j of the IMU's sample y is finite and within the sensor's range."""
    limit = k.accel_limit_mps2 if j < IMU.rate.start else k.rate_limit_radps
    return abs(y[j]) <= limit


@njit
def _store_imu(state, tick, last, sample, k):
    """Put the IMU sample into its slot; a component that is unusable keeps its last value."""
    imu, count = state.imu, state.count
    size = imu.shape[0]
    slot = tick % size
    complete = True
    for j in range(IMU.size):
        if _imu_usable(sample, j, k):
            imu[slot, j] = sample[j]
        else:
            imu[slot, j] = imu[last % size, j]
            count[L.C_IMU_DROPPED] += 1
            complete = False
    if complete:
        count[L.C_IMU_OK] = tick
    # ticks that never came: linear between their neighbours
    for t in range(last + 1, tick):
        part = (t - last) / (tick - last)
        for j in range(IMU.size):
            imu[t % size, j] = (1.0 - part) * imu[last % size, j] + part * imu[slot, j]


@njit
def store_mag_baro(state, tick, y):
    """Put magnetometer and barometer of this tick into their slot, if finite."""
    aid, count = state.aid, state.count
    row = aid[tick % aid.shape[0]]
    fill(row, 0.0)
    if y[MEAS.mag_valid] > 0.5:
        mag, bad = y[MEAS.mag], 0
        for i in range(3):
            if not math.isfinite(mag[i]):
                bad += 1
        count[L.C_MAG_DROPPED] += bad
        if bad == 0:
            row[L.AID_MAG_VALID] = 1.0
            copy_part(row, L.AID_MAG, mag, 0, 3)
    if y[MEAS.baro_valid] > 0.5:
        if math.isfinite(y[MEAS.baro]) and y[MEAS.baro] > 0.0:
            row[L.AID_BARO_VALID] = 1.0
            row[L.AID_BARO] = y[MEAS.baro]
        else:
            count[L.C_BARO_DROPPED] += 1


@njit
def store_gps(state, tick, y, horizon_ticks):
    """Put a fix into the slot of its stamp; too old, in the future, not finite: count and drop."""
    if not y[MEAS.gps_valid] > 0.5:
        return
    aid, count = state.aid, state.count
    if not abs(y[MEAS.gps_tick]) < 1e15:
        count[L.C_GPS_DROPPED] += 1
        return
    stamp = int(round(y[MEAS.gps_tick]))
    if stamp > tick:
        count[L.C_GPS_FUTURE] += 1
        return
    if stamp < tick - horizon_ticks:
        count[L.C_GPS_LATE] += 1
        return
    row = aid[stamp % aid.shape[0]]
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    copy_part(row, L.AID_GPS_POS, pos, 0, 3)
    copy_part(row, L.AID_GPS_VEL, vel, 0, 3)
    finite = 0
    for i in range(3):
        finite += int(math.isfinite(pos[i])) + int(math.isfinite(vel[i]))
    count[L.C_GPS_DROPPED] += pos.size + vel.size - finite
    row[L.AID_GPS_VALID] = 1.0 if finite > 0 else 0.0


@njit
def _restart(state, tick, sample, k):
    """Begin at this tick: fill the IMU ring with its sample. False if that is not usable."""
    fill_matrix(state.aid, 0.0)
    state.count[L.C_ALIGNED] = 0
    state.count[L.C_TICK] = L.NO_TICK
    for j in range(IMU.size):
        if not _imu_usable(sample, j, k.ekf):
            state.count[L.C_IMU_DROPPED] += 1
            return False
    for slot in range(state.imu.shape[0]):
        copy_part(state.imu[slot], 0, sample, 0, IMU.size)
    state.count[L.C_TICK] = tick
    state.count[L.C_BEGUN] = tick
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
        return 1 if _restart(state, tick, y[MEAS.imu], k) else 0
    count[L.C_TICK_GAPS] += tick - last > 1
    for t in range(last + 1, tick):
        fill(state.aid[t % state.aid.shape[0]], 0.0)
    _store_imu(state, tick, last, y[MEAS.imu], k.ekf)
    count[L.C_TICK] = tick
    return tick - last
