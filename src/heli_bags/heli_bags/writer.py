# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 folder that is written: splitting, metadata, a full disk; the recorder. No rclpy."""

import contextlib
import os
import shutil
import sqlite3
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9

from heli_bags.bag_clock import LATE, WINDOW_NS, BagClock, steps_of
from heli_bags.storage_files import (
    NEVER_NS,
    Definitions,
    McapFile,
    SqliteFile,
    StorageFile,
    UnknownTypeError,
    serialization_format,
)
from heli_core.rcl_yaml import printable
from heli_core.ticks import NS_PER_S, OF_100_HZ, Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of, stamp_of_first

# -------------------------------------------------------------------------------------------------
# Folder.
# -------------------------------------------------------------------------------------------------

BAG_VERSION = 9
METADATA = "metadata.yaml"
SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}
_RESERVE = ".reserve"
# Room for index and metadata of hours of flight, given back when the disk is full.
_RESERVE_BYTES = 2 * 2**20
# At most that much is lost when the disk fills up, however fast the messages come.
_FLUSH_BYTES = 2**19


class BagCause(Enum):
    """Why a bag cannot be written or read."""

    MISSING = "it does not exist"
    NO_BAG = "it is no bag"
    DAMAGED = "its content cannot be read"
    NOT_WHOLE = "it was never closed, or is cut off; a repair restores what can be"
    NOTHING_LEFT = "it holds no message that can be read or played"
    EXISTS = "there is one of its name already"
    UNWRITABLE = "it cannot be written"
    STOPPED = "its recording has stopped"
    OPTION = "options do not go together, or one is not known"
    TOPIC = "a topic or its type is not known"
    TOO_LARGE = "it is larger than the budget, or would become so"


class BagError(Exception):
    """A bag cannot be written or read; the message is one line that names it.

    Attributes
    ----------
    cause : BagCause or None
        For programs; None where none is named.
    kept : int or None
        Messages that the bag holds whose recording has stopped; None where only a repair can tell.
    """

    def __init__(
        self, sentence: str, cause: BagCause | None = None, kept: int | None = None
    ) -> None:
        super().__init__(sentence)
        self.cause, self.kept = cause, kept


def reason(error: Exception) -> str:
    """Why a file could not be written or read, in a few words."""
    strerror = getattr(error, "strerror", None)
    lines = str(error).strip().splitlines()
    return printable(str(strerror or (lines[0] if lines else type(error).__name__)))


def custom_data(entries: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Names and texts of entries `name: text`; `none` says nothing.

    Raises
    ------
    BagError
        An entry has no name.
    """
    pairs = []
    for entry in entries:
        name, colon, text = entry.partition(":")
        if entry == "none":
            continue
        if not colon or not name.strip():
            allowed = "'name: text', or none"
            sentence = f"custom_data: {entry!r} is not allowed; allowed: {allowed}"
            raise BagError(sentence, BagCause.OPTION)
        pairs.append((name.strip(), text.strip()))
    return tuple(pairs)


@dataclass(frozen=True)
class Format:
    """How a bag is stored.

    Attributes
    ----------
    storage : str
        "mcap" or "sqlite3".
    zstd : bool
        Compress the chunks (MCAP only).
    split_bytes, split_ns : int
        Begin a new file at this size or after this span of stamps; 0 for never.
    custom_data : tuple of (str, str)
        Names and texts for metadata.yaml.
    """

    storage: str = "mcap"
    zstd: bool = False
    split_bytes: int = 0
    split_ns: int = 0
    custom_data: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.storage not in SUFFIXES:
            sentence = f"storage: {self.storage} is none of {', '.join(SUFFIXES)}"
            raise BagError(sentence, BagCause.OPTION)
        if self.zstd and self.storage != "mcap":
            sentence = f"compression: zstd is for storage mcap, not for {self.storage}"
            raise BagError(sentence, BagCause.OPTION)


@dataclass(frozen=True)
class BagChannel:
    """One topic of a bag: full name, type, definition, hash, QoS; how both are encoded.

    `schema` is the encoding of the definition, `form` that of the messages.
    """

    topic: str
    type: str
    definition: str
    hash: str
    qos: tuple[Qos, ...] = ()
    schema: str = "ros2msg"
    form: str = "cdr"


@dataclass
class _Part:
    """What metadata.yaml says of one file."""

    path: str
    start_ns: int = NEVER_NS
    end_ns: int = 0
    counts: dict[int, int] = field(default_factory=dict)

    def info(self) -> dict[str, Any]:
        count = sum(self.counts.values())
        return {
            "path": self.path,
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": max(0, self.end_ns - self.start_ns) if count else 0},
            "message_count": count,
        }


def _profiles(connection: Connection) -> list[Any]:
    """Offered QoS profiles; all connections of a rosbag2 have them."""
    return list(getattr(connection.ext, "offered_qos_profiles", ()))


class BagFolder:
    """Writes messages into a new rosbag2 folder.

    The folder opens everywhere after `close`; before, all that the last `flush` confirmed can be
    restored, whatever happens to the process. After half a megabyte it flushes by itself. Finished
    files of a split bag are in metadata.yaml at once.

    Parameters
    ----------
    folder : path
        Must not exist.
    channels : sequence of Channel
    form : Format

    Raises
    ------
    BagError
        The folder exists or cannot be written.
    """

    def __init__(
        self, folder: str | Path, channels: Sequence[BagChannel], form: Format | None = None
    ) -> None:
        self.folder, self.form = Path(folder), form or Format()
        if self.folder.exists():
            sentence = f"{folder}: exists already; a bag needs a new folder"
            raise BagError(sentence, BagCause.EXISTS)
        self._connections = [self._connection(i + 1, c) for i, c in enumerate(channels)]
        self._schemas = [channel.schema for channel in channels]
        self._parts: list[_Part] = []
        self._file: StorageFile | None = None
        self._unflushed_bytes = 0
        try:
            self.folder.mkdir(parents=True)
            with open(self.folder / _RESERVE, "xb") as reserve:
                os.posix_fallocate(reserve.fileno(), 0, _RESERVE_BYTES)
            self._begin_file()
        except (OSError, sqlite3.Error) as error:
            self.abandon()
            shutil.rmtree(self.folder, ignore_errors=True)
            sentence = f"{folder}: cannot be written: {reason(error)}"
            raise BagError(sentence, BagCause.UNWRITABLE) from error

    def _connection(self, number: int, channel: BagChannel) -> Connection:
        return Connection(
            number,
            channel.topic,
            channel.type,
            MessageDefinition(MessageDefinitionFormat.NONE, channel.definition),
            channel.hash,
            0,
            ConnectionExtRosbag2(channel.form, list(channel.qos)),
            self,
        )

    def _begin_file(self) -> None:
        suffix = SUFFIXES[self.form.storage]
        path = self.folder / f"{self.folder.name}_{len(self._parts)}{suffix}"
        self._parts.append(_Part(path.name))
        mcap = self.form.storage == "mcap"
        file = McapFile(path, self.form.zstd) if mcap else SqliteFile(path)
        self._file = file
        known: set[str] = set()
        for connection, schema in zip(self._connections, self._schemas, strict=True):
            if connection.msgtype not in known:
                file.add_msgtype(connection, schema)
                known.add(connection.msgtype)
            profiles = dump_qos_v9(_profiles(connection))
            file.add_connection(connection, yaml.safe_dump(profiles, sort_keys=False).strip())
        # Definitions reach the disk before the first message.
        file.flush()

    def write(self, number: int, stamp_ns: int, raw: bytes) -> None:
        """Write a serialised message of channel `number` (0 is the first).

        Raises
        ------
        OSError, sqlite3.Error
            The disk is full or gone; call `give_up` then.
        """
        part = self._parts[-1]
        if self._due(part, stamp_ns):
            self.split()
            part = self._parts[-1]
        assert self._file is not None
        self._file.write(self._connections[number], stamp_ns, raw)
        part.counts[number] = part.counts.get(number, 0) + 1
        if stamp_ns < part.start_ns:
            part.start_ns = stamp_ns
        if stamp_ns > part.end_ns:
            part.end_ns = stamp_ns
        self._unflushed_bytes += len(raw)
        if self._unflushed_bytes > _FLUSH_BYTES:
            self.flush()

    def _due(self, part: _Part, stamp_ns: int) -> bool:
        """Whether this message belongs into a new file."""
        if not part.counts:
            return False
        if self.form.split_ns and stamp_ns - part.start_ns >= self.form.split_ns:
            return True
        full = self.form.split_bytes
        return bool(full) and self._file is not None and self._file.size >= full

    def split(self) -> None:
        """Finish the present file and begin the next."""
        self._end_file()
        self._write_metadata()
        self._begin_file()

    def flush(self) -> None:
        """Hand everything to the operating system; what it confirms outlives this process.

        Raises
        ------
        OSError, sqlite3.Error
            The disk is full or gone; call `give_up` then.
        """
        if self._file is not None:
            self._file.flush()
        self._unflushed_bytes = 0

    def _end_file(self) -> None:
        if self._file is not None:
            self._file.close(BAG_VERSION, yaml.safe_dump(self.information(), sort_keys=False))
            self._file = None

    def close(self) -> None:
        """Write index and metadata.

        Raises
        ------
        OSError, sqlite3.Error
            They could not be written; what the last `flush` confirmed can be restored.
        """
        self._drop_reserve()
        self._end_file()
        self._write_metadata()

    def give_up(self) -> int:
        """After a failed write: keep what the last `flush` confirmed and close the bag with that.

        Returns
        -------
        int
            Messages that are left out although `write` had taken them.

        Raises
        ------
        OSError, sqlite3.Error
            Not even that could be written.
        """
        part, lost = self._parts[-1], 0
        # First of all: without room not even the cut is certain.
        self._drop_reserve()
        if self._file is not None:
            kept = self._file.cut_back()
            now = {number: kept.get(number + 1, 0) for number in part.counts}
            lost = sum(part.counts.values()) - sum(now.values())
            part.counts = now
        if len(self._parts) > 1 and not sum(part.counts.values()):
            self.abandon()
            self._parts.pop()
            (self.folder / part.path).unlink(missing_ok=True)
        self.close()
        return lost

    def abandon(self) -> None:
        """Let go of the files without writing anything more."""
        if self._file is not None:
            with contextlib.suppress(OSError, sqlite3.Error, ValueError):
                self._file.abort()
            self._file = None

    def _drop_reserve(self) -> None:
        (self.folder / _RESERVE).unlink(missing_ok=True)

    def counts(self) -> list[int]:
        """Messages per channel."""
        return [
            sum(part.counts.get(number, 0) for part in self._parts)
            for number in range(len(self._connections))
        ]

    def information(self) -> dict[str, Any]:
        """Content of metadata.yaml below its first key (rosbag2 version 9)."""
        parts = [part for part in self._parts if part.counts] or self._parts[:1]
        start_ns, end_ns = min(p.start_ns for p in parts), max(p.end_ns for p in parts)
        counts = self.counts()
        return {
            "version": BAG_VERSION,
            "storage_identifier": self.form.storage,
            "duration": {"nanoseconds": max(0, end_ns - start_ns) if sum(counts) else 0},
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "message_count": sum(counts),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": c.topic,
                        "type": c.msgtype,
                        "serialization_format": serialization_format(c),
                        "offered_qos_profiles": dump_qos_v9(_profiles(c)),
                        "type_description_hash": c.digest,
                    },
                    "message_count": count,
                }
                for c, count in zip(self._connections, counts, strict=True)
            ],
            # Compressed MCAP chunks are the file's affair: this speaks of rosbag2's own layer.
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [part.path for part in parts],
            "files": [part.info() for part in parts],
            "custom_data": dict(self.form.custom_data) or None,
            "ros_distro": "jazzy",
        }

    def _write_metadata(self) -> None:
        content = {"rosbag2_bagfile_information": self.information()}
        new = self.folder / f"{METADATA}.new"
        new.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        new.replace(self.folder / METADATA)


# -------------------------------------------------------------------------------------------------
# The graph's serialised messages into a rosbag2 folder, without a ROS installation. No rclpy here.
#
# `flush` closes a chunk that is complete in itself: what was flushed before a power cut or a
# `kill -9` can be read again (`heli bag repair`).
# -------------------------------------------------------------------------------------------------

_FOREVER = QosTime(9223372036, 854775807)
# So many messages are kept at most until a stream has told the time.
_MOST_WAITING = 500
# Stamps of a topic among which one that goes back may be a repetition.
_RECENT_STAMPS = 64
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
            "any other as name:package/msg/Type",
            BagCause.TOPIC,
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
    latency_ns : mapping of str to int, optional
        By how much messages of a topic are sent after their stamps; of others they are sent then.

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
        latency_ns: Mapping[str, int] | None = None,
    ) -> None:
        self.folder, self._rate = Path(folder), rate
        self._latency_ns = dict(latency_ns or {})
        rows = [row_of(name) for name in names]
        self.rows = {row.name: row for row in rows}
        definitions, channels = Definitions(), []
        for row in self.rows.values():
            full = row.name if row.name.startswith("/") else f"{namespace.rstrip('/')}/{row.name}"
            try:
                text, digest = definitions.text_and_hash(row.type)
            except UnknownTypeError as error:
                raise BagError(f"topic {row.name}: {error}", BagCause.TOPIC) from error
            channels.append(BagChannel(full, row.type, text, digest, (_qos(row),)))
        self._bag = BagFolder(self.folder, channels, form)
        self._numbers = {name: number for number, name in enumerate(self.rows)}
        self._steps_ns = steps_of(self.rows)
        self.counts = dict.fromkeys(self.rows, 0)
        self.odd_stamps: dict[str, int] = {}
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}
        # A node that was started again repeats some messages: they fill no gap.
        self._recent = {name: deque[int](maxlen=_RECENT_STAMPS) for name in self.rows}
        self._repeated = dict.fromkeys(self.rows, 0)
        # Per topic when another one has said that it has no message.
        self._absent: defaultdict[str, set[int]] = defaultdict(set)
        # By how much a sensor's messages are heard after the newest of other topics.
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
        """Write a serialised message, at the flight's time at which it was sent, and its step.

        A message whose stamp is of another time, and that of a foreign topic, which need not carry
        one, get the graph's newest stamp. Nothing is written before the time is known.

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
            self._clock.admits(name, self._sent_ns(name, raw))
        if self._clock.known or len(self._waiting) > _MOST_WAITING:
            self._write_waiting()

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for name, raw in waiting:
            self._write(name, raw)

    def _sent_ns(self, name: str, raw: bytes) -> int:
        """When a message of the graph was sent, as its sender says; negative: it does not say."""
        if name in topics.BY_NAME or name == topics.JOINT_STATES:
            return stamp_of(raw) + self._latency_ns.get(name, 0)
        return stamp_of_first(raw) if name in (topics.TF, topics.TF_STATIC) else -1

    def _write(self, name: str, raw: bytes, last: bool = False) -> None:
        if self._failed:
            return
        clock, fits = self._clock, False
        sent_ns = log_ns = clock.now_ns
        if name in topics.KNOWN:
            sent_ns = self._sent_ns(name, raw)
            if name in LATE and WINDOW_NS < sent_ns - clock.now_ns <= _AHEAD_NS and not last:
                self._ahead.append((name, raw))
                return
            fits = clock.admits(name, sent_ns)
            log_ns = sent_ns if fits else log_ns
        try:
            self._bag.write(self._numbers[name], max(log_ns, 0) + self._steps_ns[name], raw)
        except (OSError, sqlite3.Error) as error:
            self._give_up(error)
        self.counts[name] += 1
        if name in topics.BY_NAME:
            self._note(name, sent_ns, fits)

    def _note(self, name: str, sent_ns: int, fits: bool) -> None:
        """Remember of a message what tells whether others lack."""
        if not fits:
            self.odd_stamps[name] = self.odd_stamps.get(name, 0) + 1
            return
        self._first.setdefault(name, sent_ns)
        for replaced in topics.BY_NAME[name].replaces:
            self._absent[replaced].add(sent_ns)
        if sent_ns <= self._last.get(name, -1) and sent_ns in self._recent[name]:
            self._repeated[name] += 1
        self._recent[name].append(sent_ns)
        self._last[name] = max(sent_ns, self._last.get(name, 0))
        if name in LATE:
            # A tick more: it may come before the rest of its own.
            late_ns = max(self._clock.now_ns - sent_ns, 0) + self._rate.tick_ns
            self._late_ns[name] = max(late_ns, self._late_ns.get(name, 0))
        elif self._ahead:
            self._write_ahead()

    def _write_ahead(self) -> None:
        """Write what has waited for the time that has come now."""
        ahead, until_ns = self._ahead, self._clock.now_ns + WINDOW_NS
        while ahead and self._sent_ns(*ahead[0]) <= until_ns:
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
        sentence = f"{self.folder}: recording stopped: {reason(error)}"
        try:
            lost = self._bag.give_up()
        except (OSError, sqlite3.Error):
            self._bag.abandon()
            sentence = f"{sentence}; 'heli bag repair' restores what was written"
            raise BagError(sentence, BagCause.STOPPED) from error
        finally:
            self.counts = dict(zip(self.rows, self._bag.counts(), strict=True))
        kept = sum(self.counts.values())
        sentence = f"{sentence}; the bag holds {kept} messages, {lost} more are lost"
        raise BagError(sentence, BagCause.STOPPED, kept) from error

    def missing(self, until_ns: int | None = None) -> list[str]:
        """Topics with a fixed rate of which a message of the middle or of the end has not come.

        Parameters
        ----------
        until_ns : int, optional
            Stamp up to which an end is looked at, by default the newest.
        """
        incomplete, end_ns = [], self._clock.now_ns if until_ns is None else until_ns
        for name, last in self._last.items():
            period_ns = self.rows[name].period_ns(self._rate)
            if not period_ns or self._failed:
                continue
            first, absent = self._first[name], self._absent[name]
            last = max(last, *absent, first)
            expected = (last - first) // period_ns + 1
            fitting = self.counts[name] - self.odd_stamps.get(name, 0) - self._repeated[name]
            fitting += sum(stamp >= first for stamp in absent)
            newest_ns = last + self._late_ns.get(name, 0)
            if fitting < expected or newest_ns <= end_ns - period_ns:
                incomplete.append(name)
        return incomplete

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
