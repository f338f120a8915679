# SPDX-License-Identifier: Apache-2.0
"""The flight as simple solids in the frame `map` (ENU, m): helicopter, rotor disc, trail, wind.

Sizes follow the rotor's radius. No ROS; `scene_message` makes markers of the shapes.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import foxglove
import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from visualization_msgs.msg import Marker, MarkerArray

from heli_core.rotations import quat_multiply, quat_to_R_nb
from heli_core.ticks import NS_PER_S
from heli_live_view.access import LOOPBACK, listen, port_error
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.messages import Transform, encode_transforms
from heli_msgs_bridge.topics import BASE, MAP, in_namespace

# -------------------------------------------------------------------------------------------------
# Scene.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
# Turns per second of the drawn rotor. The real one (some 30) would seem to stand at 20 pictures/s.
_DRAWN_TURNS_HZ = 0.7
_WIND_M_PER_MPS = 0.4
_GRID_HALF_M, _GRID_MOVES_M = 20, 10
_TRAIL_SPACING_S, _TRAIL_POINTS = 0.2, 600
_IDENTITY = (0.0, 0.0, 0.0, 1.0)

CUBE, SPHERE, CYLINDER, ARROW, LINES, STRIP = (
    "cube",
    "sphere",
    "cylinder",
    "arrow",
    "lines",
    "strip",
)
BODY_RGBA, DARK_RGBA = (0.16, 0.38, 0.65, 1.0), (0.15, 0.15, 0.17, 1.0)
DISC_RGBA, BLADE_RGBA = (0.55, 0.6, 0.65, 0.35), (0.1, 0.1, 0.1, 0.9)
TRAIL_RGBA, REFERENCE_RGBA = (0.16, 0.38, 0.65, 0.9), (0.9, 0.6, 0.0, 0.9)
WIND_RGBA, SHADOW_RGBA = (0.0, 0.62, 0.45, 0.9), (0.0, 0.0, 0.0, 0.35)
GROUND_RGBA, GRID_RGBA = (0.86, 0.88, 0.84, 1.0), (0.6, 0.63, 0.6, 1.0)


@dataclass(frozen=True)
class Shape:
    """One solid or set of lines.

    Attributes
    ----------
    name : str
        Unique; a later shape of this name replaces it.
    kind : str
        One of the kinds above.
    position, quaternion : tuple
        In `map`, m; x, y, z, w.
    size : tuple
        Extent along its own axes, m; of lines: width first; of an arrow between two points: shaft
        and head diameter.
    rgba : tuple
    points : tuple of (3,) tuple
        Of lines and arrows, relative to the position.
    """

    name: str
    kind: str
    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    size: tuple[float, float, float]
    rgba: tuple[float, float, float, float]
    points: tuple[tuple[float, ...], ...] = ()


def _wxyz(q: Sequence[float]) -> Array:
    return np.array([q[3], q[0], q[1], q[2]], dtype=np.float64)


def _xyzw(q: Array) -> tuple[float, ...]:
    return (float(q[1]), float(q[2]), float(q[3]), float(q[0]))


def _about(axis: int, angle_rad: float) -> Array:
    """Quaternion w, x, y, z of a turn about a coordinate axis."""
    q = np.array([math.cos(0.5 * angle_rad), 0.0, 0.0, 0.0])
    q[1 + axis] = math.sin(0.5 * angle_rad)
    return q


def disc_tilt(a_s_rad: float, b_s_rad: float) -> Array:
    """Quaternion w, x, y, z from the level disc to the tilted one, in body axes FLU.

    Positive a_s tilts the thrust backwards, positive b_s to the right: the disc's normal is
    (-a_s, -b_s, 1) forward, left, up, to first order.
    """
    return quat_multiply(_about(1, -a_s_rad), _about(0, b_s_rad))


def vehicle(
    body: dict[str, Any], rotor: dict[str, Any] | None, time_s: float, radius_m: float
) -> list[Shape]:
    """The helicopter.

    Parameters
    ----------
    body : dict
        p (ENU) and q (FLU -> ENU) as in a state row.
    rotor : dict or None
        a_s_deg, b_s_deg; None draws a level disc.
    time_s : float
        Flight time, turns the blades.
    radius_m : float
        Of the main rotor.
    """
    p, q, r = np.array(body["p"]), _wxyz(body["q"]), radius_m
    R = quat_to_R_nb(q)

    def part(
        name: str,
        kind: str,
        at: tuple[float, float, float],
        size: tuple,
        rgba: Any,
        turn: Any = None,
    ) -> Shape:
        where = tuple((p + R @ (r * np.array(at))).tolist())
        attitude = q if turn is None else quat_multiply(q, turn)
        extent = (r * size[0], r * size[1], r * size[2])
        return Shape(name, kind, where, _xyzw(attitude), extent, rgba)

    tilt = np.array([1.0, 0.0, 0.0, 0.0])
    if rotor is not None:
        tilt = disc_tilt(math.radians(rotor["a_s_deg"]), math.radians(rotor["b_s_deg"]))
    azimuth = _about(2, -2.0 * math.pi * _DRAWN_TURNS_HZ * time_s)
    hub, side = (0.0, 0.0, 0.48), _about(0, 0.5 * math.pi)
    return [
        part("fuselage", SPHERE, (0.05, 0.0, 0.0), (1.05, 0.38, 0.46), BODY_RGBA),
        part("tail_boom", CUBE, (-0.9, 0.0, 0.06), (1.2, 0.09, 0.09), BODY_RGBA),
        part("tail_rotor", CYLINDER, (-1.45, 0.08, 0.1), (0.4, 0.4, 0.02), DISC_RGBA, side),
        part("mast", CYLINDER, (0.0, 0.0, 0.34), (0.05, 0.05, 0.3), DARK_RGBA),
        part("skid_left", CUBE, (0.0, 0.2, -0.36), (0.9, 0.04, 0.04), DARK_RGBA),
        part("skid_right", CUBE, (0.0, -0.2, -0.36), (0.9, 0.04, 0.04), DARK_RGBA),
        part("rotor_disc", CYLINDER, hub, (2.0, 2.0, 0.015), DISC_RGBA, tilt),
        part("blades", CUBE, hub, (2.0, 0.08, 0.02), BLADE_RGBA, quat_multiply(tilt, azimuth)),
    ]


def shadow(body: dict[str, Any], radius_m: float) -> Shape:
    """The rotor's shadow, straight below on the ground."""
    east, north, _ = body["p"]
    size = (2.0 * radius_m, 2.0 * radius_m, 0.01)
    return Shape("shadow", CYLINDER, (east, north, 0.02), _IDENTITY, size, SHADOW_RGBA)


def wind_arrow(body: dict[str, Any], wind_enu_mps: Sequence[float], radius_m: float) -> Shape:
    """Where the air moves to, beginning above the helicopter; 0.4 m for each m/s."""
    east, north, up = body["p"]
    tip = tuple(_WIND_M_PER_MPS * v for v in wind_enu_mps)
    start = (east, north, up + 1.5 * radius_m)
    points = ((0.0, 0.0, 0.0), tip)
    return Shape("wind", ARROW, start, _IDENTITY, (0.06, 0.14, 0.2), WIND_RGBA, points)


def reference(ref: dict[str, Any]) -> list[Shape]:
    """Where the helicopter should be, and its heading (clockwise from north)."""
    heading = math.radians(ref["yaw_deg"])
    nose = (0.8 * math.sin(heading), 0.8 * math.cos(heading), 0.0)
    at, points = tuple(ref["p"]), ((0.0, 0.0, 0.0), nose)
    return [
        Shape("reference", SPHERE, at, _IDENTITY, (0.25, 0.25, 0.25), REFERENCE_RGBA),
        Shape("reference_heading", ARROW, at, _IDENTITY, (0.04, 0.1, 0.12), REFERENCE_RGBA, points),
    ]


def ground(body: dict[str, Any] | None) -> list[Shape]:
    """Ground and a 1 m grid, 40 m wide, that moves along in steps of 10 m."""
    east, north = (0.0, 0.0) if body is None else body["p"][:2]
    x = _GRID_MOVES_M * round(east / _GRID_MOVES_M)
    y = _GRID_MOVES_M * round(north / _GRID_MOVES_M)
    half, lines = float(_GRID_HALF_M), []
    for i in range(-_GRID_HALF_M, _GRID_HALF_M + 1):
        lines += [(float(i), -half, 0.0), (float(i), half, 0.0)]
        lines += [(-half, float(i), 0.0), (half, float(i), 0.0)]
    wide = (2.0 * half, 2.0 * half, 0.02)
    return [
        Shape("ground", CUBE, (float(x), float(y), -0.02), _IDENTITY, wide, GROUND_RGBA),
        Shape("grid", LINES, (float(x), float(y), 0.0), _IDENTITY, (0.02, 0.0, 0.0), GRID_RGBA,
              tuple(lines)),
    ]  # fmt: skip


class Trail:
    """Where the helicopter has been lately: bounded, spaced in flight time."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, ...]] = deque(maxlen=_TRAIL_POINTS)
        self._last_s = -math.inf

    def add(self, time_s: float, position_enu_m: Sequence[float]) -> None:
        """Take a position (3,); time that goes back begins a new trail."""
        if time_s < self._last_s:
            self._points.clear()
        elif time_s < self._last_s + _TRAIL_SPACING_S:
            return
        self._points.append(tuple(position_enu_m))
        self._last_s = time_s

    def shape(self) -> Shape | None:
        """The trail as one line; None before there are two points."""
        if len(self._points) < 2:
            return None
        origin = (0.0, 0.0, 0.0)
        width = (0.04, 0.0, 0.0)
        return Shape("trail", STRIP, origin, _IDENTITY, width, TRAIL_RGBA, tuple(self._points))


def moving(row: dict[str, Any], radius_m: float) -> list[Shape]:
    """Everything of a state row that moves; the estimate is drawn where there is no truth."""
    body, shapes = row["truth"] or row["nav"], []
    if body is not None:
        rotor = row["rotor_truth"] or row["rotor"]
        shapes += vehicle(body, rotor, row["t"] or 0.0, radius_m)
        shapes.append(shadow(body, radius_m))
        if row["wind_enu"] is not None:
            shapes.append(wind_arrow(body, row["wind_enu"], radius_m))
    if row["ref"] is not None:
        shapes += reference(row["ref"])
    return shapes


# -------------------------------------------------------------------------------------------------
# Shapes of the scene as `visualization_msgs/MarkerArray` in the frame `map`, and the pose as tf.
#
# Marker objects are kept and only moved, because making them costs more than sending them.
# -------------------------------------------------------------------------------------------------

_KINDS = {
    CUBE: Marker.CUBE,
    SPHERE: Marker.SPHERE,
    CYLINDER: Marker.CYLINDER,
    ARROW: Marker.ARROW,
    LINES: Marker.LINE_LIST,
    STRIP: Marker.LINE_STRIP,
}


class SceneMessages:
    """Makes serialised marker arrays and transforms; one object per node, in its namespace."""

    def __init__(self, namespace: str = "") -> None:
        self._markers: dict[str, tuple[Any, tuple]] = {}
        self._base = in_namespace(BASE, namespace)

    def serialize(self, shapes: Sequence[Shape], stamp_ns: int) -> bytes:
        """Serialised MarkerArray of the shapes, stamped in ns."""
        array = MarkerArray()
        array.markers = [self._marker(shape, stamp_ns) for shape in shapes]
        return serialize_message(array)

    def _marker(self, shape: Shape, stamp_ns: int) -> Any:
        marker, points = self._markers.get(shape.name, (None, ()))
        if marker is None:
            marker = Marker()
            marker.header.frame_id, marker.ns, marker.type = MAP, shape.name, _KINDS[shape.kind]
            marker.action = Marker.ADD
            c = marker.color
            c.r, c.g, c.b, c.a = shape.rgba
        stamp, pose, scale = marker.header.stamp, marker.pose, marker.scale
        stamp.sec, stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        p, q = pose.position, pose.orientation
        p.x, p.y, p.z = shape.position
        q.x, q.y, q.z, q.w = shape.quaternion
        scale.x, scale.y, scale.z = shape.size
        if shape.points != points:
            marker.points = [Point(x=x, y=y, z=z) for x, y, z in shape.points]
        self._markers[shape.name] = marker, shape.points
        return marker

    def transform(self, body: dict[str, Any], stamp_ns: int) -> bytes:
        """Serialised tf2_msgs/TFMessage map -> base_link (the type is not among the wheels)."""
        return encode_transforms([Transform(MAP, self._base, body["p"], body["q"])], stamp_ns)


# -------------------------------------------------------------------------------------------------
# Sends the scene to RViz (topic `scene`) and Foxglove, if somebody looks.
# -------------------------------------------------------------------------------------------------

_TRAIL_EVERY, _GROUND_EVERY = 6, 30


class SceneSender:
    """One scene of one node.

    Parameters
    ----------
    node : Node
        Gets the publisher.
    foxglove : FoxgloveServer or None
        With channels for `scene` and `/tf`.
    radius_m : float
        Of the main rotor.
    """

    def __init__(self, node: Node, foxglove: Any, radius_m: float) -> None:
        self._node, self._foxglove, self._radius_m = node, foxglove, radius_m
        self._publisher = node.create_publisher(MarkerArray, topics.SCENE, topics.qos(topics.SCENE))
        self._name = self._publisher.topic_name
        self._messages, self._trail = SceneMessages(node.get_namespace()), Trail()
        self._count = 0

    def show(self, row: dict[str, Any], now_ns: int) -> None:
        """Send a state row as markers; the slow parts of the scene now and then."""
        body = row["truth"] or row["nav"]
        if body is not None and row["t"] is not None:
            self._trail.add(row["t"], body["p"])
        self._count += 1
        watched = self._foxglove is not None and self._foxglove.is_watched(self._name)
        if watched or self._publisher.get_subscription_count():
            self._send(self._shapes(row, body), now_ns, watched)
        if body is not None and self._foxglove is not None and self._foxglove.is_watched(topics.TF):
            self._foxglove.log_unstamped(topics.TF, self._messages.transform(body, now_ns))

    def _shapes(self, row: dict[str, Any], body: dict[str, Any] | None) -> list[Shape]:
        shapes = moving(row, self._radius_m)
        trail = self._trail.shape() if self._count % _TRAIL_EVERY == 0 else None
        if trail is not None:
            shapes.append(trail)
        if self._count % _GROUND_EVERY == 0:
            shapes += ground(body)
        return shapes

    def _send(self, shapes: list[Shape], now_ns: int, watched: bool) -> None:
        if not shapes:
            return
        raw = self._messages.serialize(shapes, now_ns)
        self._publisher.publish(raw)
        if watched:
            self._foxglove.log_unstamped(self._name, raw)

    def close(self) -> None:
        """Take the publisher out of the graph."""
        self._node.destroy_publisher(self._publisher)


# -------------------------------------------------------------------------------------------------
# The graph's topics for Foxglove: a WebSocket server on 127.0.0.1, messages passed through as CDR.
#
# https://docs.foxglove.dev/docs/sdk; protocol: https://github.com/foxglove/ws-protocol. View only:
# clients can neither publish nor call. No ROS.
# -------------------------------------------------------------------------------------------------

STATE = "/live_state"
"""The page's state rows as JSON, for plots of what no message holds ready (Euler angles, deg)."""
_PARAMETER, _OPTION = "foxglove_port", "--foxglove-port"


class FoxgloveServer:
    """A channel per topic, with its ROS 2 message definition.

    Parameters
    ----------
    port : int
        On 127.0.0.1; 0 for any free one.
    types : mapping
        Full topic name to type, `package/msg/Name`.

    Raises
    ------
    PortError
        The port cannot be bound.

    Attributes
    ----------
    url : str
    """

    def __init__(self, port: int, types: Mapping[str, str]) -> None:
        if port:
            listen(port, _PARAMETER, _OPTION).close()
        # Channels live as long as their context is held.
        self._context = context = foxglove.Context()
        store = get_typestore(Stores.ROS2_JAZZY)
        self._channels = {}
        for name, kind in types.items():
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
            self._channels[name] = foxglove.Channel(
                name, schema=schema, message_encoding="cdr", context=context
            )
        self._state = foxglove.Channel(STATE, message_encoding="json", context=context)
        try:
            self._server = foxglove.start_server(
                name="heli-hover",
                host=LOOPBACK,
                port=port,
                capabilities=[foxglove.websocket.Capability.Time],
                supported_encodings=["cdr"],
                context=context,
                message_backlog_size=256,
            )
        except RuntimeError as error:
            raise port_error(port, _PARAMETER, _OPTION, f"cannot be bound: {error}") from error
        self.port = self._server.port
        self.url = f"ws://{LOOPBACK}:{self.port}"
        self._newest_ns = 0

    def is_watched(self, name: str) -> bool:
        """True if a client subscribes to the topic."""
        return self._channels[name].has_sinks()

    def log(self, name: str, raw: bytes) -> None:
        """Pass a serialised message on; its log time never goes back (late fixes, latched ones)."""
        self._channels[name].base.log(raw, max(stamp_of(raw), self._newest_ns))

    def log_unstamped(self, name: str, raw: bytes) -> None:
        """Pass a serialised message without a stamp on, at the present simulation time."""
        self._channels[name].base.log(raw, self._newest_ns)

    def log_state(self, text: str) -> None:
        """Pass a state row (JSON text) on."""
        if self._state.has_sinks():
            self._state.base.log(text.encode(), self._newest_ns)

    def set_time(self, stamp_ns: int) -> None:
        """Tell clients the simulation time."""
        self._newest_ns = stamp_ns
        self._server.broadcast_time(stamp_ns)

    def stop(self) -> None:
        """End the server; clients see the connection close."""
        self._server.stop()
