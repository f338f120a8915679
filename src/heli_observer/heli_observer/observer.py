# SPDX-License-Identifier: Apache-2.0
"""The observer by ticks: what the node and the one-process loop call.

The filter runs at a delayed horizon, `horizon_ticks` behind: every sample waits in a ring buffer in
the slot of its time of validity, so a GPS fix that is at most that late is fused in time order with
the IMU, magnetometer and barometer of its own time. The output is the filter's state carried to the
newest tick through the buffered IMU samples.
"""

import math

import numpy as np

from heli_math.arrays import copy_part, fill, fill_matrix, scratch, scratch_matrix
from heli_math.jit import njit
from heli_math.rotations import euler_from_quat, wrap_pi
from heli_math.rows import ACTUATOR, IMU, MEAS, NAV
from heli_observer import layout as L
from heli_observer.alignment import align
from heli_observer.buffers import (
    SAME,
    replaced_for_long,
    store_gps,
    store_mag_baro,
    take_tick,
)
from heli_observer.config import ObserverConfig
from heli_observer.doubt import believe, keeps_its_offset, refuse, widen
from heli_observer.ins_ekf import (
    coast,
    fuse_baro,
    fuse_gps,
    fuse_mag,
    predict,
    start_baro,
    take_for_jump,
)
from heli_observer.late import bridge
from heli_observer.layout import ObserverState, ObserverStatus
from heli_observer.recover import is_rotor, is_state, recover
from heli_observer.reduced_order import rotor_output, rotor_start, rotor_step
from heli_observer.relearn import empty_window, remember, solve_again
from heli_observer.strapdown import glide, strapdown
from heli_observer.two_imus import P_LEFT, P_TRIAL, begin_pair, combine, follow_trial, new_pair

__all__ = ["ObserverConfig", "ObserverState", "ObserverStatus", "initial_state", "observe"]
__all__ += ["status"]

_N_ERROR, _N_OUTPUT, _N_IMU = L.N_ERROR, L.N_OUTPUT, IMU.size  # lengths of what lies on the stack
_OK = int(ObserverStatus.OK)
_ALIGNING = int(ObserverStatus.ALIGNING)
_NOT_FINITE = int(ObserverStatus.NOT_FINITE)
_IMU_TIMEOUT = int(ObserverStatus.IMU_TIMEOUT)
_GPS_TIMEOUT = int(ObserverStatus.GPS_TIMEOUT)
_GPS_REJECTED = int(ObserverStatus.GPS_REJECTED)
_MAG_TIMEOUT = int(ObserverStatus.MAG_TIMEOUT)
_MAG_REJECTED = int(ObserverStatus.MAG_REJECTED)
_BARO_TIMEOUT = int(ObserverStatus.BARO_TIMEOUT)
_BARO_REJECTED = int(ObserverStatus.BARO_REJECTED)
_GPS_STUCK = int(ObserverStatus.GPS_STUCK)
_IMU_FROZEN = int(ObserverStatus.IMU_FROZEN)
_IMU_LEFT = int(ObserverStatus.IMU_LEFT)
_IMUS_DISAGREE = int(ObserverStatus.IMUS_DISAGREE)


def initial_state(config: ObserverConfig) -> ObserverState:
    """Memory of an observer that has seen nothing yet (status ALIGNING)."""
    slots = config.kernel.horizon_ticks + config.kernel.max_gap_ticks + 2
    count = np.zeros(L.N_COUNT, dtype=np.int64)
    count[L.C_TICK] = L.NO_TICK
    count[L.C_IMU_OK : L.C_GPS_SEEN + 1] = L.NO_TICK
    count[L.C_GPS_KEPT] = count[L.C_IMU_LATE] = L.NO_TICK
    return ObserverState(
        nominal=np.zeros(L.N_NOMINAL),
        P=np.zeros((L.N_ERROR, L.N_ERROR)),
        trial=np.zeros((L.N_ERROR, L.N_ERROR)),
        dx=np.zeros((2, L.N_ERROR)),
        imu=np.zeros((slots, L.N_IMU)),
        aid=np.zeros((slots, L.N_AID)),
        now=np.zeros(L.N_NOMINAL),
        rotor=np.zeros(L.N_ROTOR_W),
        y=np.zeros((2, L.N_OUTPUT)),
        u=np.tile(config.kernel.rotor.u_trim, (config.kernel.rotor.u_delay_ticks + 1, 1)),
        diag=np.zeros(L.N_DIAG),
        heard=np.full(L.N_HEARD, np.nan),
        count=count,
        window=empty_window(),
        pair=new_pair(),
    )


@njit
def _fuse_fix(state, tick, horizon, row, observer_k):
    """Fuse the fix of a ring slot, unless its receiver is known to be off; as `_fuse_slot`."""
    x, P, count, k = state.nominal, state.P, state.count, observer_k.ekf
    count[L.C_GPS_SEEN] = tick
    if keeps_its_offset(state, row, k):
        position, velocity = 0, 0
        count[L.C_GPS_KEPT] = tick
    else:
        position, velocity = fuse_gps(x, P, state.trial, state.dx, state.diag, row, k)
    count[L.C_GPS_POS_REJECTED] += position == 0
    count[L.C_GPS_VEL_REJECTED] += velocity == 0
    count[L.C_GPS_FUSED] += position == 1 or velocity == 1
    since = max(count[L.C_GPS_OK], count[L.C_GPS_KEPT])
    late = position == 0 and tick - since > observer_k.gps_recovery_ticks
    lost = late and velocity == 0
    if velocity == 1:
        believe(state)
    elif velocity == 0 and refuse(state, row, horizon * k.dt_s, k):
        solve_again(state, horizon, k)
    if position == 1 and velocity != 0:
        count[L.C_GPS_OK] = tick
    elif late and velocity == 1:
        take_for_jump(x, P, row, k)
        count[L.C_GPS_JUMPS] += 1
        count[L.C_GPS_OK] = tick
    return lost


@njit
def _fuse_slot(state, tick, horizon, row, observer_k):
    """Fuse what the ring slot `row` of the horizon holds; `tick` is now, for the time-outs.

    Returns
    -------
    bool
        Whether the filter is lost: fixes have been refused for so long that it should align anew.
        While velocities are fused it is the receiver that jumped, and its error starts anew.
    """
    k, lost = observer_k.ekf, False
    x, P, trial, dx, diag, count = (
        state.nominal,
        state.P,
        state.trial,
        state.dx,
        state.diag,
        state.count,
    )
    if row[L.AID_GPS_VALID] > 0.0:
        lost = _fuse_fix(state, tick, horizon, row, observer_k)
    if row[L.AID_BARO_VALID] > 0.0:
        count[L.C_BARO_SEEN] = tick
        if count[L.C_BARO_READY] == 0:
            start_baro(x, P, row, k)
            count[L.C_BARO_READY] = 1
            count[L.C_BARO_OK] = tick
        elif fuse_baro(x, P, trial, dx, diag, row, k):
            count[L.C_BARO_OK] = tick
            count[L.C_BARO_FUSED] += 1
        else:
            count[L.C_BARO_REJECTED] += 1
    if row[L.AID_MAG_VALID] > 0.0:
        count[L.C_MAG_SEEN] = tick
        if fuse_mag(x, P, trial, dx, diag, row, k):
            count[L.C_MAG_OK] = tick
            count[L.C_MAG_FUSED] += 1
        else:
            count[L.C_MAG_REJECTED] += 1
    return lost


@njit
def _filter_step(state, horizon, tick, k):
    """Bring the filter from horizon - 1 to horizon and fuse what was measured there.

    Returns whether it is lost, as `_fuse_slot` does.
    """
    x, P, imu, size = state.nominal, state.P, state.imu, state.imu.shape[0]
    if horizon <= state.count[L.C_BEGUN]:
        coast(x, P, k.ekf)
    else:
        bridged = bridge(imu, horizon, tick, k.ekf.dt_s, P)
        predict(x, P, imu[(horizon - 1) % size], imu[horizon % size], k.ekf)
        if not bridged and replaced_for_long(imu, horizon):
            widen(P, k.ekf.dt_s)
    remember(state, horizon, imu[horizon % size], state.aid[horizon % size])
    return _fuse_slot(state, tick, horizon, state.aid[horizon % size], k)


@njit
def _attitude_variance(P, R, axis, lead_s, k):
    """Variance (rad2) of the attitude error about a NED axis, lead_s after the horizon."""
    var_bias, cov = 0.0, 0.0
    for j in range(3):
        cov += R[axis, j] * P[L.E_ATT + axis, L.E_GYRO_BIAS + j]
        for m in range(3):
            var_bias += R[axis, j] * R[axis, m] * P[L.E_GYRO_BIAS + j, L.E_GYRO_BIAS + m]
    noise = k.var_att_step / k.dt_s
    own = P[L.E_ATT + axis, L.E_ATT + axis]
    return own - 2.0 * lead_s * cov + lead_s * lead_s * var_bias + noise * lead_s


@njit
def _sigma_now(P, R, a_ned, lead_s, k, out):
    """Standard deviations of position, velocity, attitude at the newest tick into out (31,).

    First order over the lead (the horizon's length): velocity error grows by the tilt and the
    accelerometer bias, position error by the velocity error, both by the accelerometer's noise;
    attitude error (rotation vector, NED axes) by the gyro's bias and noise.
    """
    by_att, by_bias = scratch(3), scratch(3)  # velocity error rate by attitude, by force bias
    pg = scratch(_N_ERROR)
    sigma_pos, sigma_vel, sigma_att = out[NAV.sigma_pos], out[NAV.sigma_vel], out[NAV.sigma_att]
    noise = k.var_vel_step / k.dt_s
    for i in range(3):
        after, before = (i + 1) % 3, (i + 2) % 3
        by_att[i], by_att[after], by_att[before] = 0.0, a_ned[before], -a_ned[after]
        for j in range(3):
            by_bias[j] = -R[i, j]
        for n in range(L.N_ERROR):
            pg[n] = 0.0
            for j in range(3):
                pg[n] += by_att[j] * P[n, L.E_ATT + j] + by_bias[j] * P[n, L.E_ACCEL_BIAS + j]
        var_force = 0.0
        for j in range(3):
            var_force += by_att[j] * pg[L.E_ATT + j] + by_bias[j] * pg[L.E_ACCEL_BIAS + j]
        var_v, cov_pv = P[L.E_VEL + i, L.E_VEL + i], P[L.E_POS + i, L.E_VEL + i]
        t, h = lead_s, 0.5 * lead_s * lead_s
        velocity = var_v + 2.0 * t * pg[L.E_VEL + i] + t * t * var_force + noise * t
        position = P[L.E_POS + i, L.E_POS + i] + t * t * var_v + h * h * var_force
        position += 2.0 * (t * cov_pv + h * pg[L.E_POS + i] + t * h * pg[L.E_VEL + i])
        position += noise * t * t * t / 3.0
        sigma_pos[i] = math.sqrt(max(position, 0.0))
        sigma_vel[i] = math.sqrt(max(velocity, 0.0))
        sigma_att[i] = math.sqrt(max(_attitude_variance(P, R, i, lead_s, k), 0.0))


@njit
def _navigation_output(state, tick, k, out):
    """Carry the horizon's state to the newest tick and fill out (31,) except the rotor states."""
    size = state.imu.shape[0]
    now = state.now
    copy_part(now, 0, state.nominal, 0, L.N_NOMINAL)
    a_ned, R = scratch(3), scratch_matrix(3, 3)
    fill(a_ned, 0.0)
    fill_matrix(R, 0.0)
    for t in range(tick - k.horizon_ticks, tick):
        if t < state.count[L.C_BEGUN]:
            glide(now, k.ekf.dt_s)
        else:
            imu0, imu1 = state.imu[t % size], state.imu[(t + 1) % size]
            strapdown(now, imu0, imu1, k.ekf.gravity_mps2, k.ekf.dt_s, a_ned, R)
    copy_part(out[NAV.pos], 0, now, L.X_POS, 3)
    copy_part(out[NAV.vel], 0, now, L.X_VEL, 3)
    copy_part(out[NAV.quat], 0, now, L.X_QUAT, 4)
    copy_part(out[NAV.gyro_bias], 0, now, L.X_GYRO_BIAS, 3)
    copy_part(out[NAV.accel_bias], 0, now, L.X_ACCEL_BIAS, 3)
    rate, measured = out[NAV.rate], state.imu[tick % size, IMU.rate]
    for i in range(3):
        rate[i] = measured[i] - now[L.X_GYRO_BIAS + i]
    _sigma_now(state.P, R, a_ned, k.horizon_ticks * k.ekf.dt_s, k.ekf, out)


@njit
def _outputs_from_trim(y, psi_before, out, k):
    """phi theta p q r psi of out, minus trim, into y (6,); psi goes on from psi_before."""
    phi, theta, psi = euler_from_quat(out[NAV.quat])
    y[L.M_PHI], y[L.M_THETA] = phi - k.y_trim[L.M_PHI], theta - k.y_trim[L.M_THETA]
    rate = out[NAV.rate]
    for i in range(3):
        y[L.M_RATE + i] = rate[i] - k.y_trim[L.M_RATE + i]
    y[L.M_PSI] = psi_before + wrap_pi(psi - k.y_trim[L.M_PSI] - psi_before)


@njit
def _rotor_update(state, ticks, u_prev, started, k, out):
    """Advance the reduced-order observer by `ticks`, or start it, and write its states into out."""
    u = state.u
    for i in range(ACTUATOR.size):
        if not math.isfinite(u_prev[i]):
            state.count[L.C_ACTUATOR_DROPPED] += 1
    before, after = state.y[1], state.y[0]
    if not started:
        for i in range(ACTUATOR.size):
            if math.isfinite(u_prev[i]):
                for j in range(u.shape[0]):
                    u[j, i] = u_prev[i]
        _outputs_from_trim(after, 0.0, out, k)
        rotor_start(state.rotor, after, u[0], k)
    else:
        start, end = scratch(_N_OUTPUT), scratch(_N_OUTPUT)
        copy_part(start, 0, after, 0, L.N_OUTPUT)
        _outputs_from_trim(end, start[L.M_PSI], out, k)
        for n in range(ticks):
            for j in range(u.shape[0] - 1, 0, -1):
                copy_part(u[j], 0, u[j - 1], 0, ACTUATOR.size)
            for i in range(ACTUATOR.size):
                if math.isfinite(u_prev[i]):
                    u[0, i] = u_prev[i]
            copy_part(before, 0, after, 0, L.N_OUTPUT)
            part = (n + 1.0) / ticks
            for i in range(L.N_OUTPUT):
                after[i] = start[i] + part * (end[i] - start[i])
            rotor_step(state.rotor, before, after, u[k.u_delay_ticks], k)
    rotor_output(state.rotor, after, k, out[NAV.rotor])


@njit
def observe(state, tick, y, u_prev, k, out):
    """One tick of the observer.

    Parameters
    ----------
    state : ObserverState
        In place.
    tick : int
        The tick that y belongs to. Ticks may be missing (held), not come twice.
    y : ndarray (>= 26,)
        Measurement row, places of `heli_math.rows.MEAS`; nothing behind what is sensed is read.
    u_prev : ndarray (4,)
        Actuators computed at tick - 1: lateral, longitudinal, pedal, collective.
    k : ObserverKernel
    out : ndarray (31,)
        Navigation row, places of `heli_math.rows.NAV`; NaN while the observer is aligning or not
        finite.
    """
    sample = scratch(_N_IMU)
    copy_part(sample, 0, y, MEAS.imu.start, IMU.size)
    if k.pair.on and tick > state.count[L.C_TICK]:
        combine(state, tick, y, k, sample)
    ticks = take_tick(state, tick, sample, k)
    fill(out, math.nan)
    count = state.count
    now = count[L.C_TICK]
    if now == L.NO_TICK:
        return
    started, lost = count[L.C_ALIGNED] == 1, False
    if ticks > 0:
        for t in range(now - ticks + 1, now + 1):
            if t == now:
                store_mag_baro(state, now, y)
                store_gps(state, now, y, k.horizon_ticks)
            if started:
                lost = _filter_step(state, t - k.horizon_ticks, now, k) or lost
                if k.pair.on:
                    follow_trial(state, t - k.horizon_ticks, now, k.ekf)
    broken = started and not is_state(state.nominal, state.P)
    if broken and recover(state, now - k.horizon_ticks, k.ekf):
        begin_pair(state)
        broken = False
    if (lost or broken) and align(state, now, k.horizon_ticks, k.ekf):
        count[L.C_REALIGNED] += 1
        begin_pair(state)
        broken = False
    count[L.C_NOT_FINITE] = broken
    if broken:
        return
    if not started and now - count[L.C_BEGUN] < k.align_ticks:
        return
    if not started:
        if not align(state, now, k.horizon_ticks, k.ekf):
            return
        begin_pair(state)
    _navigation_output(state, now, k, out)
    if ticks > 0 or not started:
        _rotor_update(state, ticks, u_prev, started and is_rotor(state.rotor), k.rotor, out)
    else:
        rotor_output(state.rotor, state.y[0], k.rotor, out[NAV.rotor])


@njit
def status(state, k):
    """Health as an integer, an ObserverStatus; the worst that applies."""
    count = state.count
    now = count[L.C_TICK]
    if count[L.C_NOT_FINITE] == 1:
        return _NOT_FINITE
    if count[L.C_ALIGNED] == 0:
        return _ALIGNING
    if now - count[L.C_IMU_OK] > k.imu_timeout_ticks:
        stuck = max(count[L.C_FORCE_SAME], count[L.C_RATE_SAME]) >= SAME
        return _IMU_FROZEN if stuck else _IMU_TIMEOUT
    if state.pair.count[P_LEFT] > 0:
        return _IMU_LEFT
    if state.pair.count[P_TRIAL] == 1:
        return _IMUS_DISAGREE
    if max(count[L.C_GPS_POS_SAME], count[L.C_GPS_VEL_SAME]) >= SAME:
        return _GPS_STUCK
    if now - count[L.C_GPS_OK] > k.gps_timeout_ticks:
        silent = now - count[L.C_GPS_SEEN] > k.gps_timeout_ticks
        return _GPS_TIMEOUT if silent else _GPS_REJECTED
    if now - count[L.C_MAG_OK] > k.mag_timeout_ticks:
        silent = now - count[L.C_MAG_SEEN] > k.mag_timeout_ticks
        return _MAG_TIMEOUT if silent else _MAG_REJECTED
    if now - count[L.C_BARO_OK] > k.baro_timeout_ticks:
        silent = now - count[L.C_BARO_SEEN] > k.baro_timeout_ticks
        return _BARO_TIMEOUT if silent else _BARO_REJECTED
    return _OK
