# SPDX-License-Identifier: Apache-2.0
"""Arrays of the cores <-> serialised messages, for every stream of the graph.

`Encoder` and `Decoder` of a topic share one table (`channels`). The usual message has a layout that
is known beforehand and is read from its bytes (`cdr`). Any other valid message of the type, such as
a pilot's with another frame_id or other joints in another order, goes through the ordinary decoder.
What cannot be used is refused by `MessageError`, which names topic and reason.
"""

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.rcl_yaml import printable
from heli_core.rows import NAV
from heli_core.ticks import NS_PER_S, TICK_S
from heli_msgs_bridge import layouts, topics
from heli_msgs_bridge.cdr import FixedMessage, Layout, stamp_of
from heli_msgs_bridge.frames import Datum, ned_to_enu, quat_ned_frd_to_enu_flu
from heli_msgs_bridge.layouts import (
    CHANNELS,
    COVARIANCE_DIAGONAL_KNOWN,
    COVARIANCE_UNKNOWN,
    EXACT_VARIANCE,
    FIX,
    FIX_STATUS,
    IMU,
    STATUS_FIX,
    STATUS_NO_FIX,
    Channel,
    CutOffError,
    FrameError,
    MessageCause,
    MessageError,
)
from heli_msgs_bridge.message_size import too_long
from heli_msgs_bridge.topics import BASE, MAP, ODOM, in_namespace

# -------------------------------------------------------------------------------------------------
# Messages.
# -------------------------------------------------------------------------------------------------

__all__ = [
    "CHANNELS",
    "FIX_STATUS",
    "ClockEncoder",
    "CutOffError",
    "Decoder",
    "Encoder",
    "FrameError",
    "MessageCause",
    "MessageError",
    "Variance",
    "has_fix",
]
_NOT_ENU = re.compile(r"_(ned|frd)\Z")
Variance = float | tuple[float, float, float]
"""One for all three axes, or one for each, in the message's axes; SI^2."""


class Encoder:
    """Array -> serialised message of one topic.

    Parameters
    ----------
    topic : str
        Name in `topics.TABLE`.
    variances : sequence of Variance
        Constant variance of each covariance group of the message (Imu: rate, acceleration). A
        group for which none is given says that it is not known.
    datum : Datum, optional
        For `gps/fix`.
    namespace : str
        Of the aircraft, whose frames carry it.
    fix_status : int
        For `gps/fix`: one of `FIX_STATUS`.
    """

    def __init__(
        self,
        topic: str,
        variances: Sequence[Variance] = (),
        datum: Datum | None = None,
        namespace: str = "",
        fix_status: int = STATUS_FIX,
    ) -> None:
        channel = CHANNELS[topic]
        layout = channel.layout(namespace)
        self._free, self._fix_status = layout.free, fix_status
        self._message = FixedMessage(layout)
        self._block, self._pack, self._datum = self._message.block, channel.pack, datum
        self._topic, self._size = topic, channel.size
        wider = channel.wider
        self._wider = None if wider is None else FixedMessage(wider.layout(namespace))
        if topic == topics.GPS_FIX and datum is None:
            raise ValueError(f"{topic}: needs a datum")
        if topic in (topics.IMU, topics.IMU2):
            # No orientation is given (message definition; REP-145).
            self._block[IMU.quat_cov.start] = -1.0
        diagonals = [*variances, *[channel.variance] * len(channel.variance_at)]
        for (start, width), variance in zip(channel.variance_at, diagonals, strict=False):
            size = min(width, 3)
            diagonal = np.maximum(np.broadcast_to(variance, 3), EXACT_VARIANCE)[:size]
            self._block[start : start + size * (width + 1) : width + 1] = diagonal

    def encode(self, array: NDArray[np.float64], stamp_ns: int) -> bytes:
        """Serialised message of the array (NED/FRD), stamped in ns.

        Where the channel has a wider message, a longer array becomes that.

        Raises
        ------
        ValueError
            The array is shorter than the topic's row (`Channel.size`).
        """
        if array.size < self._size:
            # The kernels do not check: they would send what is in memory behind it.
            raise ValueError(f"{self._topic}: {array.size} numbers, expected {self._size}")
        if self._datum is None:
            message = self._message
            if self._wider is not None and array.size > self._size:
                message = self._wider
            self._pack(array, message.block)
            return message.encode(stamp_ns)
        self._pack(array, self._datum, self._block)
        lost = self._block[FIX.latitude] != self._block[FIX.latitude]
        status, covariance = self._free
        self._message.set_byte(status, STATUS_NO_FIX & 0xFF if lost else self._fix_status)
        known = COVARIANCE_UNKNOWN if lost else COVARIANCE_DIAGONAL_KNOWN
        self._message.set_byte(covariance, known)
        return self._message.encode(stamp_ns)


def has_fix(message: Any) -> bool:
    """Whether a NavSatFix is one: a receiver without a fix sends STATUS_NO_FIX."""
    return bool(message.status.status >= STATUS_FIX)


def _frames_of(message: Any) -> tuple[str, ...]:
    """Names of the frames in a message object, as `Channel.frames` has them."""
    child = getattr(message, "child_frame_id", None)
    return (message.header.frame_id,) if child is None else (message.header.frame_id, child)


def _refuse_frame(topic: str, frames: Sequence[str]) -> None:
    for frame in frames:
        if _NOT_ENU.search(frame):
            raise FrameError(topic, frame, says=" says NED or FRD; expected ENU and FLU (REP-103)")


class Decoder:
    """Serialised message -> array of one topic.

    What is usual is learned from the sender: after a message with other names of its frames (an
    aircraft's in a namespace, a pilot's, those of older versions) the next is read from its bytes.

    Parameters
    ----------
    topic : str
        Name in `topics.TABLE`.
    datum : Datum, optional
        For `gps/fix`.
    deserialize : callable, optional
        `bytes -> message object` for messages of unusual layout; by default rclpy's.
    namespace : str, optional
        Of the aircraft: frames of others, and of none, are refused. Left out, any name is taken
        (bags of others, the page).

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
        namespace: str | None = None,
    ) -> None:
        channel = CHANNELS[topic]
        self._usual, self._unpack, self._datum = channel, channel.unpack, datum
        frames = tuple(in_namespace(frame, namespace or "") for frame in channel.frames)
        self._allowed = None if namespace is None else frames
        self._expect(frames, channel)
        if topic == topics.GPS_FIX and datum is None:
            raise ValueError(f"{topic}: needs a datum")
        self._deserialize = deserialize or rclpy_deserializer(topic)
        self.topic = topic
        self.stamp_ns = 0

    def _expect(self, frames: tuple[str, ...], channel: Channel) -> None:
        """Messages with these frames are the usual ones."""
        layout = channel.layout_in(frames)
        self._channel, self.array = channel, np.zeros(channel.size)
        self._frames, self._free, self._message = frames, layout.free, FixedMessage(layout)

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
                raise layouts.refusal(self.topic, layouts.NO_FIX)
        else:
            self._decode_slowly(raw)
            message = self._message
        if self._datum is None:
            code = self._unpack(message.block, self.array)
        else:
            code = self._unpack(message.block, self._datum, self.array)
        if code:
            raise layouts.refusal(self.topic, code)
        return self.array

    def _decode_slowly(self, raw: bytes) -> None:
        if len(raw) < 12:
            raise CutOffError(
                f"a message of {len(raw)} bytes is cut off",
                MessageCause.CUT_OFF,
                topic=self.topic,
                value=len(raw),
            )
        self.stamp_ns = stamp_of(raw)
        if why := too_long(self.topic, len(raw)):
            raise MessageError(why, MessageCause.TOO_LONG, value=len(raw))
        try:
            message = self._deserialize(raw)
        except Exception as error:
            why = printable(str(error))
            raise MessageError(
                f"cannot be deserialised: {why}", MessageCause.UNREADABLE, topic=self.topic
            ) from error
        stamp = message.header.stamp
        self.stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
        frames = _frames_of(message)
        _refuse_frame(self.topic, frames)
        for frame, allowed in zip(frames, self._allowed or (), strict=False):
            if frame != allowed:
                raise FrameError(self.topic, frame, f"'{allowed}'")
        channel, wider = self._usual, self._usual.wider
        if wider is not None and set(wider.joints) <= set(message.name):
            channel = wider
        if frames != self._frames or channel is not self._channel:
            self._expect(frames, channel)
        self._channel.read(message, self.topic, self._message.block)


def rclpy_deserializer(topic: str) -> Callable[[bytes], Any]:
    """`bytes -> message object` of a topic through rclpy, imported when first needed."""
    type_name = topics.BY_NAME[topic].type

    def deserialize(raw: bytes) -> Any:
        from rclpy.serialization import deserialize_message

        return deserialize_message(raw, topics.message_class(type_name))

    return deserialize


# Four bytes that say how it is serialised, then seconds and nanoseconds.
_CLOCK, _CLOCK_HEADER = struct.Struct("<4siI"), bytes(Layout().data)
_CLOCK_BYTES = _CLOCK.size


class ClockEncoder:
    """Tick time -> serialised `rosgraph_msgs/Clock`."""

    def encode(self, stamp_ns: int) -> bytes:
        """Serialised clock message of a time in ns."""
        return _CLOCK.pack(_CLOCK_HEADER, *divmod(stamp_ns, NS_PER_S))


def encode_header(stamp_ns: int, frame: str) -> bytes:
    """Serialised `std_msgs/Header`."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    return bytes(Layout().put("i", sec).put("I", nanosec).text(frame).data)


class StampDecoder:
    """Serialised message that begins with a time, as Clock and Header do -> `stamp_ns` alone.

    Parameters
    ----------
    topic : str
    """

    def __init__(self, topic: str) -> None:
        self.array, self.stamp_ns = np.zeros(0), 0
        self._topic = topic

    def decode(self, raw: bytes) -> NDArray[np.float64]:
        """Read the time; raises CutOffError."""
        if len(raw) < _CLOCK_BYTES:
            raise CutOffError(f"{self._topic}: a message of {len(raw)} bytes is cut off")
        self.stamp_ns = stamp_of(raw)
        return self.array


# -------------------------------------------------------------------------------------------------
# Transforms between frames as the bytes of `tf2_msgs/TFMessage`, and the frame `odom`. No ROS.
#
# The wheels of ROS 2 hold no tf2_msgs; where it is installed, these bytes are what its messages
# are.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


class Transform(NamedTuple):
    """Where a frame lies in its parent: m; quaternion x, y, z, w. ENU or FLU, as the parent is."""

    parent: str
    child: str
    xyz_m: Sequence[float]
    xyzw: Sequence[float] = _UNTURNED


def encode_transforms(transforms: Sequence[Transform], stamp_ns: int) -> bytes:
    """Serialised `tf2_msgs/TFMessage`, all of one stamp (ns)."""
    layout = Layout().put("I", len(transforms))
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    for t in transforms:
        layout.put("i", sec).put("I", nanosec).text(t.parent).text(t.child)
        layout.numbers([*t.xyz_m, *t.xyzw])
    return bytes(layout.data)


def fixed_to_base(mounts: Mapping[str, Sequence[float]], namespace: str) -> list[Transform]:
    """Where frames are fixed to the aircraft's own, by name: m, FLU, not turned."""
    base = in_namespace(BASE, namespace)
    return [Transform(base, in_namespace(child, namespace), at) for child, at in mounts.items()]


def encode_joint(name: str, position_rad: float, speed_radps: float, stamp_ns: int) -> bytes:
    """Serialised `sensor_msgs/JointState` of one joint; what turns it has no frame, no effort."""
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    layout = Layout().put("i", sec).put("I", nanosec).text("").texts([name])
    layout.put("I", 1).numbers([position_rad]).put("I", 1).numbers([speed_radps])
    return bytes(layout.put("I", 0).data)


def encode_text(text: str) -> bytes:
    """Serialised `std_msgs/String`."""
    return bytes(Layout().text(text).data)


class FrameTree:
    """map -> odom -> base_link of an aircraft, as its navigation says.

    REP-105: in `odom` the aircraft moves without jumps, in `map` it is where the GPS says. So
    base_link moves in odom as the estimated velocity says, summed up, and odom lies in map where
    the estimated position then comes out right. Both begin together.

    Parameters
    ----------
    namespace : str
        Of the aircraft.
    tick_s : float
        Length of a tick.
    """

    def __init__(self, namespace: str, tick_s: float = TICK_S) -> None:
        self._tick_s = tick_s
        self._odom, self._base = (in_namespace(frame, namespace) for frame in (ODOM, BASE))
        self._tick: int | None = None
        self._pos_ned_m, self._vel_ned_mps = np.zeros(3), np.zeros(3)

    def follow(self, nav: Array, tick: int) -> bool:
        """Take the navigation row (31,) of a tick; False while it knows nothing."""
        pos, vel = nav[NAV.pos], nav[NAV.vel]
        if not (np.isfinite(pos).all() and np.isfinite(vel).all()):
            self._tick = None
            return False
        if self._tick is None:
            self._pos_ned_m[:] = pos
        else:
            self._pos_ned_m += (
                0.5 * (self._vel_ned_mps + vel) * ((tick - self._tick) * self._tick_s)
            )
        self._tick, self._vel_ned_mps[:] = tick, vel
        return True

    def transforms(self, nav: Array) -> tuple[Transform, Transform]:
        """map -> odom and odom -> base_link, ENU and FLU, after `follow` of the same row."""
        there, here, xyzw = np.empty(3), np.empty(3), np.empty(4)
        ned_to_enu(nav[NAV.pos] - self._pos_ned_m, there)
        ned_to_enu(self._pos_ned_m, here)
        quat_ned_frd_to_enu_flu(nav[NAV.quat], xyzw)
        return (
            Transform(MAP, self._odom, there.tolist()),
            Transform(self._odom, self._base, here.tolist(), xyzw.tolist()),
        )
