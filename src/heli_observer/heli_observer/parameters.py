# SPDX-License-Identifier: Apache-2.0
"""The observer's parameters; their values stand in config/observer.yaml."""

from typing import Any

from heli_core.parameters import Parameter
from heli_core.sensors import AIDS, SampledSensor

NODE_NAME = "observer"


def _row(name: str, kind: str, description: str, unit: str = "", **bounds: Any) -> Parameter:
    return Parameter(name, kind, description, unit, read_only=True, **bounds)


def _sigma(name: str, description: str, unit: str, upper: float) -> Parameter:
    return _row(name, "double", description, unit, lower=0.0, upper=upper, lower_open=True)


def _period(sensor: str) -> Parameter:
    return _row(f"schedule.{sensor}_period_ticks", "int", f"A {sensor} sample every so many ticks",
                "ticks", lower=1, upper=1000)  # fmt: skip


def _noise(sensor: SampledSensor) -> Parameter:
    name = f"ekf.{sensor.name}.noise_{sensor.suffix}"
    each = ", each axis" if sensor.numbers > 1 else ""
    return _sigma(name, f"White {sensor.quantity} error{each}", sensor.unit, sensor.most_noise)


def _lever_arm(sensor: str, words: str) -> Parameter:
    return _row(f"ekf.{sensor}.lever_arm_m", "double[]",
                f"Place of the {words} from the centre of gravity, body FRD", "m",
                shape=(3,), lower=-2.0, upper=2.0)  # fmt: skip


def _timeout(sensor: str) -> Parameter:
    return _row(f"ekf.timeout.{sensor}_s", "double", f"Longest time without an accepted {sensor}",
                "s", lower=0.02, upper=600.0)  # fmt: skip


TABLE: tuple[Parameter, ...] = (
    _row("lockstep", "bool", "Act on the set of messages of a tick instead of on arrival"),
    _period("imu"),
    *(_period(sensor.name) for sensor in AIDS),
    _period("gps"),
    _row("schedule.gps_latency_ticks", "int", "A fix comes so many ticks after it was true",
         "ticks", lower=0, upper=100),
    _row("ekf.horizon_ticks", "int", "The filter runs so many ticks behind; >= GPS latency",
         "ticks", lower=0, upper=100),
    _row("ekf.max_gap_ticks", "int", "Longer gaps in the ticks start a new alignment", "ticks",
         lower=1, upper=200),
    _row("ekf.gravity_mps2", "double", "Local gravity", "m/s2", lower=9.7, upper=9.9),
    _row("ekf.origin_altitude_m", "double", "Altitude of the NED origin", "m",
         lower=-500.0, upper=9000.0),
    _row("ekf.gate_probability", "double", "Part of good samples that every gate lets through", "",
         lower=0.5, upper=1.0, upper_open=True),
    _sigma("ekf.imu.gyro_noise_density", "Rate noise density", "rad/s/sqrt(Hz)", 1.0),
    _sigma("ekf.imu.gyro_bias_walk", "Rate bias random walk", "rad/s2/sqrt(Hz)", 1.0),
    _sigma("ekf.imu.accel_noise_density", "Specific force noise density", "m/s2/sqrt(Hz)", 10.0),
    _sigma("ekf.imu.accel_bias_walk", "Specific force bias random walk", "m/s3/sqrt(Hz)", 10.0),
    _sigma("ekf.imu.accel_limit_mps2", "Larger specific forces are not believed", "m/s2", 1e4),
    _sigma("ekf.imu.rate_limit_radps", "Larger rates are not believed", "rad/s", 1e3),
    _lever_arm("imu", "IMU"),
    _row("ekf.imu.delay_s", "double", "A sample is of the motion so long before its stamp", "s",
         lower=0.0, upper=0.05),
    _row("imu2.enabled", "bool", "Whether there is a second IMU, on imu2/data_raw"),
    _sigma("imu2.offset_mps2", "Largest lasting difference of two IMUs, each axis", "m/s2", 10.0),
    _sigma("imu2.offset_radps", "The same of their rates", "rad/s", 1.0),
    _sigma("imu2.apart_mps2", "Larger differences beside it are a fault of one", "m/s2", 10.0),
    _sigma("imu2.apart_radps", "The same of their rates", "rad/s", 1.0),
    _sigma("ekf.gps.position_horizontal_m", "White position error, each axis", "m", 100.0),
    _sigma("ekf.gps.position_vertical_m", "White height error", "m", 100.0),
    _sigma("ekf.gps.velocity_horizontal_mps", "White velocity error, each axis", "m/s", 100.0),
    _sigma("ekf.gps.velocity_vertical_mps", "White vertical velocity error", "m/s", 100.0),
    _row("ekf.gps.drift_horizontal_m", "double", "Slowly drifting position error, each axis", "m",
         lower=0.0, upper=100.0),
    _row("ekf.gps.drift_vertical_m", "double", "Slowly drifting height error", "m",
         lower=0.0, upper=100.0),
    _sigma("ekf.gps.drift_time_constant_s", "Correlation time of the drift", "s", 1e5),
    _lever_arm("gps", "GPS antenna"),
    *map(_noise, AIDS),
    _sigma("ekf.baro.bias_walk", "Pressure bias random walk", "Pa/s/sqrt(Hz)", 1e3),
    _row("ekf.mag.field_ned_t", "double[]", "Local magnetic field, north, east, down", "T",
         shape=(3,), lower=-1e-4, upper=1e-4),
    _row("ekf.mag.heading_error_rad", "double", "Slowly varying heading error (iron)", "rad",
         lower=0.0, upper=1.0),
    _sigma("ekf.mag.heading_error_time_constant_s", "Correlation time of that error", "s", 1e5),
    _row("ekf.mag.field_tolerance", "double", "Allowed deviation of the field strength", "",
         lower=0.01, upper=1.0),
    _row("ekf.mag.max_innovation_rad", "double", "Larger heading innovations are never fused",
         "rad", lower=0.01, upper=3.15),
    _row("ekf.motion.difference_rad", "double", "Heading that motion tells may differ by so much",
         "rad", lower=0.05, upper=3.15),
    _sigma("ekf.motion.sigma_rad", "It is known once its standard deviation is below", "rad", 0.5),
    _row("ekf.motion.hold_s", "double", "It is believed after it has differed for", "s",
         lower=0.2, upper=600.0),
    _sigma("ekf.initial.gyro_bias_radps", "Rate bias, each axis", "rad/s", 1.0),
    _sigma("ekf.initial.accel_bias_mps2", "Specific force bias, each axis", "m/s2", 10.0),
    _row("ekf.initial.align_ticks", "int", "Samples that the alignment waits for", "ticks",
         lower=0, upper=1000),
    _sigma("ekf.initial.level_rad", "Tilt error beside that of the bias", "rad", 1.0),
    _sigma("ekf.initial.heading_rad", "Heading error beside that of noise and tilt", "rad", 3.0),
    _row("ekf.initial.drift_at_alignment_fraction", "double",
         "0: position and sigma count from the alignment, 1: they are absolute; between: the part "
         "of the GPS drift's steady sigma that is taken for unknown at alignment",
         "", lower=0.0, upper=1.0, was="ekf.initial.gps_drift_fraction"),
    _timeout("imu"),
    _timeout("gps"),
    _row("ekf.timeout.gps_recovery_s", "double", "Fixes that were refused for so long are believed",
         "s", lower=0.02, upper=600.0),
    *(_timeout(sensor.name) for sensor in AIDS),
    _row("model.A", "double[]", "Hover model A of eq. (10), row by row", "", shape=(9, 9)),
    _row("model.B", "double[]", "Hover model B of eq. (10), row by row", "", shape=(9, 3)),
    _row("trim.x", "double[]", "Trim phi theta p q a_s b_s r d_int psi", "rad, rad/s", shape=(9,),
         lower=-10.0, upper=10.0),
    _row("trim.u", "double[]", "Trim d_lat d_lon d_ped d_col", "", shape=(4,), lower=-1.0,
         upper=1.0, lower_open=True, upper_open=True),
    _row("K", "double[]", "Gain of eq. (19), rows a_s b_s d_int, columns phi theta p q r psi", "",
         shape=(3, 6)),
    _row("u_delay_ticks", "int", "A command acts so many ticks after the tick it was computed",
         "ticks", lower=0, upper=2),
    _row("servo.frequency_radps", "double", "Natural frequency of the servos, 0: none", "rad/s",
         lower=0.0, upper=1000.0),
    _row("servo.damping", "double", "Damping ratio of the servos", "", lower=0.05, upper=5.0),
)  # fmt: skip
