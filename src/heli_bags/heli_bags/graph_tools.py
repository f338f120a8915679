# SPDX-License-Identifier: Apache-2.0
"""Looks at a running graph: its topics, how often they come, what they say."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from heli_msgs_bridge import topics
from heli_msgs_bridge.node_process import outlasts_set_clock

# Three announcements of a node of ours (config/fastdds.xml): what was lost under load comes again.
SETTLED_S = 1.5
# An empty graph gets the first; one that changes all the time is taken as it is after the second.
DISCOVERY_S, DISCOVERY_LIMIT_S, _POLL_S = 2.0, 10.0, 0.05
_DEPTH = 1000
# What came while the listeners were made arrives at once; it does not count.
_BACKLOG_S = 0.3


class TopicCause(Enum):
    """Why a topic cannot be listened to."""

    UNKNOWN = "the graph has no such topic"
    SEVERAL_TYPES = "its senders do not agree on a type"
    NO_TYPE = "its type is not installed"
    SILENT = "no message comes"


class TopicError(Exception):
    """A topic cannot be listened to; the message is one line that names it.

    Attributes
    ----------
    cause : TopicCause
    topic : str
        Its name, as it was asked for where the graph has none.
    known : tuple of str
        Names of the topics that there are, where there is no such.
    """

    def __init__(
        self, sentence: str, cause: TopicCause, topic: str, known: tuple[str, ...] = ()
    ) -> None:
        super().__init__(sentence)
        self.cause, self.topic, self.known = cause, topic, known


@dataclass(frozen=True)
class TopicStatus:
    """One topic of the graph; rate_hz is None where it was not measured."""

    topic: str
    type: str
    publishers: int
    subscribers: int
    rate_hz: float | None = None


def _infos(node: Node, name: str) -> tuple[list[Any], list[Any]]:
    """Publishers and subscriptions of a topic, without this node's own."""
    node_name = node.get_name()
    return (
        [i for i in node.get_publishers_info_by_topic(name) if i.node_name != node_name],
        [i for i in node.get_subscriptions_info_by_topic(name) if i.node_name != node_name],
    )


def _listed(node: Node) -> list[TopicStatus]:
    statuses = []
    for name, types in sorted(node.get_topic_names_and_types()):
        publishers, subscribers = _infos(node, name)
        if publishers or subscribers:
            statuses.append(TopicStatus(name, ", ".join(types), len(publishers), len(subscribers)))
    return statuses


class Discovery:
    """Watches a graph until it stands still: nodes, publishers and subscribers.

    Parameters
    ----------
    node : Node
        What listens.
    settle_s : float
        For how long nothing may have changed; an empty graph gets DISCOVERY_S at least.
    """

    def __init__(self, node: Node, settle_s: float):
        self._node, self.settle_s = node, settle_s
        self._last_graph: tuple[Any, ...] | None = None
        self._begun = self._changed = self._looked = time.monotonic()

    def look(self) -> list[TopicStatus]:
        """All topics that are known by now."""
        topics_seen = _listed(self._node)
        graph = (topics_seen, sorted(self._node.get_node_names_and_namespaces()))
        self._looked = time.monotonic()
        if graph != self._last_graph:
            self._last_graph, self._changed = graph, self._looked
        return topics_seen

    @property
    def waited_s(self) -> float:
        """Wall time from the beginning to the last look."""
        return self._looked - self._begun

    @property
    def still(self) -> bool:
        """Whether the graph has stood still for long enough."""
        shown = bool(self._last_graph and self._last_graph[0]) or self.waited_s > DISCOVERY_S
        return shown and self._looked - self._changed > self.settle_s

    @property
    def over(self) -> bool:
        """Whether to wait no longer: it is still, or the limit has passed."""
        return self.still or self.waited_s > DISCOVERY_LIMIT_S + self.settle_s

    def __str__(self) -> str:
        if self.still:
            return f"nothing new for {self.settle_s:g} s"
        return f"still changing after {self.waited_s:.0f} s"


def list_topics(
    node: Node, hidden: bool = False, settle_s: float = SETTLED_S
) -> tuple[list[TopicStatus], Discovery]:
    """Topics of the graph, as soon as discovery has stood still.

    Parameters
    ----------
    node : Node
    hidden : bool
        Also names with a part that begins with an underscore.
    settle_s : float
        Wall time in which nothing new may have come.

    Returns
    -------
    list of Seen, Discovery
        The second says whether the graph stood still or the limit was reached.
    """
    discovery = Discovery(node, settle_s)
    rows = discovery.look()
    while not discovery.over:
        time.sleep(_POLL_S)
        rows = discovery.look()
    if not hidden:
        rows = [r for r in rows if not any(part.startswith("_") for part in r.topic.split("/"))]
    return rows, discovery


class _Counter:
    """Counts a topic's messages between the first and the last."""

    def __init__(self) -> None:
        self.count, self.first, self.last = 0, 0.0, 0.0
        self._begin = time.monotonic() + _BACKLOG_S

    def __call__(self, _: bytes) -> None:
        self.last = time.monotonic()
        if self.last < self._begin:
            return
        self.first = self.first or self.last
        self.count += 1

    @property
    def rate_hz(self) -> float:
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0


def measure(
    node: Node,
    statuses: Sequence[TopicStatus],
    duration_s: float,
    progress: Callable[[float], None] = lambda done: None,
) -> list[TopicStatus]:
    """The topics with their rates, messages per second of wall time, measured over a while.

    Listens best effort, so that no publisher waits for it; a type that is not installed has no
    rate.
    """
    counters: dict[str, _Counter] = {}
    executor = EventsExecutor()
    qos = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
    for row in statuses:
        try:
            cls = topics.message_class(row.type)
        except LookupError:
            continue
        if row.publishers:
            counters[row.topic] = _Counter()
            node.create_subscription(cls, row.topic, counters[row.topic], qos, raw=True)
    executor.add_node(node)
    begun = time.monotonic()
    try:
        with outlasts_set_clock(executor):
            while (done := time.monotonic() - begun) < duration_s + _BACKLOG_S:
                progress(done)
                executor.spin_once(timeout_sec=_POLL_S)
    finally:
        executor.remove_node(node)
        executor.shutdown()
    return [
        TopicStatus(
            row.topic,
            row.type,
            row.publishers,
            row.subscribers,
            counters[row.topic].rate_hz if row.topic in counters else None,
        )
        for row in statuses
    ]


def find(node: Node, name: str, settle_s: float, wait_s: float = 0.0) -> TopicStatus:
    """The topic by its name, with or without the slash.

    Waits for its first publisher, whose QoS the listener needs, at most until the graph is still
    and wait_s have passed.

    Raises
    ------
    TopicError
        No such topic, or one of several types.
    """
    discovery = Discovery(node, settle_s)
    while True:
        rows = {row.topic: row for row in discovery.look()}
        status = rows.get(name) or rows.get(f"/{name}")
        if status is not None and status.publishers:
            break
        if discovery.over and discovery.waited_s >= wait_s:
            break
        time.sleep(_POLL_S)
    if status is None:
        known = tuple(r for r in rows if r not in ("/parameter_events", "/rosout"))
        sentence = f"no topic {name} in the graph ({discovery}); there is "
        sentence += ", ".join(known) or "none"
        raise TopicError(sentence, TopicCause.UNKNOWN, name, known)
    if "," in status.type:
        sentence = f"topic {status.topic} has several types: {status.type}"
        raise TopicError(sentence, TopicCause.SEVERAL_TYPES, status.topic)
    return status


def listen(
    node: Node, name: str, timeout_s: float | None = None, settle_s: float = SETTLED_S
) -> Iterator[tuple[str, Any]]:
    """Messages of a topic as they come, with a QoS that all its publishers can serve.

    Parameters
    ----------
    node : Node
    name : str
        With or without the slash in front.
    timeout_s : float, optional
        Wall time without a message after which it is given up, also without a publisher; None
        for never, unless there is no such topic.
    settle_s : float
        How long the graph must have stood still before the topic is said to be missing.

    Yields
    ------
    str, message
        Full name, message.

    Raises
    ------
    TopicError
        No such topic, a type that is not installed, or silence.
    """
    status = find(node, name, settle_s, timeout_s or 0.0)
    try:
        cls = topics.message_class(status.type)
    except LookupError as error:
        sentence = f"topic {status.topic}: {error}"
        raise TopicError(sentence, TopicCause.NO_TYPE, status.topic) from error
    offered = [info.qos_profile for info in _infos(node, status.topic)[0]]
    reliable = all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
    latched = bool(offered) and all(
        q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered
    )
    arrived: deque[Any] = deque()
    qos = QoSProfile(
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
    executor = EventsExecutor()
    node.create_subscription(cls, status.topic, lambda message: arrived.append(message), qos)
    executor.add_node(node)
    heard = time.monotonic()
    try:
        with outlasts_set_clock(executor):
            while True:
                executor.spin_once(timeout_sec=_POLL_S)
                if arrived:
                    heard = time.monotonic()
                elif timeout_s is not None and time.monotonic() - heard > timeout_s:
                    sentence = f"no message on {status.topic} in {timeout_s:g} s"
                    raise TopicError(sentence, TopicCause.SILENT, status.topic)
                while arrived:
                    yield status.topic, arrived.popleft()
    finally:
        executor.remove_node(node)
        executor.shutdown()
