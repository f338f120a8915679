# SPDX-License-Identifier: Apache-2.0
"""How the arrays of each topic and its messages correspond: frames, layout, conversion. One table.

`messages` makes encoders and decoders of it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

from numpy.typing import NDArray

from heli_core import rows, sensors
from heli_core.jit import fill, njit, scratch, scratch_matrix
from heli_core.rcl_yaml import printable
from heli_core.rotations import euler_from_quat, fill_from_euler, fill_R_nb
from heli_core.rows import NAV, PLANT, SETPOINT
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import Layout
from heli_msgs_bridge.frames import (
    R_ENU_NED,
    Datum,
    enu_to_ned,
    flu_to_frd,
    frd_to_flu,
    geodetic_to_ned,
    ned_to_enu,
    ned_to_geodetic,
    quat_enu_flu_to_ned_frd,
    quat_ned_frd_to_enu_flu,
)
from heli_msgs_bridge.topics import BASE, GPS_LINK, IMU2_LINK, IMU_LINK, MAP, in_namespace

# -------------------------------------------------------------------------------------------------
# Places in the block of doubles of each message type, field by field as its definition has them.
#
# ENU, FLU, SI. Covariances are row by row; as everywhere, a place of one number is an int and of
# several a slice.
# -------------------------------------------------------------------------------------------------


class OdometryBlock(NamedTuple):
    """nav_msgs/Odometry (85,)."""

    pos: slice = slice(0, 3)
    quat: slice = slice(3, 7)  # x, y, z, w
    pose: slice = slice(0, 7)  # both
    pose_cov: slice = slice(7, 43)  # 6 x 6: position, rotation about the fixed axes
    rotation_cov: slice = slice(28, 43)  # the same from its lower right 3 x 3 on
    linear: slice = slice(43, 46)
    angular: slice = slice(46, 49)
    twist: slice = slice(43, 49)  # both
    twist_cov: slice = slice(49, 85)  # 6 x 6: linear, angular
    size: int = 85


class ImuBlock(NamedTuple):
    """sensor_msgs/Imu (37,)."""

    quat: slice = slice(0, 4)  # x, y, z, w
    quat_cov: slice = slice(4, 13)
    rate: slice = slice(13, 16)
    rate_cov: slice = slice(16, 25)
    accel: slice = slice(25, 28)
    accel_cov: slice = slice(28, 37)
    size: int = 37


class FieldBlock(NamedTuple):
    """sensor_msgs/MagneticField (12,)."""

    field: slice = slice(0, 3)
    cov: slice = slice(3, 12)
    size: int = 12


class FixBlock(NamedTuple):
    """sensor_msgs/NavSatFix (12,)."""

    latitude: int = 0
    longitude: int = 1
    geodetic: slice = slice(0, 3)  # both, deg, and the altitude, m
    cov: slice = slice(3, 12)  # ENU
    size: int = 12


class TwistBlock(NamedTuple):
    """geometry_msgs/TwistWithCovarianceStamped (42,)."""

    linear: slice = slice(0, 3)
    angular: slice = slice(3, 6)
    twist: slice = slice(0, 6)  # both
    cov: slice = slice(6, 42)  # 6 x 6
    size: int = 42


class PressureBlock(NamedTuple):
    """sensor_msgs/FluidPressure (2,)."""

    pressure: int = 0
    variance: int = 1
    size: int = 2


class QuaternionBlock(NamedTuple):
    """geometry_msgs/QuaternionStamped (4,)."""

    xyzw: slice = slice(0, 4)
    size: int = 4


class VectorBlock(NamedTuple):
    """geometry_msgs/Vector3Stamped (3,), and the three first doubles of other messages."""

    xyz: slice = slice(0, 3)
    size: int = 3


ODOMETRY = OdometryBlock()
IMU = ImuBlock()
FIELD = FieldBlock()
FIX = FixBlock()
TWIST = TwistBlock()
PRESSURE = PressureBlock()
QUATERNION = QuaternionBlock()
VECTOR = VectorBlock()


# -------------------------------------------------------------------------------------------------
# Between the cores' arrays (NED, FRD) and the double blocks of messages (ENU, FLU), compiled.
#
# `pack_*(array, block)` fills a message's doubles, `unpack_*(block, array)` reads them and returns
# 0
# or the code of what is wrong (`REASONS`). Places: `heli_core.rows` and `blocks`.
# -------------------------------------------------------------------------------------------------

OK, NOT_FINITE, NOT_UNIT, OUT_OF_RANGE, NO_FIX = 0, 1, 2, 3, 4
REASONS = {
    NOT_FINITE: "holds a value that is not finite",
    NOT_UNIT: "holds a quaternion that is not of unit length",
    OUT_OF_RANGE: "holds a value outside of its range",
    NO_FIX: "says that there is no fix",
}
_UNIT_TOLERANCE = 1e-3
_N_QUATERNION = QUATERNION.size
_COLUMNS = 6  # of the covariances in an Odometry


@njit
def _finite(values):
    """True if all of a 1-D array is finite."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def _unit(q):
    """True if a quaternion (4,) is of unit length."""
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return abs(norm - 1.0) <= _UNIT_TOLERANCE


@njit
def _diagonal_to_block(R, sigma, block):
    """R diag(sigma^2) R' into a 3x3 at the start of a flat block with six columns."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += R[i, k] * sigma[k] * sigma[k] * R[j, k]
            block[_COLUMNS * i + j] = total


@njit
def _block_to_sigma(R, block, sigma):
    """Roots of the diagonal of R' C R, C the 3x3 at the start of a block with six columns."""
    for k in range(3):
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += R[i, k] * block[_COLUMNS * i + j] * R[j, k]
        sigma[k] = math.sqrt(max(total, 0.0))


@njit
def _R_flu_ned(q_nb, R):
    """Rotation matrix NED -> FLU of the attitude q_nb (4,) into R (3, 3)."""
    R_nb = scratch_matrix(3, 3)
    fill_R_nb(q_nb, R_nb)
    for j in range(3):
        R[0, j] = R_nb[j, 0]
        R[1, j] = -R_nb[j, 1]
        R[2, j] = -R_nb[j, 2]


@njit
def pack_nav(nav, block):
    """Navigation row (31,) into an Odometry block (85,), twist in the child frame.

    Covariances from the standard deviations: position and rotation about the fixed axes (ENU),
    velocity (FLU); that of the rate, which the row does not carry, stays as it is in the block.
    """
    ned_to_enu(nav[NAV.pos], block[ODOMETRY.pos])
    quat_ned_frd_to_enu_flu(nav[NAV.quat], block[ODOMETRY.quat])
    R, vel, linear = scratch_matrix(3, 3), nav[NAV.vel], block[ODOMETRY.linear]
    _R_flu_ned(nav[NAV.quat], R)
    for i in range(3):
        linear[i] = R[i, 0] * vel[0] + R[i, 1] * vel[1] + R[i, 2] * vel[2]
    frd_to_flu(nav[NAV.rate], block[ODOMETRY.angular])
    _diagonal_to_block(R_ENU_NED, nav[NAV.sigma_pos], block[ODOMETRY.pose_cov])
    _diagonal_to_block(R_ENU_NED, nav[NAV.sigma_att], block[ODOMETRY.rotation_cov])
    _diagonal_to_block(R, nav[NAV.sigma_vel], block[ODOMETRY.twist_cov])


@njit
def unpack_nav(block, nav):
    """Odometry block (85,) into a navigation row (31,); rotor states and biases become zero."""
    fill(nav, 0.0)
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[ODOMETRY.quat]):
        return NOT_UNIT
    enu_to_ned(block[ODOMETRY.pos], nav[NAV.pos])
    quat_enu_flu_to_ned_frd(block[ODOMETRY.quat], nav[NAV.quat])
    R, vel, linear = scratch_matrix(3, 3), nav[NAV.vel], block[ODOMETRY.linear]
    _R_flu_ned(nav[NAV.quat], R)
    for j in range(3):
        vel[j] = R[0, j] * linear[0] + R[1, j] * linear[1] + R[2, j] * linear[2]
    flu_to_frd(block[ODOMETRY.angular], nav[NAV.rate])
    _block_to_sigma(R_ENU_NED, block[ODOMETRY.pose_cov], nav[NAV.sigma_pos])
    _block_to_sigma(R_ENU_NED, block[ODOMETRY.rotation_cov], nav[NAV.sigma_att])
    _block_to_sigma(R, block[ODOMETRY.twist_cov], nav[NAV.sigma_vel])
    # Numbers near the largest double overflow when they are turned.
    return OK if _finite(nav) else NOT_FINITE


@njit
def pack_truth(x, block):
    """Rigid part of a plant state (13,), velocity in FRD, into an Odometry block (85,).

    The covariances stay as they are in the block.
    """
    ned_to_enu(x[PLANT.pos], block[ODOMETRY.pos])
    quat_ned_frd_to_enu_flu(x[PLANT.quat], block[ODOMETRY.quat])
    frd_to_flu(x[PLANT.vel], block[ODOMETRY.linear])
    frd_to_flu(x[PLANT.rate], block[ODOMETRY.angular])


@njit
def unpack_truth(block, x):
    """Odometry block (85,) into the rigid part of a plant state (13,)."""
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[ODOMETRY.quat]):
        return NOT_UNIT
    enu_to_ned(block[ODOMETRY.pos], x[PLANT.pos])
    quat_enu_flu_to_ned_frd(block[ODOMETRY.quat], x[PLANT.quat])
    flu_to_frd(block[ODOMETRY.linear], x[PLANT.vel])
    flu_to_frd(block[ODOMETRY.angular], x[PLANT.rate])
    return OK


@njit
def pack_imu(imu, block):
    """Specific force (m/s2) and rate (rad/s), body FRD (6,), into an Imu block (37,)."""
    frd_to_flu(imu[rows.IMU.force], block[IMU.accel])
    frd_to_flu(imu[rows.IMU.rate], block[IMU.rate])


@njit
def unpack_imu(block, imu):
    """Imu block (37,) into specific force and rate, body FRD (6,)."""
    flu_to_frd(block[IMU.accel], imu[rows.IMU.force])
    flu_to_frd(block[IMU.rate], imu[rows.IMU.rate])
    return OK if _finite(imu) else NOT_FINITE


@njit
def pack_body_vector(v, block):
    """Body vector FRD (3,) into the first three doubles, FLU."""
    frd_to_flu(v, block[VECTOR.xyz])


@njit
def unpack_body_vector(block, v):
    """First three doubles, FLU, into a body vector FRD (3,)."""
    flu_to_frd(block[VECTOR.xyz], v)
    return OK if _finite(v) else NOT_FINITE


@njit
def pack_world_vector(v, block):
    """World vector NED (3,) into the first three doubles, ENU."""
    ned_to_enu(v, block[VECTOR.xyz])


@njit
def unpack_world_vector(block, v):
    """First three doubles, ENU, into a world vector NED (3,)."""
    enu_to_ned(block[VECTOR.xyz], v)
    return OK if _finite(v) else NOT_FINITE


@njit
def pack_values(values, block):
    """Values (N,) into the first N doubles, as they are."""
    for i in range(values.size):
        block[i] = values[i]


@njit
def unpack_values(block, values):
    """First N doubles as they are into values (N,)."""
    for i in range(values.size):
        values[i] = block[i]
    return OK if _finite(values) else NOT_FINITE


@njit
def unpack_normalised(block, values):
    """First N doubles into values (N,), each of which must lie in [-1, 1]."""
    code = unpack_values(block, values)
    if code != OK:
        return code
    for value in values:
        if abs(value) > 1.0:
            return OUT_OF_RANGE
    return OK


@njit
def pack_rotor_speed(speed, block):
    """Speed of the main rotor (1,), rad/s, as a joint's velocity about the axis that points up.

    Seen from above it turns clockwise, so the sign changes (REP-103).
    """
    for i in range(speed.size):
        block[i] = -speed[i]


@njit
def unpack_rotor_speed(block, speed):
    """A joint's velocity into the speed of the main rotor (1,), rad/s."""
    for i in range(speed.size):
        speed[i] = -block[i]
    return OK if _finite(speed) else NOT_FINITE


@njit
def pack_attitude(euler, block):
    """phi, theta, psi (3,), rad, NED/FRD, into a quaternion block (4,), ENU/FLU."""
    phi, theta, psi = euler[SETPOINT.phi], euler[SETPOINT.theta], euler[SETPOINT.psi]
    q_nb = scratch(_N_QUATERNION)
    fill_from_euler(phi, theta, psi, q_nb)
    quat_ned_frd_to_enu_flu(q_nb, block)


@njit
def unpack_attitude(block, euler):
    """Quaternion block (4,) into phi, theta, psi (3,), rad."""
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block):
        return NOT_UNIT
    q_nb = scratch(_N_QUATERNION)
    quat_enu_flu_to_ned_frd(block, q_nb)
    euler[SETPOINT.phi], euler[SETPOINT.theta], euler[SETPOINT.psi] = euler_from_quat(q_nb)
    return OK


@njit
def pack_fix(pos_ned_m, datum: Datum, block):
    """Position NED (3,), m, into latitude, longitude (deg) and altitude (m); NaN stays NaN."""
    if _finite(pos_ned_m):
        ned_to_geodetic(pos_ned_m, datum, block[FIX.geodetic])
    else:
        block[FIX.geodetic] = math.nan


@njit
def unpack_fix(block, datum: Datum, pos_ned_m):
    """Latitude, longitude, altitude into position NED (3,), m."""
    if not _finite(block[FIX.geodetic]):
        return NOT_FINITE
    if abs(block[FIX.latitude]) > 90.0 or abs(block[FIX.longitude]) > 180.0:
        return OUT_OF_RANGE
    geodetic_to_ned(block[FIX.geodetic], datum, pos_ned_m)
    return OK if _finite(pos_ned_m) else NOT_FINITE


# -------------------------------------------------------------------------------------------------
# Channels.
# -------------------------------------------------------------------------------------------------

STATUS_FIX, STATUS_NO_FIX, _SERVICE_GPS = 0, -1, 1
FIX_STATUS = {"none": STATUS_FIX, "satellite": 1, "ground": 2}
"""NavSatStatus by what augments the fixes: ground stations, as for RTK, make STATUS_GBAS_FIX."""
COVARIANCE_UNKNOWN, COVARIANCE_DIAGONAL_KNOWN = 0, 2
UNKNOWN_VARIANCE = 1e6
"""Of what is not measured, SI^2: so large that nobody believes the value."""
EXACT_VARIANCE = 1e-18
"""Of what is known exactly, SI^2: below every sensor's. Zero would be read as "unknown"."""
# Of the joints in a message: an aircraft has few, and each is looked for.
_MOST_JOINTS, _SHOWN, _LONGEST_TEXT = 64, 8, 40
_PLURAL = {"position": "positions", "velocity": "velocities"}


class MessageCause(Enum):
    """Why a message cannot be used."""

    CUT_OFF = "it is too short to hold a stamp"
    TOO_LONG = "it has more bytes, joints or points than are looked through"
    UNREADABLE = "it is no message of its type"
    FRAME = "it is in another frame"
    AIRCRAFT = "it is for another aircraft"
    MISSING_JOINT = "a joint is missing"
    LENGTH = "it has not as many of one as of another: joints and numbers, points and poses"
    NO_POINTS = "it holds no points"
    TRAJECTORY = "its points or times cannot be flown"
    NOT_FINITE = "a number is not finite"
    QUATERNION = "a quaternion is not of unit length"
    OUT_OF_RANGE = "a number is outside of its range"
    NO_FIX = "the receiver has no fix"
    AXIS = "a number is not 0 about or along an axis that cannot be commanded"
    NOT_LEVEL = "an orientation is not level"
    COMMAND = "it names no command and id"


class MessageError(ValueError):
    """A message that cannot be used; the text is one sentence that names topic and reason.

    Parameters
    ----------
    problem : str
        What is wrong, in words; the sentence is made of it and of the facts.

    Attributes
    ----------
    cause : MessageCause or None
        For programs; None where none is named.
    topic : str
        Its name; empty where the problem names it.
    value : Any
        What is refused: a frame's name, a number, a length; None where it is no matter of one.
    allowed : str
        What would be allowed, in words.
    """

    def __init__(
        self,
        problem: str,
        cause: MessageCause | None = None,
        *,
        topic: str = "",
        value: Any = None,
        allowed: str = "",
    ) -> None:
        super().__init__(problem)
        self.problem, self.cause, self.topic = problem, cause, topic
        self.value, self.allowed = value, allowed

    def __str__(self) -> str:
        line = f"{self.topic}: {self.problem}" if self.topic else self.problem
        return f"{line}; allowed: {self.allowed}" if self.allowed else line


class FrameError(MessageError):
    """A message in another frame than its topic's.

    Parameters
    ----------
    topic, frame : str
        The message's.
    allowed : str
        Which frames are, in words.
    says : str
        What the frame's name says that is wrong.
    """

    def __init__(self, topic: str, frame: str, allowed: str = "", says: str = "") -> None:
        super().__init__(
            f"frame {quoted(frame)}{says}",
            MessageCause.FRAME,
            topic=topic,
            value=frame,
            allowed=allowed,
        )


class CutOffError(MessageError):
    """A message that is too short to hold a stamp: nobody knows when it belongs."""


_CAUSES = {
    NOT_FINITE: MessageCause.NOT_FINITE,
    NOT_UNIT: MessageCause.QUATERNION,
    OUT_OF_RANGE: MessageCause.OUT_OF_RANGE,
    NO_FIX: MessageCause.NO_FIX,
}
_Lay = Callable[[Layout], Layout]
"""Appends what stands behind the frames' names."""


def _doubles(count: int) -> _Lay:
    return lambda layout: layout.doubles(count)


def _joints(names: tuple[str, ...]) -> _Lay:
    count = len(names)
    return lambda layout: layout.texts(names).put("I", count).doubles(count).put("I", 0).put("I", 0)


def _velocities(names: tuple[str, ...]) -> _Lay:
    count = len(names)
    return lambda layout: layout.texts(names).put("I", 0).put("I", count).doubles(count).put("I", 0)


def _fix(layout: Layout) -> Layout:
    layout.put("b", STATUS_FIX, free=True).put("H", _SERVICE_GPS).doubles(FIX.size)
    return layout.put("B", COVARIANCE_DIAGONAL_KNOWN, free=True)


def quoted(text: str) -> str:
    """A text out of a message for a sentence: short, and nothing that steers a terminal."""
    return f"'{printable(text, _LONGEST_TEXT)}'"


def _joint_block(
    names: tuple[str, ...], field: str = "position"
) -> Callable[[Any, str, NDArray], None]:
    def read(message: Any, topic: str, block: NDArray) -> None:
        numbers = getattr(message, field)
        if len(message.name) > _MOST_JOINTS:
            raise MessageError(
                f"names {len(message.name)} joints",
                MessageCause.TOO_LONG,
                topic=topic,
                value=len(message.name),
                allowed=f"at most {_MOST_JOINTS}",
            )
        if len(numbers) != len(message.name):
            raise MessageError(
                f"{len(message.name)} names but {len(numbers)} {_PLURAL[field]}",
                MessageCause.LENGTH,
                topic=topic,
                value=(len(message.name), len(numbers)),
            )
        for i, name in enumerate(names):
            if name not in message.name:
                got = (
                    ", ".join(printable(joint, _LONGEST_TEXT) for joint in message.name[:_SHOWN])
                    or "none"
                )
                got += ", ..." if len(message.name) > _SHOWN else ""
                raise MessageError(
                    f"no joint '{name}'; the message names {got}",
                    MessageCause.MISSING_JOINT,
                    topic=topic,
                    value=name,
                )
            block[i] = numbers[list(message.name).index(name)]

    return read


def refusal(topic: str, code: int) -> MessageError:
    """The error of a code of `REASONS`."""
    return MessageError(REASONS[code], _CAUSES[code], topic=topic)


def _xyz(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def _xyzw(q: Any) -> list[float]:
    return [q.x, q.y, q.z, q.w]


def _odometry_block(message: Any, topic: str, block: NDArray) -> None:
    pose, twist = message.pose, message.twist
    block[ODOMETRY.pose] = _xyz(pose.pose.position) + _xyzw(pose.pose.orientation)
    block[ODOMETRY.pose_cov] = pose.covariance
    block[ODOMETRY.twist] = _xyz(twist.twist.linear) + _xyz(twist.twist.angular)
    block[ODOMETRY.twist_cov] = twist.covariance


def _imu_block(message: Any, topic: str, block: NDArray) -> None:
    block[IMU.quat] = _xyzw(message.orientation)
    block[IMU.quat_cov] = message.orientation_covariance
    block[IMU.rate] = _xyz(message.angular_velocity)
    block[IMU.rate_cov] = message.angular_velocity_covariance
    block[IMU.accel] = _xyz(message.linear_acceleration)
    block[IMU.accel_cov] = message.linear_acceleration_covariance


def _fix_block(message: Any, topic: str, block: NDArray) -> None:
    if message.status.status < STATUS_FIX:
        raise refusal(topic, NO_FIX)
    block[FIX.geodetic] = message.latitude, message.longitude, message.altitude
    block[FIX.cov] = message.position_covariance


def _mag_block(message: Any, topic: str, block: NDArray) -> None:
    block[FIELD.field] = _xyz(message.magnetic_field)
    block[FIELD.cov] = message.magnetic_field_covariance


def _twist_block(message: Any, topic: str, block: NDArray) -> None:
    block[TWIST.twist] = _xyz(message.twist.twist.linear) + _xyz(message.twist.twist.angular)
    block[TWIST.cov] = message.twist.covariance


def _pressure_block(message: Any, topic: str, block: NDArray) -> None:
    block[PRESSURE.pressure], block[PRESSURE.variance] = message.fluid_pressure, message.variance


def _quaternion_block(message: Any, topic: str, block: NDArray) -> None:
    block[QUATERNION.xyzw] = _xyzw(message.quaternion)


def _vector_block(message: Any, topic: str, block: NDArray) -> None:
    block[VECTOR.xyz] = _xyz(message.vector)


@dataclass(frozen=True)
class Channel:
    """How one topic's arrays and messages correspond.

    Attributes
    ----------
    size : int
        Length of the core's array.
    frames : tuple of str
        Frame of the header, and that of the child where the message has one (`frame_ids`).
    rest : callable
        Appends to a `Layout` what stands behind the frames.
    pack, unpack : callable
        Kernels of `packing`.
    read : callable
        Fills the block from a message object, `(message, topic, block)`.
    variance_at : tuple of (int, int)
        Per group of variances that `pack` leaves alone: offset in the block of a 3x3 (or 6x6, or
        scalar) covariance and its width.
    variance : float
        Of the groups for which the sender gives none, SI^2.
    wider : Channel, optional
        The same with more joints behind, if a message may have them.
    joints : tuple of str
        What tells the wider message: names that it has.
    """

    size: int
    frames: tuple[str, ...]
    rest: _Lay
    pack: Callable[..., Any]
    unpack: Callable[..., Any]
    read: Callable[[Any, str, NDArray], None]
    variance_at: tuple[tuple[int, int], ...] = ()
    variance: float = UNKNOWN_VARIANCE
    wider: "Channel | None" = None
    joints: tuple[str, ...] = ()

    def layout(self, namespace: str = "") -> Layout:
        """The message as the aircraft in a namespace sends it."""
        return self.layout_in([in_namespace(frame, namespace) for frame in self.frames])

    def layout_in(self, frames: Sequence[str]) -> Layout:
        """The message with other names of its frames."""
        layout = Layout().stamp()
        for frame in frames:
            layout.text(frame)
        return self.rest(layout)


def _imu(frame: str) -> Channel:
    return Channel(
        rows.IMU.size, (frame,), _doubles(IMU.size), pack_imu, unpack_imu, _imu_block,
        ((IMU.rate_cov.start, 3), (IMU.accel_cov.start, 3)),
    )  # fmt: skip


_BODY, _WORLD = (BASE,), (MAP,)
_TWIST_AT = ((TWIST.cov.start, 6), (TWIST.cov.start + 21, 6))
_RATE_AT = ODOMETRY.twist_cov.start + 21
_TRUTH_AT = tuple(
    (first + block, 6) for first in (ODOMETRY.pose_cov.start, ODOMETRY.twist_cov.start)
    for block in (0, 21)
)  # fmt: skip
_HANDED = (*topics.COLLECTIVE_NAMES, *topics.HAND_NAMES)
_BY_HAND = Channel(
    len(_HANDED), _BODY, _joints(_HANDED), pack_values, unpack_normalised,
    _joint_block(_HANDED), joints=_HANDED,
)  # fmt: skip
_SAMPLE_LAYOUTS: dict[str, tuple[int, Callable[..., None], tuple[tuple[int, int], ...]]] = {
    "sensor_msgs/msg/MagneticField": (FIELD.size, _mag_block, ((FIELD.cov.start, 3),)),
    "sensor_msgs/msg/FluidPressure": (PRESSURE.size, _pressure_block, ((PRESSURE.variance, 1),)),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (TWIST.size, _twist_block, _TWIST_AT),
    "geometry_msgs/msg/Vector3Stamped": (VECTOR.size, _vector_block, ()),
}
"""By the message of a sensor's samples: doubles, how they are read, where variances stand."""
_OF_AXES = {
    "body": (pack_body_vector, unpack_body_vector),
    "ned": (pack_world_vector, unpack_world_vector),
    "each": (pack_values, unpack_values),
}


def _samples(row: sensors.SampledSensor) -> Channel:
    size, read, variance_at = _SAMPLE_LAYOUTS[row.message]
    return Channel(
        row.numbers, (row.frame,), _doubles(size), *_OF_AXES[row.axes], read, variance_at
    )


CHANNELS: dict[str, Channel] = {
    topics.IMU: _imu(IMU_LINK),
    topics.IMU2: _imu(IMU2_LINK),
    **{row.topic: _samples(row) for row in sensors.SENSORS if row.message in _SAMPLE_LAYOUTS},
    topics.GPS_FIX: Channel(
        3, (GPS_LINK,), _fix, pack_fix, unpack_fix, _fix_block, ((FIX.cov.start, 3),)
    ),
    topics.GPS_VELOCITY: Channel(
        3, _WORLD, _doubles(TWIST.size), pack_world_vector, unpack_world_vector,
        _twist_block, _TWIST_AT,
    ),
    topics.ROTOR_SPEED: Channel(
        1, _BODY, _velocities(topics.ROTOR_SPEED_NAMES), pack_rotor_speed,
        unpack_rotor_speed, _joint_block(topics.ROTOR_SPEED_NAMES, "velocity"),
    ),
    topics.ODOM: Channel(
        rows.NAV.size, (MAP, BASE), _doubles(ODOMETRY.size), pack_nav, unpack_nav,
        _odometry_block, ((_RATE_AT, 6),),
    ),
    topics.ROTOR_STATE: Channel(
        rows.ROTOR.size, _BODY, _joints(topics.ROTOR_NAMES), pack_values, unpack_values,
        _joint_block(topics.ROTOR_NAMES),
    ),
    topics.ATTITUDE_SETPOINT: Channel(
        3, _WORLD, _doubles(QUATERNION.size), pack_attitude, unpack_attitude,
        _quaternion_block,
    ),
    topics.COLLECTIVE: Channel(
        1, _BODY, _joints(topics.COLLECTIVE_NAMES), pack_values, unpack_normalised,
        _joint_block(topics.COLLECTIVE_NAMES), wider=_BY_HAND,
    ),
    topics.ACTUATORS: Channel(
        rows.ACTUATOR.size, _BODY, _joints(topics.ACTUATOR_NAMES), pack_values,
        unpack_normalised, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.TRUTH_ODOM: Channel(
        rows.PLANT.rigid.stop, (MAP, BASE), _doubles(ODOMETRY.size), pack_truth,
        unpack_truth, _odometry_block, _TRUTH_AT, EXACT_VARIANCE,
    ),
    topics.TRUTH_WIND: Channel(
        3, _WORLD, _doubles(VECTOR.size), pack_world_vector, unpack_world_vector,
        _vector_block,
    ),
    topics.TRUTH_ROTOR: Channel(
        rows.JOINTS.size, _BODY, _joints(topics.TRUTH_ROTOR_NAMES), pack_values,
        unpack_values, _joint_block(topics.TRUTH_ROTOR_NAMES),
    ),
    topics.EXCITATION_ACTUATORS: Channel(
        rows.ACTUATOR.size, _BODY, _joints(topics.ACTUATOR_NAMES), pack_values,
        unpack_values, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.EXCITATION_ATTITUDE: Channel(
        3, _WORLD, _doubles(QUATERNION.size), pack_attitude, unpack_attitude,
        _quaternion_block,
    ),
    topics.EXCITATION_WIND: Channel(
        3, _WORLD, _doubles(VECTOR.size), pack_world_vector, unpack_world_vector,
        _vector_block,
    ),
}  # fmt: skip
