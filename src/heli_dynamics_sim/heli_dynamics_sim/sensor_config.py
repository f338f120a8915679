# SPDX-License-Identifier: Apache-2.0
"""The sensors' kernels from the node's parameters `sensors.*`."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.gps_errors import GpsErrorKernel
from heli_dynamics_sim.imu_errors import ImuErrorKernel, VibrationKernel
from heli_dynamics_sim.installation import PortKernel, PowerFieldKernel
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.sensors import (
    BaroKernel,
    GpsKernel,
    ImuKernel,
    MagKernel,
    RotorSpeedKernel,
    SensorKernel,
)
from heli_math.ticks import TICK_S, Rate

_Get = Callable[[str], Any]
_NEVER = 2**62


def sensor_kernel(
    values: Mapping[str, Any], helicopter: HelicopterParameters, rate: Rate
) -> SensorKernel:
    """Build the kernels of all sensors.

    Parameters
    ----------
    values : mapping
        Parameters of the node `plant`.
    helicopter : HelicopterParameters
        Its rotor shakes the IMU and blows on the static port.
    rate : Rate
        Of the ticks, at each of which the IMU is read.

    Raises
    ------
    PlantConfigError
        Satellites come and go too often for the period of the fixes.
    """

    def get(name: str) -> Any:
        return values[f"sensors.{name}"]

    mag = MagKernel(
        np.array(get("mag.field_ned_t"), dtype=np.float64),
        np.array(get("mag.soft_iron"), dtype=np.float64).reshape(3, 3),
        np.array(get("mag.hard_iron_t"), dtype=np.float64),
        get("mag.white_t"),
        rate.of(get("mag.period_ticks")),
        get("mag.clock_jitter_s"),
        get("mag.soft_iron_sigma"),
        get("mag.hard_iron_sigma_t"),
        _power_field(get),
    )
    baro = BaroKernel(
        values["origin.altitude_m"],
        get("baro.white_pa"),
        get("baro.drift_pa"),
        math.exp(-get("baro.period_ticks") * TICK_S / get("baro.drift_tau_s")),
        rate.of(get("baro.period_ticks")),
        get("baro.clock_jitter_s"),
        _port(get, helicopter),
    )
    rotor = RotorSpeedKernel(
        get("rotor_speed.white_radps"),
        get("rotor_speed.step_radps"),
        rate.of(get("rotor_speed.period_ticks")),
    )
    imu, imu2 = _imu(get, helicopter, rate.tick_s), bool(get("imu2.enabled"))
    return SensorKernel(imu, mag, baro, _gps(get, rate), rotor, imu2)


def _imu(get: _Get, helicopter: HelicopterParameters, tick_s: float) -> ImuKernel:
    root_rate, root_tick = math.sqrt(1.0 / tick_s), math.sqrt(tick_s)
    return ImuKernel(
        gyro_white=get("imu.gyro_noise_density") * root_rate,
        accel_white=get("imu.accel_noise_density") * root_rate,
        gyro_walk=get("imu.gyro_bias_walk") * root_tick,
        accel_walk=get("imu.accel_bias_walk") * root_tick,
        gyro_bias=get("imu.gyro_bias_sigma_radps"),
        accel_bias=get("imu.accel_bias_sigma_mps2"),
        errors=_imu_errors(get, helicopter, tick_s),
    )


def _imu_errors(get: _Get, helicopter: HelicopterParameters, tick_s: float) -> ImuErrorKernel:
    def six(name: str) -> Any:
        force, rate = get(f"imu.vibration.{name}_mps2"), get(f"imu.vibration.{name}_radps")
        return np.concatenate([np.asarray(force, float), np.asarray(rate, float)])

    rev, blade = six("rev"), six("blade")
    vibration = VibrationKernel(
        bool(rev.any() or blade.any()),
        rev,
        blade,
        float(helicopter.main_blades),
        get("imu.average_s"),
        get("imu.lowpass_hz"),
    )
    kinds = ("accel", "gyro")
    gain_sigma = np.empty((2, 3, 3))
    for sensor, kind in enumerate(kinds):
        gain_sigma[sensor] = get(f"imu.{kind}_misalignment_rad")
        np.fill_diagonal(gain_sigma[sensor], get(f"imu.{kind}_scale_sigma"))
    limits = np.array([get("imu.accel_range_mps2"), get("imu.gyro_range_radps")])
    ranges = np.repeat(np.where(limits > 0.0, limits, np.inf), 3)
    clock_s = get("imu.clock_jitter_s")
    on = vibration.on or clock_s > 0.0 or gain_sigma.any() or (limits > 0.0).any()
    return ImuErrorKernel(bool(on), vibration, clock_s, ranges, gain_sigma, tick_s)


def _power_field(get: _Get) -> PowerFieldKernel:
    field = np.array(get("mag.power_field_t_per_w"), dtype=np.float64)
    return PowerFieldKernel(bool(field.any()), field)


def _port(get: _Get, helicopter: HelicopterParameters) -> PortKernel:
    wind = np.array(get("baro.wind_coefficients"), dtype=np.float64)
    wash = get("baro.wash_coefficient")
    on = bool(wind.any() or wash != 0.0)
    return PortKernel(on, wind, wash, 0.5 * helicopter.air_density_kgpm3)


def _gps(get: _Get, rate: Rate) -> GpsKernel:
    axes = np.array([1.0, 1.0, get("gps.vertical_factor")])
    lost_s, found_s = get("gps.outage.from_s"), get("gps.outage.until_s")
    return GpsKernel(
        get("gps.white_m") * axes,
        get("gps.drift_m") * axes,
        math.exp(-get("gps.period_ticks") * TICK_S / get("gps.drift_tau_s")),
        get("gps.velocity_mps"),
        rate.of(get("gps.period_ticks")),
        rate.of(get("gps.latency_ticks")),
        rate.of(round(lost_s / TICK_S)) if lost_s >= 0.0 else _NEVER,
        rate.of(round(found_s / TICK_S)) if found_s >= 0.0 else _NEVER,
        _gps_errors(get, axes),
    )


def _gps_errors(get: _Get, axes: Any) -> GpsErrorKernel:
    period_s = get("gps.period_ticks") * TICK_S
    multipath, jump = get("gps.multipath.sigma_m"), get("gps.jump.sigma_m")
    satellites, blocked = get("gps.satellites.open"), get("gps.satellites.blocked")
    blocked_s, latency_s = get("gps.satellites.blocked_s"), get("gps.latency_jitter_s")
    # All may be blocked: what comes and goes in a period must still be a probability.
    least_s = (satellites + blocked) * period_s
    if blocked > 0.0 and blocked_s < least_s:
        raise PlantConfigError(
            f"sensors.gps.satellites.blocked_s: {blocked_s:g} is not allowed; allowed: at least "
            f"{least_s:g}, (open + blocked) times the period of the fixes"
        )
    between_s, out_s = get("gps.outage.interval_s"), get("gps.outage.duration_s")
    begin = end = 0.0
    if between_s > 0.0:
        # a two-state chain in continuous time, sampled once a period
        rates = 1.0 / between_s + 1.0 / out_s
        moved = -math.expm1(-rates * period_s) / rates
        begin, end = moved / between_s, moved / out_s
    on = multipath > 0.0 or jump > 0.0 or blocked > 0.0 or between_s > 0.0 or latency_s > 0.0
    return GpsErrorKernel(
        on,
        multipath * axes,
        math.exp(-period_s / get("gps.multipath.tau_s")),
        satellites,
        blocked,
        blocked / blocked_s * period_s,
        period_s / blocked_s if blocked > 0.0 else 0.0,
        begin,
        end,
        -math.expm1(-period_s / get("gps.jump.interval_s")) if jump > 0.0 else 0.0,
        jump * axes,
        latency_s,
    )


def message_variances(v: Mapping[str, Any]) -> tuple[tuple[Any, ...], ...]:
    """What the sensors' messages say of their errors: per group of numbers, SI^2.

    Parameters
    ----------
    v : mapping
        Parameters of the plant.

    Returns
    -------
    tuple of tuple
        Of IMU, magnetometer, barometer, fix and its velocity; a group with three variances has one
        per axis.
    """
    tick_s = Rate.of_parameters(v).tick_s
    gyro, accel = v["sensors.imu.gyro_noise_density"], v["sensors.imu.accel_noise_density"]
    level = v["sensors.gps.white_m"] ** 2 + v["sensors.gps.drift_m"] ** 2
    if v["sensors.gps.covariance"] == "honest":
        level += v["sensors.gps.multipath.sigma_m"] ** 2 + v["sensors.gps.jump.sigma_m"] ** 2
    return (
        (gyro**2 / tick_s, accel**2 / tick_s),
        (v["sensors.mag.white_t"] ** 2,),
        (v["sensors.baro.white_pa"] ** 2,),
        ((level, level, level * v["sensors.gps.vertical_factor"] ** 2),),
        (v["sensors.gps.velocity_mps"] ** 2,),
    )
