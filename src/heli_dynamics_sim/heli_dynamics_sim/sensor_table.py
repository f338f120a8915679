# SPDX-License-Identifier: Apache-2.0
"""The parameters of the plant's sensors; their values stand in config/plant.yaml."""

from typing import Any

from heli_parameters.parameters import Parameter


def _row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    # Read when the plant is configured.
    return Parameter(name, kind, description, unit, read_only=True, **rest)


def _sigma(name: str, description: str, unit: str, upper: float) -> Parameter:
    return _row(name, "double", description, unit, lower=0.0, upper=upper)


def _ticks(name: str, description: str, lower: int, upper: int) -> Parameter:
    return _row(name, "int", description, "ticks", lower=lower, upper=upper)


def _amplitude(name: str, description: str, unit: str, upper: float) -> Parameter:
    name = f"sensors.imu.vibration.{name}"
    return _row(name, "double[]", description, unit, shape=(3,), lower=0.0, upper=upper)


SENSORS: tuple[Parameter, ...] = (
    _sigma("sensors.imu.gyro_noise_density", "White noise of the gyros", "rad/s/sqrt(Hz)", 0.1),
    _sigma("sensors.imu.gyro_bias_walk", "Random walk of the gyro biases", "rad/s/sqrt(s)", 0.01),
    _sigma("sensors.imu.gyro_bias_sigma_radps", "Gyro bias at the start", "rad/s", 0.1),
    _sigma(
        "sensors.imu.accel_noise_density", "White noise of the accelerometers", "m/s2/sqrt(Hz)", 1.0
    ),
    _sigma(
        "sensors.imu.accel_bias_walk",
        "Random walk of the accelerometer biases",
        "m/s2/sqrt(s)",
        0.1,
    ),
    _sigma("sensors.imu.accel_bias_sigma_mps2", "Accelerometer bias at the start", "m/s2", 1.0),
    _sigma("sensors.imu.gyro_scale_sigma", "Scale factor error of each gyro", "1", 0.2),
    _sigma("sensors.imu.accel_scale_sigma", "Scale factor error of each accelerometer", "1", 0.2),
    _sigma("sensors.imu.gyro_misalignment_rad", "Misalignment of a gyro's axis", "rad", 0.2),
    _sigma("sensors.imu.accel_misalignment_rad", "The same of an accelerometer", "rad", 0.2),
    _sigma("sensors.imu.gyro_range_radps", "Range of the gyros; 0: no limit", "rad/s", 1000.0),
    _sigma("sensors.imu.accel_range_mps2", "Range of the accelerometers; 0: no limit", "m/s2", 1e4),
    _sigma("sensors.imu.average_s", "Vibration: IMU averages over; 0: not", "s", 0.1),
    _sigma("sensors.imu.lowpass_hz", "Vibration: IMU's low-pass; 0: none", "Hz", 1e4),
    _sigma("sensors.imu.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.005),
    _amplitude("rev_mps2", "Acceleration at 1/rev, each axis", "m/s2", 500.0),
    _amplitude("rev_radps", "Rate at 1/rev, each axis", "rad/s", 50.0),
    _amplitude("blade_mps2", "Acceleration at N/rev, each axis", "m/s2", 500.0),
    _amplitude("blade_radps", "Rate at N/rev, each axis", "rad/s", 50.0),
    _row(
        "sensors.mag.field_ned_t",
        "double[]",
        "Local magnetic field, NED",
        "T",
        shape=(3,),
        lower=-1e-4,
        upper=1e-4,
    ),
    _row(
        "sensors.mag.hard_iron_t",
        "double[]",
        "Constant offset, body",
        "T",
        shape=(3,),
        lower=-1e-4,
        upper=1e-4,
    ),
    _row(
        "sensors.mag.soft_iron",
        "double[]",
        "Distortion of the field, body",
        "",
        shape=(3, 3),
        lower=-2.0,
        upper=2.0,
    ),
    _sigma("sensors.mag.white_t", "White noise of a sample", "T", 1e-5),
    _sigma("sensors.mag.hard_iron_sigma_t", "Offset of a flight's own, each axis", "T", 1e-4),
    _sigma("sensors.mag.soft_iron_sigma", "Distortion of a flight's own, each entry", "1", 0.5),
    _row(
        "sensors.mag.power_field_t_per_w",
        "double[]",
        "Field of the drive's currents over the main rotor's power, body",
        "T/W",
        shape=(3,),
        lower=-1e-6,
        upper=1e-6,
    ),
    _sigma("sensors.mag.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.02),
    _ticks("sensors.mag.period_ticks", "Sampling period", 1, 1000),
    _sigma("sensors.baro.white_pa", "White noise of a sample", "Pa", 1000.0),
    _sigma("sensors.baro.drift_pa", "Slow drift, sigma", "Pa", 1000.0),
    _row(
        "sensors.baro.drift_tau_s",
        "double",
        "Time constant of the drift",
        "s",
        lower=1.0,
        upper=1e6,
    ),
    _ticks("sensors.baro.period_ticks", "Sampling period", 1, 1000),
    _sigma("sensors.baro.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.05),
    _row(
        "sensors.baro.wind_coefficients",
        "double[]",
        "Pressure error over dynamic pressure: air from the front, back, right, left, along z",
        "1",
        shape=(5,),
        lower=-2.0,
        upper=2.0,
    ),
    _row(
        "sensors.baro.wash_coefficient",
        "double",
        "Pressure error over that of the main rotor's induced velocity",
        "1",
        lower=-3.0,
        upper=3.0,
    ),
    _sigma("sensors.gps.white_m", "White position error, horizontal", "m", 100.0),
    _sigma("sensors.gps.drift_m", "Slow position drift, horizontal sigma", "m", 100.0),
    _row(
        "sensors.gps.drift_tau_s", "double", "Time constant of the drift", "s", lower=1.0, upper=1e6
    ),
    _row(
        "sensors.gps.vertical_factor",
        "double",
        "Vertical over horizontal position error",
        "",
        lower=0.0,
        upper=10.0,
    ),
    _sigma("sensors.gps.velocity_mps", "White velocity error per axis", "m/s", 10.0),
    _ticks("sensors.gps.period_ticks", "Period of the fixes", 1, 1000),
    _ticks("sensors.gps.latency_ticks", "Age of a fix on arrival", 0, 1000),
    _sigma("sensors.gps.latency_jitter_s", "Instant of validity about the stamp", "s", 0.2),
    _sigma("sensors.gps.multipath.sigma_m", "Multipath error, horizontal", "m", 100.0),
    _row(
        "sensors.gps.multipath.tau_s",
        "double",
        "Time constant of the multipath",
        "s",
        lower=0.1,
        upper=1e5,
    ),
    _row("sensors.gps.satellites.open", "int", "Satellites in the open", lower=4, upper=60),
    _sigma("sensors.gps.satellites.blocked", "How many of them are blocked on average", "1", 40.0),
    _row(
        "sensors.gps.satellites.blocked_s",
        "double",
        "Mean time for which one is blocked",
        "s",
        lower=0.1,
        upper=1e5,
    ),
    _sigma("sensors.gps.outage.interval_s", "Mean time between outages; 0: none", "s", 1e6),
    _row(
        "sensors.gps.outage.duration_s",
        "double",
        "Mean length of an outage",
        "s",
        lower=0.01,
        upper=1e5,
    ),
    _sigma("sensors.gps.jump.sigma_m", "Error that jumps, horizontal", "m", 100.0),
    _row(
        "sensors.gps.jump.interval_s",
        "double",
        "Mean time between jumps",
        "s",
        lower=0.1,
        upper=1e6,
    ),
    _row(
        "sensors.gps.covariance",
        "string",
        "Whether the messages' covariance knows of multipath and jumps",
        choices=("honest", "receiver"),
    ),
    _row(
        "sensors.gps.augmentation",
        "string",
        "What corrects the fixes, for the status in their messages",
        choices=("none", "satellite", "ground"),
    ),
)
