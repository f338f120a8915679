# SPDX-License-Identifier: Apache-2.0
"""Storage files of a bag that survive a `kill -9`: MCAP and SQLite, on the writers of `rosbags`.

Those keep up to 1 MiB (MCAP) or everything (SQLite) to themselves until it is full or closed. Here
`flush` hands all that was written to the operating system: MCAP closes its chunk, SQLite commits to
its write-ahead log. What a `flush` has confirmed outlives the process.
"""

import contextlib
import sqlite3
import struct
from collections import defaultdict
from io import BufferedWriter, BytesIO
from pathlib import Path
from typing import Any, cast
from zlib import crc32

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode
from rosbags.rosbag2.storage_mcap import (
    Channel,
    McapWriter,
    PendingChunk,
    write_channel,
    write_string,
)
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from heli_bags.chunk_index import ChunkIndex

_NEVER_NS = 2**63 - 1
# Pages of 4 KiB after which the write-ahead log is moved into the database.
_WAL_PAGES = 256
# In a chunk's record: opcode, length, start and end time and size stand before it (MCAP format).
_CHECK_SUM_AT, _CHECK_SUM = 1 + 8 + 3 * 8, struct.Struct("<I")
# A message's record: opcode, length of the rest; channel, sequence, times of log and publication.
_MESSAGE, _MESSAGE_RECORD, _IN_RECORD = struct.Struct("<BQHIQQ"), 0x05, 2 + 4 + 8 + 8
_CHUNK_BYTES = 2**20


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

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a channel with its QoS and type hash, as rosbag2 of Jazzy writes it."""
        metadata = BytesIO()
        write_string(metadata, "offered_qos_profiles")
        write_string(metadata, offered_qos_profiles)
        write_string(metadata, "topic_type_hash")
        write_string(metadata, connection.digest)
        channel = Channel(
            connection.id, connection.msgtype, connection.topic, "cdr", metadata.getvalue()
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
