# SPDX-License-Identifier: Apache-2.0
"""Named places of every row of numbers that one part of the stack hands to another.

A row is a float64 vector, or a column block of an array with one row per tick. `nav[NAV.quat]` is
its attitude, `record[:, REFERENCE.psi]` the headings. A place of one number is an int, of several a
slice; `size` is the row's length. Kernels take both as constants; a loop over a vector takes its
view first (`mag = y[MEAS.mag]`), or counts from `MEAS.mag.start`.

NED and FRD, SI, rad; quaternions are (w, x, y, z), body -> NED. What a package keeps to itself
(states of a filter, of a controller) is laid out where it is used.
"""

from typing import NamedTuple

from heli_core.sensors import PLACES, ROTOR_SPEED, SENSED

# -------------------------------------------------------------------------------------------------
# Rows.
# -------------------------------------------------------------------------------------------------


class ImuRow(NamedTuple):
    """What the inertial sensors say at a tick (6,)."""

    force: slice = slice(0, 3)  # specific force, body, m/s2
    rate: slice = slice(3, 6)  # body rates, rad/s
    size: int = 6


class MeasurementRow(NamedTuple):
    """What the plant's sensors say at a tick (28,), and the wind that none of them measures (31,).

    A value that did not arrive at this tick is 0, and so is its flag; so is all of a second IMU
    where there is none. A new sensor (`sensors.PLAIN`) has its places behind the rotor's speed.
    """

    force: slice = slice(0, 3)  # specific force, body, m/s2
    rate: slice = slice(3, 6)  # body rates, rad/s
    imu: slice = slice(0, 6)  # both, an ImuRow
    mag: slice = slice(6, 9)  # magnetic field, body, T
    baro: int = 9  # static pressure, Pa
    gps_pos: slice = slice(10, 13)  # NED, m
    gps_vel: slice = slice(13, 16)  # NED, m/s
    mag_valid: int = 16  # 1.0 if a new value arrived at this tick
    baro_valid: int = 17
    gps_valid: int = 18
    gps_tick: int = 19  # tick at which the arriving fix was true
    force2: slice = slice(20, 23)  # of a second IMU: specific force, body, m/s2
    rate2: slice = slice(23, 26)  # body rates, rad/s
    imu2: slice = slice(20, 26)  # both, an ImuRow
    rotor: int = PLACES[ROTOR_SPEED.name].first  # speed of the main rotor, rad/s
    rotor_valid: int = PLACES[ROTOR_SPEED.name].valid
    sensed: int = SENSED  # length of what a sensor said: an observer reads nothing behind it
    wind: slice = slice(SENSED, SENSED + 3)  # true velocity of the air, NED, m/s
    size: int = SENSED + 3


class NavigationRow(NamedTuple):
    """What the observer says of the aircraft (31,); NaN while it knows nothing."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    down_vel: int = 5
    quat: slice = slice(6, 10)
    rate: slice = slice(10, 13)  # body, rad/s
    p: int = 10
    q: int = 11
    r: int = 12
    rotor: slice = slice(13, 16)  # a RotorRow
    motion: slice = slice(0, 16)  # all so far: the places that TruthRow has, too
    gyro_bias: slice = slice(16, 19)  # body, rad/s
    accel_bias: slice = slice(19, 22)  # body, m/s2
    sigma_pos: slice = slice(22, 25)  # standard deviations, NED, m
    sigma_vel: slice = slice(25, 28)  # NED, m/s
    sigma_att: slice = slice(28, 31)  # of a rotation about north, east, down, rad
    size: int = 31


class TruthRow(NamedTuple):
    """How the aircraft really moved, as a flight is recorded (19,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    quat: slice = slice(6, 10)
    rate: slice = slice(10, 13)  # body, rad/s
    rotor: slice = slice(13, 16)  # a RotorRow
    motion: slice = slice(0, 16)  # all so far: the places that NavigationRow has, too
    wind: slice = slice(16, 19)  # velocity of the air, NED, m/s
    size: int = 19


class PlantRow(NamedTuple):
    """State of the simulated aircraft (42,); its first 13 places are the message of its truth."""

    pos: slice = slice(0, 3)  # of the c.g., NED, m
    north: int = 0
    east: int = 1
    down: int = 2
    vel: slice = slice(3, 6)  # inertial velocity in body axes, m/s
    u: int = 3
    v: int = 4
    w: int = 5
    quat: slice = slice(6, 10)
    qw: int = 6
    qx: int = 7
    qy: int = 8
    qz: int = 9
    rate: slice = slice(10, 13)  # body, rad/s
    p: int = 10
    q: int = 11
    r: int = 12
    rigid: slice = slice(0, 13)  # all so far
    a_s: int = 13  # longitudinal flapping angle, rad, positive: disc tilted backwards
    b_s: int = 14  # lateral flapping angle, rad, positive: disc tilted to the right
    d_int: int = 15  # integrator of the yaw-rate gyro, rad
    rotor: slice = slice(13, 16)  # these three, a RotorRow
    servo: slice = slice(16, 20)  # servo positions in (-1, 1), an ActuatorRow
    servo_lat: int = 16
    servo_lon: int = 17
    servo_ped: int = 18
    servo_col: int = 19
    servo_rate: slice = slice(20, 24)  # their rates, 1/s
    # States of terms (`heli_dynamics_sim.aircraft`); of one that is off they stay as they are.
    inflow: slice = slice(24, 27)  # induced velocity of the main rotor, m/s
    inflow_mean: int = 24  # over the disc
    inflow_right: int = 25  # what the disc's right edge has more
    inflow_rear: int = 26  # what its rear edge has more
    omega: int = 27  # main rotor's speed, rad/s
    governor: int = 28  # integrator of the governor
    fuel: int = 29  # burnt so far, kg
    blades: slice = slice(
        30, 32
    )  # tilt of the disc by the air's speed across it, rad: the blades' part
    blade_a: int = 30  # as a_s
    blade_b: int = 31  # as b_s
    engine: int = 32  # engine's power over its limit
    engine_out: int = 33  # 1.0 once the engine has failed
    # Stretch of the skids' friction, two directions along the ground for each of four ends, m.
    stick: slice = slice(34, 42)
    size: int = 42


class AirRow(NamedTuple):
    """The air at an aircraft (12,): its velocity where it acts, and how it turns."""

    main: slice = slice(0, 3)  # at the main rotor's hub, NED, m/s
    tail: slice = slice(3, 6)  # at the tail rotor; the fins share it
    fuselage: slice = slice(6, 9)  # over the fuselage
    velocity: slice = slice(0, 9)  # all three places
    rates: slice = slice(9, 12)  # rotational gust p, q, r, body, rad/s
    p: int = 9
    q: int = 10
    size: int = 12


class RotorRow(NamedTuple):
    """What no sensor sees of the rotor and of the yaw-rate gyro (3,)."""

    a_s: int = 0  # longitudinal flapping angle, rad
    b_s: int = 1  # lateral flapping angle, rad
    flapping: slice = slice(0, 2)  # both
    d_int: int = 2  # integrator of the gyro, rad
    size: int = 3


class JointRow(NamedTuple):
    """True rotor states and servo positions as they are published (7,)."""

    rotor: slice = slice(0, 3)  # a RotorRow
    servo: slice = slice(3, 7)  # an ActuatorRow
    size: int = 7


class ActuatorRow(NamedTuple):
    """Commands to the servos, each in (-1, 1) (4,)."""

    lat: int = 0
    lon: int = 1
    ped: int = 2
    attitude: slice = slice(0, 3)  # these three, which the attitude controller commands
    col: int = 3
    size: int = 4


class ReferenceRow(NamedTuple):
    """Where the aircraft should be: a way point of a trajectory (7,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    down_vel: int = 5
    psi: int = 6  # heading, rad
    size: int = 7


class ShapedReferenceRow(NamedTuple):
    """A reference without jumps of its velocity, for the position controller (10,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    down_vel: int = 5
    acc: slice = slice(6, 9)  # NED, m/s2
    psi: int = 9  # heading, rad
    size: int = 10


class SetpointRow(NamedTuple):
    """What the outer loop commands (4,)."""

    phi: int = 0  # roll, rad
    theta: int = 1  # pitch, rad
    psi: int = 2  # heading, rad
    attitude: slice = slice(0, 3)  # these three, which the attitude controller follows
    col: int = 3  # collective in (-1, 1)
    size: int = 4


class StickRow(NamedTuple):
    """A pilot's sticks, each in -1..1, 0 in the middle (4,)."""

    roll: int = 0  # to the right
    pitch: int = 1  # nose up: the stick is pulled
    yaw: int = 2  # nose to the right
    climb: int = 3  # up
    size: int = 4


class NineStates(NamedTuple):
    """The nine states of eq. (10) (9,); `state_names` has their units."""

    phi: int = 0
    theta: int = 1
    p: int = 2
    q: int = 3
    a_s: int = 4
    b_s: int = 5
    r: int = 6
    d_int: int = 7
    psi: int = 8


IMU = ImuRow()
MEAS = MeasurementRow()
NAV = NavigationRow()
TRUTH = TruthRow()
PLANT = PlantRow()
AIR = AirRow()
ROTOR = RotorRow()
JOINTS = JointRow()
ACTUATOR = ActuatorRow()
REFERENCE = ReferenceRow()
SHAPED = ShapedReferenceRow()
SETPOINT = SetpointRow()
STICKS = StickRow()
NINE = NineStates()


# -------------------------------------------------------------------------------------------------
# States, inputs and wind of the linear model of eq. (10): names, units, and which are measured.
# -------------------------------------------------------------------------------------------------

STATE_NAMES = NINE._fields
"""phi theta p q a_s b_s r d_int psi: the order of every A, B, E of the stack; rad, p q r rad/s."""
ACTUATOR_NAMES = ("d_lat", "d_lon", "d_ped", "d_col")
INPUT_NAMES = ACTUATOR_NAMES[ACTUATOR.attitude]
"""The three inputs of B, -1..1; the collective belongs to the altitude controller."""
WIND_NAMES = ("u", "v", "w")
"""The three inputs of E: velocity of the air in body axes, m/s."""

MEASURED = (NINE.phi, NINE.theta, NINE.p, NINE.q, NINE.r, NINE.psi)
"""Places of y in x, eq. (10)."""
UNMEASURED = (NINE.a_s, NINE.b_s, NINE.d_int)
"""Places in x of what the reduced-order observer (19) estimates, in the order of a RotorRow."""
ATTITUDE = (NINE.phi, NINE.theta, NINE.psi)
"""Places in x of what follows a command: the rows of C_out in eq. (15)."""
