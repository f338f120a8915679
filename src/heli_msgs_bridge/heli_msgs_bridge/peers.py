# SPDX-License-Identifier: Apache-2.0
"""The wait for a node's peers: who must listen, under whatever name, before a node takes part.

A node subscribes when it has been configured, its kernels compiled (`ManagedNode.subscribe`), so a
peer that listens is ready. One that is in the graph and does not listen yet gets ready: the first
start after an installation compiles, a minute or two on two cores. Nothing here blocks: a node that
waits is active, looks now and then, and answers meanwhile.
"""

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from heli_msgs_bridge import topics

READY_LIMIT_S = 600.0
"""How long (wall time) a peer may take that is there and gets ready."""
ALONE_S = 5.0
"""How long (wall time) a node waits that sees no other node of the graph at all. Discovery takes
up to three seconds."""
LOOK_S = 0.02
"""Wall time between two looks at the graph."""
# Who waits for long leaves the processor to those who compile.
_PATIENT_AFTER_S, _PATIENT_LOOK_S = 2.0, 0.1
# All who are missing are sought so often: to find one of them is quicker.
_NAME_S = 0.5
_KNOWN_NODES = frozenset(name for row in topics.TABLE for name in (*row.source, *row.sinks))


@dataclass(frozen=True)
class Absent:
    """A topic that lacks listeners.

    Attributes
    ----------
    topic : str
    peers : frozenset of str
        Who does not listen, or is not connected yet.
    """

    topic: str
    peers: frozenset[str]


def in_order(peers: Iterable[str]) -> str:
    """Names in one line."""
    return ", ".join(sorted(peers))


def disagreeing(broken: Mapping[str, str]) -> str:
    """What a node says of peers that it does not fly with; empty if there are none."""
    return "; ".join(why for _, why in sorted(broken.items()))


def waiting_for(peers: Iterable[str], comes: bool = True, alone_s: float = 0.0) -> str:
    """What a node says while it waits for peers.

    Parameters
    ----------
    peers : iterable of str
    comes : bool
        Whether they are there and get ready; else they are not in the graph.
    alone_s : float
        Wall time after which those are not waited for any longer.
    """
    what = "get ready" if comes else f"come; begins without after {alone_s:g} s"
    return f"waiting for {in_order(peers)} to {what}"


def begun_without(peers: Iterable[str]) -> str:
    """What a node says that takes part though not all of its peers listen."""
    return f"begun without {in_order(peers)}"


def _names(node: Any, peer: str) -> set[str]:
    """A peer's own name, and those under which somebody sends what it sends (`-r __node:=`)."""
    sent = [topic.name for topic in topics.TABLE if topic.source == (peer,)]
    senders = [node.get_publishers_info_by_topic(node.resolve_topic_name(name)) for name in sent]
    return {peer, *(info.node_name for infos in senders for info in infos)}


def _missing(node: Any, topic: str, expected: Iterable[str]) -> frozenset[str]:
    infos = node.get_subscriptions_info_by_topic(node.resolve_topic_name(topic))
    listening = {info.node_name for info in infos} - node.agreement.broken.keys()
    left = set(expected) - listening
    return frozenset(peer for peer in left if not _names(node, peer) & listening)


def _all_absent(node: Any) -> Iterator[Absent]:
    for topic, publisher in list(node.outputs.items()):
        expected = node.expected_listeners(topic)
        if not expected:
            continue
        missing = _missing(node, topic, expected)
        if missing:
            yield Absent(topic, missing)
        elif publisher.get_subscription_count() < len(expected):
            yield Absent(topic, frozenset(expected))
    for topic, listeners in node.awaited_links().items():
        if missing := _missing(node, topic, listeners):
            yield Absent(topic, missing)


def _peers(lacking: Iterable[Absent]) -> frozenset[str]:
    return frozenset(peer for absent in lacking for peer in absent.peers)


class PeerWait:
    """The wait of one node, from its activation to its taking part.

    Parameters
    ----------
    node : ManagedNode
        Its `connect_timeout_s` is the limit for peers that are not in the graph.
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    missing : frozenset of str
        Who does not listen, as far as it was looked for.
    sentence : str
        What the node says of it.
    """

    def __init__(self, node: Any, now_s: Callable[[], float] = time.monotonic) -> None:
        self._node, self._now_s = node, now_s
        self._begun_s = self._seen_s = now_s()
        self._looked_s = self._begun_s - _PATIENT_LOOK_S
        self._named_s = self._begun_s - 2 * _NAME_S
        self.missing: frozenset[str] = frozenset()
        self.sentence = ""

    def over(self) -> bool:
        """Whether the node takes part now: all listen, or the absent have been waited for.

        Looks at the graph as often as is worth it, however often it is called.
        """
        now_s = self._now_s()
        patient = now_s - self._begun_s > _PATIENT_AFTER_S
        if now_s - self._looked_s < (_PATIENT_LOOK_S if patient else 0.0):
            return False
        self._looked_s = now_s
        try:
            return self._look(now_s)
        except Exception:
            # A look at the graph fails when ROS ends under it.
            if not self._node.leaving():
                raise
            return False

    def _look(self, now_s: float) -> bool:
        node, limit_s = self._node, self._node.values["connect_timeout_s"]
        if (first := next(_all_absent(node), None)) is None:
            self.missing = frozenset()
            return True
        broken = node.agreement.broken
        present = self._present() - broken.keys()
        if now_s - self._named_s > _NAME_S:
            self._named_s = now_s
            self.missing = _peers(_all_absent(node))
        self.missing |= first.peers
        # The recorder compiles nothing: it is there, or it does not come.
        gets_ready = "recorder" not in self.missing and all(
            _names(node, peer) & present for peer in self.missing
        )
        if gets_ready and now_s - self._begun_s < READY_LIMIT_S:
            self._seen_s = now_s
        elif not present & _KNOWN_NODES.union(node.values["peers"]) - {node.get_name()}:
            limit_s = min(limit_s, ALONE_S)
        self.sentence = waiting_for(self.missing, gets_ready, limit_s)
        if broken:
            self.sentence += f"; not flown with {disagreeing(broken)}"
        if now_s - self._seen_s <= limit_s:
            return False
        self.missing = _peers(_all_absent(node))
        return True

    def _present(self) -> set[str]:
        """Nodes that are in the graph; the clock of a world is in no aircraft's namespace."""
        spaces = (self._node.get_namespace(), "/")
        there = self._node.get_node_names_and_namespaces()
        own = (self._node.get_name(), self._node.get_namespace())
        return {name for name, space in there if space in spaces and (name, space) != own}


def still_missing(node: Any, missing: Collection[str]) -> frozenset[str]:
    """Of peers without which a node has begun, those that do not listen yet."""
    return _peers(_all_absent(node)).intersection(missing)
