# SPDX-License-Identifier: Apache-2.0
"""From the observer's parameters to the constants of its compiled kernels."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from heli_math.ticks import Rate
from heli_observer.layout import (
    E_ACCEL_BIAS,
    E_ATT,
    E_DRIFT,
    E_GYRO_BIAS,
    E_MAG_ERROR,
    N_ERROR,
    EkfKernel,
    ObserverKernel,
    RotorKernel,
)
from heli_observer.reduced_order import (
    ReducedOrderError,
    ReducedOrderModel,
    reduced_order_model,
    rotor_kernel,
)
from heli_observer.two_imus import PairKernel


class ObserverConfigError(ValueError):
    """Parameters that are each allowed but do not fit together; the message names them."""


def _initial_variances(v: Mapping[str, Any]) -> np.ndarray:
    """Variances (20,) at alignment that do not follow from a sensor's own noise."""
    var0 = np.zeros(N_ERROR)
    var0[E_ATT : E_ATT + 2] = v["ekf.initial.level_rad"] ** 2
    var0[E_ATT + 2] = v["ekf.initial.heading_rad"] ** 2
    var0[E_GYRO_BIAS : E_GYRO_BIAS + 3] = v["ekf.initial.gyro_bias_radps"] ** 2
    var0[E_ACCEL_BIAS : E_ACCEL_BIAS + 3] = v["ekf.initial.accel_bias_mps2"] ** 2
    unknown = v["ekf.initial.drift_at_alignment_fraction"]
    var0[E_DRIFT : E_DRIFT + 2] = (unknown * v["ekf.gps.drift_horizontal_m"]) ** 2
    var0[E_DRIFT + 2] = (unknown * v["ekf.gps.drift_vertical_m"]) ** 2
    var0[E_MAG_ERROR] = v["ekf.mag.heading_error_rad"] ** 2
    return var0


def _ekf_kernel(v: Mapping[str, Any], tick_s: float) -> EkfKernel:
    decay = float(np.exp(-tick_s / v["ekf.gps.drift_time_constant_s"]))
    step = 1.0 - decay**2
    mag_decay = float(np.exp(-tick_s / v["ekf.mag.heading_error_time_constant_s"]))
    # Quantiles of chi-square with 1, 2, 3 degrees of freedom; scipy.stats takes 0.7 s to import.
    probability = v["ekf.gate_probability"]
    gates = np.array([0.0] + [2.0 * gammaincinv(0.5 * dof, probability) for dof in (1, 2, 3)])
    return EkfKernel(
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
        var_baro=v["ekf.baro.noise_pa"] ** 2,
        var_mag=v["ekf.mag.noise_t"] ** 2,
        field_ned_t=np.array(v["ekf.mag.field_ned_t"], dtype=np.float64),
        field_tolerance=v["ekf.mag.field_tolerance"],
        max_heading_innovation_rad=v["ekf.mag.max_innovation_rad"],
        origin_altitude_m=v["ekf.origin_altitude_m"],
        gates=gates,
        accel_limit_mps2=v["ekf.imu.accel_limit_mps2"],
        rate_limit_radps=v["ekf.imu.rate_limit_radps"],
        var0=_initial_variances(v),
    )


def _pair_kernel(v: Mapping[str, Any]) -> PairKernel:
    def six(name: str) -> np.ndarray:
        return np.repeat([v[f"imu2.{name}_mps2"], v[f"imu2.{name}_radps"]], 3)

    return PairKernel(bool(v["imu2.enabled"]), six("offset"), six("apart"))


@dataclass(frozen=True)
class ObserverConfig:
    """Checked configuration of the observer.

    Attributes
    ----------
    parameters : mapping
        Name -> value of every row of parameter_table.TABLE, as heli_parameters.parameters.load
        gives it.
    rate : Rate
        Of the ticks at which it observes.
    model : ReducedOrderModel
        Continuous matrices of eq. (19), for analysis.
    kernel : ObserverKernel
        Constants of observe().

    Raises
    ------
    ObserverConfigError
        Parameters that do not fit together.
    """

    parameters: Mapping[str, Any]
    rate: Rate = field(init=False)
    model: ReducedOrderModel = field(init=False)
    kernel: ObserverKernel = field(init=False)

    def __post_init__(self) -> None:
        v = self.parameters
        object.__setattr__(self, "rate", Rate.of_parameters(v))
        if v["ekf.horizon_ticks"] < v["schedule.gps_latency_ticks"]:
            raise ObserverConfigError(
                f"ekf.horizon_ticks = {v['ekf.horizon_ticks']} is less than "
                f"schedule.gps_latency_ticks = {v['schedule.gps_latency_ticks']}: "
                "every fix would be too old to be fused"
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
        object.__setattr__(self, "kernel", self._kernel(rotor))

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "ObserverConfig":
        """The configuration of these parameters; raises ObserverConfigError."""
        return cls(parameters)

    def _rotor(self, model: ReducedOrderModel) -> RotorKernel:
        v = self.parameters
        return rotor_kernel(
            model,
            v["trim.x"],
            v["trim.u"],
            self.rate.of(v["u_delay_ticks"]),
            v["servo.frequency_radps"],
            v["servo.damping"],
            self.rate.tick_s,
        )

    def _kernel(self, rotor: RotorKernel) -> ObserverKernel:
        v, rate = self.parameters, self.rate

        def ticks(time_s: float) -> int:
            return max(1, rate.ticks_in(time_s))

        return ObserverKernel(
            ekf=_ekf_kernel(v, rate.tick_s),
            rotor=rotor,
            pair=_pair_kernel(v),
            horizon_ticks=rate.of(v["ekf.horizon_ticks"]),
            align_ticks=rate.of(v["ekf.initial.align_ticks"]),
            max_gap_ticks=rate.of(v["ekf.max_gap_ticks"]),
            imu_timeout_ticks=ticks(v["ekf.timeout.imu_s"]),
            gps_timeout_ticks=ticks(v["ekf.timeout.gps_s"]),
            gps_recovery_ticks=ticks(v["ekf.timeout.gps_recovery_s"]),
            mag_timeout_ticks=ticks(v["ekf.timeout.mag_s"]),
            baro_timeout_ticks=ticks(v["ekf.timeout.baro_s"]),
        )
