# SPDX-License-Identifier: Apache-2.0
"""Arrays of the cores <-> serialised messages, for every stream of the graph.

`Encoder` and `Decoder` of a topic share one table (`CHANNELS`). The usual message has a layout that
is known beforehand and is read from its bytes (`cdr`). Any other valid message of the type, such as
a pilot's with another frame_id or other joints in another order, goes through the ordinary decoder.
What cannot be used is refused by `MessageError`, which names topic and reason.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math import rows
from heli_math.ticks import NS_PER_S
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
from heli_msgs_bridge.cdr import FixedMessage, Layout, stamp_of
from heli_msgs_bridge.frames import Datum

MAP, BASE = "map", "base_link"
_NOT_ENU = re.compile(r"_(ned|frd)\Z")
_STATUS_FIX, _STATUS_NO_FIX, _SERVICE_GPS = 0, -1, 1
_COVARIANCE_DIAGONAL_KNOWN = 2


class MessageError(ValueError):
    """A message that cannot be used; the text names topic and reason."""


class CutOffError(MessageError):
    """A message that is too short to hold a stamp: nobody knows when it belongs."""


def _headed(frame: str) -> Layout:
    return Layout().stamp().text(frame)


def _joints(names: tuple[str, ...], frame: str = BASE) -> Layout:
    layout = _headed(frame).texts(names).put("I", len(names)).doubles(len(names))
    return layout.put("I", 0).put("I", 0)


def _odometry(frame: str) -> Layout:
    return _headed(frame).text(BASE).doubles(ODOMETRY.size)


def _fix() -> Layout:
    layout = _headed("gps_link").put("b", _STATUS_FIX).put("H", _SERVICE_GPS).doubles(FIX.size)
    return layout.put("B", _COVARIANCE_DIAGONAL_KNOWN)


def _joint_block(names: tuple[str, ...]) -> Callable[[Any, str, NDArray], None]:
    def read(message: Any, topic: str, block: NDArray) -> None:
        if len(message.position) != len(message.name):
            raise MessageError(
                f"{topic}: {len(message.name)} names but {len(message.position)} positions"
            )
        for i, name in enumerate(names):
            if name not in message.name:
                got = ", ".join(message.name) or "none"
                raise MessageError(f"{topic}: no joint '{name}'; the message names {got}")
            block[i] = message.position[list(message.name).index(name)]

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
    if message.status.status < _STATUS_FIX:
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
    layout : callable
        Makes the message's `Layout`.
    pack, unpack : callable
        Kernels of `packing`.
    read : callable
        Fills the block from a message object, `(message, topic, block)`.
    variance_at : tuple of (int, int)
        Per group of variances: offset in the block of a 3x3 (or 6x6, or scalar) covariance and its
        width.
    free : callable
        Offsets of the layout that may differ from message to message.
    """

    size: int
    layout: Callable[[], Layout]
    pack: Callable[..., Any]
    unpack: Callable[..., Any]
    read: Callable[[Any, str, NDArray], None]
    variance_at: tuple[tuple[int, int], ...] = ()
    free: Callable[[Layout], tuple[int, ...]] = lambda layout: ()


def _status_offset(layout: Layout) -> tuple[int, ...]:
    """Offset of NavSatFix.status.status: it follows the frame_id directly."""
    return (4 + 8 + 4 + len("gps_link") + 1,)


_P = packing
CHANNELS: dict[str, Channel] = {
    topics.IMU: Channel(
        rows.IMU.size, lambda: _headed("imu_link").doubles(IMU.size), _P.pack_imu, _P.unpack_imu,
        _imu_block, ((IMU.rate_cov.start, 3), (IMU.accel_cov.start, 3)),
    ),
    topics.MAG: Channel(
        3, lambda: _headed("imu_link").doubles(FIELD.size), _P.pack_body_vector,
        _P.unpack_body_vector, _mag_block, ((FIELD.cov.start, 3),),
    ),
    topics.GPS_FIX: Channel(
        3, _fix, _P.pack_fix, _P.unpack_fix, _fix_block, ((FIX.cov.start, 3),), _status_offset
    ),
    topics.GPS_VELOCITY: Channel(
        3, lambda: _headed(MAP).doubles(TWIST.size), _P.pack_world_vector, _P.unpack_world_vector,
        _twist_block, ((TWIST.cov.start, 6),),
    ),
    topics.BARO: Channel(
        1, lambda: _headed(BASE).doubles(PRESSURE.size), _P.pack_values, _P.unpack_values,
        _pressure_block, ((PRESSURE.variance, 1),),
    ),
    topics.ODOM: Channel(
        rows.NAV.size, lambda: _odometry("odom"), _P.pack_nav, _P.unpack_nav, _odometry_block
    ),
    topics.ROTOR_STATE: Channel(
        rows.ROTOR.size, lambda: _joints(topics.ROTOR_NAMES), _P.pack_values, _P.unpack_values,
        _joint_block(topics.ROTOR_NAMES),
    ),
    topics.ATTITUDE_SETPOINT: Channel(
        3, lambda: _headed("odom").doubles(QUATERNION.size), _P.pack_attitude, _P.unpack_attitude,
        _quaternion_block,
    ),
    topics.COLLECTIVE: Channel(
        1, lambda: _joints(topics.COLLECTIVE_NAMES), _P.pack_values, _P.unpack_normalised,
        _joint_block(topics.COLLECTIVE_NAMES),
    ),
    topics.ACTUATORS: Channel(
        rows.ACTUATOR.size, lambda: _joints(topics.ACTUATOR_NAMES), _P.pack_values,
        _P.unpack_normalised, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.TRUTH_ODOM: Channel(
        rows.PLANT.rigid.stop, lambda: _odometry(MAP), _P.pack_truth, _P.unpack_truth,
        _odometry_block,
    ),
    topics.TRUTH_WIND: Channel(
        3, lambda: _headed(MAP).doubles(VECTOR.size), _P.pack_world_vector, _P.unpack_world_vector,
        _vector_block,
    ),
    topics.TRUTH_ROTOR: Channel(
        rows.JOINTS.size, lambda: _joints(topics.TRUTH_ROTOR_NAMES), _P.pack_values,
        _P.unpack_values, _joint_block(topics.TRUTH_ROTOR_NAMES),
    ),
    topics.EXCITATION_ACTUATORS: Channel(
        rows.ACTUATOR.size, lambda: _joints(topics.ACTUATOR_NAMES), _P.pack_values,
        _P.unpack_values, _joint_block(topics.ACTUATOR_NAMES),
    ),
    topics.EXCITATION_WIND: Channel(
        3, lambda: _headed(MAP).doubles(VECTOR.size), _P.pack_world_vector, _P.unpack_world_vector,
        _vector_block,
    ),
}  # fmt: skip


class Encoder:
    """Array -> serialised message of one topic.

    Parameters
    ----------
    topic : str
        Name in `topics.TABLE`.
    variances : sequence of float
        Constant variance of each covariance group of the message (Imu: rate, acceleration), SI^2.
    datum : Datum, optional
        For `gps/fix`.
    """

    def __init__(
        self, topic: str, variances: tuple[float, ...] = (), datum: Datum | None = None
    ) -> None:
        channel = CHANNELS[topic]
        layout = channel.layout()
        self._free = channel.free(layout)
        self._message = FixedMessage(layout, self._free)
        self._block, self._pack, self._datum = self._message.block, channel.pack, datum
        self._topic, self._size = topic, channel.size
        if topic == topics.GPS_FIX and datum is None:
            raise ValueError(f"{topic}: needs a datum")
        if topic == topics.IMU:
            # No orientation is given (message definition; REP-145).
            self._block[IMU.quat_cov.start] = -1.0
        for (start, width), variance in zip(channel.variance_at, variances, strict=False):
            for i in range(min(width, 3)):
                self._block[start + i * (width + 1)] = variance

    def encode(self, array: NDArray[np.float64], stamp_ns: int) -> bytes:
        """Serialised message of the array (NED/FRD), stamped in ns.

        Raises
        ------
        ValueError
            The array is shorter than the topic's row (`Channel.size`).
        """
        if array.size < self._size:
            # The kernels do not check: they would send what is in memory behind it.
            raise ValueError(f"{self._topic}: {array.size} numbers, expected {self._size}")
        if self._datum is None:
            self._pack(array, self._block)
            return self._message.encode(stamp_ns)
        self._pack(array, self._datum, self._block)
        lost = self._block[FIX.latitude] != self._block[FIX.latitude]
        self._message.set_byte(self._free[0], _STATUS_NO_FIX & 0xFF if lost else _STATUS_FIX)
        return self._message.encode(stamp_ns)


def _refuse_frame(topic: str, message: Any) -> None:
    for frame in (message.header.frame_id, getattr(message, "child_frame_id", "")):
        if _NOT_ENU.search(frame):
            raise MessageError(
                f"{topic}: frame '{frame}' says NED or FRD; expected ENU and FLU (REP-103)"
            )


class Decoder:
    """Serialised message -> array of one topic.

    Parameters
    ----------
    topic : str
        Name in `topics.TABLE`.
    datum : Datum, optional
        For `gps/fix`.
    deserialize : callable, optional
        `bytes -> message object` for messages of unusual layout; by default rclpy's.

    Attributes
    ----------
    array : ndarray
        The last decoded array (NED/FRD), overwritten by the next.
    stamp_ns : int
        Stamp of the last message, also of a refused one unless it was cut off.
    """

    def __init__(
        self,
        topic: str,
        datum: Datum | None = None,
        deserialize: Callable[[bytes], Any] | None = None,
    ) -> None:
        channel = CHANNELS[topic]
        layout = channel.layout()
        self._free = channel.free(layout)
        self._message = FixedMessage(layout, self._free)
        self._channel, self._unpack, self._datum = channel, channel.unpack, datum
        if topic == topics.GPS_FIX and datum is None:
            raise ValueError(f"{topic}: needs a datum")
        self._deserialize = deserialize or rclpy_deserializer(topic)
        self.topic, self.array = topic, np.zeros(channel.size)
        self.stamp_ns = 0

    def decode(self, raw: bytes) -> NDArray[np.float64]:
        """Array (NED/FRD) of a serialised message; its stamp is in `stamp_ns`.

        Raises
        ------
        MessageError
            Not finite, not a unit quaternion, out of range, no fix, a joint missing, a frame that
            is not ENU/FLU, or not a message of this type.
        CutOffError
            Too short to hold a stamp; `stamp_ns` is still that of the message before.
        """
        message = self._message
        if message.decode(raw):
            self.stamp_ns = message.stamp_ns
            # An int8: the upper half are negative, no fix or a status that is not known.
            if self._free and message.get_byte(self._free[0]) > 0x7F:
                raise MessageError(f"{self.topic}: {packing.REASONS[packing.NO_FIX]}")
        else:
            self._decode_slowly(raw)
        if self._datum is None:
            code = self._unpack(message.block, self.array)
        else:
            code = self._unpack(message.block, self._datum, self.array)
        if code:
            raise MessageError(f"{self.topic}: {packing.REASONS[code]}")
        return self.array

    def _decode_slowly(self, raw: bytes) -> None:
        if len(raw) < 12:
            raise CutOffError(f"{self.topic}: a message of {len(raw)} bytes is cut off")
        self.stamp_ns = stamp_of(raw)
        try:
            message = self._deserialize(raw)
        except Exception as error:
            raise MessageError(f"{self.topic}: cannot be deserialised: {error}") from error
        stamp = message.header.stamp
        self.stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
        _refuse_frame(self.topic, message)
        self._channel.read(message, self.topic, self._message.block)


def rclpy_deserializer(topic: str) -> Callable[[bytes], Any]:
    """`bytes -> message object` of a topic through rclpy, imported when first needed."""
    type_name = topics.BY_NAME[topic].type

    def deserialize(raw: bytes) -> Any:
        from rclpy.serialization import deserialize_message

        return deserialize_message(raw, topics.message_class(type_name))

    return deserialize


class ClockEncoder:
    """Tick time -> serialised `rosgraph_msgs/Clock`."""

    def encode(self, stamp_ns: int) -> bytes:
        """Serialised clock message of a time in ns."""
        sec, nanosec = divmod(stamp_ns, NS_PER_S)
        return bytes(Layout().put("i", sec).put("I", nanosec).data)
