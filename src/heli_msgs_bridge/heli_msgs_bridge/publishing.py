# SPDX-License-Identifier: Apache-2.0
"""The way of a message out of a node, which is taken some hundred times a second."""

from collections import deque
from collections.abc import Callable
from typing import Any, Protocol


class Sender(Protocol):
    """A node that keeps the last messages of each topic, where somebody wants to know."""

    sent: dict[str, deque[bytes]] | None


def publishing(node: Sender, publisher: Any, topic: str) -> Callable[[Any], None]:
    """Publish function (bytes or message) of a lifecycle publisher."""
    publish_raw = publisher.handle.publish_raw

    def publish(message: Any) -> None:
        # Bytes, nearly always: rclpy's own way goes through four functions, each message.
        if type(message) is bytes:
            if publisher.is_activated:
                publish_raw(message)
                if node.sent is not None:
                    node.sent[topic].append(message)
        else:
            publisher.publish(message)

    return publish
