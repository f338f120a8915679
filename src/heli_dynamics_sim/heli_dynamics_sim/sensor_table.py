# SPDX-License-Identifier: Apache-2.0
"""The parameters of the plant's sensors; their values stand in config/plant.yaml."""

from heli_dynamics_sim.parameter_row import real, row, ticks
from heli_parameters.parameters import Parameter


def _amplitude(name: str, description: str, unit: str, upper: float) -> Parameter:
    name = f"sensors.imu.vibration.{name}"
    return real(name, description, unit, 0.0, upper, (3,))


SENSORS: tuple[Parameter, ...] = (
    real("sensors.imu.gyro_noise_density", "White noise of the gyros", "rad/s/sqrt(Hz)", 0.0, 0.1),
    real(
        "sensors.imu.gyro_bias_walk", "Random walk of the gyro biases", "rad/s/sqrt(s)", 0.0, 0.01
    ),
    real("sensors.imu.gyro_bias_sigma_radps", "Gyro bias at the start", "rad/s", 0.0, 0.1),
    real(
        "sensors.imu.accel_noise_density",
        "White noise of the accelerometers",
        "m/s2/sqrt(Hz)",
        0.0,
        1.0,
    ),
    real(
        "sensors.imu.accel_bias_walk",
        "Random walk of the accelerometer biases",
        "m/s2/sqrt(s)",
        0.0,
        0.1,
    ),
    real("sensors.imu.accel_bias_sigma_mps2", "Accelerometer bias at the start", "m/s2", 0.0, 1.0),
    real("sensors.imu.gyro_scale_sigma", "Scale factor error of each gyro", "1", 0.0, 0.2),
    real(
        "sensors.imu.accel_scale_sigma", "Scale factor error of each accelerometer", "1", 0.0, 0.2
    ),
    real("sensors.imu.gyro_misalignment_rad", "Misalignment of a gyro's axis", "rad", 0.0, 0.2),
    real("sensors.imu.accel_misalignment_rad", "The same of an accelerometer", "rad", 0.0, 0.2),
    real("sensors.imu.gyro_range_radps", "Range of the gyros; 0: no limit", "rad/s", 0.0, 1000.0),
    real(
        "sensors.imu.accel_range_mps2", "Range of the accelerometers; 0: no limit", "m/s2", 0.0, 1e4
    ),
    real("sensors.imu.average_s", "Vibration: IMU averages over; 0: not", "s", 0.0, 0.1),
    real("sensors.imu.lowpass_hz", "Vibration: IMU's low-pass; 0: none", "Hz", 0.0, 1e4),
    real("sensors.imu.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.0, 0.005),
    _amplitude("rev_mps2", "Acceleration at 1/rev, each axis", "m/s2", 500.0),
    _amplitude("rev_radps", "Rate at 1/rev, each axis", "rad/s", 50.0),
    _amplitude("blade_mps2", "Acceleration at N/rev, each axis", "m/s2", 500.0),
    _amplitude("blade_radps", "Rate at N/rev, each axis", "rad/s", 50.0),
    row("sensors.imu2.enabled", "bool", "Whether there is a second IMU of the same kind"),
    real("sensors.mag.field_ned_t", "Local magnetic field, NED", "T", -1e-4, 1e-4, (3,)),
    real("sensors.mag.hard_iron_t", "Constant offset, body", "T", -1e-4, 1e-4, (3,)),
    real("sensors.mag.soft_iron", "Distortion of the field, body", "", -2.0, 2.0, (3, 3)),
    real("sensors.mag.white_t", "White noise of a sample", "T", 0.0, 1e-5),
    real("sensors.mag.hard_iron_sigma_t", "Offset of a flight's own, each axis", "T", 0.0, 1e-4),
    real("sensors.mag.soft_iron_sigma", "Distortion of a flight's own, each entry", "1", 0.0, 0.5),
    real(
        "sensors.mag.power_field_t_per_w",
        "Field of the drive's currents over the main rotor's power, body",
        "T/W",
        -1e-6,
        1e-6,
        (3,),
    ),
    real("sensors.mag.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.0, 0.02),
    ticks("sensors.mag.period_ticks", "Sampling period", 1, 1000),
    real("sensors.baro.white_pa", "White noise of a sample", "Pa", 0.0, 1000.0),
    real("sensors.baro.drift_pa", "Slow drift, sigma", "Pa", 0.0, 1000.0),
    real("sensors.baro.drift_tau_s", "Time constant of the drift", "s", 1.0, 1e6),
    ticks("sensors.baro.period_ticks", "Sampling period", 1, 1000),
    real("sensors.baro.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.0, 0.05),
    real(
        "sensors.baro.wind_coefficients",
        "Pressure error over dynamic pressure: air from the front, back, right, left, along z",
        "1",
        -2.0,
        2.0,
        (5,),
    ),
    real(
        "sensors.baro.wash_coefficient",
        "Pressure error over that of the main rotor's induced velocity",
        "1",
        -3.0,
        3.0,
    ),
    real("sensors.rotor_speed.white_radps", "White noise of a sample", "rad/s", 0.0, 10.0),
    real("sensors.rotor_speed.step_radps", "Step of what it says; 0: none", "rad/s", 0.0, 10.0),
    ticks("sensors.rotor_speed.period_ticks", "Sampling period", 1, 100),
    real("sensors.gps.white_m", "White position error, horizontal", "m", 0.0, 100.0),
    real("sensors.gps.drift_m", "Slow position drift, horizontal sigma", "m", 0.0, 100.0),
    real("sensors.gps.drift_tau_s", "Time constant of the drift", "s", 1.0, 1e6),
    real("sensors.gps.vertical_factor", "Vertical over horizontal position error", "", 0.0, 10.0),
    real("sensors.gps.velocity_mps", "White velocity error per axis", "m/s", 0.0, 10.0),
    ticks("sensors.gps.period_ticks", "Period of the fixes", 1, 1000),
    ticks("sensors.gps.latency_ticks", "Age of a fix on arrival", 0, 1000),
    real("sensors.gps.latency_jitter_s", "Instant of validity about the stamp", "s", 0.0, 0.2),
    real("sensors.gps.multipath.sigma_m", "Multipath error, horizontal", "m", 0.0, 100.0),
    real("sensors.gps.multipath.tau_s", "Time constant of the multipath", "s", 0.1, 1e5),
    row("sensors.gps.satellites.open", "int", "Satellites in the open", lower=4, upper=60),
    real(
        "sensors.gps.satellites.blocked", "How many of them are blocked on average", "1", 0.0, 40.0
    ),
    real("sensors.gps.satellites.blocked_s", "Mean time for which one is blocked", "s", 0.1, 1e5),
    real("sensors.gps.outage.interval_s", "Mean time between outages; 0: none", "s", 0.0, 1e6),
    real("sensors.gps.outage.duration_s", "Mean length of an outage", "s", 0.01, 1e5),
    real(
        "sensors.gps.outage.from_s",
        "Flight time of the last fix; negative: they go on",
        "s",
        -1.0,
        86400.0,
    ),
    real(
        "sensors.gps.outage.until_s",
        "Flight time from which on there are fixes again after that; negative: never",
        "s",
        -1.0,
        86400.0,
    ),
    real("sensors.gps.jump.sigma_m", "Error that jumps, horizontal", "m", 0.0, 100.0),
    real("sensors.gps.jump.interval_s", "Mean time between jumps", "s", 0.1, 1e6),
    row(
        "sensors.gps.covariance",
        "string",
        "Whether the messages' covariance knows of multipath and jumps",
        choices=("honest", "receiver"),
    ),
    row(
        "sensors.gps.augmentation",
        "string",
        "What corrects the fixes, for the status in their messages",
        choices=("none", "satellite", "ground"),
    ),
)
