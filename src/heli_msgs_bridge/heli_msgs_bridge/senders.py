# SPDX-License-Identifier: Apache-2.0
"""Who sends on a topic, in names and in words."""

from collections.abc import Sequence

from rclpy.node import Node

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
    return sorted(
        ("", NOT_YET_NAMED) if i.node_name in _UNKNOWN else (i.node_namespace, i.node_name)
        for i in infos
    )


def strangers_of(node: Node, topic: str) -> bool | None:
    """Whether another node, by name, sends on a topic than those that should; None: not yet known.

    A process that was killed stays in the graph for some seconds beside its successor.
    """
    space = node.get_namespace()
    own = {(space, name) for name in BY_NAME[topic].source}
    others = set(senders_of(node, topic)) - own
    return None if others == {("", NOT_YET_NAMED)} else bool(others)


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
