# SPDX-License-Identifier: Apache-2.0
"""Who sends on a topic, in names and in words."""

from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from heli_msgs_bridge.memory import Successors, respawns
from heli_msgs_bridge.topics import BY_NAME

# What the middleware calls a node whose publishers it has discovered, but not yet its name.
_UNKNOWN = ("_NODE_NAME_UNKNOWN_", "_NODE_NAMESPACE_UNKNOWN_")
SENDERS = "senders."
"""Key of a topic's senders in /diagnostics; the topic's name follows."""
NOT_YET_NAMED = "a node that is not named yet"


def senders_of(node: Node, topic: str) -> list[tuple[str, str]]:
    """Namespace and name of each node that sends on a topic, sorted.

    A name comes after its publishers, by a topic of its own: until then it is NOT_YET_NAMED.
    """
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return sorted(map(_sender_of, infos))


def _sender_of(info: TopicEndpointInfo) -> tuple[str, str]:
    if info.node_name in _UNKNOWN:
        return "", NOT_YET_NAMED
    return info.node_namespace, info.node_name


class EverSent:
    """Who sends on a topic, or has sent on it and left: full names, one per publisher.

    By publishers, because only so a name that comes later takes the place of NOT_YET_NAMED.
    """

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}

    def look(self, node: Node, topic: str) -> None:
        """Add who sends now; a name that was known once stays known."""
        for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
            gid, name = bytes(info.endpoint_gid), full_name(_sender_of(info))
            if name != NOT_YET_NAMED or gid not in self._names:
                self._names[gid] = name

    def names(self, besides: str) -> list[str]:
        """Sorted, each once; `besides` is the full name of who asks."""
        return sorted(set(self._names.values()) - {besides})


def strangers_of(node: Node, topic: str) -> bool | None:
    """Whether another node, by name, sends on a topic than those that should; None: not yet known.

    A process that was killed stays in the graph for some seconds beside its successor.
    """
    space = node.get_namespace()
    own = {(space, name) for name in BY_NAME[topic].source}
    others = set(senders_of(node, topic)) - own
    return None if others == {("", NOT_YET_NAMED)} else bool(others)


def heirs_of(node: Node, topic: str) -> Callable[[bool], bool]:
    """For `Owner`: whether who sends on a topic now is the successor of one that was killed.

    A restart is noted before the successor can speak, so the first that comes after it is an heir
    even before its name has come. Later ones are, when the owner is silent and all have its name.
    """
    successors = Successors(BY_NAME[topic].source)

    def heir(silent: bool) -> bool:
        if not respawns():
            return False
        strangers = strangers_of(node, topic)
        if not strangers and successors.due():
            successors.meet()
            return True
        return silent and strangers is False

    return heir


def full_name(sender: tuple[str, str]) -> str:
    """`/namespace/name`."""
    namespace, name = sender
    return name if name == NOT_YET_NAMED else f"{namespace.rstrip('/')}/{name}"


def several_in_words(topic: str, senders: Sequence[tuple[str, str]], first: str = "") -> str:
    """That a topic has several senders, and what comes of it; `first` is heard, if it is known."""
    names = ", ".join(map(full_name, senders))
    if first in map(full_name, senders):
        return f"{topic}: sent by {names}; only {first} is followed, which was heard first"
    return f"{topic}: sent by {names}; only the first sender's messages are used"


def others_in_words(node: Node, topic: str) -> str:
    """Full names of those who send on a topic besides a node; empty if nobody does."""
    own = (node.get_namespace(), node.get_name())
    return ", ".join(full_name(sender) for sender in senders_of(node, topic) if sender != own)
