# SPDX-License-Identifier: Apache-2.0
"""Plays a bag into the graph: recorded bytes, recorded QoS, `/clock`."""

import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection, QosDurability, QosReliability

from heli_bags.opening import BagReader, chosen, opened
from heli_bags.writer import BagCause, BagError
from heli_core.ticks import NS_PER_S, TICKS_PER_S
from heli_msgs_bridge import topics

_CLOCK = struct.Struct("<4siI")
_CDR = b"\0\1\0\0"
# Wall time to look for listeners, and how long none may have come for all to be there.
_LISTENERS_S, _SETTLED_S, _POLL_S = 2.0, 0.4, 0.02
_ACKNOWLEDGED_S = 2.0
# A history that a slow listener can fall behind by.
_LEAST_DEPTH = 10
_MOST_DEPTH = 2000

Event = tuple[int, Publisher, bytes]


@dataclass(frozen=True)
class PlayChoice:
    """What is played and how.

    Attributes
    ----------
    rate : float
        Bag time per wall time.
    start_s : float
        Offset from the bag's first message.
    duration_s : float or None
        Bag time to play; None for all.
    topics, exclude : sequence of str
        Topics to play (all if empty), topics to leave out.
    loop : bool
        Begin again at the end, until interrupted.
    clock_hz : float
        Rate of `/clock` in bag time where the bag holds none; 0 for no clock.
    flight : int or None
        Which flight of a bag whose clock goes back, from 1 on; None for the last.
    """

    rate: float = 1.0
    start_s: float = 0.0
    duration_s: float | None = None
    topics: Sequence[str] = ()
    exclude: Sequence[str] = ()
    loop: bool = False
    clock_hz: float = float(TICKS_PER_S)
    flight: int | None = None


def qos_of(connection: Connection) -> QoSProfile:
    """QoS as recorded; reliable and volatile where the bag does not say."""
    profiles = getattr(connection.ext, "offered_qos_profiles", ())
    first = profiles[0] if profiles else None
    best_effort = first is not None and first.reliability == QosReliability.BEST_EFFORT
    latched = first is not None and first.durability == QosDurability.TRANSIENT_LOCAL
    depth = first.depth if first is not None else _LEAST_DEPTH
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth if latched and depth else min(max(depth, _LEAST_DEPTH), _MOST_DEPTH),
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _is_latched(connection: Connection) -> bool:
    return qos_of(connection).durability == DurabilityPolicy.TRANSIENT_LOCAL


class Player:
    """One run of `heli bag play`.

    Parameters
    ----------
    node : Node
        Makes the publishers.
    path : Path
        The bag.
    choice : PlayChoice
    progress : callable
        Gets the bag time played so far (s) and in all.

    Attributes
    ----------
    played : dict
        Messages played per topic.
    shortfall : list of str
        Why less was played than the bag lists, once it has been played.

    Raises
    ------
    BagError
        Not a bag, no such topic, nothing to play, or a named topic's type is not installed.
    """

    def __init__(
        self,
        node: Node,
        path: Path,
        choice: PlayChoice,
        progress: Callable[[float, float], None] = lambda done, total: None,
    ) -> None:
        self._node, self._path, self._choice, self._progress = node, path, choice, progress
        self.played: dict[str, int] = {}
        self.shortfall: list[str] = []
        self._publishers: dict[str, Publisher] = {}

    def _advertise(self, reader: BagReader, connections: Sequence[Connection]) -> list[Connection]:
        """Make publishers; the topics that have one. Of those that nobody named others may not."""
        playable = []
        for c in connections:
            why = reader.form(c)
            try:
                if why:
                    raise BagError(f"topic {c.topic}: {why}", BagCause.TOPIC)
                self._publishers[c.topic] = self._publisher(c.topic, c.msgtype, qos_of(c))
                playable.append(c)
            except BagError as error:
                if self._choice.topics:
                    raise
                self.shortfall.append(f"{c.msgcount} messages of {error}")
        return playable

    def _publisher(self, topic: str, type_name: str, qos: QoSProfile) -> Publisher:
        try:
            cls = topics.message_class(type_name)
        except LookupError as error:
            sentence = f"topic {topic}: {error}; leave it out with --exclude"
            raise BagError(sentence, BagCause.TOPIC) from error
        return self._node.create_publisher(cls, topic, qos)

    def _wait_for_listeners(self) -> None:
        """Until discovery has brought no further listener for a while; none is fine, too."""
        begun = settled = time.monotonic()
        last_count = 0
        while time.monotonic() - begun < _LISTENERS_S:
            count = sum(p.get_subscription_count() for p in self._publishers.values())
            if count != last_count:
                last_count, settled = count, time.monotonic()
            if last_count and time.monotonic() - settled > _SETTLED_S:
                return
            time.sleep(_POLL_S)

    def run(self) -> dict[str, int]:
        """Play; returns the messages played per topic."""
        with opened(self._path, self._choice.flight) as reader:
            connections = chosen(reader, self._path, self._choice.topics, self._choice.exclude)
            connections = [c for c in connections if c.msgcount]
            start_ns = reader.start_time + round(self._choice.start_s * 1e9)
            end_ns = reader.end_time
            if self._choice.duration_s is not None:
                end_ns = min(end_ns, start_ns + round(self._choice.duration_s * 1e9))
            if not connections or start_ns >= end_ns:
                length = (reader.end_time - reader.start_time) / 1e9
                sentence = f"{self._path}: nothing to play: it lasts {length:.2f} s"
                raise BagError(sentence, BagCause.NOTHING_LEFT)
            connections = self._advertise(reader, connections)
            if not connections:
                sentence = f"{self._path}: nothing to play: {'; '.join(self.shortfall)}"
                raise BagError(sentence, BagCause.NOTHING_LEFT)
            clock = self._clock()
            self._wait_for_listeners()
            while True:
                events = self._events(reader, connections, start_ns, end_ns)
                if clock is not None:
                    events = self._with_clock(events, clock, start_ns)
                self._play(events, start_ns, end_ns)
                if not self._choice.loop or not self.played:
                    break
            self._finish()
            self.shortfall += reader.shortfall_of_files(connections)
        return self.played

    def _clock(self) -> Publisher | None:
        """Publisher of a generated clock; None if the bag has one or none is wanted."""
        if topics.CLOCK in self._publishers or not self._choice.clock_hz:
            return None
        kind = topics.BY_NAME[topics.CLOCK].type
        clock = self._publisher(topics.CLOCK, kind, topics.qos(topics.CLOCK))
        self._publishers[topics.CLOCK] = clock
        return clock

    def _events(
        self, reader: BagReader, connections: list[Connection], start_ns: int, end_ns: int
    ) -> Iterator[Event]:
        """What to publish when; latched messages from before the start come first."""
        latched = [c for c in connections if _is_latched(c)]
        if latched and start_ns > reader.start_time:
            last: dict[str, bytes] = {}
            for c, _, raw in reader.messages(connections=latched, stop=start_ns):
                last[c.topic] = raw
            for topic, raw in last.items():
                yield start_ns, self._publishers[topic], bytes(raw)
        for c, stamp_ns, raw in reader.messages(
            connections=connections, start=start_ns, stop=end_ns
        ):
            yield stamp_ns, self._publishers[c.topic], bytes(raw)

    def _with_clock(
        self, events: Iterable[Event], clock: Publisher, start_ns: int
    ) -> Iterator[Event]:
        """The events with a clock in front of each that is due."""
        period_ns, now_ns = round(NS_PER_S / self._choice.clock_hz), start_ns
        for event in events:
            while now_ns <= event[0]:
                yield now_ns, clock, _CLOCK.pack(_CDR, *divmod(now_ns, 10**9))
                now_ns += period_ns
            yield event

    def _play(self, events: Iterable[Event], start_ns: int, end_ns: int) -> None:
        begun, rate, total_s = time.monotonic(), self._choice.rate, (end_ns - start_ns) / 1e9
        for stamp_ns, publisher, raw in events:
            done_s = (stamp_ns - start_ns) / 1e9
            wait = begun + done_s / rate - time.monotonic()
            if wait > 0.0:
                self._progress(done_s, total_s)
                time.sleep(wait)
            publisher.publish(raw)
            name = publisher.topic_name
            self.played[name] = self.played.get(name, 0) + 1

    def _finish(self) -> None:
        """Wait until reliable listeners have all that was sent."""
        limit: Any = Duration(seconds=_ACKNOWLEDGED_S)
        for publisher in self._publishers.values():
            if publisher.get_subscription_count():
                publisher.wait_for_all_acked(limit)
