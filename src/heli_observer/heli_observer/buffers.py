# SPDX-License-Identifier: Apache-2.0
"""Ring buffer of the observer: every sample in the slot of its time of validity (tick mod size)."""

import math

from heli_math.arrays import copy_part, fill, fill_matrix, scratch
from heli_math.jit import njit
from heli_math.rows import IMU, MEAS
from heli_observer import layout as L

_N_IMU = L.N_IMU  # a length of what lies on the stack
SAME = 2
"""Repeats in a row from which on a sensor has stopped; one may be a message that came twice."""
HELD = 2
"""Ticks without a sample over which the last one is held."""
MEAN_TICKS = 16
"""Ticks before it over which the mean is taken."""
RATE_FADES_S = 0.2
"""Time constant with which a rate that nothing says is taken to fade: the law damps it."""


@njit
def usable_imu(y, j, k):
    """Whether component j of the IMU's sample y is finite and within the sensor's range."""
    limit = k.accel_limit_mps2 if j < IMU.rate.start else k.rate_limit_radps
    return abs(y[j]) <= limit


@njit
def _repeats(z, heard, at):
    """Whether a vector z (3,) is to the last bit what stands in `heard` at `at`; it stands there
    then. White noise never repeats itself: who does has stopped measuring.
    """
    same = True
    for i in range(3):
        same = same and z[i] == heard[at + i]
        heard[at + i] = z[i]
    return same


@njit
def judge_imu(state, sample, k):
    """Whether specific force and rate of a sample (6,) may be integrated: finite, within range,
    measured anew. No specific force at all is free fall, or a sensor that has lost its supply.
    """
    heard, count = state.heard, state.count
    again = _repeats(sample[IMU.force], heard, L.H_FORCE)
    count[L.C_FORCE_SAME] = count[L.C_FORCE_SAME] + 1 if again else 0
    again = _repeats(sample[IMU.rate], heard, L.H_RATE)
    count[L.C_RATE_SAME] = count[L.C_RATE_SAME] + 1 if again else 0
    force = count[L.C_FORCE_SAME] < SAME
    rate = count[L.C_RATE_SAME] < SAME
    fx, fy, fz = sample[0], sample[1], sample[2]
    force = force and not (fx == 0.0 and fy == 0.0 and fz == 0.0)
    for j in range(IMU.size):
        if not usable_imu(sample, j, k):
            count[L.C_IMU_DROPPED] += 1
            force = force and j >= IMU.rate.start
            rate = rate and j < IMU.rate.start
    return force, rate


@njit
def _likely(state, tick, first, end, fade, row):
    """What is likely instead of components first..end of a sample, into row, as no sensor says it.

    For `HELD` ticks the last one, and as long as samples come late; then the mean of the last ones
    that a sensor said, which vibration does not tip, times `fade`.
    """
    imu, late = state.imu, tick - state.count[L.C_IMU_LATE] <= HELD
    size, last = imu.shape[0], (tick - 1) % imu.shape[0]
    for j in range(first, end):
        row[j] = imu[last, j]
    since = 0
    while since < size - 1 and imu[(tick - 1 - since) % size, L.I_REPLACED] > 0.0:
        since += 1
    if since != HELD or since == size - 1 or late:
        # Before: held. After: what was likely once goes on, the rate fading.
        for j in range(first, end):
            row[j] *= 1.0 if since < HELD or late else fade
        return
    for j in range(first, end):
        mean, n = 0.0, 0
        for back in range(since, min(since + MEAN_TICKS, size - 1)):
            slot = (tick - 1 - back) % size
            if imu[slot, L.I_REPLACED] == 0.0:
                mean += imu[slot, j]
                n += 1
        row[j] = fade * mean / n if n > 0 else row[j]


@njit
def replaced_for_long(imu, tick):
    """Whether what was integrated up to a tick is more than a last sample that is held."""
    for back in range(HELD + 1):
        if imu[(tick - back) % imu.shape[0], L.I_REPLACED] == 0.0:
            return False
    return True


@njit
def _store_imu(state, tick, last, sample, k):
    """Put the IMU sample into its slot; what of it is not believed becomes what is likely."""
    imu, count = state.imu, state.count
    size = imu.shape[0]
    slot = tick % size
    force, rate = judge_imu(state, sample, k)
    row = scratch(_N_IMU)
    copy_part(row, 0, sample, 0, IMU.size)
    if not force:
        _likely(state, last + 1, 0, 3, 1.0, row)
    if not rate:
        _likely(state, last + 1, 3, 6, math.exp(-k.dt_s / RATE_FADES_S), row)
    believed = force and rate
    row[L.I_REPLACED] = 0.0 if believed else 1.0
    copy_part(imu[slot], 0, row, 0, L.N_IMU)
    if believed:
        count[L.C_IMU_OK] = tick
    else:
        count[L.C_IMU_REPLACED] += 1
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
def _leave_repeated(state, z, at, same, row, place):
    """Leave a part of a fix, z (3,), out of its row from its third time on; how much was left out.

    A stuck receiver says again what it said last; with noise in it that does not happen.
    """
    count = state.count
    if not _repeats(z, state.heard, at):
        count[same] = 0
        return 0
    count[same] += 1
    if count[same] < SAME:
        return 0
    count[L.C_GPS_REPEATED] += 1
    for i in range(3):
        row[place + i] = math.nan
    return 3


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
    finite -= _leave_repeated(state, pos, L.H_GPS_POS, L.C_GPS_POS_SAME, row, L.AID_GPS_POS)
    finite -= _leave_repeated(state, vel, L.H_GPS_VEL, L.C_GPS_VEL_SAME, row, L.AID_GPS_VEL)
    row[L.AID_GPS_VALID] = 1.0 if finite > 0 else 0.0


@njit
def _restart(state, tick, sample, k):
    """Begin at this tick: fill the IMU ring with its sample. False if that is not usable."""
    fill_matrix(state.aid, 0.0)
    state.count[L.C_ALIGNED] = 0
    state.count[L.C_TICK] = L.NO_TICK
    for j in range(IMU.size):
        if not usable_imu(sample, j, k.ekf):
            state.count[L.C_IMU_DROPPED] += 1
            return False
    for slot in range(state.imu.shape[0]):
        copy_part(state.imu[slot], 0, sample, 0, IMU.size)
        state.imu[slot, L.I_REPLACED] = 0.0
    state.count[L.C_TICK] = tick
    state.count[L.C_BEGUN] = tick
    state.count[L.C_IMU_OK] = tick
    return True


@njit
def take_tick(state, tick, sample, k):
    """Store the IMU sample of a tick.

    Parameters
    ----------
    state : ObserverState
        In place.
    tick : int
    sample : ndarray (6,)
        Places of `rows.IMU`.
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
        return 1 if _restart(state, tick, sample, k) else 0
    count[L.C_TICK_GAPS] += tick - last > 1
    for t in range(last + 1, tick):
        fill(state.aid[t % state.aid.shape[0]], 0.0)
    _store_imu(state, tick, last, sample, k.ekf)
    count[L.C_TICK] = tick
    return tick - last
