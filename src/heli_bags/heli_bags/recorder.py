# SPDX-License-Identifier: Apache-2.0
"""The graph's serialised messages into a rosbag2 folder, without a ROS installation. No rclpy here.

`flush` closes a chunk that is complete in itself: what was flushed before a power cut or a
`kill -9` can be read again (`heli bag repair`).
"""

import sqlite3
from collections import deque
from collections.abc import Iterable
from pathlib import Path

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from heli_bags.bag_clock import LATE, WINDOW_NS, BagClock
from heli_bags.definitions import Definitions, UnknownTypeError
from heli_bags.folder import BagError, BagFolder, Channel, Format, reason
from heli_math.ticks import NS_PER_S, OF_100_HZ, Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of

__all__ = ["BagError", "BagRecorder", "Format", "row_of"]

_FOREVER = QosTime(9223372036, 854775807)
# So many messages are kept at most until a stream has told the time.
_MOST_WAITING = 500
# Stamps of a topic among which one that goes back may be a repetition.
_RECENT = 64
# After a pause of the recorder the queue of a topic that does not tell the time may be emptied
# before those that do: so far ahead it waits for them.
_AHEAD_NS = 100 * NS_PER_S


def row_of(wanted: str) -> topics.Topic:
    """Row of a topic of the graph by its name, or of any other as `name:package/msg/Type`.

    Raises
    ------
    BagError
        The graph has no such topic and no type is given.
    """
    if wanted in topics.KNOWN:
        return topics.KNOWN[wanted]
    name, _, type_name = wanted.partition(":")
    if not name or "/msg/" not in type_name:
        raise BagError(
            f"unknown topic '{wanted}'; known: {', '.join(topics.KNOWN)}; "
            "any other as name:package/msg/Type"
        )
    return topics.Topic(name, type_name, (), (), 0)


def _qos(topic: topics.Topic) -> Qos:
    durability = QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE
    return Qos(
        QosHistory.KEEP_LAST,
        1 if topic.latched else topics.DEPTH,
        QosReliability.RELIABLE,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


class BagRecorder:
    """Writes topics to a new bag.

    Parameters
    ----------
    folder : path
        rosbag2 folder to make; must not exist.
    names : iterable of str
        Topics of `topics.TABLE`, or others as `name:package/msg/Type`.
    namespace : str
        Put before relative names, "/" by default.
    form : Format
        Storage, compression, splitting.
    start_ns : int
        Stamp of the flight's first tick.
    rate : Rate
        Of its ticks.

    Raises
    ------
    BagError
        The folder exists or cannot be written, or a topic's type is unknown.

    Attributes
    ----------
    counts : dict
        Messages written per topic.
    rows : dict
        Row of each topic.
    odd_stamps : dict
        Messages per topic whose stamps were not of the flight's time (`BagClock`).
    """

    def __init__(
        self,
        folder: str | Path,
        names: Iterable[str],
        namespace: str = "/",
        form: Format | None = None,
        start_ns: int = 0,
        rate: Rate = OF_100_HZ,
    ) -> None:
        self.folder, self._rate = Path(folder), rate
        rows = [row_of(name) for name in names]
        self.rows = {row.name: row for row in rows}
        definitions, channels = Definitions(), []
        for row in self.rows.values():
            full = row.name if row.name.startswith("/") else f"{namespace.rstrip('/')}/{row.name}"
            try:
                text, digest = definitions.text_and_hash(row.type)
            except UnknownTypeError as error:
                raise BagError(f"topic {row.name}: {error}") from error
            channels.append(Channel(full, row.type, text, digest, (_qos(row),)))
        self._bag = BagFolder(self.folder, channels, form)
        self._numbers = {name: number for number, name in enumerate(self.rows)}
        self.counts = dict.fromkeys(self.rows, 0)
        self.odd_stamps: dict[str, int] = {}
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}
        # A node that was started again repeats some messages: they fill no gap.
        self._recent = {name: deque[int](maxlen=_RECENT) for name in self.rows}
        self._repeated = dict.fromkeys(self.rows, 0)
        # By how much a sensor's stamps are behind the time at which they come.
        self._late_ns: dict[str, int] = {}
        self._clock = BagClock(start_ns, self.rows)
        self._waiting: list[tuple[str, bytes]] = []
        self._ahead: deque[tuple[str, bytes]] = deque()
        self._failed = self._closed = False

    @property
    def newest_ns(self) -> int:
        """Newest stamp of the flight, ns."""
        return self._clock.likely_ns

    def write(self, name: str, raw: bytes) -> None:
        """Write a serialised message, stamped in the flight's time.

        A message whose stamp is of another time, and that of a foreign topic or of one of
        `topics.TOOLS`, which need not carry one, get the graph's newest stamp. Nothing is written
        before the time is known.

        Raises
        ------
        BagError
            The disk is full or gone; said once, later messages are dropped silently.
        """
        if self._failed:
            return
        if self._clock.known:
            self._write(name, raw)
            return
        self._waiting.append((name, raw))
        if name in topics.BY_NAME:
            self._clock.admits(name, stamp_of(raw))
        if self._clock.known or len(self._waiting) > _MOST_WAITING:
            self._write_waiting()

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for name, raw in waiting:
            self._write(name, raw)

    def _write(self, name: str, raw: bytes, last: bool = False) -> None:
        if self._failed:
            return
        clock, fits = self._clock, False
        given_ns = stamp_ns = clock.now_ns
        if name in topics.BY_NAME:
            given_ns = stamp_of(raw)
            if name in LATE and WINDOW_NS < given_ns - clock.now_ns <= _AHEAD_NS and not last:
                self._ahead.append((name, raw))
                return
            fits = clock.admits(name, given_ns)
            if not fits:
                self.odd_stamps[name] = self.odd_stamps.get(name, 0) + 1
            else:
                stamp_ns = max(given_ns, clock.now_ns) if name in LATE else given_ns
        try:
            self._bag.write(self._numbers[name], max(stamp_ns, 0), raw)
        except (OSError, sqlite3.Error) as error:
            self._give_up(error)
        self.counts[name] += 1
        if self._ahead and fits and name not in LATE:
            self._write_ahead()
        if fits:
            self._first.setdefault(name, given_ns)
            if given_ns <= self._last.get(name, -1) and given_ns in self._recent[name]:
                self._repeated[name] += 1
            self._recent[name].append(given_ns)
            self._last[name] = max(given_ns, self._last.get(name, 0))
            if name in LATE:
                # A tick more: it may come before the rest of its own.
                late_ns = stamp_ns - given_ns + self._rate.tick_ns
                self._late_ns[name] = max(late_ns, self._late_ns.get(name, 0))

    def _write_ahead(self) -> None:
        """Write what has waited for the time that has come now."""
        ahead, until_ns = self._ahead, self._clock.now_ns + WINDOW_NS
        while ahead and stamp_of(ahead[0][1]) <= until_ns:
            self._write(*ahead.popleft())

    def flush(self) -> None:
        """Hand all messages to the operating system.

        Raises
        ------
        BagError
            As for `write`.
        """
        if self._failed:
            return
        try:
            self._bag.flush()
        except (OSError, sqlite3.Error) as error:
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        """Close the bag with what is safe; always raises BagError."""
        self._failed = True
        said = f"{self.folder}: recording stopped: {reason(error)}"
        try:
            lost = self._bag.give_up()
        except (OSError, sqlite3.Error):
            self._bag.abandon()
            raise BagError(f"{said}; 'heli bag repair' restores what was written") from error
        finally:
            self.counts = dict(zip(self.rows, self._bag.counts(), strict=True))
        raise BagError(
            f"{said}; the bag holds {sum(self.counts.values())} messages, {lost} more are lost"
        ) from error

    def missing(self, until_ns: int | None = None) -> list[str]:
        """Topics with a fixed rate of which a message of the middle or of the end has not come.

        Parameters
        ----------
        until_ns : int, optional
            Stamp up to which an end is looked at, by default the newest.
        """
        found, end_ns = [], self._clock.now_ns if until_ns is None else until_ns
        for name, last in self._last.items():
            period_ns = self.rows[name].period_ns(self._rate)
            if not period_ns or self._failed:
                continue
            expected = (last - self._first[name]) // period_ns + 1
            fitting = self.counts[name] - self.odd_stamps.get(name, 0) - self._repeated[name]
            newest_ns = last + self._late_ns.get(name, 0)
            if fitting < expected or newest_ns <= end_ns - period_ns:
                found.append(name)
        return found

    def close(self) -> None:
        """Write index and metadata; the bag opens everywhere then. Once is enough.

        Raises
        ------
        BagError
            They could not be written; the chunks that are on the disk stay readable.
        """
        if self._closed:
            return
        self._write_waiting()
        while self._ahead:
            self._write(*self._ahead.popleft(), last=True)
        if self._failed:
            return
        self._closed = True
        try:
            self._bag.flush()
            self._bag.close()
        except (OSError, sqlite3.Error) as error:
            self._give_up(error)
