# SPDX-License-Identifier: Apache-2.0
"""How the arrays of each topic and its messages correspond: frames, layout, conversion. One table.

`messages` makes encoders and decoders of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from heli_math import rows
from heli_msgs_bridge import packing, topics
from heli_msgs_bridge.blocks import (
    FIELD,
    FIX,
    IMU,
    ODOMETRY,
    PRESSURE,
    QUATERNION,
    TWIST,
    VECTOR,
)
from heli_msgs_bridge.cdr import Layout
from heli_msgs_bridge.frame_ids import BASE, GPS_LINK, IMU2_LINK, IMU_LINK, MAP, in_namespace
from heli_parameters.printable import printable

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


class MessageError(ValueError):
    """A message that cannot be used; the text names topic and reason."""


class FrameError(MessageError):
    """A message in another frame than its topic's."""


class CutOffError(MessageError):
    """A message that is too short to hold a stamp: nobody knows when it belongs."""


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
                f"{topic}: names {len(message.name)} joints; allowed: at most {_MOST_JOINTS}"
            )
        if len(numbers) != len(message.name):
            raise MessageError(
                f"{topic}: {len(message.name)} names but {len(numbers)} {_PLURAL[field]}"
            )
        for i, name in enumerate(names):
            if name not in message.name:
                got = (
                    ", ".join(printable(given, _LONGEST_TEXT) for given in message.name[:_SHOWN])
                    or "none"
                )
                got += ", ..." if len(message.name) > _SHOWN else ""
                raise MessageError(f"{topic}: no joint '{name}'; the message names {got}")
            block[i] = numbers[list(message.name).index(name)]

    return read


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
        raise MessageError(f"{topic}: {packing.REASONS[packing.NO_FIX]}")
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


_P = packing


def _imu(frame: str) -> Channel:
    return Channel(
        rows.IMU.size, (frame,), _doubles(IMU.size), _P.pack_imu, _P.unpack_imu, _imu_block,
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
    len(_HANDED), _BODY, _joints(_HANDED), _P.pack_values, _P.unpack_normalised,
    _joint_block(_HANDED), joints=_HANDED,
)  # fmt: skip
CHANNELS: dict[str, Channel] = {
    topics.IMU: _imu(IMU_LINK),
    topics.IMU2: _imu(IMU2_LINK),
    topics.MAG: Channel(
        3, (IMU_LINK,), _doubles(FIELD.size), _P.pack_body_vector, _P.unpack_body_vector,
        _mag_block, ((FIELD.cov.start, 3),),
    ),
    topics.GPS_FIX: Channel(
        3, (GPS_LINK,), _fix, _P.pack_fix, _P.unpack_fix, _fix_block, ((FIX.cov.start, 3),)
    ),
    topics.GPS_VELOCITY: Channel(
        3, _WORLD, _doubles(TWIST.size), _P.pack_world_vector, _P.unpack_world_vector,
        _twist_block, _TWIST_AT,
    ),
    topics.BARO: Channel(
        1, _BODY, _doubles(PRESSURE.size), _P.pack_values, _P.unpack_values, _pressure_block,
        ((PRESSURE.variance, 1),),
    ),
    topics.ROTOR_SPEED: Channel(
        1, _BODY, _velocities(topics.ROTOR_SPEED_NAMES), _P.pack_rotor_speed,
        _P.unpack_rotor_speed, _joint_block(topics.ROTOR_SPEED_NAMES, "velocity"),
    ),
    topics.ODOM: Channel(
        rows.NAV.size, (MAP, BASE), _doubles(ODOMETRY.size), _P.pack_nav, _P.unpack_nav,
        _odometry_block, ((_RATE_AT, 6),),
    ),
    topics.ROTOR_STATE: Channel(
        rows.ROTOR.size, _BODY, _joints(topics.ROTOR_NAMES), _P.pack_values, _P.unpack_values,
        _joint_block(topics.ROTOR_NAMES),
    ),
    topics.ATTITUDE_SETPOINT: Channel(
        3, _WORLD, _doubles(QUATERNION.size), _P.pack_attitude, _P.unpack_attitude,
        _quaternion_block,
    ),
    topics.COLLECTIVE: Channel(
        1, _BODY, _joints(topics.COLLECTIVE_NAMES), _P.pack_values, _P.unpack_normalised,
        _joint_block(topics.COLLECTIVE_NAMES), wider=_BY_HAND,
    ),
    topics.ACTUATORS: Channel(
        rows.ACTUATOR.size, _BODY, _joints(topics.ACTUATOR_NAMES), _P.pack_values,
        _P.unpack_normalised, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.TRUTH_ODOM: Channel(
        rows.PLANT.rigid.stop, (MAP, BASE), _doubles(ODOMETRY.size), _P.pack_truth,
        _P.unpack_truth, _odometry_block, _TRUTH_AT, EXACT_VARIANCE,
    ),
    topics.TRUTH_WIND: Channel(
        3, _WORLD, _doubles(VECTOR.size), _P.pack_world_vector, _P.unpack_world_vector,
        _vector_block,
    ),
    topics.TRUTH_ROTOR: Channel(
        rows.JOINTS.size, _BODY, _joints(topics.TRUTH_ROTOR_NAMES), _P.pack_values,
        _P.unpack_values, _joint_block(topics.TRUTH_ROTOR_NAMES),
    ),
    topics.EXCITATION_ACTUATORS: Channel(
        rows.ACTUATOR.size, _BODY, _joints(topics.ACTUATOR_NAMES), _P.pack_values,
        _P.unpack_values, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.EXCITATION_ATTITUDE: Channel(
        3, _WORLD, _doubles(QUATERNION.size), _P.pack_attitude, _P.unpack_attitude,
        _quaternion_block,
    ),
    topics.EXCITATION_WIND: Channel(
        3, _WORLD, _doubles(VECTOR.size), _P.pack_world_vector, _P.unpack_world_vector,
        _vector_block,
    ),
}  # fmt: skip
