# SPDX-License-Identifier: Apache-2.0
"""The wait for a node's peers: who must listen, under whatever name, before the node takes part.

A node subscribes when it has been configured, its kernels compiled (`ManagedNode.hear`), so a peer
that listens is ready. One that is in the graph and does not listen yet gets ready: the first start
after an installation compiles, a minute or two on two cores.
"""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rclpy.executors import ExternalShutdownException

from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.node_spec import StartError

if TYPE_CHECKING:
    from heli_msgs_bridge.managed_node import ManagedNode

READY_LIMIT_S = 600.0
"""How long (wall time) a peer may take that is there and gets ready."""
_POLL_S, _LOOK_S = 0.002, 0.1
# Who waits for long leaves the processor to those who compile.
_PATIENT_AFTER_S, _PATIENT_POLL_S = 2.0, 0.05


@dataclass(frozen=True)
class Absent:
    """A topic that lacks listeners.

    Attributes
    ----------
    topic : str
    peers : frozenset of str
        Who does not listen.
    connected : bool
        False if all do, and are not connected yet.
    """

    topic: str
    peers: frozenset[str]
    connected: bool = True


def _names(node: "ManagedNode", peer: str) -> set[str]:
    """A peer's own name, and those under which somebody sends what it sends (`-r __node:=`)."""
    sent = [topic.name for topic in topics.TABLE if topic.source == (peer,)]
    senders = [node.get_publishers_info_by_topic(node.resolve_topic_name(name)) for name in sent]
    return {peer, *(info.node_name for infos in senders for info in infos)}


def _missing(node: "ManagedNode", topic: str, expected: Iterable[str]) -> frozenset[str]:
    infos = node.get_subscriptions_info_by_topic(node.resolve_topic_name(topic))
    listening = {info.node_name for info in infos}
    left = set(expected) - listening
    return frozenset(peer for peer in left if not _names(node, peer) & listening)


def _all_absent(node: "ManagedNode") -> Iterator[Absent]:
    for topic, publisher in node.outputs.items():
        expected = node.expected_listeners(topic)
        if not expected:
            continue
        missing = _missing(node, topic, expected)
        if missing:
            yield Absent(topic, missing)
        elif publisher.get_subscription_count() < len(expected):
            yield Absent(topic, frozenset(expected), connected=False)
    for topic, listeners in node.awaited_links().items():
        if missing := _missing(node, topic, listeners):
            yield Absent(topic, missing)


def absent(node: "ManagedNode") -> Absent | None:
    """First topic that lacks listeners; None if nobody is waited for.

    Raises
    ------
    ExternalShutdownException
        The process was asked to end.
    """
    try:
        found = next(_all_absent(node), None)
    except Exception:
        # A look at the graph fails when ROS ends under it.
        if not node.leaving():
            raise
    if node.leaving():
        raise ExternalShutdownException
    return found


def _get_ready(node: "ManagedNode", lacking: Absent) -> bool:
    """Whether all who do not listen are in the graph; the recorder compiles nothing."""
    if "recorder" in lacking.peers:
        return False
    # The clock of a world is in no aircraft's namespace.
    spaces = (node.get_namespace(), "/")
    there = {name for name, space in node.get_node_names_and_namespaces() if space in spaces}
    return lacking.connected and all(_names(node, peer) & there for peer in lacking.peers)


def wait_for_peers(node: "ManagedNode") -> None:
    """Block until every expected listener is connected.

    Raises
    ------
    StartError
        Naming topic and missing nodes, when for `connect_timeout_s` of wall time they were not in
        the graph, or for `READY_LIMIT_S` did not get ready.
    """
    limit_s = node.values["connect_timeout_s"]
    begun_s = looked_s = time.monotonic()
    deadline_s = begun_s + limit_s
    while (lacking := absent(node)) is not None:
        now_s = time.monotonic()
        names = ", ".join(sorted(lacking.peers))
        if now_s - looked_s > _LOOK_S:
            looked_s = now_s
            if _get_ready(node, lacking) and now_s - begun_s < READY_LIMIT_S:
                deadline_s = now_s + limit_s
                node.report(Level.OK, f"waiting for {names} to get ready")
        if now_s > deadline_s:
            waited = f"{now_s - begun_s:.3g}"
            raise StartError(
                f"nobody listens to '{lacking.topic}' after {waited} s: missing {names}"
            )
        time.sleep(_POLL_S if now_s - begun_s < _PATIENT_AFTER_S else _PATIENT_POLL_S)
