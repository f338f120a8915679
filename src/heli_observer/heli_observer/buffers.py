# SPDX-License-Identifier: Apache-2.0
"""Ring buffer of the observer: every sample in the slot of its time of validity (tick mod size)."""

import math

from heli_core.jit import copy_part, fill, fill_matrix, njit, scratch, scratch_matrix
from heli_core.rotations import fill_from_rotvec, fill_product, fill_R_nb
from heli_core.rows import IMU, MEAS
from heli_observer import layout as L
from heli_observer.ekf import leave_arm

# -------------------------------------------------------------------------------------------------
# Buffers.
# -------------------------------------------------------------------------------------------------

_N_IMU = L.RING.size  # a length of what lies on the stack
SAME = 2
"""Repeats in a row from which on a sensor has stopped; one may be a message that came twice."""
HELD = 2
"""Ticks without a sample over which the last one is held."""
MEAN_TICKS = 16
"""Ticks before it over which the mean is taken."""
RATE_FADES_S = 0.2
"""Time constant with which a rate that nothing says is taken to fade: the controller damps it."""


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
    again = _repeats(sample[IMU.force], heard, L.HEARD.force)
    count[L.COUNT.force_same] = count[L.COUNT.force_same] + 1 if again else 0
    again = _repeats(sample[IMU.rate], heard, L.HEARD.rate)
    count[L.COUNT.rate_same] = count[L.COUNT.rate_same] + 1 if again else 0
    force = count[L.COUNT.force_same] < SAME
    rate = count[L.COUNT.rate_same] < SAME
    fx, fy, fz = sample[0], sample[1], sample[2]
    force = force and not (fx == 0.0 and fy == 0.0 and fz == 0.0)
    for j in range(IMU.size):
        if not usable_imu(sample, j, k):
            count[L.COUNT.imu_dropped] += 1
            force = force and j >= IMU.rate.start
            rate = rate and j < IMU.rate.start
    return force, rate


@njit
def _likely(state, tick, first, end, fade, row):
    """What is likely instead of components first..end of a sample, into row, as no sensor says it.

    For `HELD` ticks the last one, and as long as samples come late; then the mean of the last ones
    that a sensor said, which vibration does not tip, times `fade`.
    """
    imu, late = state.imu, tick - state.count[L.COUNT.imu_late] <= HELD
    size, last = imu.shape[0], (tick - 1) % imu.shape[0]
    for j in range(first, end):
        row[j] = imu[last, j]
    since = 0
    while since < size - 1 and imu[(tick - 1 - since) % size, L.RING.replaced] > 0.0:
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
            if imu[slot, L.RING.replaced] == 0.0:
                mean += imu[slot, j]
                n += 1
        row[j] = fade * mean / n if n > 0 else row[j]


@njit
def replaced_for_long(imu, tick):
    """Whether what was integrated up to a tick is more than a last sample that is held."""
    for back in range(HELD + 1):
        if imu[(tick - back) % imu.shape[0], L.RING.replaced] == 0.0:
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
    row[L.RING.replaced] = 0.0 if believed else 1.0
    copy_part(imu[slot], 0, row, 0, L.RING.size)
    if believed:
        count[L.COUNT.imu_ok] = tick
    else:
        count[L.COUNT.imu_replaced] += 1
    # ticks that never came: linear between their neighbours
    for t in range(last + 1, tick):
        part = (t - last) / (tick - last)
        for j in range(L.RING.size):
            imu[t % size, j] = (1.0 - part) * imu[last % size, j] + part * imu[slot, j]


@njit
def store_aids(state, tick, y):
    """Put the samples of this tick's aids into their slot, if they are numbers to believe."""
    aid, count = state.aid, state.count
    row = aid[tick % aid.shape[0]]
    fill(row, 0.0)
    for which in range(len(L.AID_PLACES)):
        at = L.AID_PLACES[which]
        if not y[at.arrived] > 0.5:
            continue
        bad = 0
        for i in range(at.first, at.first + at.numbers):
            if not (math.isfinite(y[i]) and y[i] > at.above):
                bad += 1
        count[at.dropped] += bad
        if bad == 0:
            row[at.valid] = 1.0
            copy_part(row, at.slot, y, at.first, at.numbers)


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
    count[L.COUNT.gps_repeated] += 1
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
        count[L.COUNT.gps_dropped] += 1
        return
    stamp = int(round(y[MEAS.gps_tick]))
    if stamp > tick:
        count[L.COUNT.gps_future] += 1
        return
    if stamp < tick - horizon_ticks:
        count[L.COUNT.gps_late] += 1
        return
    row = aid[stamp % aid.shape[0]]
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    copy_part(row, L.AID.gps_pos, pos, 0, 3)
    copy_part(row, L.AID.gps_vel, vel, 0, 3)
    row[L.AID.gps_at_imu] = 0.0
    finite = 0
    for i in range(3):
        finite += int(math.isfinite(pos[i])) + int(math.isfinite(vel[i]))
    count[L.COUNT.gps_dropped] += pos.size + vel.size - finite
    finite -= _leave_repeated(state, pos, L.HEARD.gps_pos, L.COUNT.gps_pos_same, row, L.AID.gps_pos)
    finite -= _leave_repeated(state, vel, L.HEARD.gps_vel, L.COUNT.gps_vel_same, row, L.AID.gps_vel)
    row[L.AID.gps_valid] = 1.0 if finite > 0 else 0.0


@njit
def _restart(state, tick, sample, k):
    """Begin at this tick: fill the IMU ring with its sample. False if that is not usable."""
    fill_matrix(state.aid, 0.0)
    state.count[L.COUNT.aligned] = 0
    state.count[L.COUNT.tick] = L.NO_TICK
    for j in range(IMU.size):
        if not usable_imu(sample, j, k.ekf):
            state.count[L.COUNT.imu_dropped] += 1
            return False
    for slot in range(state.imu.shape[0]):
        copy_part(state.imu[slot], 0, sample, 0, IMU.size)
        state.imu[slot, L.RING.replaced] = 0.0
    state.count[L.COUNT.tick] = tick
    state.count[L.COUNT.begun] = tick
    state.count[L.COUNT.imu_ok] = tick
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
    k : ObserverParams

    Returns
    -------
    int
        Ticks gone by since the newest one before: 1 usually, more after lost ticks (which are
        filled in), 0 for a tick that is not new or a first sample that is not usable.
    """
    count = state.count
    last = count[L.COUNT.tick]
    if tick <= last:
        count[L.COUNT.tick_repeated] += 1
        return 0
    if tick - last > k.max_gap_ticks:
        if last != L.NO_TICK:
            count[L.COUNT.realigned] += 1
        return 1 if _restart(state, tick, sample, k) else 0
    count[L.COUNT.tick_gaps] += tick - last > 1
    for t in range(last + 1, tick):
        fill(state.aid[t % state.aid.shape[0]], 0.0)
    _store_imu(state, tick, last, sample, k.ekf)
    count[L.COUNT.tick] = tick
    return tick - last


# -------------------------------------------------------------------------------------------------
# An IMU whose filters are late by a known time (`ekf.imu.delay_s`): the motion of a tick is what
# the samples after it say, on a straight line between two of them. Behind the newest one the mean
# over about a turn of the rotor goes on: one sample alone has all of the vibration in it.
# -------------------------------------------------------------------------------------------------

GOES_ON_S = 0.03
"""Time over which that mean is taken."""


@njit
def said_at(tick, newest, k):
    """The newest tick whose sample tells the motion of a tick; k is an EkfParams."""
    return min(tick + k.late_ticks + (k.late_part > 0.0), newest)


@njit
def _sample_at(imu, tick, newest, mean_ticks, row):
    """Fill row (7,) with the sample of a tick, or with what goes on behind the newest one."""
    size = imu.shape[0]
    copy_part(row, 0, imu[min(tick, newest) % size], 0, L.RING.size)
    if tick > newest:
        for back in range(1, mean_ticks):
            for i in range(IMU.size):
                row[i] += imu[(newest - back) % size, i]
        for i in range(IMU.size):
            row[i] /= mean_ticks


@njit
def motion_at(imu, tick, newest, k, row):
    """Fill row (7,) with what the ring imu (slots, 7) says of the motion of a tick.

    newest is the newest tick in the ring, k an EkfParams.
    """
    first = tick + k.late_ticks
    _sample_at(imu, first, newest, k.mean_ticks, row)
    if k.late_part > 0.0:
        after = scratch(_N_IMU)
        _sample_at(imu, first + 1, newest, k.mean_ticks, after)
        for i in range(IMU.size):
            row[i] += k.late_part * (after[i] - row[i])
        row[L.RING.replaced] = max(row[L.RING.replaced], after[L.RING.replaced])


# -------------------------------------------------------------------------------------------------
# Samples that come late or not at all, put into the ring buffers before the filter reads them.
# -------------------------------------------------------------------------------------------------

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
        if sample[L.RING.replaced] > 0.0:
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
def interpolate_gap(imu, tick, newest, dt_s, P):
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
    if imu[tick % size, L.RING.replaced] == 0.0:
        return False
    first = last = tick
    while first > tick - BRIDGED and imu[(first - 1) % size, L.RING.replaced] > 0.0:
        first -= 1
    while last < min(newest, tick + BRIDGED) and imu[(last + 1) % size, L.RING.replaced] > 0.0:
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
        P[L.ERROR.vel + i, L.ERROR.vel + i] += share * (force + force_after)
        P[L.ERROR.att + i, L.ERROR.att + i] += share * (rate + rate_after)
    return True


@njit
def _mend_imu(state, stamp, sample, k):
    """Put a sample (6,) that came late into its slot, and hold it on until now.

    The filter, at its horizon, then reads it as if it had come in time.
    """
    imu, count = state.imu, state.count
    size, now = imu.shape[0], count[L.COUNT.tick]
    slot = stamp % size
    if not now - k.horizon_ticks < stamp <= now or stamp <= count[L.COUNT.begun]:
        return
    force, rate = judge_imu(state, sample, k.ekf)
    if not (force and rate) or imu[slot, L.RING.replaced] == 0.0:
        return
    copy_part(imu[slot], 0, sample, 0, IMU.size)
    imu[slot, L.RING.replaced] = 0.0
    for t in range(stamp + 1, now + 1):
        if imu[t % size, L.RING.replaced] == 0.0:
            break
        copy_part(imu[t % size], 0, sample, 0, IMU.size)
    count[L.COUNT.imu_ok] = max(count[L.COUNT.imu_ok], stamp)
    count[L.COUNT.imu_late] = now + 1
    count[L.COUNT.imu_mended] += 1


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
    k : ObserverParams
    y : (>= 20,) array
        Measurement row of the tick; its IMU is written, NaN for a sample of an earlier tick.
    """
    if stamp == tick or state.count[L.COUNT.tick] == L.NO_TICK:
        copy_part(y, MEAS.imu.start, sample, 0, IMU.size)
        return
    fill(y[MEAS.imu], math.nan)
    _mend_imu(state, stamp, sample, k)


@njit
def _turn(quat, rotvec):
    """Turn a quaternion (4,) body -> NED by a rotation vector (3,), body, in place."""
    turn, turned = scratch(4), scratch(4)
    fill_from_rotvec(rotvec, turn)
    fill_product(quat, turn, turned)
    copy_part(quat, 0, turned, 0, 4)


@njit
def _motion_since(state, horizon, stamp, k, quat, dv, dp):
    """What the filter integrated from an earlier tick to its horizon, which it has yet to reach.

    quat (4,): out, of the earlier tick; dv, dp (3,): out, NED, change of the velocity, and of the
    position beyond that of a steady velocity.
    """
    x, window, dt_s = state.nominal, state.window.imu, k.dt_s
    R, back = scratch_matrix(3, 3), scratch(3)
    copy_part(quat, 0, x, L.NOMINAL.quat, 4)
    fill(dv, 0.0)
    fill(dp, 0.0)
    for t in range(horizon - 1, stamp - 1, -1):
        sample, before = window[t % window.shape[0]], window[(t - 1) % window.shape[0]]
        fill_R_nb(quat, R)
        # Each sample stands for half a tick on either side, the last one up to the horizon.
        weight_s = dt_s * ((0.5 if t > stamp else 0.0) + (1.0 if t == horizon - 1 else 0.5))
        for i in range(3):
            a = k.gravity_mps2 if i == 2 else 0.0
            for j in range(3):
                a += R[i, j] * (sample[j] - x[L.NOMINAL.accel_bias + j])
            dv[i] += weight_s * a
            dp[i] += weight_s * a * dt_s * (horizon - t)
        if t > stamp:
            for i in range(3):
                at = IMU.rate.start + i
                mean = 0.5 * (sample[at] + before[at])
                back[i] = dt_s * (x[L.NOMINAL.gyro_bias + i] - mean)
            _turn(quat, back)


@njit
def _leave_antenna(state, quat, stamp, k, pos, vel):
    """Bring a fix of a tick, in place, from the antenna to the IMU; quat: of that tick."""
    window, rate = state.window.imu, scratch(3)
    for i in range(3):
        rate[i] = window[stamp % window.shape[0], IMU.rate.start + i]
        rate[i] -= state.nominal[L.NOMINAL.gyro_bias + i]
    leave_arm(quat, rate, k.antenna_m, pos, vel)


@njit
def _return_to_antenna(state, horizon, k, pos, vel):
    """Bring it back, in place, at the horizon, where every fix is expected at the antenna.

    The turn up to the horizon is that of the tick before, and goes on changing as it did.
    """
    x, window = state.nominal, state.window.imu
    last, before = window[(horizon - 1) % window.shape[0]], window[(horizon - 2) % window.shape[0]]
    quat, rotvec, rate, arm_m = scratch(4), scratch(3), scratch(3), scratch(3)
    copy_part(quat, 0, x, L.NOMINAL.quat, 4)
    for i in range(3):
        at = IMU.rate.start + i
        change, bias = last[at] - before[at], x[L.NOMINAL.gyro_bias + i]
        rotvec[i] = k.dt_s * (last[at] + 0.5 * change - bias)
        rate[i] = last[at] + change - bias
        arm_m[i] = -k.antenna_m[i]
    _turn(quat, rotvec)
    leave_arm(quat, rate, arm_m, pos, vel)


@njit
def hear_fix(state, tick, k, y):
    """Bring a fix of a measurement row y that came too late for the filter to its horizon.

    By its own velocity and by what the inertial sensors have said since, over `LATE_S` at most: an
    aircraft that swings changes its velocity in that time by more than a receiver errs. A fix that
    has no velocity stays too late.
    """
    horizon, count = tick - k.horizon_ticks, state.count
    late = horizon - y[MEAS.gps_tick]
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    if not (y[MEAS.gps_valid] > 0.5 and 0.0 < late <= LATE_S / k.ekf.dt_s):
        return
    if not math.isfinite(vel[0] + vel[1] + vel[2]):
        return
    stamp, late_s = int(y[MEAS.gps_tick]), late * k.ekf.dt_s
    quat, dv, dp = scratch(4), scratch(3), scratch(3)
    # Only of a filter that runs without a gap is its own motion since then at hand.
    known = count[L.COUNT.aligned] == 1 and stamp > count[L.COUNT.begun]
    known = known and count[L.COUNT.tick] == tick - 1
    if known:
        _motion_since(state, horizon, stamp, k.ekf, quat, dv, dp)
        _leave_antenna(state, quat, stamp, k.ekf, pos, vel)
    for i in range(3):
        pos[i] += late_s * vel[i]
        if known:
            pos[i] += dp[i]
            vel[i] += dv[i]
    if known:
        _return_to_antenna(state, horizon, k.ekf, pos, vel)
    y[MEAS.gps_tick] = float(horizon)
