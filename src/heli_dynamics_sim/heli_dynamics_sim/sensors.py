# SPDX-License-Identifier: Apache-2.0
"""Sensors: IMU, magnetometer, barometer, GPS, rotor speed. All in body FRD and NED, SI.

Every error is a function of the standard normals that are passed in. First-order Gauss-Markov
processes and random walks are stepped exactly. Noise, bias and drift are here; what sensors of some
grade have besides, off by default, in `imu_errors`, `gps_errors` and `installation`. A sample of a
sensor with a jittering clock is taken a little before or after its stamp, to first order.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.atmosphere import pressure_pa
from heli_core.jit import by_reference, fill, njit, referred, scratch
from heli_core.rows import AIR, IMU, MEAS, PLANT
from heli_core.sensors import PLACES, PLAIN, ROTOR_SPEED, place_of
from heli_dynamics_sim.airframe import (
    LeverArm,
    add_lever_acceleration,
    attitude_of,
    cross,
    fuselage_force,
    rates_of,
    to_body,
    to_ned,
    velocity_of,
)
from heli_dynamics_sim.engine import engine_torque
from heli_dynamics_sim.helicopter import (
    airspeed,
    airspeeds,
    angular_acceleration,
    is_off_nominal,
    main_rotor_power,
    off_nominal,
    specific_force,
)
from heli_dynamics_sim.main_rotor import rotor_flow
from heli_dynamics_sim.noise import NOISE

# -------------------------------------------------------------------------------------------------
# Errors of an IMU besides noise and bias: vibration, scale and misalignment, range, its clock.
#
# A sensor reads `clip((I + E) (motion + vibration) + bias + white)`; E has scale factors on its
# diagonal and misalignments beside it (Groves, Principles of GNSS, Inertial, and Multisensor
# Integrated Navigation Systems, 2nd ed. 2013, eq. 4.16 and 4.17).
#
# Vibration is what the rotor shakes: sines at one and at N per revolution (N blades) of the
# azimuth
# that the rotor has turned through (Bramwell, Helicopter Dynamics, 2nd ed. 2001, ch. 8: a rotor of
# N
# equal blades passes N/rev and its multiples on to the fuselage, unequal blades 1/rev). It is read
# at
# the ticks, so what lies above half their rate R comes back below: f is seen at |f - R round(f /
# R)|.
# The IMU's own filters see it before it is sampled: an average over some time T with the response
# |sin(pi f T)| / (pi f T), and a second-order Butterworth low-pass, 1 / sqrt(1 + (f / fc)^4).
#
# The aircraft flies below them, so they act on the vibration alone; but the low-pass delays its
# motion, too, by sqrt(2) / (2 pi fc) at low frequencies: 5.0 ms for 44.8 Hz, where the register map
# of the InvenSense MPU-9250 (ACCEL_CONFIG2, A_DLPFCFG 3) has 4.88 ms. Where that is asked for
# (`LowpassParams`), the motion goes through the filter, stepped exactly for an input on a straight
# line from tick to tick. The average never delays.
# -------------------------------------------------------------------------------------------------


@by_reference
class VibrationParams(NamedTuple):
    """Amplitudes at the IMU's case, before its filters; forces (m/s2), then rates (rad/s)."""

    on: bool
    rev: np.ndarray  # (6,) at 1/rev, places of `rows.IMU`
    blade: np.ndarray  # (6,) at N/rev
    blades: float  # N
    average_s: float  # 0: none
    lowpass_hz: float  # 0: none


@by_reference
class LowpassParams(NamedTuple):
    """One tick of the low-pass that the motion goes through: s+ = Phi s + g0 u(n-1) + g1 u(n)."""

    on: bool
    Phi: np.ndarray  # (2, 2) of the output and its slope
    g0: np.ndarray  # (2,)
    g1: np.ndarray  # (2,)


@by_reference
class ImuErrorParams(NamedTuple):
    """What `distort` and `clip` read, and what their state is drawn with."""

    on: bool
    vibration: VibrationParams
    clock_s: float  # sigma of the sampling instant about the stamp
    ranges: np.ndarray  # (6,) largest reading, infinite: no limit
    gain_sigma: np.ndarray  # (2, 3, 3) of E at the start: accelerometers, gyros
    tick_s: float  # between samples
    lowpass: LowpassParams


@by_reference
class ImuErrorState(NamedTuple):
    """What stays of these errors from tick to tick."""

    gain: np.ndarray  # (2, 3, 3) I + E of accelerometers and gyros
    azimuth: np.ndarray  # (1,) rad that the rotor has turned through, modulo a turn
    before: np.ndarray  # (6,) motion at the tick before, as it is sampled
    lowpass: np.ndarray  # (6, 3) input, output and its slope (1/s), of the motion's low-pass


@njit
def filter_gain(frequency_hz, k):
    """What the IMU's filters leave of a sine of this frequency; negative: its sign turns."""
    gain = 1.0
    phase = math.pi * frequency_hz * k.average_s
    if phase > 0.0:
        gain = math.sin(phase) / phase
    if k.lowpass_hz > 0.0:
        gain /= math.sqrt(1.0 + (frequency_hz / k.lowpass_hz) ** 4)
    return gain


@njit
def filter_motion(state, tick, k, motion):
    """Let the motion (6,) through the low-pass, in place; at tick 0 it has been there for long.

    state is an ImuErrorState, k a LowpassParams.
    """
    for i in range(IMU.size):
        axis, now = state.lowpass[i], motion[i]
        if tick == 0:
            axis[0], axis[1], axis[2] = now, now, 0.0
        was, out, slope = axis[0], axis[1], axis[2]
        for j in range(2):
            axis[1 + j] = k.Phi[j, 0] * out + k.Phi[j, 1] * slope + k.g0[j] * was + k.g1[j] * now
        axis[0], motion[i] = now, axis[1]


@njit
def _shake(azimuth, speed, k, motion):
    """Add the vibration at an azimuth (rad) and rotor speed (rad/s) to the motion (6,)."""
    turns_hz = speed / (2.0 * math.pi)
    rev, blade = filter_gain(turns_hz, k), filter_gain(k.blades * turns_hz, k)
    for i in range(IMU.size):
        # What is unequal turns with the rotor: the lateral axis follows the longitudinal one by
        # a quarter of a turn.
        quarter = 0.5 * math.pi if i % 3 == 1 else 0.0
        motion[i] += rev * k.rev[i] * math.cos(azimuth - quarter)
        motion[i] += blade * k.blade[i] * math.cos(k.blades * azimuth - quarter)


@njit
def distort(state, tick, speed, clock, k, motion):
    """Turn the true specific force and rates into what the sensors' elements put out.

    Parameters
    ----------
    state : ImuErrorState
        In place.
    tick : int
    speed : float
        Of the rotor, rad/s.
    clock : float
        Standard normal: the sample is `clock * clock_s` later than its stamp.
    k : ImuErrorParams
    motion : (6,) array
        True motion at the tick, places of `rows.IMU`; changed in place.
    """
    if tick > 0:
        state.azimuth[0] = (state.azimuth[0] + speed * k.tick_s) % (2.0 * math.pi)
    if k.lowpass.on:
        filter_motion(state, tick, k.lowpass, motion)
    late_s = clock * k.clock_s
    for i in range(IMU.size):
        true = motion[i]
        if tick > 0:
            motion[i] += late_s / k.tick_s * (true - state.before[i])
        state.before[i] = true
    if k.vibration.on:
        _shake(state.azimuth[0] + speed * late_s, speed, k.vibration, motion)
    for sensor in range(2):
        gain, first = state.gain[sensor], 3 * sensor
        a, b, c = motion[first], motion[first + 1], motion[first + 2]
        for i in range(3):
            motion[first + i] = gain[i, 0] * a + gain[i, 1] * b + gain[i, 2] * c


@njit
def clip(k, motion):
    """Cut the readings (6,) at the sensors' ranges, in place."""
    for i in range(IMU.size):
        motion[i] = min(max(motion[i], -k.ranges[i]), k.ranges[i])


# -------------------------------------------------------------------------------------------------
# Errors of a GPS receiver besides noise and drift: multipath, satellites, outages, jumps, timing.
#
# Stepped once per fix, each exactly, from standard normals:
#
# - Multipath is a first-order Gauss-Markov process per axis, as integrity studies bound it
# (Gallon,
#   Joerger, Pervan, NAVIGATION 69(1) 2022: sigma 0.5 m of code, 5 mm of carrier at the zenith,
#   time
#   constant 10 to 900 s).
# - Satellites are blocked one by one, at a constant rate, each for an exponential time: the
# chain's
#   stationary distribution is Poisson's (M/M/inf queue; Kleinrock, Queueing Systems 1, 1975, sec.
#   3.4), cut off at the number in the open. White error, multipath and velocity error grow as
#   sqrt(open / used), the least-squares law for ranges of equal quality in an unchanged geometry
#   (Langley, Dilution of Precision, GPS World 10(5), 1999). Fewer than 4 give no fix.
# - Outages begin and end at constant rates: a two-state Markov chain.
# - Jumps: at the instants of a Poisson process the position gets another constant error, drawn
# anew.
#   It stays until the next one (other satellites), or ends at a constant rate (a wrong set of
#   ambiguities, which the receiver's own check then refuses): the chain of the outages.
# - Timing: the fix was true a little before or after its stamp. That is how jitter of the latency
#   enters where the receiver's pulse does not set the host's clock: the host takes the nominal age
#   (PX4's EKF2_GPS_DELAY, ArduPilot's GPS1_DELAY_MS).
# -------------------------------------------------------------------------------------------------

FEWEST_SATELLITES = 4
"""Three coordinates and the receiver's clock."""


@by_reference
class GpsErrorParams(NamedTuple):
    """Per fix, not per second."""

    on: bool
    multipath_m: np.ndarray  # (3,) NED, sigma with all satellites in the open
    multipath_decay: float
    satellites: int  # in the open
    blocked: float  # of them on average
    block: float  # probability that one more is blocked
    release: float  # probability per blocked one that it comes back
    outage_begin: float  # probability
    outage_end: float  # probability
    jump: float  # probability; of one that ends, while there is none
    jump_end: float  # probability that one ends; 0.0: they stay until the next one
    jump_at_start: float  # probability that there is one
    jump_m: np.ndarray  # (3,) NED, sigma
    latency_s: float  # sigma of the instant of validity about the stamp


@by_reference
class GpsErrorState(NamedTuple):
    """What stays from fix to fix."""

    multipath: np.ndarray  # (3,) NED, m, with all satellites in the open
    jump: np.ndarray  # (3,) NED, m; zeros: there is none
    blocked: np.ndarray  # (1,) satellites
    out: np.ndarray  # (1,) 1.0 in an outage


@njit
def uniform(n):
    """Number uniform in (0, 1) of a standard normal."""
    return 0.5 * math.erfc(-n / math.sqrt(2.0))


@njit
def dilution(state, k):
    """How many times larger the errors are than with all satellites; infinite: no fix."""
    used = k.satellites - state.blocked[0]
    if used < FEWEST_SATELLITES or state.out[0] > 0.0:
        return math.inf
    return math.sqrt(k.satellites / used)


@njit
def step_gps_errors(state, noise, k):
    """Bring multipath, satellites, outage and jump to the next fix.

    Parameters
    ----------
    state : GpsErrorState
        In place.
    noise : (n,) array
        Standard normals of the tick, places of `noise.NOISE`.
    k : GpsErrorParams
    """
    fresh, jumped = noise[NOISE.gps_multipath], noise[NOISE.gps_jump]
    kept = math.sqrt(1.0 - k.multipath_decay * k.multipath_decay)
    draw = uniform(noise[NOISE.gps_jump_now])
    lasts = k.jump_end > 0.0 and state.jump[0] != 0.0
    jumps, ends = not lasts and draw < k.jump, lasts and draw < k.jump_end
    for i in range(3):
        state.multipath[i] *= k.multipath_decay
        state.multipath[i] += kept * k.multipath_m[i] * fresh[i]
        if jumps:
            state.jump[i] = k.jump_m[i] * jumped[i]
        elif ends:
            state.jump[i] = 0.0
    draw, blocked = uniform(noise[NOISE.gps_satellites]), state.blocked[0]
    if draw < k.block:
        state.blocked[0] = min(blocked + 1.0, float(k.satellites))
    elif draw > 1.0 - k.release * blocked:
        state.blocked[0] = blocked - 1.0
    draw = uniform(noise[NOISE.gps_outage])
    if state.out[0] > 0.0:
        state.out[0] = 0.0 if draw < k.outage_end else 1.0
    else:
        state.out[0] = 1.0 if draw < k.outage_begin else 0.0


@njit
def spoil_fix(state, noise, gps, velocity, pos, vel):
    """Add these errors to a fix that has noise and drift already. False: there is none.

    Parameters
    ----------
    state : GpsErrorState
    noise : (n,) array
        Standard normals of the tick.
    gps : GpsParams
    velocity : (float, float, float)
        True one of the antenna, NED, m/s.
    pos, vel : (3,) array
        In place.
    """
    k, larger = gps.errors, dilution(state, gps.errors)
    if math.isinf(larger):
        return False
    white_pos, white_vel = noise[NOISE.gps_pos], noise[NOISE.gps_vel]
    late_s = k.latency_s * noise[NOISE.gps_clock]
    for i in range(3):
        pos[i] += (larger - 1.0) * gps.white_m[i] * white_pos[i]
        pos[i] += larger * state.multipath[i] + state.jump[i] + late_s * velocity[i]
        vel[i] += (larger - 1.0) * gps.velocity_mps * white_vel[i]
    return True


# -------------------------------------------------------------------------------------------------
# What a sensor's place in the aircraft adds: the field of the power, air on the static port.
#
# - Field: currents of the drive make a field fixed to the airframe and proportional to them, so at
# a
#   constant voltage to the power (Biot and Savart; ArduPilot's compass/motor calibration fits the
#   same law). The power is the engine's where rotor speed is a term, else the main rotor's.
# - Wind: the error of the static pressure is a part of the dynamic pressure along each body axis,
# of
#   its own for either direction: the model that PX4 (EKF2_PCOEF_XP, _XN, _YP, _YN, _Z) and
#   ArduPilot
#   (BARO1_WCF_FWD, _BCK, _RGT, _LFT) correct by.
# - Wash: behind the disc the pressure of an ideal rotor in hover is 3/2 rho v_i^2 above that of
# the
#   still air and falls to it down the wake (Leishman, Principles of Helicopter Aerodynamics, 2nd
#   ed.
#   2006, sec. 2.2, Bernoulli below the disc). A port sees a part of it: a coefficient of
#   1/2 rho v_i^2, from 0 to 3.
# -------------------------------------------------------------------------------------------------

# Places of the static port's coefficients.
_FRONT, _BACK, _RIGHT, _LEFT, _ALONG_Z = range(5)


@by_reference
class PortParams(NamedTuple):
    """The barometer's static port."""

    on: bool
    wind: np.ndarray  # (5,) pressure error over dynamic pressure: front, back, right, left, along z
    wash: float  # pressure error over 1/2 rho v_i^2
    half_rho: float  # kg/m3


@by_reference
class PowerFieldParams(NamedTuple):
    """The field of the drive's currents at the magnetometer."""

    on: bool
    field: np.ndarray  # (3,) body, T/W


@njit
def wash_and_power(x, air, k):
    """Induced velocity of the main rotor (m/s), power of the drive (W); k is a HelicopterParams."""
    if is_off_nominal(k):
        k = referred(off_nominal(x, k))
    at_main, _, at_body = airspeeds(x, air)
    u_f, v_f, w_f = at_body
    thrust, v_i, _, _ = rotor_flow(x, at_main, k)
    if k.terms.rotor_speed:
        return v_i, engine_torque(x, k.engine) * k.main.speed
    drag = fuselage_force(u_f, v_f, w_f, v_i, k.fuselage)
    return v_i, main_rotor_power(at_main, at_body, v_i, thrust, drag, k)


@njit
def port_error(x, air, aircraft, k):
    """Pressure (Pa) that air speed and the rotor's wash add at the static port."""
    u_a, v_a, w_a = airspeed(x, air[AIR.fuselage])
    v_i, _ = wash_and_power(x, air, aircraft)
    error = k.wind[_FRONT if u_a >= 0.0 else _BACK] * u_a * u_a
    error += k.wind[_RIGHT if v_a >= 0.0 else _LEFT] * v_a * v_a
    error += k.wind[_ALONG_Z] * w_a * w_a
    return k.half_rho * (error + k.wash * v_i * v_i)


@njit
def add_power_field(x, air, aircraft, k, mag):
    """Add the field of the drive's currents (T) to a reading (3,), in place."""
    _, power = wash_and_power(x, air, aircraft)
    for i in range(3):
        mag[i] += k.field[i] * power


# -------------------------------------------------------------------------------------------------
# Sensors.
# -------------------------------------------------------------------------------------------------


class FixRow(NamedTuple):
    """A GPS fix under way (8,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    tick: int = 6  # of validity
    got: int = 7  # 1.0 if there was one
    size: int = 8


FIX = FixRow()


@by_reference
class ImuParams(NamedTuple):
    """Per tick, not per root hertz."""

    gyro_white: float  # rad/s
    accel_white: float  # m/s2
    gyro_walk: float  # rad/s per tick
    accel_walk: float  # m/s2 per tick
    gyro_bias: float  # sigma at start, rad/s
    accel_bias: float  # m/s2
    errors: ImuErrorParams
    arm: LeverArm


@by_reference
class MagParams(NamedTuple):
    """Reads `soft_iron @ field + hard_iron + white`; the state holds the flight's own iron."""

    field_ned_t: np.ndarray  # (3,)
    soft_iron: np.ndarray  # (3, 3)
    hard_iron_t: np.ndarray  # (3,)
    white: float  # T
    period: int  # ticks
    clock_s: float  # sigma of the sampling instant about the stamp
    soft_sigma: float  # of each entry at the start
    hard_sigma_t: float  # of each axis at the start
    power: PowerFieldParams


@by_reference
class BaroParams(NamedTuple):
    """ISA pressure at the altitude above the origin, white noise and a slow drift."""

    origin_altitude_m: float
    white: float  # Pa
    drift: float  # stationary sigma, Pa
    decay: float  # per period
    period: int  # ticks
    clock_s: float  # sigma of the sampling instant about the stamp
    port: PortParams


@by_reference
class GpsParams(NamedTuple):
    """Fixes that are valid now and arrive later."""

    white_m: np.ndarray  # (3,) NED
    drift_m: np.ndarray  # (3,) stationary sigma, NED
    decay: float  # of the drift, per period
    velocity_mps: float
    period: int  # ticks
    latency: int  # ticks
    lost_tick: int  # from which on there is no fix
    found_tick: int  # and from which on there is one again
    errors: GpsErrorParams
    arm: LeverArm  # of the antenna


@by_reference
class PlainParams(NamedTuple):
    """The sensors of `PLAIN`, each: white noise, then whole steps."""

    white: np.ndarray  # (n,) in the sensor's unit
    step: np.ndarray  # (n,) 0: none
    period: np.ndarray  # (n,) int64, ticks


@by_reference
class SensorParams(NamedTuple):
    """All sensors."""

    imu: ImuParams
    mag: MagParams
    baro: BaroParams
    gps: GpsParams
    plain: PlainParams
    imu2: bool  # whether there is a second one, of the same kind as the first


def periods(k: SensorParams) -> tuple[int, ...]:
    """Ticks from sample to sample of each of `heli_core.sensors.SENSORS`."""
    return (k.mag.period, k.baro.period, *map(int, k.plain.period))


def white_noise(k: SensorParams) -> tuple[float, ...]:
    """White noise of each of `heli_core.sensors.SENSORS`, sigma in its unit."""
    return (k.mag.white, k.baro.white, *map(float, k.plain.white))


@by_reference
class ImuState(NamedTuple):
    """What an IMU remembers."""

    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s2
    errors: ImuErrorState


@by_reference
class SensorState(NamedTuple):
    """What the sensors remember."""

    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s2
    baro_drift: np.ndarray  # (1,) Pa
    gps_drift: np.ndarray  # (3,) NED, m
    gps_queue: np.ndarray  # (slots, 8) fixes under way, a FixRow each
    imu: ImuErrorState
    soft_iron: np.ndarray  # (3, 3) of this flight
    hard_iron_t: np.ndarray  # (3,)
    gps: GpsErrorState
    imu2: ImuState  # of the second one, if there is one


@njit
def gauss_markov_step(x, decay, sigma, n):
    """Next value of a stationary first-order Gauss-Markov process with this sigma."""
    return decay * x + sigma * math.sqrt(1.0 - decay * decay) * n


@njit
def rotor_speed(x, aircraft):
    """Speed of the main rotor, rad/s: a state, or as the aircraft's file says."""
    return x[PLANT.omega] if aircraft.terms.rotor_speed else aircraft.main.speed


class ImuNormals(NamedTuple):
    """Standard normals of an IMU at a tick, (3,) each, and of its clock."""

    gyro: np.ndarray
    accel: np.ndarray
    gyro_walk: np.ndarray
    accel_walk: np.ndarray
    clock: float


@njit
def _spoil_imu(imu, tick, true_rate, omega, normals, k, out):
    """Make of the true specific force in out (6,), places of `rows.IMU`, and of the true rates what
    one IMU (ImuState) says; its biases walk. omega: speed of the main rotor, rad/s."""
    force, rate = out[IMU.force], out[IMU.rate]
    for i in range(3):
        rate[i] = true_rate[i]
    if k.errors.on:
        distort(imu.errors, tick, omega, normals.clock, k.errors, out)
    for i in range(3):
        if tick > 0:
            imu.gyro_bias[i] += k.gyro_walk * normals.gyro_walk[i]
            imu.accel_bias[i] += k.accel_walk * normals.accel_walk[i]
        force[i] += imu.accel_bias[i] + k.accel_white * normals.accel[i]
        rate[i] = rate[i] + imu.gyro_bias[i] + k.gyro_white * normals.gyro[i]
    if k.errors.on:
        clip(k.errors, out)


@njit
def spoil_imu(sensors, tick, x, omega, noise, k, y):
    """What the first IMU says, for the true specific force in the row y; biases walk."""
    first = referred(ImuState(sensors.gyro_bias, sensors.accel_bias, sensors.imu))
    normals = ImuNormals(
        noise[NOISE.gyro],
        noise[NOISE.accel],
        noise[NOISE.gyro_walk],
        noise[NOISE.accel_walk],
        noise[NOISE.imu_clock],
    )
    _spoil_imu(first, tick, x[PLANT.rate], omega, normals, k, y[MEAS.imu])


@njit
def spoil_imu2(sensors, tick, x, omega, noise, k, y):
    """The same of the second IMU: errors of its own, shaken by the same rotor."""
    normals = ImuNormals(
        noise[NOISE.gyro2],
        noise[NOISE.accel2],
        noise[NOISE.gyro2_walk],
        noise[NOISE.accel2_walk],
        noise[NOISE.imu2_clock],
    )
    _spoil_imu(sensors.imu2, tick, x[PLANT.rate], omega, normals, k.imu, y[MEAS.imu2])


@njit
def _force_at_imu(x, air, aircraft, k, out):
    """Specific force, body, m/s2, at the IMU's place: fills out (3,)."""
    specific_force(x, air, aircraft, out)
    if k.arm.on:
        angular = scratch(3)
        angular_acceleration(x, air, aircraft, angular)
        turning = angular[0], angular[1], angular[2]
        add_lever_acceleration(rates_of(x), turning, k.arm, out)


@njit
def read_imu(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill specific force and rates of the measurement row y."""
    _force_at_imu(x, air, aircraft, k, y[MEAS.force])
    spoil_imu(sensors, tick, x, rotor_speed(x, aircraft), noise, k, y)


@njit
def read_imu2(sensors, tick, x, air, noise, aircraft, k, y):
    """The same of the second IMU; zeros without it."""
    if not k.imu2:
        fill(y[MEAS.imu2], 0.0)
        return
    _force_at_imu(x, air, aircraft, k.imu, y[MEAS.force2])
    spoil_imu2(sensors, tick, x, rotor_speed(x, aircraft), noise, k, y)


@njit
def read_mag(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill the magnetometer's places of the row y; zeros between the periods."""
    mag, white = y[MEAS.mag], noise[NOISE.mag]
    y[MEAS.mag_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.mag_valid] == 0.0:
        mag[0] = mag[1] = mag[2] = 0.0
        return
    f = k.field_ned_t
    b0, b1, b2 = to_body(attitude_of(x), f[0], f[1], f[2])
    if k.clock_s > 0.0:
        # db/dt = b x omega in turning axes
        late_s, (p, q, r) = k.clock_s * noise[NOISE.mag_clock], rates_of(x)
        b0, b1, b2 = (
            b0 + late_s * (b1 * r - b2 * q),
            b1 + late_s * (b2 * p - b0 * r),
            b2 + late_s * (b0 * q - b1 * p),
        )
    soft, hard = sensors.soft_iron, sensors.hard_iron_t
    for i in range(3):
        mag[i] = soft[i, 0] * b0 + soft[i, 1] * b1 + soft[i, 2] * b2
        mag[i] += hard[i] + k.white * white[i]
    if k.power.on:
        add_power_field(x, air, aircraft, k.power, mag)


@njit
def read_baro(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill the barometer's places of the row y; zero between the periods."""
    y[MEAS.baro_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.baro_valid] == 0.0:
        y[MEAS.baro] = 0.0
        return
    if tick > 0:
        sensors.baro_drift[0] = gauss_markov_step(
            sensors.baro_drift[0], k.decay, k.drift, noise[NOISE.baro_drift]
        )
    down = x[PLANT.down]
    if k.clock_s > 0.0:
        u, v, w = velocity_of(x)
        down += k.clock_s * noise[NOISE.baro_clock] * to_ned(attitude_of(x), u, v, w)[2]
    y[MEAS.baro] = pressure_pa(k.origin_altitude_m - down) + sensors.baro_drift[0]
    y[MEAS.baro] += k.white * noise[NOISE.baro]
    if k.port.on:
        y[MEAS.baro] += port_error(x, air, aircraft, k.port)


@njit
def take_fix(sensors, tick, x, noise, k):
    """Measure the antenna's position and velocity at `tick` and send them on their way."""
    slot = ((tick + k.latency) // k.period) % sensors.gps_queue.shape[0]
    u, v, w = velocity_of(x)
    if k.arm.on:
        turning = cross(rates_of(x), (k.arm.x, k.arm.y, k.arm.z))
        u, v, w = u + turning[0], v + turning[1], w + turning[2]
    fix = sensors.gps_queue[slot]
    pos, vel, true_pos = fix[FIX.pos], fix[FIX.vel], x[PLANT.pos]
    white_pos, white_vel = noise[NOISE.gps_pos], noise[NOISE.gps_vel]
    velocity = to_ned(attitude_of(x), u, v, w)
    vel[0], vel[1], vel[2] = velocity
    for i in range(3):
        pos[i] = true_pos[i] + sensors.gps_drift[i] + k.white_m[i] * white_pos[i]
        vel[i] += k.velocity_mps * white_vel[i]
    if k.arm.on:
        north, east, down = to_ned(attitude_of(x), k.arm.x, k.arm.y, k.arm.z)
        pos[0], pos[1], pos[2] = pos[0] + north, pos[1] + east, pos[2] + down
    fix[FIX.tick], fix[FIX.got] = tick, 1.0
    if k.errors.on and not spoil_fix(sensors.gps, noise, k, velocity, pos, vel):
        fix[FIX.got] = 0.0
    if k.lost_tick <= tick < k.found_tick:
        fix[FIX.got] = 0.0


@njit
def read_gps(sensors, tick, x, noise, k, y):
    """Fill the row y's places of GPS with the fix that arrives; zeros if none does.

    Fixes arrive at the multiples of the period and were valid `latency` ticks before; a receiver
    without a fix then has none.
    """
    drift = noise[NOISE.gps_drift]
    if (tick + k.latency) % k.period == 0:
        for i in range(3):
            sensors.gps_drift[i] = gauss_markov_step(
                sensors.gps_drift[i], k.decay, k.drift_m[i], drift[i]
            )
        if k.errors.on:
            step_gps_errors(sensors.gps, noise, k.errors)
        take_fix(sensors, tick, x, noise, k)
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    y[MEAS.gps_valid] = y[MEAS.gps_tick] = 0.0
    for i in range(3):
        pos[i] = vel[i] = 0.0
    fix = sensors.gps_queue[(tick // k.period) % sensors.gps_queue.shape[0]]
    if tick % k.period == 0 and fix[FIX.got] == 1.0:
        fix_pos, fix_vel = fix[FIX.pos], fix[FIX.vel]
        for i in range(3):
            pos[i], vel[i] = fix_pos[i], fix_vel[i]
        y[MEAS.gps_valid], y[MEAS.gps_tick] = 1.0, fix[FIX.tick]


_PLAIN_PLACES = tuple(PLACES[row.name] for row in PLAIN)
_ROTOR_SPEED = place_of(ROTOR_SPEED.name, PLAIN)


@njit
def true_sample(which, x, air, aircraft, out):
    """What a sensor of `PLAIN` would say without errors into its numbers; each has its lines here.

    Parameters
    ----------
    which : int
        Its place in `PLAIN`.
    x : (n,) array
        State of the aircraft, places of `rows.PLANT`.
    air : (12,) array
        What the air does at it, places of `rows.AIR`.
    aircraft : HelicopterParams
    out : (numbers,) array
    """
    if which == _ROTOR_SPEED:
        # A Hall sensor beside the mast: time between the passes of a magnet.
        out[0] = rotor_speed(x, aircraft)


@njit
def read_plain(tick, x, air, noise, aircraft, k, y):
    """Fill the places of the sensors of `PLAIN` in the row y; zero between the periods."""
    for which in range(len(_PLAIN_PLACES)):
        at = _PLAIN_PLACES[which]
        sample = y[at.first : at.first + at.numbers]
        y[at.valid] = 1.0 if tick % k.period[which] == 0 else 0.0
        if y[at.valid] == 0.0:
            fill(sample, 0.0)
            continue
        true_sample(which, x, air, aircraft, sample)
        step = k.step[which]
        for i in range(at.numbers):
            value = sample[i] + k.white[which] * noise[at.white + i]
            sample[i] = step * round(value / step) if step > 0.0 else value


@njit
def read_sensors(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill what sensors say of the measurement row y at a tick."""
    read_imu(sensors, tick, x, air, noise, aircraft, k.imu, y)
    read_mag(sensors, tick, x, air, noise, aircraft, k.mag, y)
    read_baro(sensors, tick, x, air, noise, aircraft, k.baro, y)
    read_gps(sensors, tick, x, noise, k.gps, y)
    read_plain(tick, x, air, noise, aircraft, k.plain, y)
    read_imu2(sensors, tick, x, air, noise, aircraft, k, y)


# -------------------------------------------------------------------------------------------------
# What sensors remember before tick 0, drawn from the stationary distributions.
# -------------------------------------------------------------------------------------------------


class OnceRow(NamedTuple):
    """Standard normals that a flight's sensors draw once (28,)."""

    gains: slice = slice(0, 18)  # scale and misalignment of both triads
    soft_iron: slice = slice(18, 24)
    hard_iron: slice = slice(24, 27)
    azimuth: int = 27
    size: int = 28


ONCE = OnceRow()


def fix_slots(gps: GpsParams) -> int:
    """Length of the queue of fixes under way."""
    return gps.latency // gps.period + 1


def initial_sensors(
    k: SensorParams,
    rows: NDArray[np.float64],
    once: NDArray[np.float64],
    once_imu2: NDArray[np.float64],
    x: NDArray[np.float64],
) -> SensorState:
    """Biases, drifts, scale factors, iron and the fixes under way of a flight.

    Parameters
    ----------
    k : SensorParams
    rows : (fix_slots, n) array
        Standard normals, places of `noise.NOISE`.
    once : (28,) array
        Standard normals, places of ONCE.
    once_imu2 : (18,) array
        The same of a second IMU: scale and misalignment of both triads.
    x : (n,) array
        State of the plant at the start, places of `rows.PLANT`: the fixes under way are its.
    """
    gps, first = k.gps, rows[0]
    # The rotor stands anywhere, all azimuths alike.
    azimuth = 2.0 * math.pi * uniform(once[ONCE.azimuth])
    sensors = SensorState(
        gyro_bias=k.imu.gyro_bias * first[NOISE.gyro],
        accel_bias=k.imu.accel_bias * first[NOISE.accel],
        baro_drift=np.array([k.baro.drift * first[NOISE.baro]]),
        gps_drift=gps.drift_m * first[NOISE.gps_drift],
        gps_queue=np.zeros((rows.shape[0], FIX.size)),
        imu=_imu_errors(k.imu, once[ONCE.gains], azimuth),
        soft_iron=k.mag.soft_iron + k.mag.soft_sigma * _symmetric(once[ONCE.soft_iron]),
        hard_iron_t=k.mag.hard_iron_t + k.mag.hard_sigma_t * once[ONCE.hard_iron],
        gps=_gps_errors(gps.errors, first),
        imu2=ImuState(
            k.imu.gyro_bias * first[NOISE.gyro2],
            k.imu.accel_bias * first[NOISE.accel2],
            _imu_errors(k.imu, once_imu2, azimuth),
        ),
    )
    for i in range(rows.shape[0]):
        valid = i * gps.period - gps.latency
        if valid < 0:
            take_fix(sensors, valid, x, rows[i], gps)
    return sensors


def _imu_errors(k: ImuParams, gains: NDArray[np.float64], azimuth: float) -> ImuErrorState:
    """Scale and misalignment (18 normals); the rotor's azimuth is that of the aircraft."""
    sigma = k.errors.gain_sigma
    return ImuErrorState(
        np.eye(3) + sigma * gains.reshape(2, 3, 3),
        np.array([azimuth]),
        np.zeros(IMU.size),
        np.zeros((IMU.size, 3)),
    )


def _symmetric(six: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric matrix (3, 3) of its six entries: induced magnetisation is reciprocal."""
    a, b, c, d, e, f = six
    return np.array([[a, d, e], [d, b, f], [e, f, c]])


def _gps_errors(k: GpsErrorParams, first: NDArray[np.float64]) -> GpsErrorState:
    """Stationary, but the flight begins with a fix: enough satellites, no outage."""
    draw = float(uniform(first[NOISE.gps_satellites]))
    blocked, part = 0, np.exp(-k.blocked)
    while draw > part and blocked < k.satellites - FEWEST_SATELLITES:
        draw -= part
        blocked += 1
        part *= k.blocked / blocked
    jumped = uniform(first[NOISE.gps_jump_now]) < k.jump_at_start
    return GpsErrorState(
        multipath=k.multipath_m * first[NOISE.gps_multipath],
        jump=k.jump_m * first[NOISE.gps_jump] if jumped else np.zeros(3),
        blocked=np.array([float(blocked)]),
        out=np.zeros(1),
    )
