# SPDX-License-Identifier: Apache-2.0
"""What a log of a helicopter can hold, and where it stands in each format: one table a format.

Body axes are front, right, down; the world is north, east, down; rates, angles and inputs turn the
right-hand way about them, the pedal apart: d_ped is positive for nose left, as eq. (10) has it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import CausedError

Array = NDArray[np.float64]


class LogCause(Enum):
    """Why a log, or the map of its columns, is refused."""

    UNKNOWN_FORMAT = "its name ends in none of the endings that are read"
    NOT_A_LOG = "it is not what its name says"
    DAMAGED = "its parts contradict each other"
    UNSUPPORTED = "a newer or another form of the format"
    TOO_MANY = "it holds more than is read"
    EMPTY = "it holds nothing that says how a helicopter moves"
    NO_TIME = "its times do not rise"
    MAP_NEEDED = "its columns have no names that are known"
    BAD_MAP = "the map of its columns is wrong"
    NO_COLUMN = "a column that the map names is not there"


class LogError(CausedError):
    """A log that is refused; `cause` is a `LogCause`."""


class Group(Enum):
    """What a signal is."""

    RATE = "angular rate"
    FORCE = "specific force"
    ATTITUDE = "attitude"
    VELOCITY = "velocity over ground"
    INPUT = "controller output or stick to the swashplate and tail"
    REFERENCE = "what was asked for, or added from outside"
    SERVO = "servo"
    ROTOR = "rotor"


class SignalKind(NamedTuple):
    """A signal's unit and group."""

    unit: str
    group: Group


SIGNALS: dict[str, SignalKind] = {
    **dict.fromkeys(("p", "q", "r"), SignalKind("rad/s", Group.RATE)),
    **dict.fromkeys(("ax", "ay", "az"), SignalKind("m/s2", Group.FORCE)),
    **dict.fromkeys(("phi", "theta", "psi"), SignalKind("rad", Group.ATTITUDE)),
    **dict.fromkeys(("vn", "ve", "vd", "u", "v", "w"), SignalKind("m/s", Group.VELOCITY)),
    **dict.fromkeys(("d_lat", "d_lon", "d_ped", "d_col"), SignalKind("1", Group.INPUT)),
    **dict.fromkeys(("p_ref", "q_ref", "r_ref"), SignalKind("rad/s", Group.REFERENCE)),
    **dict.fromkeys(
        ("stick_lat", "stick_lon", "stick_ped", "stick_col", "chirp"),
        SignalKind("1", Group.REFERENCE),
    ),
    **{f"servo_{i}": SignalKind("us", Group.SERVO) for i in range(1, 9)},
    **dict.fromkeys(("swash_col", "swash_lat", "swash_lon"), SignalKind("rad", Group.SERVO)),
    "rotor_speed": SignalKind("rad/s", Group.ROTOR),
}
"""Names that a map of columns may use, and those of all answers."""


class SignalSource(NamedTuple):
    """Where a signal stands in a format, and what makes it SI with this page's signs."""

    signal: str
    message: str
    column: str
    factor: float = 1.0


_DEG, _RPM = pi / 180.0, pi / 30.0


def _each(signals: str, message: str, columns: str, *factors: float) -> tuple[SignalSource, ...]:
    """A source for each of some signals, with one factor for all or one each."""
    names, labels = signals.split(), columns.split()
    each = (
        factors if len(factors) == len(names) else factors[:1] * len(names) or (1.0,) * len(names)
    )
    return tuple(
        SignalSource(n, message, c, f) for n, c, f in zip(names, labels, each, strict=True)
    )


# Of several sources of a signal the one with most rows is taken, of equal ones the first.

DATAFLASH: tuple[SignalSource, ...] = (
    *_each("p q r", "SIDD", "Gx Gy Gz", _DEG),
    *_each("ax ay az", "SIDD", "Ax Ay Az"),
    SignalSource("chirp", "SIDD", "Targ"),
    *_each("p q r", "RATE", "R P Y", _DEG),
    *_each("p_ref q_ref r_ref", "RATE", "RDes PDes YDes", _DEG),
    *_each("d_lat d_lon d_ped d_col", "RATE", "ROut POut YOut AOut", 1.0, 1.0, -1.0, 1.0),
    *_each("p q r", "IMU", "GyrX GyrY GyrZ"),
    *_each("ax ay az", "IMU", "AccX AccY AccZ"),
    *_each("phi theta psi", "ATT", "Roll Pitch Yaw", _DEG),
    *_each("vn ve vd", "XKF1", "VN VE VD"),
    *_each("vn ve vd", "NKF1", "VN VE VD"),
    *(SignalSource(f"servo_{i}", "RCOU", f"C{i}") for i in range(1, 9)),
    *_each("swash_col swash_lon swash_lat", "SWSH", "Col Pit Rol", _DEG),
    SignalSource("rotor_speed", "RPM", "RPM", _RPM),
    SignalSource("rotor_speed", "RPM", "rpm1", _RPM),
)
"""ArduPilot's messages: labels, units and rates by its LogStructure.h of each library
(AP_InertialSensor, AC_AttitudeControl, AP_NavEKF3, AP_RPM) and ArduCopter's Log.cpp (SIDD, SIDS).
Roll to the right, nose up and nose right are positive in RATE's outputs."""

ULOG: tuple[SignalSource, ...] = (
    *_each("p q r", "vehicle_angular_velocity", "xyz[0] xyz[1] xyz[2]"),
    *_each("p q r", "sensor_combined", "gyro_rad[0] gyro_rad[1] gyro_rad[2]"),
    *_each("ax ay az", "vehicle_acceleration", "xyz[0] xyz[1] xyz[2]"),
    *_each("ax ay az", "sensor_combined", "accelerometer_m_s2[0] accelerometer_m_s2[1] "
           "accelerometer_m_s2[2]"),
    *_each("phi theta psi", "vehicle_attitude", "roll pitch yaw"),
    *_each("vn ve vd", "vehicle_local_position", "vx vy vz"),
    *_each("p_ref q_ref r_ref", "vehicle_rates_setpoint", "roll pitch yaw"),
    *_each("d_lat d_lon d_ped", "vehicle_torque_setpoint", "xyz[0] xyz[1] xyz[2]", 1.0, 1.0, -1.0),
    SignalSource("d_col", "vehicle_thrust_setpoint", "xyz[2]", -1.0),
    *_each("d_lat d_lon d_ped d_col", "actuator_controls_0", "control[0] control[1] control[2] "
           "control[3]", 1.0, 1.0, -1.0, 1.0),
    *_each("stick_lat stick_lon stick_ped stick_col", "manual_control_setpoint",
           "roll pitch yaw throttle", 1.0, -1.0, -1.0, 1.0),
    *_each("stick_lat stick_lon stick_ped stick_col", "manual_control_setpoint", "y x r z",
           1.0, -1.0, -1.0, 1.0),
    SignalSource("rotor_speed", "rpm", "rpm_estimate", _RPM),
)  # fmt: skip
"""PX4's topics, by its `msg` folder. vehicle_attitude's roll, pitch and yaw are made of its
quaternion, which turns FRD to NED. Of the pilot, stick forward is positive there: nose down."""

BAG: tuple[SignalSource, ...] = (
    *_each("p q r", "imu/data_raw", "angular_velocity.x angular_velocity.y angular_velocity.z",
           1.0, -1.0, -1.0),
    *_each("ax ay az", "imu/data_raw", "linear_acceleration.x linear_acceleration.y "
           "linear_acceleration.z", 1.0, -1.0, -1.0),
    *_each("phi theta psi", "odom", "roll pitch yaw"),
    *_each("u v w", "odom", "twist.twist.linear.x twist.twist.linear.y twist.twist.linear.z",
           1.0, -1.0, -1.0),
    *_each("d_lat d_lon d_ped d_col", "actuators", "position[0] position[1] position[2] "
           "position[3]"),
)  # fmt: skip
"""Our own topics; axes by REP-103. odom's roll, pitch and yaw are made of its quaternion, and are
NED's and FRD's."""


@dataclass(frozen=True)
class LoggedSignal:
    """One signal.

    Attributes
    ----------
    name : str
        Of `SIGNALS`.
    source : str
        Message or topic and column, as the log has them.
    time_s : (N,) array
        Rising; since the log's own zero.
    value : (N,) array
        Finite; in the unit of `SIGNALS`.
    """

    name: str
    source: str
    time_s: Array
    value: Array

    @property
    def rate_hz(self) -> float:
        """One over the median step; 0 of fewer than two samples."""
        return rate_of(self.time_s)


@dataclass(frozen=True)
class Message:
    """How often a message, topic or table of a log is there.

    Attributes
    ----------
    name : str
    rows : int
    rate_hz : float
        One over the median step.
    longest_gap_s : float
        Longest step from row to row.
    gaps : int
        Steps of more than `GAP` medians.
    """

    name: str
    rows: int
    rate_hz: float
    longest_gap_s: float
    gaps: int


GAP = 3.0
"""A step of more than so many median ones is a gap."""


@dataclass(frozen=True)
class Sweep:
    """Settings of an excitation that the log itself tells (ArduPilot's SIDS)."""

    time_s: float
    axis: int
    magnitude: float
    start_hz: float
    stop_hz: float
    length_s: float


@dataclass(frozen=True)
class FlightLog:
    """A log.

    Attributes
    ----------
    path, format : str
    size_bytes : int
    messages : tuple of Message
    signals : dict of str to LoggedSignal
    sweeps : tuple of Sweep
    skipped_bytes : int
        That belong to no message.
    dropped_s : float
        That the log says were not recorded.
    cut : bool
        The last message is not whole.
    """

    path: str
    format: str
    size_bytes: int
    messages: tuple[Message, ...]
    signals: Mapping[str, LoggedSignal]
    sweeps: tuple[Sweep, ...] = ()
    skipped_bytes: int = 0
    dropped_s: float = 0.0
    cut: bool = False
    left_out: Mapping[str, int] = field(default_factory=dict)
    """Rows that were left out of a message: times that do not rise, values that are not finite."""


def rate_of(time_s: Array) -> float:
    """One over the median step, 1/s; 0 of fewer than two samples."""
    steps = np.diff(time_s)
    return float(1.0 / np.median(steps)) if steps.size and np.median(steps) > 0.0 else 0.0


def message_of(name: str, time_s: Array) -> Message:
    """What is said of a message with rows at these times, s."""
    steps = np.diff(np.sort(time_s))
    if not steps.size:
        return Message(name, int(time_s.size), 0.0, 0.0, 0)
    usual = float(np.median(steps))
    late = steps > GAP * max(usual, 1e-9)
    return Message(name, int(time_s.size), rate_of(np.sort(time_s)), float(steps.max()),
                   int(late.sum()))  # fmt: skip
