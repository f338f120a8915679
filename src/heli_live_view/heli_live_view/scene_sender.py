# SPDX-License-Identifier: Apache-2.0
"""Sends the scene to RViz (topic `scene`) and Foxglove, if somebody looks."""

from typing import Any

from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from heli_live_view import scene
from heli_live_view.scene_message import SceneMessages
from heli_msgs_bridge import topics

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
        self._messages, self._trail = SceneMessages(node.get_namespace()), scene.Trail()
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

    def _shapes(self, row: dict[str, Any], body: dict[str, Any] | None) -> list[scene.Shape]:
        shapes = scene.moving(row, self._radius_m)
        trail = self._trail.shape() if self._count % _TRAIL_EVERY == 0 else None
        if trail is not None:
            shapes.append(trail)
        if self._count % _GROUND_EVERY == 0:
            shapes += scene.ground(body)
        return shapes

    def _send(self, shapes: list[scene.Shape], now_ns: int, watched: bool) -> None:
        if not shapes:
            return
        raw = self._messages.serialize(shapes, now_ns)
        self._publisher.publish(raw)
        if watched:
            self._foxglove.log_unstamped(self._name, raw)

    def close(self) -> None:
        """Take the publisher out of the graph."""
        self._node.destroy_publisher(self._publisher)
