# SPDX-License-Identifier: Apache-2.0
"""Shapes of the scene as `visualization_msgs/MarkerArray` in the frame `map`, and the pose as tf.

Marker objects are kept and only moved, because making them costs more than sending them.
"""

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from heli_live_view import scene
from heli_math.ticks import NS_PER_S
from heli_msgs_bridge.frame_ids import BASE, MAP, in_namespace
from heli_msgs_bridge.transforms import Transform, encode_transforms

_KINDS = {
    scene.CUBE: Marker.CUBE,
    scene.SPHERE: Marker.SPHERE,
    scene.CYLINDER: Marker.CYLINDER,
    scene.ARROW: Marker.ARROW,
    scene.LINES: Marker.LINE_LIST,
    scene.STRIP: Marker.LINE_STRIP,
}


class SceneMessages:
    """Makes serialised marker arrays and transforms; one object per node, in its namespace."""

    def __init__(self, namespace: str = "") -> None:
        self._markers: dict[str, tuple[Any, tuple]] = {}
        self._base = in_namespace(BASE, namespace)

    def serialize(self, shapes: Sequence[scene.Shape], stamp_ns: int) -> bytes:
        """Serialised MarkerArray of the shapes, stamped in ns."""
        array = MarkerArray()
        array.markers = [self._marker(shape, stamp_ns) for shape in shapes]
        return serialize_message(array)

    def _marker(self, shape: scene.Shape, stamp_ns: int) -> Any:
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
