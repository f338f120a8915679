# SPDX-License-Identifier: Apache-2.0
"""The observer by ticks: what the node and the one-process loop call.

The filter runs at a delayed horizon, `horizon_ticks` behind: every sample waits in a ring buffer in
the slot of its time of validity, so a GPS fix that is at most that late is fused in time order with
the IMU, magnetometer and barometer of its own time. The output is the filter's state carried to the
newest tick through the buffered IMU samples.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from heli_core.errors import ParameterError
from heli_core.inbox import has_come
from heli_core.jit import copy_part, fill, fill_matrix, njit, scratch, scratch_matrix
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import ACTUATOR, IMU, MEAS, NAV
from heli_core.sensors import AIDS
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_observer import layout as L
from heli_observer.buffers import (
    GOES_ON_S,
    SAME,
    hear_fix,
    hear_imu,
    interpolate_gap,
    motion_at,
    replaced_for_long,
    said_at,
    store_aids,
    store_gps,
    take_tick,
)
from heli_observer.dual_imu import PAIR, begin_pair, combine, follow_trial, new_pair
from heli_observer.ekf import (
    FUSED_IN_ORDER,
    align,
    conclude,
    fuse_aid,
    fuse_gps,
    leave_arm,
    move_fix_to_imu,
    predict,
    predict_without_imu,
    scalar_update,
    start_baro,
    strapdown,
    strapdown_without_imu,
    take_for_jump,
)
from heli_observer.fault_detection import (
    accept_velocity,
    empty_window,
    is_rotor,
    is_state,
    keep_window,
    keeps_its_offset,
    reject_velocity,
    reset_biases,
    reset_filter,
    widen_covariance,
)
from heli_observer.layout import (
    ERROR,
    EkfParams,
    ObserverParams,
    ObserverState,
    ObserverStatus,
    ReducedOrderParams,
)
from heli_observer.reduced_order import (
    ReducedOrderError,
    ReducedOrderModel,
    reduced_order_model,
    reduced_order_params,
    rotor_output,
    rotor_start,
    rotor_step,
)
from heli_observer.yaw_bank import (
    begin_bank,
    carry_bank,
    fuse_bank,
    judge_heading,
    may_take,
    new_bank,
    take_heading,
    take_yaw,
)

# -------------------------------------------------------------------------------------------------
# From the observer's parameters to the constants of its compiled kernels.
# -------------------------------------------------------------------------------------------------


class ObserverConfigError(ValueError):
    """Parameters that are each allowed but do not fit together; the message names them."""


def _initial_variances(v: Mapping[str, Any]) -> np.ndarray:
    """Variances (20,) at alignment that do not follow from a sensor's own noise."""
    var0 = np.zeros(ERROR.size)
    var0[ERROR.att : ERROR.att + 2] = v["ekf.initial.level_rad"] ** 2
    var0[ERROR.att + 2] = v["ekf.initial.heading_rad"] ** 2
    var0[ERROR.gyro_bias : ERROR.gyro_bias + 3] = v["ekf.initial.gyro_bias_radps"] ** 2
    var0[ERROR.accel_bias : ERROR.accel_bias + 3] = v["ekf.initial.accel_bias_mps2"] ** 2
    unknown = v["ekf.initial.drift_at_alignment_fraction"]
    var0[ERROR.drift : ERROR.drift + 2] = (unknown * v["ekf.gps.drift_horizontal_m"]) ** 2
    var0[ERROR.drift + 2] = (unknown * v["ekf.gps.drift_vertical_m"]) ** 2
    var0[ERROR.mag_error] = v["ekf.mag.heading_error_rad"] ** 2
    return var0


def _ekf_params(v: Mapping[str, Any], tick_s: float) -> EkfParams:
    decay = float(np.exp(-tick_s / v["ekf.gps.drift_time_constant_s"]))
    step = 1.0 - decay**2
    mag_decay = float(np.exp(-tick_s / v["ekf.mag.heading_error_time_constant_s"]))
    # Quantiles of chi-square with 1, 2, 3 degrees of freedom; scipy.stats takes 0.7 s to import.
    imu_arm_m, gps_arm_m = (
        np.array(v[f"ekf.{sensor}.lever_arm_m"], dtype=np.float64) for sensor in ("imu", "gps")
    )
    late = v["ekf.imu.delay_s"] / tick_s
    probability = v["ekf.gate_probability"]
    gates = np.array([0.0] + [2.0 * gammaincinv(0.5 * dof, probability) for dof in (1, 2, 3)])
    return EkfParams(
        dt_s=tick_s,
        gravity_mps2=v["ekf.gravity_mps2"],
        var_vel_step=v["ekf.imu.accel_noise_density"] ** 2 * tick_s,
        var_att_step=v["ekf.imu.gyro_noise_density"] ** 2 * tick_s,
        var_gyro_bias_step=v["ekf.imu.gyro_bias_walk"] ** 2 * tick_s,
        var_accel_bias_step=v["ekf.imu.accel_bias_walk"] ** 2 * tick_s,
        drift_decay=decay,
        var_drift_step_horizontal=v["ekf.gps.drift_horizontal_m"] ** 2 * step,
        var_drift_step_vertical=v["ekf.gps.drift_vertical_m"] ** 2 * step,
        var_baro_bias_step=v["ekf.baro.bias_walk"] ** 2 * tick_s,
        mag_error_decay=mag_decay,
        var_mag_error_step=v["ekf.mag.heading_error_rad"] ** 2 * (1.0 - mag_decay**2),
        var_gps_pos_horizontal=v["ekf.gps.position_horizontal_m"] ** 2,
        var_gps_pos_vertical=v["ekf.gps.position_vertical_m"] ** 2,
        var_gps_vel_horizontal=v["ekf.gps.velocity_horizontal_mps"] ** 2,
        var_gps_vel_vertical=v["ekf.gps.velocity_vertical_mps"] ** 2,
        var_aid=np.array([v[f"ekf.{row.name}.noise_{row.suffix}"] ** 2 for row in AIDS]),
        field_ned_t=np.array(v["ekf.mag.field_ned_t"], dtype=np.float64),
        field_tolerance=v["ekf.mag.field_tolerance"],
        max_heading_innovation_rad=v["ekf.mag.max_innovation_rad"],
        origin_altitude_m=v["ekf.origin_altitude_m"],
        gates=gates,
        accel_limit_mps2=v["ekf.imu.accel_limit_mps2"],
        rate_limit_radps=v["ekf.imu.rate_limit_radps"],
        var0=_initial_variances(v),
        arms=bool(imu_arm_m.any() or gps_arm_m.any()),
        imu_arm_m=imu_arm_m,
        antenna_m=gps_arm_m - imu_arm_m,
        late_ticks=int(late),
        late_part=late - int(late),
        mean_ticks=max(1, round(GOES_ON_S / tick_s)),
    )


def _pair_params(v: Mapping[str, Any]) -> L.PairParams:
    def six(name: str) -> np.ndarray:
        return np.repeat([v[f"imu2.{name}_mps2"], v[f"imu2.{name}_radps"]], 3)

    return L.PairParams(bool(v["imu2.enabled"]), six("offset"), six("apart"))


def _yaw_params(v: Mapping[str, Any], rate: Rate) -> L.YawParams:
    return L.YawParams(
        v["ekf.motion.difference_rad"],
        v["ekf.motion.sigma_rad"],
        max(1, rate.ticks_in(v["ekf.motion.hold_s"])),
    )


@dataclass(frozen=True)
class ObserverConfig:
    """Checked configuration of the observer.

    Attributes
    ----------
    parameters : mapping
        Name -> value of every row of parameters.TABLE, as heli_core.parameters.load
        gives it.
    rate : Rate
        Of the ticks at which it observes.
    model : ReducedOrderModel
        Continuous matrices of eq. (19), for analysis.
    params : ObserverParams
        Constants of observe().

    Raises
    ------
    ObserverConfigError
        Parameters that do not fit together.
    """

    parameters: Mapping[str, Any]
    rate: Rate = field(init=False)
    model: ReducedOrderModel = field(init=False)
    params: ObserverParams = field(init=False)

    def __post_init__(self) -> None:
        v = self.parameters
        object.__setattr__(self, "rate", Rate.of_parameters(v))
        if v["ekf.horizon_ticks"] < v["schedule.gps_latency_ticks"]:
            raise ObserverConfigError(
                f"ekf.horizon_ticks = {v['ekf.horizon_ticks']} is less than "
                f"schedule.gps_latency_ticks = {v['schedule.gps_latency_ticks']}: "
                "every fix would be too old to be fused"
            )
        late_ticks = v["ekf.imu.delay_s"] / self.rate.tick_s
        if late_ticks > self.rate.of(v["ekf.horizon_ticks"]):
            raise ObserverConfigError(
                f"ekf.imu.delay_s = {v['ekf.imu.delay_s']:g} is longer than "
                f"ekf.horizon_ticks = {v['ekf.horizon_ticks']}: what the samples of the IMU are of "
                "would be known after the filter has been there"
            )
        local = np.asarray(v["ekf.mag.field_ned_t"])
        if np.hypot(local[0], local[1]) < 5e-6:
            raise ObserverConfigError(
                f"ekf.mag.field_ned_t = {local.tolist()} has a horizontal part below 5e-6 T: "
                "no heading can be had from it"
            )
        try:
            model = reduced_order_model(v["model.A"], v["model.B"], v["K"])
            rotor = self._rotor(model)
        except ReducedOrderError as error:
            raise ObserverConfigError(f"model.A, model.B, K: {error}") from error
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "params", self._params(rotor))

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "ObserverConfig":
        """The configuration of these parameters; raises ObserverConfigError."""
        return cls(parameters)

    def _rotor(self, model: ReducedOrderModel) -> ReducedOrderParams:
        v = self.parameters
        return reduced_order_params(
            model,
            v["trim.x"],
            v["trim.u"],
            self.rate.of(v["u_delay_ticks"]),
            v["servo.frequency_radps"],
            v["servo.damping"],
            self.rate.tick_s,
        )

    def _params(self, rotor: ReducedOrderParams) -> ObserverParams:
        v, rate = self.parameters, self.rate

        def ticks(time_s: float) -> int:
            return max(1, rate.ticks_in(time_s))

        return ObserverParams(
            ekf=_ekf_params(v, rate.tick_s),
            rotor=rotor,
            pair=_pair_params(v),
            yaw=_yaw_params(v, rate),
            horizon_ticks=rate.of(v["ekf.horizon_ticks"]),
            align_ticks=rate.of(v["ekf.initial.align_ticks"]),
            max_gap_ticks=rate.of(v["ekf.max_gap_ticks"]),
            imu_timeout_ticks=ticks(v["ekf.timeout.imu_s"]),
            gps_timeout_ticks=ticks(v["ekf.timeout.gps_s"]),
            gps_recovery_ticks=ticks(v["ekf.timeout.gps_recovery_s"]),
            aid_timeout_ticks=np.array([ticks(v[f"ekf.timeout.{row.name}_s"]) for row in AIDS]),
        )


# -------------------------------------------------------------------------------------------------
# Observer.
# -------------------------------------------------------------------------------------------------

__all__ = ["ObserverConfig", "ObserverState", "ObserverStatus", "initial_state", "observe"]
__all__ += ["status"]

# Lengths of what lies on the stack.
_N_ERROR, _N_OUTPUT, _N_IMU, _N_RING = L.ERROR.size, L.OUTPUT.size, IMU.size, L.RING.size
_N_MEAS, _N_ACTUATOR = MEAS.sensed, ACTUATOR.size
_OK = int(ObserverStatus.OK)
_ALIGNING = int(ObserverStatus.ALIGNING)
_NOT_FINITE = int(ObserverStatus.NOT_FINITE)
_IMU_TIMEOUT = int(ObserverStatus.IMU_TIMEOUT)
_GPS_TIMEOUT = int(ObserverStatus.GPS_TIMEOUT)
_GPS_REJECTED = int(ObserverStatus.GPS_REJECTED)
_GPS_STUCK = int(ObserverStatus.GPS_STUCK)
_IMU_FROZEN = int(ObserverStatus.IMU_FROZEN)
_IMU_LEFT = int(ObserverStatus.IMU_LEFT)
_IMUS_DISAGREE = int(ObserverStatus.IMUS_DISAGREE)
_MAG_LEFT = int(ObserverStatus.MAG_LEFT)
_HEADING_DISAGREES = int(ObserverStatus.HEADING_DISAGREES)
_DISAGREES = int(L.YawState.DISAGREES)


def initial_state(config: ObserverConfig) -> ObserverState:
    """Memory of an observer that has seen nothing yet (status ALIGNING)."""
    slots = config.params.horizon_ticks + config.params.max_gap_ticks + 2
    count = np.zeros(L.COUNT.size, dtype=np.int64)
    count[L.COUNT.tick] = L.NO_TICK
    count[L.COUNT.imu_ok : L.COUNT.gps_seen + 1] = L.NO_TICK
    count[L.COUNT.gps_kept] = count[L.COUNT.imu_late] = L.NO_TICK
    for at in L.AID_PLACES:
        count[at.ok] = count[at.seen] = L.NO_TICK
    return ObserverState(
        nominal=np.zeros(L.NOMINAL.size),
        P=np.zeros((L.ERROR.size, L.ERROR.size)),
        trial=np.zeros((L.ERROR.size, L.ERROR.size)),
        dx=np.zeros((2, L.ERROR.size)),
        imu=np.zeros((slots, L.RING.size)),
        aid=np.zeros((slots, L.AID.size)),
        now=np.zeros(L.NOMINAL.size),
        rotor=np.zeros(L.ROTOR_W.size),
        y=np.zeros((2, L.OUTPUT.size)),
        u=np.tile(config.params.rotor.u_trim, (config.params.rotor.u_delay_ticks + 1, 1)),
        diag=np.zeros(L.DIAG.size),
        heard=np.full(L.HEARD.size, np.nan),
        count=count,
        window=empty_window(),
        pair=new_pair(),
        yaw=new_bank(),
    )


@njit
def _fuse_fix(state, tick, horizon, row, observer_k):
    """Fuse the fix of a ring slot, unless its receiver is known to be off; as `_fuse_slot`."""
    x, P, count, k = state.nominal, state.P, state.count, observer_k.ekf
    count[L.COUNT.gps_seen] = tick
    if keeps_its_offset(state, row, k):
        position, velocity = 0, 0
        count[L.COUNT.gps_kept] = tick
    else:
        position, velocity = fuse_gps(x, P, state.trial, state.dx, state.diag, row, k)
    count[L.COUNT.gps_pos_rejected] += position == 0
    count[L.COUNT.gps_vel_rejected] += velocity == 0
    count[L.COUNT.gps_fused] += position == 1 or velocity == 1
    since = max(count[L.COUNT.gps_ok], count[L.COUNT.gps_kept])
    late = position == 0 and tick - since > observer_k.gps_recovery_ticks
    lost = late and velocity == 0
    if velocity == 1:
        accept_velocity(state)
    elif velocity == 0 and reject_velocity(state, row, horizon * k.dt_s, k):
        reset_biases(state, horizon, k)
    if position == 1 and velocity != 0:
        count[L.COUNT.gps_ok] = tick
    elif late and velocity == 1:
        take_for_jump(x, P, row, k)
        count[L.COUNT.gps_jumps] += 1
        count[L.COUNT.gps_ok] = tick
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
    if row[L.AID.gps_valid] > 0.0:
        lost = _fuse_fix(state, tick, horizon, row, observer_k)
    for which in FUSED_IN_ORDER:
        at = L.AID_PLACES[which]
        if row[at.valid] == 0.0:
            continue
        count[at.seen] = tick
        if which == L.BARO_AID and count[L.COUNT.baro_ready] == 0:
            start_baro(x, P, row, k)
            count[L.COUNT.baro_ready] = 1
            count[at.ok] = tick
        elif fuse_aid(which, x, P, trial, dx, diag, row, k):
            count[at.ok] = tick
            count[at.fused] += 1
        else:
            count[at.rejected] += 1
    return lost


@njit
def _filter_step(state, horizon, tick, k):
    """Bring the filter from horizon - 1 to horizon and fuse what was measured there.

    Returns whether it is lost, as `_fuse_slot` does.
    """
    x, P, imu = state.nominal, state.P, state.imu
    before, now = scratch(_N_RING), scratch(_N_RING)
    begins = horizon <= state.count[L.COUNT.begun]
    said = said_at(horizon, tick, k.ekf)
    bridged = not begins and interpolate_gap(imu, said, tick, k.ekf.dt_s, P)
    motion_at(imu, horizon - 1, tick, k.ekf, before)
    motion_at(imu, horizon, tick, k.ekf, now)
    if begins:
        predict_without_imu(x, P, k.ekf)
    else:
        predict(x, P, before, now, k.ekf)
        if not bridged and replaced_for_long(imu, said):
            widen_covariance(P, k.ekf.dt_s)
    row = state.aid[horizon % state.aid.shape[0]]
    if k.ekf.arms:
        move_fix_to_imu(x[L.NOMINAL.quat :], x[L.NOMINAL.gyro_bias :], now, row, k.ekf)
    _watch_heading(state, horizon, tick, before, now, row, k)
    keep_window(state, horizon, now, row)
    return _fuse_slot(state, tick, horizon, row, k)


@njit
def _watch_heading(state, horizon, tick, before, now, row, k):
    """Let the bank of headings see what the ring slot `row` of the horizon holds.

    It changes nothing of the filter, unless their headings have disagreed for long enough, and
    nothing speaks against the bank (`may_take`): then the disagreement is only told. before, now:
    motion (7,) at the tick before the horizon, and at it.
    """
    bank = state.yaw
    if horizon > state.count[L.COUNT.begun]:
        carry_bank(state, before, now, k.ekf)
    if row[L.AID.gps_valid] > 0.0:
        fuse_bank(bank, row[L.AID.gps_vel : L.AID.gps_vel + 3], k.ekf)
        if judge_heading(state, horizon, k) and may_take(state, horizon, k):
            take_heading(state, horizon, tick, row, k)
    if bank.count[L.YAW_COUNT.left] == 1:
        row[L.AID.mag_valid] = 0.0


@njit
def _attitude_variance(P, R, axis, lead_s, k):
    """Variance (rad2) of the attitude error about a NED axis, lead_s after the horizon."""
    var_bias, cov = 0.0, 0.0
    for j in range(3):
        cov += R[axis, j] * P[L.ERROR.att + axis, L.ERROR.gyro_bias + j]
        for m in range(3):
            var_bias += R[axis, j] * R[axis, m] * P[L.ERROR.gyro_bias + j, L.ERROR.gyro_bias + m]
    noise = k.var_att_step / k.dt_s
    var_attitude = P[L.ERROR.att + axis, L.ERROR.att + axis]
    return var_attitude - 2.0 * lead_s * cov + lead_s * lead_s * var_bias + noise * lead_s


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
        for n in range(L.ERROR.size):
            pg[n] = 0.0
            for j in range(3):
                pg[n] += (
                    by_att[j] * P[n, L.ERROR.att + j] + by_bias[j] * P[n, L.ERROR.accel_bias + j]
                )
        var_force = 0.0
        for j in range(3):
            var_force += by_att[j] * pg[L.ERROR.att + j] + by_bias[j] * pg[L.ERROR.accel_bias + j]
        var_v, cov_pv = P[L.ERROR.vel + i, L.ERROR.vel + i], P[L.ERROR.pos + i, L.ERROR.vel + i]
        t, h = lead_s, 0.5 * lead_s * lead_s
        velocity = var_v + 2.0 * t * pg[L.ERROR.vel + i] + t * t * var_force + noise * t
        position = P[L.ERROR.pos + i, L.ERROR.pos + i] + t * t * var_v + h * h * var_force
        position += 2.0 * (t * cov_pv + h * pg[L.ERROR.pos + i] + t * h * pg[L.ERROR.vel + i])
        position += noise * t * t * t / 3.0
        sigma_pos[i] = math.sqrt(max(position, 0.0))
        sigma_vel[i] = math.sqrt(max(velocity, 0.0))
        sigma_att[i] = math.sqrt(max(_attitude_variance(P, R, i, lead_s, k), 0.0))


@njit
def _navigation_output(state, tick, k, out):
    """Carry the horizon's state to the newest tick and fill out (31,) except the rotor states."""
    size = state.imu.shape[0]
    now = state.now
    copy_part(now, 0, state.nominal, 0, L.NOMINAL.size)
    a_ned, R = scratch(3), scratch_matrix(3, 3)
    fill(a_ned, 0.0)
    fill_matrix(R, 0.0)
    imu0, imu1 = scratch(_N_RING), scratch(_N_RING)
    for t in range(tick - k.horizon_ticks, tick):
        if t < state.count[L.COUNT.begun]:
            strapdown_without_imu(now, k.ekf.dt_s)
        else:
            motion_at(state.imu, t, tick, k.ekf, imu0)
            motion_at(state.imu, t + 1, tick, k.ekf, imu1)
            strapdown(now, imu0, imu1, k.ekf.gravity_mps2, k.ekf.dt_s, a_ned, R)
    copy_part(out[NAV.pos], 0, now, L.NOMINAL.pos, 3)
    copy_part(out[NAV.vel], 0, now, L.NOMINAL.vel, 3)
    copy_part(out[NAV.quat], 0, now, L.NOMINAL.quat, 4)
    copy_part(out[NAV.gyro_bias], 0, now, L.NOMINAL.gyro_bias, 3)
    copy_part(out[NAV.accel_bias], 0, now, L.NOMINAL.accel_bias, 3)
    rate, measured = out[NAV.rate], state.imu[tick % size, IMU.rate]
    for i in range(3):
        rate[i] = measured[i] - now[L.NOMINAL.gyro_bias + i]
    if k.ekf.arms:
        leave_arm(out[NAV.quat], rate, k.ekf.imu_arm_m, out[NAV.pos], out[NAV.vel])
    _sigma_now(state.P, R, a_ned, k.horizon_ticks * k.ekf.dt_s, k.ekf, out)


@njit
def _outputs_from_trim(y, psi_before, out, k):
    """phi theta p q r psi of out, minus trim, into y (6,); psi goes on from psi_before."""
    phi, theta, psi = euler_from_quat(out[NAV.quat])
    y[L.OUTPUT.phi], y[L.OUTPUT.theta] = (
        phi - k.y_trim[L.OUTPUT.phi],
        theta - k.y_trim[L.OUTPUT.theta],
    )
    rate = out[NAV.rate]
    for i in range(3):
        y[L.OUTPUT.rate + i] = rate[i] - k.y_trim[L.OUTPUT.rate + i]
    y[L.OUTPUT.psi] = psi_before + wrap_pi(psi - k.y_trim[L.OUTPUT.psi] - psi_before)


@njit
def _rotor_update(state, ticks, u_prev, started, k, out):
    """Advance the reduced-order observer by `ticks`, or start it, and write its states into out."""
    u = state.u
    for i in range(ACTUATOR.size):
        if not math.isfinite(u_prev[i]):
            state.count[L.COUNT.actuator_dropped] += 1
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
        copy_part(start, 0, after, 0, L.OUTPUT.size)
        _outputs_from_trim(end, start[L.OUTPUT.psi], out, k)
        for n in range(ticks):
            for j in range(u.shape[0] - 1, 0, -1):
                copy_part(u[j], 0, u[j - 1], 0, ACTUATOR.size)
            for i in range(ACTUATOR.size):
                if math.isfinite(u_prev[i]):
                    u[0, i] = u_prev[i]
            copy_part(before, 0, after, 0, L.OUTPUT.size)
            part = (n + 1.0) / ticks
            for i in range(L.OUTPUT.size):
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
        Measurement row, places of `heli_core.rows.MEAS`; nothing behind what is sensed is read.
    u_prev : ndarray (4,)
        Actuators computed at tick - 1: lateral, longitudinal, pedal, collective.
    k : ObserverParams
    out : ndarray (31,)
        Navigation row, places of `heli_core.rows.NAV`; NaN while the observer is aligning or not
        finite.
    """
    sample = scratch(_N_IMU)
    copy_part(sample, 0, y, MEAS.imu.start, IMU.size)
    if k.pair.on and tick > state.count[L.COUNT.tick]:
        combine(state, tick, y, k, sample)
    ticks = take_tick(state, tick, sample, k)
    fill(out, math.nan)
    count = state.count
    now = count[L.COUNT.tick]
    if now == L.NO_TICK:
        return
    started, lost = count[L.COUNT.aligned] == 1, False
    if ticks > 0:
        for t in range(now - ticks + 1, now + 1):
            if t == now:
                store_aids(state, now, y)
                store_gps(state, now, y, k.horizon_ticks)
            if started:
                lost = _filter_step(state, t - k.horizon_ticks, now, k) or lost
                if k.pair.on:
                    follow_trial(state, t - k.horizon_ticks, now, k.ekf)
    broken = started and not is_state(state.nominal, state.P)
    if broken and reset_filter(state, now - k.horizon_ticks, k.ekf):
        begin_pair(state)
        broken = False
    if (lost or broken) and align(state, now, k.horizon_ticks, k.ekf):
        count[L.COUNT.realigned] += 1
        begin_pair(state)
        if state.yaw.count[L.YAW_COUNT.left] == 1:
            take_yaw(state, k.ekf)
        broken = False
    count[L.COUNT.not_finite] = broken
    if broken:
        return
    if not started and now - count[L.COUNT.begun] < k.align_ticks:
        return
    if not started:
        if not align(state, now, k.horizon_ticks, k.ekf):
            return
        begin_pair(state)
        begin_bank(state)
    _navigation_output(state, now, k, out)
    if ticks > 0 or not started:
        _rotor_update(state, ticks, u_prev, started and is_rotor(state.rotor), k.rotor, out)
    else:
        rotor_output(state.rotor, state.y[0], k.rotor, out[NAV.rotor])


# -------------------------------------------------------------------------------------------------
# One tick on what has come: late samples, fixes and their velocity, what did not come.
# -------------------------------------------------------------------------------------------------

INPUTS = (
    topics.IMU,
    topics.IMU2,
    *(row.topic for row in AIDS),
    topics.GPS_FIX,
    topics.GPS_VELOCITY,
    topics.ACTUATORS,
)
"""What the observer hears, in the order of its inbox."""
AID_INPUTS = slice(2, 2 + len(AIDS))
"""Places of the samples of `AIDS` in it."""
_IMU, _IMU2, *_, _FIX, _VELOCITY, _COMMAND = range(len(INPUTS))
_FIRST_AID = AID_INPUTS.start


@njit
def _measurements(state, inbox, tick, k, y):
    """The measurement row (28,) of a tick from what has come, into y."""
    fill(y, 0.0)
    fill(y[MEAS.imu], math.nan)
    fill(y[MEAS.imu2], math.nan)
    rows, stamps = inbox.rows, inbox.stamps
    if has_come(inbox, _IMU):
        hear_imu(state, tick, stamps[_IMU], rows[_IMU], k, y)
    if stamps[_IMU2] == tick:
        copy_part(y, MEAS.imu2.start, rows[_IMU2], 0, IMU.size)
    for which in range(len(L.AID_PLACES)):
        if has_come(inbox, _FIRST_AID + which):
            at = L.AID_PLACES[which]
            copy_part(y, at.first, rows[_FIRST_AID + which], 0, at.numbers)
            y[at.arrived] = 1.0
    if has_come(inbox, _FIX):
        copy_part(y, MEAS.gps_pos.start, rows[_FIX], 0, 3)
        y[MEAS.gps_valid], y[MEAS.gps_tick] = 1.0, stamps[_FIX]
        if stamps[_VELOCITY] == stamps[_FIX]:
            copy_part(y, MEAS.gps_vel.start, rows[_VELOCITY], 0, 3)
        else:
            fill(y[MEAS.gps_vel], math.nan)
        if stamps[_FIX] < tick - k.horizon_ticks:
            hear_fix(state, tick, k, y)


@njit
def step(state, inbox, tick, k, out):
    """One tick of the observer on what has come for it; the node and the one-process loop call it.

    Parameters
    ----------
    state : ObserverState
        In place.
    inbox : Inbox
        Places of `INPUTS`. Without actuators the reduced-order observer goes on with those before.
    tick : int
    k : ObserverParams
    out : ndarray (31,)
        Navigation row, as of `observe`.
    """
    y, u = scratch(_N_MEAS), scratch(_N_ACTUATOR)
    _measurements(state, inbox, tick, k, y)
    fill(u, math.nan)
    if has_come(inbox, _COMMAND):
        copy_part(u, 0, inbox.rows[_COMMAND], 0, ACTUATOR.size)
    observe(state, tick, y, u, k, out)


@njit
def status(state, k):
    """Health as an integer, an ObserverStatus; the worst that applies."""
    count = state.count
    now = count[L.COUNT.tick]
    if count[L.COUNT.not_finite] == 1:
        return _NOT_FINITE
    if count[L.COUNT.aligned] == 0:
        return _ALIGNING
    if now - count[L.COUNT.imu_ok] > k.imu_timeout_ticks:
        stuck = max(count[L.COUNT.force_same], count[L.COUNT.rate_same]) >= SAME
        return _IMU_FROZEN if stuck else _IMU_TIMEOUT
    if state.pair.count[PAIR.left] > 0:
        return _IMU_LEFT
    if state.pair.count[PAIR.trial] == 1:
        return _IMUS_DISAGREE
    if max(count[L.COUNT.gps_pos_same], count[L.COUNT.gps_vel_same]) >= SAME:
        return _GPS_STUCK
    if now - count[L.COUNT.gps_ok] > k.gps_timeout_ticks:
        silent = now - count[L.COUNT.gps_seen] > k.gps_timeout_ticks
        return _GPS_TIMEOUT if silent else _GPS_REJECTED
    if state.yaw.count[L.YAW_COUNT.left] == 1:
        return _MAG_LEFT
    if state.yaw.count[L.YAW_COUNT.state] == _DISAGREES:
        return _HEADING_DISAGREES
    for which in range(len(L.AID_PLACES)):
        at, limit = L.AID_PLACES[which], k.aid_timeout_ticks[which]
        if now - count[at.ok] > limit:
            return at.timeout if now - count[at.seen] > limit else at.timeout + 1
    return _OK


# -------------------------------------------------------------------------------------------------
# The observer as an object: by itself, or in an estimator of one's own.
# -------------------------------------------------------------------------------------------------


class Observer:
    """The packaged observer, fed with measurement rows of one tick after another.

    An estimator of one's own may hold one, and fuse into it what a sensor of one's own says.
    """

    def reset(
        self, rng: np.random.Generator, tick_s: float, nodes: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Begin a flight with the parameters of the node `observer` among `nodes`.

        Raises
        ------
        ObserverConfigError, ReducedOrderError
        """
        config = ObserverConfig.from_parameters(nodes["observer"])
        self.params, self.state = config.params, initial_state(config)
        self.nav = np.full(NAV.size, np.nan)

    def step(
        self,
        tick: int,
        time_s: float,
        y: NDArray[np.float64],
        u: NDArray[np.float64],
        readings: Mapping[str, NDArray[np.float64]],
    ) -> NDArray[np.float64]:
        """The navigation row (31,), places of `NAV`, as of `observe`."""
        observe(self.state, tick, y, u, self.params, self.nav)
        return self.nav

    def fuse_velocity(self, vel_ned_mps: NDArray[np.float64], sigma_mps: float) -> float:
        """Fuse a velocity of now, each axis with a standard deviation, if it passes its gate.

        `vel_ned_mps`: north, east, down; a climb has a negative third.

        The error of the velocity is taken to be that at the filter's horizon, 0.2 s ago: over so
        short a time it hardly changes.

        Returns
        -------
        float
            Normalised innovation squared (three degrees of freedom); NaN before the alignment.

        Raises
        ------
        ParameterError
            The velocity has no three numbers, or the standard deviation is not above 0.
        """
        if np.shape(vel_ned_mps) != (3,):
            raise ParameterError.of_argument(
                "vel_ned_mps", vel_ned_mps, "3 numbers: north, east, down"
            )
        if not (isinstance(sigma_mps, int | float | np.number) and 0.0 < sigma_mps < math.inf):
            raise ParameterError.of_argument("sigma_mps", sigma_mps, "a finite number above 0")
        state, off = self.state, vel_ned_mps - self.nav[NAV.vel]
        if not np.isfinite(off).all():
            return math.nan
        state.trial[:] = state.P
        nis = 0.0
        for i in range(off.size):
            nis += scalar_update(
                state.trial, state.dx, L.ERROR.vel + i, 1.0, 0, 0.0, 0, 0.0, 0, 0.0,
                float(off[i]), sigma_mps**2,
            )  # fmt: skip
        passed = bool(nis <= self.params.ekf.gates[off.size])
        conclude(state.nominal, state.P, state.trial, state.dx, passed)
        return nis
