# SPDX-License-Identifier: Apache-2.0
"""Storage files of a bag that survive a `kill -9`, and the definitions in them. No rclpy."""

import contextlib
import os
import sqlite3
import struct
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from io import BufferedWriter, BytesIO
from pathlib import Path
from typing import Any, cast
from zlib import crc32

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
)
from rosbags.rosbag2 import CompressionMode
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

NEVER_NS = 2**63 - 1
# Pages of 4 KiB after which the write-ahead log is moved into the database.
_WAL_PAGES = 256
# In a chunk's record: opcode, length, start and end time and size stand before it (MCAP format).
_CHECK_SUM_AT, _CHECK_SUM = 1 + 8 + 3 * 8, struct.Struct("<I")
# A message's record: opcode, length of the rest; channel, sequence, times of log and publication.
_MESSAGE, _MESSAGE_RECORD, _IN_RECORD = struct.Struct("<BQHIQQ"), 0x05, 2 + 4 + 8 + 8
_CHUNK_BYTES = 2**20


def serialization_format(connection: Connection) -> str:
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
        self._safe: tuple[int, int, int, int, dict[int, int]] = (0, 0, NEVER_NS, 0, {})

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
            serialization_format(connection),
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
        self.chunk = PendingChunk(NEVER_NS, 0, BytesIO(), defaultdict(list))
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
