# SPDX-License-Identifier: Apache-2.0
"""A bag's files as one: its topics, the messages in the order of their times or of writing.

The readers of `rosbags` make what a bag's bytes ask for. They have no setting for how much that may
be, so ours stand in front: a stream that gives no record above the budget, decompression that stops
at it, a database without views. What is refused is a FileError (`heli_core.foreign_files`).
"""

import contextlib
import heapq
import os
import re
import sqlite3
import struct
from array import array
from collections import Counter
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import apsw
import numpy as np
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2 import storage_mcap
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, read_exact, read_sized
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from zstandard import FRAME_HEADER

from heli_bags.storage import (
    EXPANDERS,
    MOST_DEFINITIONS,
    MOST_TOPICS,
    chunk_content,
    expanded,
    storage_of,
    unpacked,
)
from heli_bags.writer import METADATA
from heli_core.foreign_files import (
    FileCause,
    FileError,
    budget_bytes,
    load_yaml,
    open_regular,
    read_yaml,
    too_large,
    within_budget,
)

_MOST_QOS_KEYS = 2000
_OVERLAP_SHARE = 2
_HEAD = struct.Struct("<BQ")

# -------------------------------------------------------------------------------------------------
# Files, each with the budget in front. What a topic is, how many messages it has and when they were
# is asked of the files; metadata.yaml, which recorders fill differently, adds what they do not say.
# A topic that cannot be understood is a topic of the bag all the same: it hides no other one.
# -------------------------------------------------------------------------------------------------


def bounded_qos(profiles: Any) -> list[Qos]:
    """QoS profiles of a bag, of which a text is YAML; none where they cannot be understood.

    Raises
    ------
    FileError
        They are above the budget.
    """
    if isinstance(profiles, str) and profiles:
        return list(_qos_of_text(profiles))
    return _understood(profiles)


@lru_cache(maxsize=256)
def _qos_of_text(text: str) -> tuple[Qos, ...]:
    """A bag's topics have few different ones."""
    if text.count(":") > _MOST_QOS_KEYS:
        raise FileError(FileCause.TOO_MANY, "a topic has too many QoS profiles")
    try:
        return tuple(_understood(load_yaml(text, "offered_qos_profiles")))
    except FileError as error:
        if error.cause != FileCause.SYNTAX:
            raise
        return ()


def _understood(profiles: Any) -> list[Qos]:
    try:
        return parse_qos(profiles)
    except (LookupError, TypeError, AttributeError, ValueError):
        return []


# Encodings of definitions, as rosbag2 and MCAP's registry of schemas have them.
_KINDS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
_NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, "")


def _definition(encoding: object, text: object) -> MessageDefinition:
    """A definition; none where it is of another kind or empty."""
    kind = _KINDS.get(str(encoding))
    return MessageDefinition(kind, str(text)) if kind and text else _NO_DEFINITION


# These have no parameter for it; `test_the_library_s_readers_ask_the_budget` tells if they change.
storage_mcap.DECOMPRESSORS.update(
    {
        name: lambda data, size, name=name: chunk_content(data, name, size)  # type: ignore[misc]
        for name in EXPANDERS
    }
)
vars(storage_mcap)["parse_qos"] = bounded_qos
# Theirs raise at a schema of another kind, or one that is no text.
vars(storage_mcap)["get_msgdef"] = lambda schema: (
    _NO_DEFINITION if schema is None else _definition(schema.encoding, schema.data)
)
vars(storage_mcap)["read_string"] = lambda stream: storage_mcap.read_bytes(stream).decode(
    errors="replace"
)


class _Stream:
    """A file of which no record above the budget is read."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.close = file.seek, file.tell, file.close

    def read(self, size: int = -1) -> bytes:
        """As of a file; of one byte, an opcode, that is 0 there is none."""
        within_budget(size, "a record")
        data = self._file.read(size)
        if size == 1 and data == b"\0":
            raise FileError(FileCause.SYNTAX, "a record has no opcode")
        return data


Place = tuple[int, ...]
"""Where a message was written: the piece of its file (chunk or row), and where in that."""
Bounds = Mapping[int, tuple[Place, Place]]
"""By channel: the place from which on, and the one before which, its messages are meant."""


class Written(NamedTuple):
    """Messages of a piece of a file in the order of writing."""

    piece: int
    inside: NDArray[np.int64]
    channel: NDArray[np.int64]
    log_ns: NDArray[np.int64]


def _within(bounds: Bounds | None, channel: int, place: Place) -> bool:
    if bounds is None or channel not in bounds:
        return True
    first, beyond = bounds[channel]
    return first <= place < beyond


_FOOTER = struct.Struct("<BQQQI")
_TIMES = struct.Struct("<QQQI")
_MESSAGE = struct.Struct("<HIQQ")
_INDEX = np.dtype([("log_ns", "<i8"), ("inside", "<i8")])
_INDEX_HEAD = struct.Struct("<HI")
_Row = tuple[int, int, int, int, bytes]


class _Mcap(McapReader):
    """One MCAP file, of any profile: what a topic's messages are is said by its channel."""

    def open(self) -> None:
        open_regular(cast(Path, self.path)).close()
        super().open()

    def _open(self) -> None:
        self._loose: tuple[array[int], array[int], array[int]] = (
            array("q"),
            array("q"),
            array("q"),
        )
        self.bio = bio = cast(BinaryIO, _Stream(cast(BinaryIO, self.bio)))
        if bio.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC or bio.read(1) != bytes([Opcode.HEADER]):
            raise FileError(FileCause.SYNTAX, "it is no MCAP file")
        read_sized(bio)
        self.data_start = bio.tell()
        end = bio.seek(-_FOOTER.size - len(MCAP0_MAGIC), os.SEEK_END)
        opcode, _, summary, _, _ = _FOOTER.unpack(read_exact(bio, _FOOTER.size))
        whole = opcode == Opcode.FOOTER and bio.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC
        if not whole or (summary and not self.data_start <= summary <= end):
            raise FileError(FileCause.SYNTAX, "its end is damaged")
        self.data_end = summary or end
        if summary:
            self.read_index()
        if not self._is_listed():
            for known in (self.schemas, self.channels, self.connections):
                known.clear()
            self.meta_scan()
        if not self.chunks:
            self._find()
        counts = self._measure()
        self.connections = [c._replace(msgcount=counts.get(c.id, 0)) for c in self.connections]
        _check_topics(self.connections)
        _check_overlap(self.chunks)

    def _is_listed(self) -> bool:
        """Whether the file's end names all its topics and counts."""
        stats = self.statistics
        return (
            stats is not None
            and len(self.channels) >= stats.channel_count
            and len(self.schemas) >= stats.schema_count
        )

    def _measure(self) -> dict[int, int]:
        stats = self.statistics
        assert stats is not None
        count = stats.message_count
        self.metadata = self.metadata._replace(
            start_time=stats.start_time if count else storage_mcap.MAXSIZE,
            end_time=stats.end_time + 1 if count else 0,
            message_count=count,
        )
        return stats.channel_message_counts

    def _find(self) -> None:
        """Chunks, and messages outside of chunks, of a file whose end does not list them."""
        bio, at = cast(BinaryIO, self.bio), self.data_start
        while at + _HEAD.size <= self.data_end:
            bio.seek(at)
            opcode, size = _HEAD.unpack(read_exact(bio, _HEAD.size))
            if opcode == Opcode.CHUNK:
                start, end, full, _ = _TIMES.unpack(read_exact(bio, _TIMES.size))
                kind = storage_mcap.read_string(bio)
                (packed,) = struct.unpack("<Q", read_exact(bio, 8))
                self.chunks.append(
                    ChunkInfo(start, end, at, _HEAD.size + size, {}, 0, kind, packed, full, {})
                )
            elif opcode == Opcode.MESSAGE and size >= _MESSAGE.size:
                channel, _, log_ns, _ = _MESSAGE.unpack(read_exact(bio, _MESSAGE.size))
                for column, value in zip(self._loose, (at, channel, log_ns), strict=True):
                    column.append(min(value, storage_mcap.MAXSIZE))
            at += _HEAD.size + size

    def _content(self, chunk: ChunkInfo) -> bytes:
        bio, at = cast(BinaryIO, self.bio), chunk.chunk_start_offset + _HEAD.size
        bio.seek(at)
        _, _, _, crc = _TIMES.unpack(read_exact(bio, _TIMES.size))
        bio.seek(at + _TIMES.size + 4 + len(chunk.compression.encode()) + 8)
        data = read_exact(bio, chunk.compressed_size)
        return chunk_content(data, chunk.compression, chunk.uncompressed_size, crc)

    @staticmethod
    def _records(content: bytes) -> Iterator[tuple[int, int, int, int]]:
        """Place, channel, time and end of each message of a chunk."""
        at, end = 0, len(content)
        while at < end:
            if at + _HEAD.size > end:
                raise FileError(FileCause.SYNTAX, "a record of a chunk is cut off")
            opcode, size = _HEAD.unpack_from(content, at)
            beyond = at + _HEAD.size + size
            if not opcode or beyond > end or (opcode == Opcode.MESSAGE and size < _MESSAGE.size):
                raise FileError(FileCause.SYNTAX, "a record of a chunk is damaged")
            if opcode == Opcode.MESSAGE:
                channel, _, log_ns, _ = _MESSAGE.unpack_from(content, at + _HEAD.size)
                yield at, channel, log_ns, beyond
            at = beyond

    def _indexed(self, chunk: ChunkInfo) -> list[tuple[int, NDArray[np.void]]]:
        """What the indexes behind a chunk say: channel, times and places; empty if there is none"""
        size, found, at = chunk.message_index_length, [], 0
        if not size:
            return []
        bio = cast(BinaryIO, self.bio)
        bio.seek(chunk.chunk_start_offset + chunk.chunk_length)
        data = read_exact(bio, size)
        while at + _HEAD.size + _INDEX_HEAD.size <= size:
            opcode, length = _HEAD.unpack_from(data, at)
            channel, many = _INDEX_HEAD.unpack_from(data, at + _HEAD.size)
            begin = at + _HEAD.size + _INDEX_HEAD.size
            at += _HEAD.size + length
            if opcode != Opcode.MESSAGE_INDEX or begin + many > at or many % _INDEX.itemsize:
                return []
            found.append((channel, np.frombuffer(data, _INDEX, many // _INDEX.itemsize, begin)))
        return found

    def written(self, channels: Collection[int]) -> Iterator[Written]:
        """The messages of some channels in the order in which they were written."""
        if len(self._loose[0]):
            places, of, times = (np.array(column, dtype=np.int64) for column in self._loose)
            mine = np.isin(of, list(channels))
            yield Written(0, places[mine], of[mine], times[mine])
        for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset):
            index = self._indexed(chunk)
            if not index:
                rows = [
                    (at, channel, log_ns)
                    for at, channel, log_ns, _ in self._records(self._content(chunk))
                    if channel in channels
                ]
                places, of, times = np.array(rows, dtype=np.int64).reshape(-1, 3).T
            else:
                kept = [(channel, rows) for channel, rows in index if channel in channels]
                if not kept:
                    continue
                of = np.repeat([channel for channel, _ in kept], [len(rows) for _, rows in kept])
                places = np.concatenate([rows["inside"] for _, rows in kept])
                times = np.concatenate([rows["log_ns"] for _, rows in kept])
                order = np.argsort(places, kind="stable")
                places, of, times = places[order], of[order], times[order]
            yield Written(chunk.chunk_start_offset, places, of, times)

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
        bounds: Bounds | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Messages of a file in the order of their times, of one time in that of writing."""
        wanted = {c.id: c for c in connections}
        first = 0 if start is None else start
        beyond = storage_mcap.MAXSIZE if stop is None else stop
        sources: list[Iterable[_Row]] = [
            self._of_chunk(chunk, wanted, first, beyond, bounds)
            for chunk in self.chunks
            if first <= chunk.message_end_time
            and chunk.message_start_time < beyond
            and (not chunk.channel_count or any(map(chunk.channel_count.get, wanted)))
        ]
        if len(self._loose[0]):
            sources.append(self._of_loose(wanted, first, beyond, bounds))
        for log_ns, _, _, channel, data in heapq.merge(*sources):
            if channel >= 0:
                yield wanted[channel], log_ns, data

    def _of_chunk(
        self, chunk: ChunkInfo, wanted: Collection[int], start: int, stop: int,
        bounds: Bounds | None,
    ) -> Iterator[_Row]:  # fmt: skip
        piece = chunk.chunk_start_offset
        # Only now is it its turn to be read.
        yield chunk.message_start_time, piece, -1, -1, b""
        content = self._content(chunk)
        rows = [
            (log_ns, piece, at, channel, content[at + _HEAD.size + _MESSAGE.size : end])
            for at, channel, log_ns, end in self._records(content)
            if channel in wanted
            and start <= log_ns < stop
            and _within(bounds, channel, (piece, at))
        ]
        yield from sorted(rows, key=itemgetter(0))

    def _of_loose(
        self, wanted: Collection[int], start: int, stop: int, bounds: Bounds | None
    ) -> Iterator[_Row]:
        places, of, times = (np.array(column, dtype=np.int64) for column in self._loose)
        mine = np.isin(of, list(wanted)) & (times >= start) & (times < stop)
        places, of, times = places[mine], of[mine], times[mine]
        bio = cast(BinaryIO, self.bio)
        for number in np.argsort(times, kind="stable").tolist():
            at, channel, log_ns = int(places[number]), int(of[number]), int(times[number])
            if _within(bounds, channel, (0, at)):
                bio.seek(at)
                _, size = _HEAD.unpack(read_exact(bio, _HEAD.size))
                yield log_ns, 0, at, channel, read_exact(bio, size)[_MESSAGE.size :]


def _check_topics(connections: Collection[Connection]) -> None:
    if len(connections) > MOST_TOPICS:
        problem = f"it has {len(connections)} topics; allowed: {MOST_TOPICS}"
        raise FileError(FileCause.TOO_MANY, problem)
    texts = {connection.msgdef.data for connection in connections}
    if sum(map(len, texts)) > MOST_DEFINITIONS:
        raise FileError(FileCause.TOO_MANY, "its types have too long definitions")


def _check_overlap(chunks: Collection[ChunkInfo]) -> None:
    """Raise FileError where chunks of the same time, which are held at once, are too large."""
    steps = [(chunk.message_start_time, chunk.uncompressed_size) for chunk in chunks]
    steps += [(chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in chunks]
    held, count, most = 0, 0, budget_bytes() // _OVERLAP_SHARE
    for _, size in sorted(steps):
        held, count = held + size, count + (1 if size > 0 else -1)
        if count > 1 and held > most:
            what = f"{count} chunks of the same time, {held / 2**20:.0f} MB together,"
            raise too_large(what, most=most)


_STRANGE = (
    # Views and virtual tables have no page of their own.
    "SELECT count(*) FROM sqlite_master WHERE type NOT IN ('table', 'index', 'trigger')"
    " OR (type = 'table' AND NOT rootpage)",
    "SELECT count(*) FROM sqlite_master AS m, pragma_table_xinfo(m.name)"
    " WHERE m.type = 'table' AND hidden",
    f"SELECT count(*) > {MOST_TOPICS} OR count(*) > count(DISTINCT id) FROM topics",
)


def check_database(database: apsw.Connection | sqlite3.Connection) -> None:
    """Raise FileError for a database that computes what it says it holds.

    Views, virtual tables and computed columns make any number of rows of any size.
    """
    for query in _STRANGE:
        with contextlib.suppress(sqlite3.DatabaseError, apsw.Error):
            row = cast("tuple[int]", database.execute(query).fetchone())
            if row[0]:
                problem = "it holds views, computed columns or a topic twice: no bag of rosbag2"
                raise FileError(FileCause.SYNTAX, problem)


def _limited(database: apsw.Connection) -> None:
    database.limit(apsw.SQLITE_LIMIT_LENGTH, min(budget_bytes(), 10**9))
    database.config(apsw.SQLITE_DBCONFIG_ENABLE_VIEW, 0)
    database.config(apsw.SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0)


class _Sqlite(Sqlite3Reader):
    """One SQLite file, of any version of its tables: the columns that are there are read."""

    def open(self) -> None:
        open_regular(cast(Path, self.path)).close()
        apsw.connection_hooks.append(_limited)
        try:
            super().open()
        finally:
            apsw.connection_hooks.remove(_limited)

    def _rows(self, table: str) -> list[dict[str, Any]]:
        """A table's rows; of one that is not there none."""
        database = cast(apsw.Connection, self.dbconn)
        names = [str(row[1]) for row in database.execute(f"PRAGMA table_info({table})")]
        if not names:
            return []
        return [
            dict(zip(names, row, strict=True)) for row in database.execute(f"SELECT * FROM {table}")
        ]

    def _open(self) -> None:
        database = cast(apsw.Connection, self.dbconn)
        check_database(database)
        tables = {row[0] for row in database.execute("SELECT name FROM sqlite_master")}
        if not {"topics", "messages"} <= tables:
            raise FileError(FileCause.SYNTAX, "it holds no tables of rosbag2")
        definitions = {row.get("topic_type"): row for row in self._rows("message_definitions")}
        grouped = database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id")
        counts = {row[0]: cast(int, row[1]) for row in grouped}
        self.connections = [
            Connection(
                row["id"],
                _text(row.get("name")),
                _text(row.get("type")),
                _definition(
                    definitions.get(row.get("type"), {}).get("encoding"),
                    definitions.get(row.get("type"), {}).get("encoded_message_definition"),
                ),
                _text(row.get("type_description_hash")),
                counts.get(row["id"], 0),
                ConnectionExtRosbag2(
                    _text(row.get("serialization_format")),
                    bounded_qos(row.get("offered_qos_profiles")),
                ),
                self,
            )
            for row in self._rows("topics")
        ]
        _check_topics(self.connections)
        start, end = database.execute(
            f"SELECT min(timestamp), max(timestamp) FROM messages WHERE {_A_TIME}"
        ).fetchall()[0]
        self.metadata = self.metadata._replace(
            start_time=storage_mcap.MAXSIZE if start is None else cast(int, start),
            end_time=0 if end is None else cast(int, end) + 1,
            message_count=sum(counts.values()),
        )

    def written(self, channels: Collection[int]) -> Iterator[Written]:
        """The messages of some topics in the order in which they were written."""
        cursor = cast(apsw.Connection, self.dbconn).execute(
            f"SELECT id, topic_id, timestamp FROM messages WHERE {_A_TIME} AND topic_id IN "
            f"({','.join('?' * len(channels))}) ORDER BY id",
            list(channels),
        )
        rows = np.fromiter((x for row in cursor for x in cast("tuple[int]", row)), dtype=np.int64)
        ids, of, times = rows.reshape(-1, 3).T
        yield Written(0, ids, of, times)

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
        bounds: Bounds | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Messages of a file in the order of their times, of one time in that of writing."""
        wanted = {c.id: c for c in connections}
        first = 0 if start is None else start
        beyond = storage_mcap.MAXSIZE if stop is None else stop
        cursor = cast(apsw.Connection, self.dbconn).execute(
            f"SELECT id, topic_id, timestamp, data FROM messages WHERE {_A_TIME} AND topic_id IN "
            f"({','.join('?' * len(wanted))}) AND timestamp >= ? AND timestamp < ?"
            " ORDER BY timestamp, id",
            [*wanted, first, beyond],
        )
        for row in cursor:
            number, topic, log_ns, raw = cast("tuple[int, int, int, bytes]", row)
            if isinstance(raw, bytes) and _within(bounds, topic, (0, number)):
                yield wanted[topic], log_ns, raw


_A_TIME = "typeof(timestamp) = 'integer' AND timestamp >= 0"


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""


# -------------------------------------------------------------------------------------------------
# A bag: its files as one.
# -------------------------------------------------------------------------------------------------


def information(bag: Path) -> dict[str, Any]:
    """What metadata.yaml of a folder says below its first key, of any version; raises FileError."""
    content = read_yaml(bag / METADATA)
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    if not isinstance(about, dict):
        raise FileError(FileCause.SYNTAX, f"{METADATA} says nothing of a bag", bag)
    return about


def in_order(path: str | Path) -> tuple[int, str]:
    """For files of a split bag: by their number."""
    number = re.search(r"_(\d+)$", Path(path).name.partition(".")[0])
    return (int(number.group(1)) if number else -1, Path(path).name)


class _Listed(NamedTuple):
    """A topic as metadata.yaml has it."""

    type: str
    messages: int
    hash: str
    format: str
    qos: list[Qos]


def _listed(about: Mapping[str, Any]) -> dict[str, _Listed]:
    """Topics of metadata.yaml by name; what is no topic there is passed over."""
    found = {}
    rows = about.get("topics_with_message_count")
    for row in rows if isinstance(rows, list) else []:
        topic = row.get("topic_metadata") if isinstance(row, dict) else None
        if isinstance(topic, dict) and isinstance(topic.get("name"), str):
            count = row.get("message_count")
            found[topic["name"]] = _Listed(
                _text(topic.get("type")),
                count if isinstance(count, int) else 0,
                _text(topic.get("type_description_hash")),
                _text(topic.get("serialization_format")),
                bounded_qos(topic.get("offered_qos_profiles")),
            )
    return found


def listed_counts(bag: Path) -> dict[str, int]:
    """Messages of each topic as metadata.yaml of a folder counts them; {} where it cannot say."""
    try:
        return {name: row.messages for name, row in _listed(information(bag)).items()}
    except FileError:
        return {}


class BagFiles:
    """The files of a bag as one; what asks for more than the budget is a FileError.

    Attributes
    ----------
    connections : list of Connection
        Topics, each of a type once.
    message_count : int
        Messages that the files say they hold.
    start_time, end_time : int
        Stamps of the bag, ns, of the first message and behind the last.
    missing : dict
        Topic to how many messages metadata.yaml counts more than the files hold.
    nameless : int
        Messages of no topic of the bag.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.connections: list[Connection] = []
        self.message_count, self.start_time, self.end_time = 0, storage_mcap.MAXSIZE, 0
        self.missing: dict[str, int] = {}
        self.nameless = 0
        self._files: list[_Mcap | _Sqlite] = []
        self._global: list[dict[int, int]] = []
        self._stack = contextlib.ExitStack()

    def open(self) -> None:
        """Open all files; on an error all that were opened are closed."""
        try:
            about = information(self.path) if self.path.is_dir() else {}
            names = about.get("relative_file_paths", [])
            listed = [self.path / Path(str(name)).name for name in names] if about else [self.path]
            for path in sorted(dict.fromkeys(listed), key=in_order):
                file = _Mcap(path) if storage_of(path) == ".mcap" else _Sqlite(path)
                file.open()
                self._stack.callback(file.close)
                self._files.append(file)
            self._join(_listed(about))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close all files."""
        self._stack.close()

    def _join(self, listed: Mapping[str, _Listed]) -> None:
        """Topics of the files as one list, with what metadata.yaml adds."""
        numbers: dict[tuple[str, str, str, str], int] = {}
        for file in self._files:
            own = {}
            for c in file.connections:
                other = listed.get(c.topic) or _Listed("", 0, "", "", [])
                ext = cast(ConnectionExtRosbag2, c.ext)
                kind = ext.serialization_format or other.format or "cdr"
                is_same = other.type in ("", c.msgtype) or c.msgtype in ("", _SCHEMALESS)
                type_name = c.msgtype.replace(_SCHEMALESS, "") or other.type
                key = (c.topic, type_name, c.msgdef.data, kind)
                if key not in numbers:
                    numbers[key] = len(self.connections)
                    qos = ext.offered_qos_profiles or other.qos
                    digest = c.digest or (other.hash if is_same else "")
                    self.connections.append(
                        c._replace(
                            id=numbers[key] + 1, msgtype=type_name, digest=digest, msgcount=0,
                            ext=ConnectionExtRosbag2(kind, qos), owner=self,
                        )
                    )  # fmt: skip
                number = own[c.id] = numbers[key]
                total = self.connections[number].msgcount + c.msgcount
                self.connections[number] = self.connections[number]._replace(msgcount=total)
            self._global.append(own)
            self.message_count += file.metadata.message_count
            self.nameless += file.metadata.message_count - sum(c.msgcount for c in file.connections)
            self.start_time = min(self.start_time, file.metadata.start_time)
            self.end_time = max(self.end_time, file.metadata.end_time)
        held: Counter[str] = Counter()
        for c in self.connections:
            held[c.topic] += c.msgcount
        for name, row in listed.items():
            if name not in held:
                ext = ConnectionExtRosbag2(row.format or "cdr", row.qos)
                number = len(self.connections) + 1
                self.connections.append(
                    Connection(number, name, row.type, _NO_DEFINITION, row.hash, 0, ext, self)
                )
            if row.messages > held[name]:
                self.missing[name] = row.messages - held[name]

    def written(self, connections: Collection[Connection]) -> Iterator[tuple[Place, Written]]:
        """Messages of topics in the order of writing; the file's number goes before each piece."""
        wanted = {c.id - 1 for c in connections}
        for number, (file, own) in enumerate(zip(self._files, self._global, strict=True)):
            channels = [channel for channel, which in own.items() if which in wanted]
            for piece in file.written(channels) if channels else ():
                yield (number, piece.piece), piece

    def messages(
        self,
        connections: Collection[Connection] = (),
        start: int | None = None,
        stop: int | None = None,
        bounds: Bounds | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Messages, file by file, each in the order of its times; of all topics if none is named.

        Parameters
        ----------
        connections : collection of Connection
        start, stop : int, optional
            Stamps of the bag, ns: of the first, and behind the last.
        bounds : dict, optional
            By a connection's number: places (file, piece, inside) from which, and before which.
        """
        wanted = {c.id - 1: c for c in connections or self.connections}
        for number, (file, own) in enumerate(zip(self._files, self._global, strict=True)):
            mine = [c for c in file.connections if own[c.id] in wanted]
            own_bounds = None if bounds is None else _of_file(bounds, number, own)
            if mine:
                for c, log_ns, raw in file.messages(mine, start, stop, own_bounds):
                    # A message may be compressed by itself; CDR never begins like that.
                    packed = raw[: len(FRAME_HEADER)] == FRAME_HEADER
                    yield wanted[own[c.id]], log_ns, expanded(raw) if packed else raw


_SCHEMALESS = "__schemaless__"
"""Type of a channel without schema, as `rosbags` calls it."""
_BEYOND = (1 << 63, 0)


def _of_file(bounds: Bounds, number: int, own: Mapping[int, int]) -> Bounds:
    """Bounds for one of the files, by its own channels."""
    cut = {}
    for channel, which in own.items():
        if which + 1 in bounds:
            first, beyond = bounds[which + 1]
            low = (-1, 0) if first[0] < number else _BEYOND if first[0] > number else first[1:]
            high = (-1, 0) if beyond[0] < number else _BEYOND if beyond[0] > number else beyond[1:]
            cut[channel] = (low, high)
    return cut


@contextlib.contextmanager
def budgeted(path: Path) -> Iterator[BagFiles]:
    """The files of a bag, not yet open, whatever their compression; raises FileError."""
    with unpacked(path) as plain:
        yield BagFiles(plain)
