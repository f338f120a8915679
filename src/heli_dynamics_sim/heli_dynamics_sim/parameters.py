# SPDX-License-Identifier: Apache-2.0
"""The parameters of the plant's sensors; their values stand in config/plant.yaml."""

from typing import Any

from heli_core.parameters import Parameter
from heli_core.sensors import PLAIN, SampledSensor
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import MEANINGS, ModelOptions

# -------------------------------------------------------------------------------------------------
# Rows of the plant's parameter table, built by kind.
# -------------------------------------------------------------------------------------------------


def row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    """Row that is read when the plant is configured; only gusts and faults may come in flight."""
    fixed = not name.startswith("wind.gust.") and name != "faults"
    return Parameter(name, kind, description, unit, read_only=fixed, **rest)


def ticks(name: str, description: str, lower: int, upper: int) -> Parameter:
    """Row of a number of ticks."""
    return row(name, "int", description, "ticks", lower=lower, upper=upper)


def real(
    name: str,
    description: str,
    unit: str,
    lower: float,
    upper: float,
    shape: tuple[int | None, ...] | None = None,
    **rest: Any,
) -> Parameter:
    """Row of a real number, or of an array of them if it has a shape."""
    kind = "double" if shape is None else "double[]"
    return row(name, kind, description, unit, lower=lower, upper=upper, shape=shape, **rest)


# -------------------------------------------------------------------------------------------------
# Sensor table.
# -------------------------------------------------------------------------------------------------


def _amplitude(name: str, description: str, unit: str, upper: float) -> Parameter:
    name = f"sensors.imu.vibration.{name}"
    return real(name, description, unit, 0.0, upper, (3,))


def _lever_arm(sensor: str, words: str) -> Parameter:
    name = f"sensors.{sensor}.lever_arm_m"
    return real(name, f"Place of the {words} from the centre of gravity, body FRD", "m",
                -2.0, 2.0, (3,))  # fmt: skip


def _plain(sensor: SampledSensor) -> tuple[Parameter, ...]:
    """Rows of a sensor of `heli_core.sensors.PLAIN`."""
    name, unit, most = f"sensors.{sensor.name}", sensor.unit, sensor.most_noise
    return (
        real(f"{name}.white_{sensor.suffix}", "White noise of a sample", unit, 0.0, most),
        real(f"{name}.step_{sensor.suffix}", "Step of what it says; 0: none", unit, 0.0, most),
        ticks(f"{name}.period_ticks", "Sampling period", 1, 100),
    )


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
    row("sensors.imu.lowpass_motion", "bool", "The motion goes through that low-pass, too: delay"),
    real("sensors.imu.clock_jitter_s", "Instant of sampling about the stamp", "s", 0.0, 0.005),
    _amplitude("rev_mps2", "Acceleration at 1/rev, each axis", "m/s2", 500.0),
    _amplitude("rev_radps", "Rate at 1/rev, each axis", "rad/s", 50.0),
    _amplitude("blade_mps2", "Acceleration at N/rev, each axis", "m/s2", 500.0),
    _amplitude("blade_radps", "Rate at N/rev, each axis", "rad/s", 50.0),
    _lever_arm("imu", "IMU"),
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
    *(parameter for sensor in PLAIN for parameter in _plain(sensor)),
    real("sensors.gps.white_m", "White position error, horizontal", "m", 0.0, 100.0),
    real("sensors.gps.drift_m", "Slow position drift, horizontal sigma", "m", 0.0, 100.0),
    real("sensors.gps.drift_tau_s", "Time constant of the drift", "s", 1.0, 1e6),
    real("sensors.gps.vertical_factor", "Vertical over horizontal position error", "", 0.0, 10.0),
    real("sensors.gps.velocity_mps", "White velocity error per axis", "m/s", 0.0, 10.0),
    ticks("sensors.gps.period_ticks", "Period of the fixes", 1, 1000),
    ticks("sensors.gps.latency_ticks", "Age of a fix on arrival", 0, 1000),
    real("sensors.gps.latency_jitter_s", "Instant of validity about the stamp", "s", 0.0, 0.2),
    _lever_arm("gps", "GPS antenna"),
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
    real("sensors.gps.jump.duration_s", "Mean length; 0: until the next", "s", 0.0, 1e6),
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


# -------------------------------------------------------------------------------------------------
# The parameters of the plant's wind; their values stand in config/plant.yaml.
# -------------------------------------------------------------------------------------------------

WIND: tuple[Parameter, ...] = (
    real(
        "wind.towards_deg", "Direction the air moves to, from north over east", "deg", -360.0, 360.0
    ),
    row("wind.profile", "string", "Steady wind over altitude", choices=("table", "log")),
    real(
        "wind.profile_altitude_m",
        "Altitudes of the table of the steady wind",
        "m",
        0.0,
        1e4,
        (None,),
    ),
    real("wind.profile_speed_mps", "Steady wind at these altitudes", "m/s", 0.0, 30.0, (None,)),
    real("wind.roughness_m", "Height z0 at which the log profile ends", "m", 1e-4, 2.0),
    row("wind.turbulence", "bool", "Dryden turbulence"),
    row(
        "wind.spectrum",
        "string",
        "Standard of the turbulence; the two agree below 1000 ft",
        choices=("mil_f_8785c", "mil_hdbk_1797"),
    ),
    row("wind.rotation", "bool", "Rotational gusts p, q, r of the standard"),
    real(
        "wind.w20_mps",
        "Wind at 20 ft that scales turbulence, log profile, random gusts; negative: the table's",
        "m/s",
        -1.0,
        30.0,
    ),
    real("wind.airspeed_floor_mps", "Least speed at which turbulence passes", "m/s", 0.1, 30.0),
    row("wind.parts.main", "bool", "The main rotor meets the air at its hub"),
    row("wind.parts.tail", "bool", "Tail rotor and fins meet the air at the tail"),
    row("wind.parts.fuselage", "bool", "The fuselage meets the mean of the air over its length"),
    real(
        "wind.random_gusts.rate_per_min",
        "Random gusts per minute without one; 0: none",
        "1/min",
        0.0,
        60.0,
    ),
    real(
        "wind.random_gusts.amplitude_w20",
        "Least and largest peak of a random gust, share of the wind at 20 ft",
        "",
        0.0,
        3.0,
        (2,),
    ),
    real(
        "wind.random_gusts.duration_s",
        "Least and largest length of a random gust",
        "s",
        TICK_S,
        1e3,
        (2,),
    ),
    real(
        "wind.random_gusts.spread_deg",
        "Largest angle between a random gust and the mean wind",
        "deg",
        0.0,
        180.0,
    ),
    real("wind.gust.start_s", "Start of each 1-cosine gust, flight time", "s", 0.0, 1e6, (None,)),
    real("wind.gust.duration_s", "Length of each gust", "s", TICK_S, 1e4, (None,)),
    real(
        "wind.gust.amplitude_mps",
        "Peak velocity of the air of each gust",
        "m/s",
        -30.0,
        30.0,
        (None, 3),
    ),
    row("wind.gust.frame", "string", "Axes of the gusts' amplitudes", choices=("ned", "body")),
    real(
        "wind.sines.frequency_hz",
        "Lines of the gusts injected for identification",
        "Hz",
        0.0,
        50.0,
        (None,),
        lower_open=True,
    ),
    real(
        "wind.sines.amplitude_mps",
        "Amplitude of each line on the three axes",
        "m/s",
        -30.0,
        30.0,
        (None, 3),
    ),
    real(
        "wind.sines.phase_rad",
        "Phase of each line on the three axes",
        "rad",
        -10.0,
        10.0,
        (None, 3),
    ),
    real("wind.sines.start_s", "Flight time of the start", "s", 0.0, 1e6),
    real("wind.sines.duration_s", "Length with both fades", "s", 0.0, 1e6),
    real("wind.sines.fade_s", "Length of a fade", "s", 0.0, 600.0),
    row("wind.sines.frame", "string", "Axes of the lines' amplitudes", choices=("ned", "body")),
)


# -------------------------------------------------------------------------------------------------
# The plant's parameters; their values stand in config/plant.yaml.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "plant"

_NODE = (
    row("aircraft_file", "string", "Aircraft: a path, or a bare name in config/aircraft"),
    row(
        "linear_model",
        "string",
        "Linear aircraft that flies instead: a path, or a name in config/linear; empty: none",
    ),
    row("seed", "int", "Seed of wind and sensors", lower=0, upper=2**31 - 1),
    row("lockstep", "bool", "Wait for each command (true) or follow the wall clock (false)"),
    real("duration_s", "Length of the flight", "s", TICK_S, 86400.0),
    ticks("delay_ticks", "Transport delay of the commands", 0, 50),
    row("clock", "string", "Who sends /clock", choices=("own", "world")),
)

_FALLBACK = (
    real("actuator_timeout_s", "Real time: without a command for so long the fallback flies", "s",
         0.02, 10.0),
    real("fallback.mean_s", "Time over which commands are averaged to the trim it flies", "s",
         0.1, 60.0),
    real("fallback.blend_s", "Time in which a command takes over from another", "s", 0.01, 5.0),
    real("fallback.rate", "Gains on the measured p, q, r, of d_lat, d_lon, d_ped", "s/rad",
         -2.0, 2.0, (3,)),
    real("fallback.angle", "Gains on how far it has turned, of d_lat, d_lon, d_ped", "1/rad",
         -5.0, 5.0, (3,)),
)  # fmt: skip

_SCENE = (
    real("initial.pos_ned_m", "Position at the start", "m", -1e5, 1e5, (3,)),
    real("initial.psi_deg", "Heading at the start", "deg", -360.0, 360.0),
    row(
        "initial.trim",
        "string",
        "Air in which the start is in equilibrium",
        choices=("mean_wind", "still_air"),
    ),
    ticks("initial.pilot_ticks", "So long the controls rest in the trim of the start", 0, 1000),
    real("initial.wind_onset_s", "Time over which the air begins to move", "s", 0.0, 60.0),
    row("start.on_ground", "bool", "The flight begins on the skids, not in hover"),
    real("start.spool_up_s", "Time that the rotor takes from rest; 0: it turns", "s", 0.0, 120.0),
    real("ground.slope", "Rise of the ground per metre, to north and east", "1", -0.5, 0.5, (2,)),
    real(
        "ground.idle_collective",
        "Collective at which the aircraft stands at the start",
        "",
        -1.0,
        1.0,
        lower_open=True,
        upper_open=True,
    ),
    real("limits.distance_m", "Distance from the start that counts as lost", "m", 1.0, 1e5),
    real("limits.tilt_deg", "Tilt that counts as rolled over", "deg", 10.0, 180.0),
)


def _scale(name: str, description: str) -> Parameter:
    return real(f"scale.{name}", description, "1", 0.2, 5.0)


_SCALE = (
    _scale("mass", "Mass that flies over that of the aircraft file"),
    _scale("inertia", "Inertias that fly over those of the file"),
    _scale("rotor_stiffness", "Hub stiffness that flies over that of the file"),
    _scale("thrust", "Main rotor thrust per blade pitch over that of the file"),
    _scale("servo_speed", "Bandwidth and rate limit of the servos over those of the file"),
    _scale("drag", "Drag areas of the fuselage that fly over those of the file"),
)

_TERMS = (
    *(row(f"terms.{name}", "bool", MEANINGS[name]) for name in ModelOptions._fields),
    real(
        "engine.fail_time_s",
        "Flight time at which the engine fails; negative: never",
        "s",
        -1.0,
        86400.0,
    ),
)

_FAULTS = (row("faults", "string[]", "Faults of sensors and actuators, gusts; none: no fault"),)

TABLE: tuple[Parameter, ...] = (
    _NODE + _FALLBACK + _SCENE + _SCALE + _TERMS + WIND + SENSORS + _FAULTS
)
