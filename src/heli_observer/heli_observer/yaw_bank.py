# SPDX-License-Identifier: Apache-2.0
"""Heading from motion: what fixes and inertial sensors say of the yaw without the compass.

The filter's heading comes from the compass that aligned it, so the gate of the heading compares the
compass with itself. Beside it runs a bank of small filters over headings all round, as in PX4's
EKF-GSF (P. Riseborough, "EKFGSF_yaw", https://docs.px4.io/main/en/advanced_config/tuning_the_ecl_ekf.html;
the idea of a bank: D. T. Magill, IEEE Trans. Automatic Control 10(4), 1965): each is driven by the
inertial sensors and corrected by the velocity of the fixes; a hypothesis whose innovations are less
likely loses weight. The compass has no part in it.

All hypotheses share one attitude, integrated by the gyros from a level at the alignment, whose
azimuth is free. What the accelerometers say is summed up in this level frame from fix to fix, so
the bank itself steps at the fixes alone. States of each, beside velocity north and east and yaw: an
acceleration b in the level frame that stays, which is what a wrong level makes of gravity (in the
published filter the attitude of each hypothesis takes it up). It is the same for all, and levels
the shared attitude again.

    v+ = v + Rz(yaw) (dv + b T),    yaw+ = yaw,    b+ = b;    z = v

In a hover without movement dv is zero and nothing tells the yaws apart: their mixture stays wide,
and that is told (`YawState.NOT_OBSERVABLE`), not guessed.
"""

import math

import numpy as np

from heli_core.jit import copy_part, fill, fill_matrix, njit, scratch, scratch_matrix
from heli_core.rotations import (
    euler_from_quat,
    fill_from_euler,
    fill_from_rotvec,
    fill_product,
    fill_R_nb,
    normalize,
    wrap_pi,
)
from heli_core.rows import IMU
from heli_observer import layout as L
from heli_observer.ekf import heading_innovation, newest_aid, start_covariance
from heli_observer.fault_detection import FORCE_DENSITY, RATE_DENSITY, accept_velocity, forget
from heli_observer.layout import YAW, YAW_COUNT, YawState

HYPOTHESES = 8
"""Headings all round; each filter has to be linear over the half of its part of the circle."""
_NOT_OBSERVABLE = int(YawState.NOT_OBSERVABLE)
_AGREES = int(YawState.AGREES)
_DISAGREES = int(YawState.DISAGREES)
_N = 5  # states of each: velocity north, east, yaw, acceleration in the level frame
_VN, _VE, _YAW, _BX, _BY = range(_N)

ANY = math.pi * math.pi / 3.0
"""Variance of a heading that may be any, rad^2."""

LEVELS = 0.2
"""Part of the acceleration that stays by which a fix levels the shared attitude."""
GYRO_BIAS = 2.0
"""The filter's gyro bias is believed up to so many of its sigmas at the alignment, each axis: a
filter with a wrong heading explains it by biases."""
SURPRISES, MOST_SURPRISE = 0.2, 4.0
"""Part that the newest fix has in the mean of the least surprise; of a bank whose sensors are sound
it is below 2, the degrees of freedom, and no heading is taken from one that is above this."""
SOUND_BIAS = 20.0
"""No sound gyro's bias is more sigmas at the alignment off; what jumps is."""
BIAS_MPS2, BIAS_WALK = 0.5, 0.03
"""Acceleration that stays: sigma at the start (0.05 rad of level), m/s2; walk, m/s2/sqrt(s)."""
FORCE_NOISE = 0.06
"""Of the acceleration, m/s/sqrt(s): vibration, flexing, and what the level frame leaves."""
FORCE_SCALE = 0.03
"""Part of a change of velocity that scale and misalignment of the accelerometers may make."""
YAW_NOISE, TURN_SCALE = 2e-3, 0.01
"""Walk of the yaw by a gyro bias that is not yet known, rad/sqrt(s); part of a turn that the
gyros' scale may make."""
FIX_NOISE_MPS = 0.05
"""Of a fix's velocity beside the receiver's own, each axis: lever arm, time stamp."""
GATE = 23.0
"""Chi-square, two degrees of freedom, 1e-5: a fix that surprises all hypotheses so is left out."""
REFUSED = 5
"""Fixes in a row left out, after which the bank begins anew."""
LEAST_WEIGHT = 1e-6
"""A hypothesis is never quite given up."""
CERTAIN = 4.0
"""Disagreement counts beyond so many standard deviations of both headings."""


def new_bank() -> L.YawBank:
    """Nothing is known yet."""
    count = np.zeros(YAW_COUNT.size, dtype=np.int64)
    count[YAW_COUNT.since] = L.NO_TICK
    now = np.zeros(YAW.size)
    now[YAW.variance] = ANY
    return L.YawBank(
        np.array([1.0, 0.0, 0.0, 0.0]),
        np.zeros((HYPOTHESES, _N)),
        np.zeros((HYPOTHESES, _N, _N)),
        np.full(HYPOTHESES, 1.0 / HYPOTHESES),
        now,
        count,
    )


@njit
def _forget_motion(bank):
    """Sum up anew what the inertial sensors say, from this fix on."""
    fill(bank.now[YAW.dv : YAW.dv + 2], 0.0)
    bank.now[YAW.time] = bank.now[YAW.var_vel] = bank.now[YAW.var_yaw] = bank.now[YAW.turn] = 0.0


@njit
def spread(bank):
    """Any heading, all alike; the next velocity of a fix is the first."""
    bank.count[YAW_COUNT.begun] = bank.count[YAW_COUNT.refused] = 0
    bank.count[YAW_COUNT.since] = L.NO_TICK
    bank.count[YAW_COUNT.state] = _NOT_OBSERVABLE
    bank.now[YAW.variance] = ANY
    bank.now[YAW.surprise] = 0.0
    _forget_motion(bank)


@njit
def begin_bank(state):
    """The filter was aligned for the first time: the bank shares its level, not its heading."""
    bank = state.yaw
    quat = state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4]
    phi, theta, _ = euler_from_quat(quat)
    fill_from_euler(phi, theta, 0.0, bank.quat)
    bank.count[YAW_COUNT.left] = bank.count[YAW_COUNT.agreed] = 0
    spread(bank)


@njit
def _scatter(bank, fix_vel, var):
    """Start every hypothesis at the velocity of a fix, NED, m/s, of variance `var`."""
    apart = 2.0 * math.pi / HYPOTHESES
    for i in range(HYPOTHESES):
        x, P = bank.x[i], bank.P[i]
        fill(x, 0.0)
        fill_matrix(P, 0.0)
        x[_VN], x[_VE], x[_YAW] = fix_vel[0], fix_vel[1], -math.pi + apart * i
        P[_VN, _VN] = P[_VE, _VE] = var
        P[_YAW, _YAW] = 0.25 * apart * apart
        P[_BX, _BX] = P[_BY, _BY] = BIAS_MPS2 * BIAS_MPS2
        bank.weight[i] = 1.0 / HYPOTHESES
    bank.count[YAW_COUNT.begun] = 1
    _forget_motion(bank)


@njit
def believed_bias(x, i, k):
    """What is believed of the gyro bias of axis i, rad/s, of a nominal state x (21,)."""
    most = GYRO_BIAS * math.sqrt(k.var0[L.ERROR.gyro_bias + i])
    return min(max(x[L.NOMINAL.gyro_bias + i], -most), most)


@njit
def carry_bank(state, imu0, imu1, k):
    """Bring the shared attitude over a tick, and sum up acceleration in its level frame.

    Parameters
    ----------
    state : ObserverState
        Its bank in place; the filter's gyro bias is read.
    imu0, imu1 : ndarray (7,)
        Slots of the IMU ring at the beginning and the end of the tick.
    k : EkfParams
    """
    bank, dt_s = state.yaw, k.dt_s
    rotvec, turn, q, R = scratch(3), scratch(4), scratch(4), scratch_matrix(3, 3)
    fill_R_nb(bank.quat, R)
    before, after = scratch(3), scratch(3)
    for i in range(3):
        before[i] = R[i, 0] * imu0[0] + R[i, 1] * imu0[1] + R[i, 2] * imu0[2]
    yaw = 0.0
    for i in range(3):
        at, bias = IMU.rate.start + i, believed_bias(state.nominal, i, k)
        rotvec[i] = dt_s * (0.5 * (imu0[at] + imu1[at]) - bias)
        yaw += R[2, i] * rotvec[i]
    fill_from_rotvec(rotvec, turn)
    fill_product(bank.quat, turn, q)
    normalize(q)
    copy_part(bank.quat, 0, q, 0, 4)
    fill_R_nb(q, R)
    for i in range(3):
        after[i] = R[i, 0] * imu1[0] + R[i, 1] * imu1[1] + R[i, 2] * imu1[2]
    now = bank.now
    for i in range(2):
        now[YAW.dv + i] += 0.5 * dt_s * (before[i] + after[i])
    now[YAW.time] += dt_s
    now[YAW.turn] += abs(yaw)
    if imu1[L.RING.replaced] > 0.0:
        now[YAW.var_vel] += FORCE_DENSITY * FORCE_DENSITY * dt_s
        now[YAW.var_yaw] += RATE_DENSITY * RATE_DENSITY * dt_s


@njit
def _predict(bank, k):
    """Bring every hypothesis to the fix, by what was summed up since the last one."""
    now = bank.now
    time_s, p, q = now[YAW.time], now[YAW.dv], now[YAW.dv + 1]
    scale = FORCE_SCALE * FORCE_SCALE * (p * p + q * q)
    noise = FORCE_NOISE * FORCE_NOISE + k.var_vel_step / k.dt_s
    var_vel = now[YAW.var_vel] + noise * time_s + scale
    var_yaw = now[YAW.var_yaw] + (YAW_NOISE * YAW_NOISE + k.var_att_step / k.dt_s) * time_s
    var_yaw += (TURN_SCALE * now[YAW.turn]) ** 2
    var_bias = BIAS_WALK * BIAS_WALK * time_s
    for i in range(HYPOTHESES):
        x, P = bank.x[i], bank.P[i]
        c, s = math.cos(x[_YAW]), math.sin(x[_YAW])
        dx, dy = p + time_s * x[_BX], q + time_s * x[_BY]
        north, east, c, s = c * dx - s * dy, s * dx + c * dy, time_s * c, time_s * s
        x[_VN] += north
        x[_VE] += east
        for j in range(_N):
            P[_VN, j] += -east * P[_YAW, j] + c * P[_BX, j] - s * P[_BY, j]
            P[_VE, j] += north * P[_YAW, j] + s * P[_BX, j] + c * P[_BY, j]
        for j in range(_N):
            P[j, _VN] += -east * P[j, _YAW] + c * P[j, _BX] - s * P[j, _BY]
            P[j, _VE] += north * P[j, _YAW] + s * P[j, _BX] + c * P[j, _BY]
        P[_VN, _VN] += var_vel
        P[_VE, _VE] += var_vel
        P[_YAW, _YAW] += var_yaw
        P[_BX, _BX] += var_bias
        P[_BY, _BY] += var_bias


@njit
def innovation(x, P, fix_vel, var):
    """How a fix's velocity surprises a hypothesis.

    Returns
    -------
    (float, float, float, float, float, float)
        Innovation north, east (m/s); normalised innovation squared; ln det of its covariance;
        off-diagonal and determinant of that covariance.
    """
    n, e = fix_vel[0] - x[_VN], fix_vel[1] - x[_VE]
    a, b, c = P[_VN, _VN] + var, P[_VN, _VE], P[_VE, _VE] + var
    det = a * c - b * b
    return n, e, (c * n * n - 2.0 * b * n * e + a * e * e) / det, math.log(det), b, det


@njit
def _update(x, P, fix_vel, var):
    """Fuse a fix's velocity into one hypothesis, in place."""
    n, e, _, _, b, det = innovation(x, P, fix_vel, var)
    a, c = P[_VN, _VN] + var, P[_VE, _VE] + var
    gain_n, gain_e, row_n, row_e = scratch(_N), scratch(_N), scratch(_N), scratch(_N)
    for j in range(_N):
        row_n[j], row_e[j] = P[_VN, j], P[_VE, j]
        gain_n[j] = (c * P[j, _VN] - b * P[j, _VE]) / det
        gain_e[j] = (a * P[j, _VE] - b * P[j, _VN]) / det
    for i in range(_N):
        x[i] += gain_n[i] * n + gain_e[i] * e
        for j in range(_N):
            P[i, j] -= gain_n[i] * row_n[j] + gain_e[i] * row_e[j]
    for i in range(_N):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    x[_YAW] = wrap_pi(x[_YAW])


@njit
def _mix(bank):
    """Yaw of the mixture, its variance, velocity and lasting acceleration, into `bank.now`."""
    now, c, s = bank.now, 0.0, 0.0
    fill(now[YAW.vel : YAW.vel + 2], 0.0)
    fill(now[YAW.bias : YAW.bias + 2], 0.0)
    for i in range(HYPOTHESES):
        w, x = bank.weight[i], bank.x[i]
        c += w * math.cos(x[_YAW])
        s += w * math.sin(x[_YAW])
        for j in range(2):
            now[YAW.vel + j] += w * x[_VN + j]
            now[YAW.bias + j] += w * x[_BX + j]
    yaw, var = math.atan2(s, c), 0.0
    for i in range(HYPOTHESES):
        off = wrap_pi(bank.x[i, _YAW] - yaw)
        var += bank.weight[i] * (bank.P[i, _YAW, _YAW] + off * off)
    _, _, azimuth = euler_from_quat(bank.quat)
    now[YAW.heading], now[YAW.variance] = wrap_pi(yaw + azimuth), var


@njit
def _tilt(bank, part, gravity_mps2, q):
    """Level attitude less a part of the tilt that its acceleration tells of, into q (4,).

    Turned by a small angle about x, y the level shows gravity as force along y, -x.
    """
    rotvec, turn = scratch(3), scratch(4)
    share = part / gravity_mps2
    rotvec[0], rotvec[1] = share * bank.now[YAW.bias + 1], -share * bank.now[YAW.bias]
    rotvec[2] = 0.0
    fill_from_rotvec(rotvec, turn)
    fill_product(turn, bank.quat, q)
    normalize(q)


@njit
def _level(bank, gravity_mps2):
    """Level the shared attitude by a part of what the hypotheses say stays of acceleration."""
    q = scratch(4)
    _tilt(bank, LEVELS, gravity_mps2, q)
    copy_part(bank.quat, 0, q, 0, 4)
    for i in range(HYPOTHESES):
        bank.x[i, _BX] -= LEVELS * bank.now[YAW.bias]
        bank.x[i, _BY] -= LEVELS * bank.now[YAW.bias + 1]
    for i in range(2):
        bank.now[YAW.bias + i] *= 1.0 - LEVELS


@njit
def fuse_bank(bank, fix_vel, k):
    """Correct the bank by the velocity of a fix at the tick that it was carried to.

    Parameters
    ----------
    bank : YawBank
        In place.
    fix_vel : ndarray (3,)
        NED, m/s; one that is not finite is left out.
    k : EkfParams
    """
    count, weight = bank.count, bank.weight
    if not (math.isfinite(fix_vel[0]) and math.isfinite(fix_vel[1])):
        return
    var = k.var_gps_vel_horizontal + FIX_NOISE_MPS * FIX_NOISE_MPS
    if count[YAW_COUNT.begun] == 0:
        _scatter(bank, fix_vel, var)
        return
    _predict(bank, k)
    _forget_motion(bank)
    least, best = math.inf, -math.inf
    likely = scratch(HYPOTHESES)
    for i in range(HYPOTHESES):
        _, _, nis, log_det, _, _ = innovation(bank.x[i], bank.P[i], fix_vel, var)
        least = min(least, nis)
        likely[i] = math.log(weight[i]) - 0.5 * (nis + log_det)
        best = max(best, likely[i])
    bank.now[YAW.surprise] += SURPRISES * (min(least, 10.0 * GATE) - bank.now[YAW.surprise])
    if not least <= GATE:
        count[YAW_COUNT.refused] += 1
        if not count[YAW_COUNT.refused] < REFUSED:
            spread(bank)
        return
    count[YAW_COUNT.refused] = 0
    total = 0.0
    for i in range(HYPOTHESES):
        _update(bank.x[i], bank.P[i], fix_vel, var)
        weight[i] = max(math.exp(likely[i] - best), LEAST_WEIGHT)
        total += weight[i]
    for i in range(HYPOTHESES):
        weight[i] /= total
    _mix(bank)
    _level(bank, k.gravity_mps2)


@njit
def judge_heading(state, horizon, k):
    """Compare the filter's heading with the bank's, after a fix.

    Parameters
    ----------
    state : ObserverState
        Its bank's count in place.
    horizon : int
        Tick that both are at.
    k : ObserverParams

    Returns
    -------
    bool
        Whether they have disagreed for long enough: the heading should be the bank's.
    """
    bank, limits = state.yaw, k.yaw
    count, now = bank.count, bank.now
    quat = state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4]
    _, _, psi = euler_from_quat(quat)
    sigma = math.sqrt(now[YAW.variance])
    now[YAW.difference] = wrap_pi(now[YAW.heading] - psi)
    if count[YAW_COUNT.begun] == 0 or sigma > limits.sigma_rad:
        count[YAW_COUNT.state] = _NOT_OBSERVABLE
        count[YAW_COUNT.since] = L.NO_TICK
        return False
    yaw = L.ERROR.att + 2
    both = math.sqrt(now[YAW.variance] + state.P[yaw, yaw])
    if abs(now[YAW.difference]) <= max(limits.difference_rad, CERTAIN * both):
        count[YAW_COUNT.state] = _AGREES
        count[YAW_COUNT.since] = L.NO_TICK
        # Just observable, the bank is too wide to confirm a heading.
        if CERTAIN * both <= limits.difference_rad:
            count[YAW_COUNT.agreed] = 1
        return False
    count[YAW_COUNT.state] = _DISAGREES
    if count[YAW_COUNT.since] == L.NO_TICK:
        count[YAW_COUNT.since] = horizon
        count[YAW_COUNT.biased] = 0
        for i in range(3):
            most = SOUND_BIAS * math.sqrt(k.ekf.var0[L.ERROR.gyro_bias + i])
            if not abs(state.nominal[L.NOMINAL.gyro_bias + i]) <= most:
                count[YAW_COUNT.biased] = 1
    return horizon - count[YAW_COUNT.since] >= limits.hold_ticks


@njit
def may_take(state, horizon, k):
    """Whether a heading that has disagreed for long enough may become the bank's.

    Not if the filter knew of a gyro bias that no sound sensor has when that began: the bank, driven
    by the same gyros, is astray with it. (Later a wrong heading itself shows as such biases.) Nor,
    once both headings have agreed, if the compass stays with the filter's: what was right from the
    start does not turn wrong against both. Nor from a bank that its own fixes surprise.
    """
    if state.yaw.count[YAW_COUNT.biased] == 1 or not state.yaw.now[YAW.surprise] <= MOST_SURPRISE:
        return False
    if state.yaw.count[YAW_COUNT.agreed] == 0:
        return True
    q = scratch(4)
    fill_attitude(state.yaw, k.ekf.gravity_mps2, q)
    return abs(_mag_error(state, horizon, q, k)) <= k.yaw.difference_rad


@njit
def fill_attitude(bank, gravity_mps2, q):
    """Attitude of the bank into q (4,): its level and its heading."""
    yaw, level = scratch(4), scratch(4)
    _tilt(bank, 1.0, gravity_mps2, level)
    _, _, azimuth = euler_from_quat(level)
    fill_from_euler(0.0, 0.0, wrap_pi(bank.now[YAW.heading] - azimuth), yaw)
    fill_product(yaw, level, q)
    normalize(q)


@njit
def take_yaw(state, k):
    """Give the filter, aligned at the tick of the bank, the attitude of the bank, in place.

    Its heading then is as good as the bank's, and has nothing to do with the compass.
    """
    bank, P, yaw = state.yaw, state.P, L.ERROR.att + 2
    fill_attitude(bank, k.gravity_mps2, state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4])
    start_covariance(P, state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4], 0.0, k)
    for j in range(L.ERROR.size):
        P[yaw, j] = P[j, yaw] = 0.0
    P[yaw, yaw] = bank.now[YAW.variance]


@njit
def _mag_error(state, horizon, quat, k):
    """By what the compass' last heading is off an attitude (4,), rad; NaN: none was heard."""
    aid = state.aid
    heard = newest_aid(aid, L.AID.mag_valid, horizon, k.max_gap_ticks)
    if heard == L.NO_TICK:
        return math.nan
    mag = aid[heard % aid.shape[0], L.AID.mag : L.AID.mag + 3]
    error, _ = heading_innovation(quat, mag, k.ekf.field_ned_t)
    return error


@njit
def _judge_compass(state, horizon, k):
    """Leave the compass if its last heading is not that of the filter, which is the bank's."""
    bank = state.yaw
    error = _mag_error(state, horizon, state.nominal[L.NOMINAL.quat : L.NOMINAL.quat + 4], k)
    if math.isfinite(error):
        bank.now[YAW.mag_error] = error
    if abs(error) > k.yaw.difference_rad:
        bank.count[YAW_COUNT.left] = 1


@njit
def take_heading(state, horizon, tick, row, k):
    """Align the filter anew at its horizon, with velocity, level and heading of the bank.

    The compass is not followed from then on where it is what was wrong. The gyro bias stays, as far
    as it is believed.

    Parameters
    ----------
    state : ObserverState
        In place.
    horizon, tick : int
        That of the bank; the newest one, for the time-outs.
    row : ndarray
        Slot of the ring of aids at the horizon, with a fix that the bank has fused. Fix and field
        are used up.
    k : ObserverParams
    """
    bank, x, count = state.yaw, state.nominal, state.count
    for i in range(3):
        at, pos, vel = L.NOMINAL.pos + i, row[L.AID.gps_pos + i], row[L.AID.gps_vel + i]
        x[at] = pos if math.isfinite(pos) else x[at]
        at = L.NOMINAL.vel + i
        x[at] = bank.now[YAW.vel + i] if i < 2 else vel if math.isfinite(vel) else x[at]
        x[L.NOMINAL.gyro_bias + i] = believed_bias(x, i, k.ekf)
    fill(x[L.NOMINAL.accel_bias : L.NOMINAL.size], 0.0)
    take_yaw(state, k.ekf)
    _judge_compass(state, horizon, k)
    fill_matrix(state.dx, 0.0)
    row[L.AID.gps_valid] = row[L.AID.mag_valid] = 0.0
    count[L.COUNT.baro_ready] = 0
    count[L.COUNT.gps_ok] = count[L.COUNT.gps_seen] = tick
    count[L.COUNT.gps_fused] += 1
    bank.count[YAW_COUNT.resets] += 1
    bank.count[YAW_COUNT.since] = L.NO_TICK
    bank.count[YAW_COUNT.state] = _AGREES
    accept_velocity(state)
    state.pair.count[L.PAIR.trial] = 0
    forget(state.window)
