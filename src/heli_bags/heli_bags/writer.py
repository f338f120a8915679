# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 folder that is being written: storage files, splitting, metadata.yaml. No rclpy."""

import contextlib
import os
import shutil
import sqlite3
import struct
import sys
import tempfile
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from io import BufferedWriter, BytesIO
from pathlib import Path
from typing import Any, cast
from zlib import crc32

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
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.rosbag2.storage_mcap import (
    Channel,
    McapWriter,
    PendingChunk,
    Schema,
    write_channel,
    write_schema,
    write_string,
)
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from heli_core.rcl_yaml import printable
from heli_core.ticks import NS_PER_S, OF_100_HZ, Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of, stamp_of_first

# -------------------------------------------------------------------------------------------------
# What an MCAP file's end says of its chunks, kept beside the file until then instead of in memory.
#
# A chunk's record is some 400 bytes; in real time a flight closes five chunks a second, so a list
# of them would grow by 7 MB an hour.
# -------------------------------------------------------------------------------------------------

_SIZE = struct.Struct("<I")
# Records in memory until they are moved out.
_RECENT = 64


class ChunkIndex:
    """Records of chunks, as a list that is only added to, read and cut; a file without a name.

    Parameters
    ----------
    folder : Path
        On whose disk it is.
    """

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)
        self._end = self._moved = 0
        self._recent: list[bytes] = []

    def append(self, record: BytesIO) -> None:
        """Add a record; where the disk takes none, it stays in memory."""
        self._recent.append(record.getvalue())
        if len(self._recent) >= _RECENT:
            self._move()

    def _move(self) -> None:
        raw = b"".join(_SIZE.pack(len(one)) + one for one in self._recent)
        try:
            self._file.seek(self._end)
            written = self._file.write(raw)
        except OSError:
            return
        if written == len(raw):
            self._end += written
            self._moved += len(self._recent)
            self._recent.clear()

    def __len__(self) -> int:
        return self._moved + len(self._recent)

    def _records(self) -> Iterator[bytes]:
        self._file.seek(0)
        raw, at = self._file.read(self._end), 0
        while at < len(raw):
            (size,) = _SIZE.unpack_from(raw, at)
            at += _SIZE.size
            yield raw[at : at + size]
            at += size
        yield from self._recent

    def __iter__(self) -> Iterator[BytesIO]:
        """Records as the writer of an MCAP file takes them: at their end."""
        for one in self._records():
            record = BytesIO(one)
            record.seek(0, 2)
            yield record

    def __delitem__(self, beyond: slice) -> None:
        """Forget the records from a number on."""
        kept = list(self._records())
        del kept[beyond]
        self._recent, self._end, self._moved = kept, 0, 0

    def close(self) -> None:
        """Give the file back; once is enough."""
        self._file.close()


# -------------------------------------------------------------------------------------------------
# Storage files of a bag that survive a `kill -9`: MCAP and SQLite, on the writers of `rosbags`.
#
# Those keep up to 1 MiB (MCAP) or everything (SQLite) to themselves until it is full or closed.
# Here
# `flush` hands all that was written to the operating system: MCAP closes its chunk, SQLite commits
# to
# its write-ahead log. What a `flush` has confirmed outlives the process.
# -------------------------------------------------------------------------------------------------

_NEVER_NS = 2**63 - 1
# Pages of 4 KiB after which the write-ahead log is moved into the database.
_WAL_PAGES = 256
# In a chunk's record: opcode, length, start and end time and size stand before it (MCAP format).
_CHECK_SUM_AT, _CHECK_SUM = 1 + 8 + 3 * 8, struct.Struct("<I")
# A message's record: opcode, length of the rest; channel, sequence, times of log and publication.
_MESSAGE, _MESSAGE_RECORD, _IN_RECORD = struct.Struct("<BQHIQQ"), 0x05, 2 + 4 + 8 + 8
_CHUNK_BYTES = 2**20


def _form(connection: Connection) -> str:
    """In what form its messages are."""
    return cast(ConnectionExtRosbag2, connection.ext).serialization_format


class _Text(str):
    """A definition that may be no text: its bytes come back as they were read."""

    def encode(self, encoding: str = "utf-8", errors: str = "surrogateescape") -> bytes:
        return super().encode(encoding, errors)


class McapFile(McapWriter):
    """One MCAP file, whole after every `flush` up to its index.

    Parameters
    ----------
    path : Path
        File to make.
    zstd : bool
        Compress the chunks.
    """

    def __init__(self, path: Path, zstd: bool = False) -> None:
        mode = CompressionMode.STORAGE if zstd else CompressionMode.NONE
        # rosbags names the file after its folder; the parts of a split bag have names of their own.
        super().__init__(path.parent, mode)
        self.path = self.path.rename(path)
        self._index = ChunkIndex(path.parent)
        self.chunks = cast("list[BytesIO]", self._index)
        self._safe: tuple[int, int, int, int, dict[int, int]] = (0, 0, _NEVER_NS, 0, {})

    @property
    def size(self) -> int:
        """Bytes of the file with what is not written yet."""
        return int(self.bio.tell()) + self.chunk.bio.tell()

    def add_msgtype(self, connection: Connection, encoding: str = "ros2msg") -> None:
        """Add a schema in an encoding of MCAP's registry, with the bytes that it had."""
        text = _Text(connection.msgdef.data)
        schema = Schema(len(self.schemas) + 1, connection.msgtype, encoding, text)
        self.schemas.append(schema)
        write_schema(self.chunk.bio, schema)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a channel with its QoS and type hash, as rosbag2 of Jazzy writes it."""
        metadata = BytesIO()
        write_string(metadata, "offered_qos_profiles")
        write_string(metadata, offered_qos_profiles)
        write_string(metadata, "topic_type_hash")
        write_string(metadata, connection.digest)
        channel = Channel(
            connection.id,
            connection.msgtype,
            connection.topic,
            _form(connection),
            metadata.getvalue(),
        )
        self.channels.append(channel)
        self.channel_stats[connection.id] = 0
        write_channel(self.chunk.bio, channel, self.schemas)

    def write(self, connection: Connection, timestamp: int, data: Any) -> None:
        """Write a message; the same bytes as the writer's own, which puts field by field."""
        number, chunk = connection.id, self.chunk
        if timestamp < self.message_start_time:
            self.message_start_time = timestamp
        if timestamp > self.message_end_time:
            self.message_end_time = timestamp
        if timestamp < chunk.message_start_time:
            chunk.message_start_time = timestamp
        if timestamp > chunk.message_end_time:
            chunk.message_end_time = timestamp
        self.channel_stats[number] += 1
        bio = chunk.bio
        chunk.msgs[number].append((timestamp, bio.tell()))
        size = _IN_RECORD + len(data)
        bio.write(_MESSAGE.pack(_MESSAGE_RECORD, size, number, 0, timestamp, timestamp))
        bio.write(data)
        if bio.tell() > _CHUNK_BYTES:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the present chunk with its check sum; one without messages says so in its times."""
        if not self.chunk.msgs:
            self.chunk.message_start_time = 0
        begun, check_sum = self.bio.tell(), crc32(self.chunk.bio.getvalue())
        super().close_chunk()
        # The writer leaves 0 there, "not checked": damaged numbers would be believed.
        end = self.bio.tell()
        self.bio.seek(begun + _CHECK_SUM_AT)
        self.bio.write(_CHECK_SUM.pack(check_sum))
        self.bio.seek(end)

    def flush(self) -> None:
        """Close the chunk and hand it to the operating system; raises OSError on a full disk."""
        if self.chunk.bio.tell():
            self.close_chunk()
        self.bio.flush()
        self._safe = (
            self.bio.tell(),
            len(self.chunks),
            self.message_start_time,
            self.message_end_time,
            dict(self.channel_stats),
        )

    def cut_back(self) -> dict[int, int]:
        """After a failed write: keep exactly what the last `flush` confirmed.

        Returns
        -------
        dict
            Messages kept per channel.
        """
        end, chunks, start_ns, end_ns, stats = self._safe
        self.bio.raw.close()
        with contextlib.suppress(OSError, ValueError):
            self.bio.close()
        self.bio = cast(BufferedWriter, open(self.path, "r+b"))
        self.bio.truncate(end)
        self.bio.seek(end)
        self.chunk = PendingChunk(_NEVER_NS, 0, BytesIO(), defaultdict(list))
        del self.chunks[chunks:]
        self.message_start_time, self.message_end_time = start_ns, end_ns
        self.channel_stats = dict.fromkeys(self.channel_stats, 0) | stats
        return self.channel_stats

    def close(self, version: int, metadata: str) -> None:
        """Write index and summary."""
        if not any(self.channel_stats.values()):
            self.message_start_time = 0
        if self.chunk.bio.tell():
            self.close_chunk()
        # Its room is needed when the disk is full.
        self.chunks = list(self.chunks)
        self._index.close()
        super().close(version, metadata)

    def abort(self) -> None:
        """Let go of the file without its index."""
        self._index.close()
        super().abort()


class SqliteFile(Sqlite3Writer):
    """One SQLite file with a write-ahead log while it grows, and without one when it is closed.

    Parameters
    ----------
    path : Path
        File to make.
    """

    def __init__(self, path: Path) -> None:
        # As in the writer's own, which would name the file after its folder: an open database
        # cannot be renamed.
        self.path = path
        self.conn = sqlite3.connect(f"file:{path}", uri=True)
        self.conn.executescript(self.SQLITE_SCHEMA)
        self.cursor = self.conn.cursor()
        self.conn.execute("PRAGMA journal_mode=WAL")
        self.conn.execute("PRAGMA synchronous=NORMAL")
        self.conn.execute(f"PRAGMA wal_autocheckpoint={_WAL_PAGES}")
        self.size = 0
        self._stats: dict[int, int] = defaultdict(int)
        self._safe: dict[int, int] = {}

    def add_msgtype(self, connection: Connection, encoding: str = "ros2msg") -> None:
        """Add a definition in an encoding of rosbag2."""
        self.cursor.execute(
            "INSERT INTO message_definitions (topic_type, encoding, encoded_message_definition,"
            " type_description_hash) VALUES(?, ?, ?, ?)",
            (connection.msgtype, encoding, connection.msgdef.data, connection.digest),
        )

    def write(self, connection: Connection, timestamp: int, data: Any) -> None:
        """Write a message."""
        super().write(connection, timestamp, data)
        self.size += len(data)
        self._stats[connection.id] += 1

    def flush(self) -> None:
        """Commit; raises sqlite3.Error on a full disk."""
        self.conn.commit()
        self._safe = dict(self._stats)

    def cut_back(self) -> dict[int, int]:
        """After a failed write: keep exactly what the last `flush` confirmed."""
        with contextlib.suppress(sqlite3.Error):
            self.conn.rollback()
        self._stats = defaultdict(int, self._safe)
        return self._stats

    def close(self, version: int, metadata: str) -> None:
        """Write the metadata and move the log into the database."""
        self.cursor.execute(
            "INSERT INTO metadata(metadata_version, metadata) VALUES(?, ?)", (version, metadata)
        )
        self.conn.commit()
        self.conn.execute("PRAGMA journal_mode=DELETE")
        self.conn.close()


StorageFile = McapFile | SqliteFile


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
    start_ns: int = _NEVER_NS
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
                        "serialization_format": _form(c),
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
# The time of a bag that is being recorded: the flight's, whatever stamps arrive. No rclpy.
#
# A message of the graph belongs where it was sent: where its stamp says, or a known latency later.
# When the recorder hears it says nothing: nobody waits for a recorder that lags. Not every stamp is
# of the flight's time: a pilot's `topic pub` has the wall clock's, zero or anything. Such a message
# is put where it was heard, and is no sign of a gap.
#
# In simulated time the messages of a tick are sent one after another at the same time: "superdense"
# time (Lee and Zheng, Operational semantics of hybrid systems, HSCC 2005) counts the steps besides.
# A bag has one number. Each step is a nanosecond of it, so that all readers keep the order, also
# those (`rosbags`) that put messages of one time in the order of their topics.
# -------------------------------------------------------------------------------------------------

LATE = (topics.GPS_FIX, topics.GPS_VELOCITY)
"""Stamped with the time of validity, and sent later: `BagRecorder` is told by how much."""
WINDOW_NS = 2 * NS_PER_S
"""A stamp so far ahead of the newest is of another time: each sender's messages come in order. How
far one is behind says nothing: DDS repeats what a full queue did not take after seconds."""


def steps_of(names: Iterable[str]) -> dict[str, int]:
    """Place of each topic among those of a bag, in the order in which a tick's messages are sent.

    That of a topic which no tick sends is 0.
    """
    recorded = set(names)
    in_order = [name for name in topics.SENDING_ORDER if name in recorded]
    return dict.fromkeys(recorded, 0) | {name: place for place, name in enumerate(in_order)}


def is_stream(name: str) -> bool:
    """Whether a topic has a message every so many ticks, so that its stamps tell the time."""
    return name in topics.BY_NAME and topics.BY_NAME[name].every_ticks > 0 and name not in LATE


class BagClock:
    """Which stamps are of the flight's time, and what time it is.

    Two messages in a row of `/clock` (of any stream if that is not recorded) that fit to each other
    set it: the recorder was started in flight, or time was begun anew.

    Parameters
    ----------
    start_ns : int
        Stamp of the flight's first tick.
    names : iterable of str
        What is recorded.

    Attributes
    ----------
    now_ns : int
        Newest stamp of the flight.
    known : bool
        False until a stream has confirmed or set the time.
    """

    def __init__(self, start_ns: int, names: Iterable[str]) -> None:
        streams = {name for name in names if is_stream(name)}
        self.now_ns, self.known = start_ns, False
        self._start_ns = start_ns
        self._streams = streams
        self._setters = streams & {topics.CLOCK} or streams
        self._doubted: dict[str, int] = {}

    @property
    def likely_ns(self) -> int:
        """The time; before it is known, what was last said of it."""
        doubted = [] if self.known else list(self._doubted.values())
        return doubted[-1] if doubted else self.now_ns

    def admits(self, name: str, sent_ns: int) -> bool:
        """Whether a message was sent in the flight's time, which it may move."""
        first_ns, row = self._start_ns, topics.KNOWN[name]
        if row.latched or not row.source:
            # A latched message may be as old as the flight, and a command may be stamped with
            # anything; it belongs where it was heard.
            first_ns = max(first_ns, self.now_ns - WINDOW_NS)
        if first_ns <= sent_ns <= self.now_ns + WINDOW_NS:
            if name in self._streams:
                self.known, self.now_ns = True, max(self.now_ns, sent_ns)
                self._doubted.pop(name, None)
            return True
        if name not in self._setters or sent_ns < 0:
            return False
        before, self._doubted[name] = self._doubted.get(name), sent_ns
        if before is None or not 0 < sent_ns - before <= WINDOW_NS:
            return False
        self.known, self.now_ns = True, sent_ns
        self._start_ns = min(self._start_ns, sent_ns)
        self._doubted.clear()
        return True


# -------------------------------------------------------------------------------------------------
# Message definitions and type hashes, of standard messages and of those installed here.
# -------------------------------------------------------------------------------------------------


class UnknownTypeError(LookupError):
    """No definition of a message type is here; the message is one line that names it."""


def _installed(type_name: str) -> Path | None:
    """The .msg file of an installed type."""
    package, _, name = type_name.partition("/msg/")
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in (*prefixes, Path(sys.prefix)):
        path = prefix / "share" / package / "msg" / f"{name}.msg"
        if name and path.is_file():
            return path
    return None


def named_in(description: Any) -> set[str]:
    """Message types that a field's description names, at any depth."""
    kind, content = description
    if kind.name == "NAME":
        return {content}
    if kind.name in ("ARRAY", "SEQUENCE"):
        return named_in(content[0])
    return set()


class Definitions:
    """Definitions by type name; looks into the installation for what is not standard.

    Attributes
    ----------
    store : Typestore
        Of `rosbags`: serialises and deserialises every type that was asked for.
    """

    def __init__(self) -> None:
        self.store: Typestore = get_typestore(Stores.ROS2_JAZZY)

    def require(self, type_name: str) -> None:
        """Make the store know a type and those it is built of.

        Raises
        ------
        UnknownTypeError
            It is neither standard nor installed.
        """
        wanted, definitions = {type_name}, {}
        while wanted:
            name = wanted.pop()
            if name in self.store.fielddefs or name in definitions:
                continue
            path = _installed(name)
            if path is None:
                raise UnknownTypeError(f"message type {name} is not installed")
            types = get_types_from_msg(path.read_text(encoding="utf-8"), name)
            definitions.update(types)
            for _, fields in types.values():
                for _, description in fields:
                    wanted |= named_in(description)
        if definitions:
            self.store.register(definitions)

    def text_and_hash(self, type_name: str) -> tuple[str, str]:
        """Definition with all it depends on (format `ros2msg`) and hash (`RIHS01_...`).

        Raises
        ------
        UnknownTypeError
        """
        self.require(type_name)
        text, _ = self.store.generate_msgdef(type_name, ros_version=2)
        return text, self.store.hash_rihs01(type_name)


# -------------------------------------------------------------------------------------------------
# The graph's serialised messages into a rosbag2 folder, without a ROS installation. No rclpy here.
#
# `flush` closes a chunk that is complete in itself: what was flushed before a power cut or a
# `kill -9` can be read again (`heli bag repair`).
# -------------------------------------------------------------------------------------------------

__all__ = ["BagCause", "BagError", "BagRecorder", "Format", "row_of"]

_FOREVER = QosTime(9223372036, 854775807)
# So many messages are kept at most until a stream has told the time.
_MOST_WAITING = 500
# Stamps of a topic among which one that goes back may be a repetition.
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
        self._recent = {name: deque[int](maxlen=_RECENT) for name in self.rows}
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
