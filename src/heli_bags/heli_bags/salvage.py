# SPDX-License-Identifier: Apache-2.0
"""Every complete message of a storage file that was cut off or never closed. The file stays as is.

MCAP (specification: https://mcap.dev/spec): records are read one after the other until one is not
whole; of a chunk that is cut off the whole messages are taken, also out of a zstd stream. SQLite: a
copy with its write-ahead log or rollback journal is opened; rows are read from both ends of the
table towards a damaged page.
"""

import contextlib
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, zstd
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from heli_bags.folder import BagError, Channel, reason

MAGIC = b"\x89MCAP0\r\n"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_HEAD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")
_MESSAGE = struct.Struct("<HIQQ")
_SCHEMA, _CHANNEL, _RECORD_MESSAGE, _RECORD_CHUNK, _FOOTER = 0x03, 0x04, 0x05, 0x06, 0x02

_ROWS = "SELECT id, topic_id, timestamp, data FROM messages"

Message = tuple[Channel, int, bytes]


@dataclass
class State:
    """What was found of a file, complete once its messages have been read to the end.

    Attributes
    ----------
    whole : bool
        The file was closed in good order.
    lost_bytes : int
        Bytes at the end, or on damaged pages, that no message could be read from.
    damaged_chunks : int
        Chunks whose checksum or compression is wrong.
    zstd : bool
        The chunks are compressed.
    """

    whole: bool = False
    lost_bytes: int = 0
    damaged_chunks: int = 0
    zstd: bool = False
    notes: list[str] = field(default_factory=list)


def type_hash(type_name: str, definition: str) -> str:
    """Hash of a type (`RIHS01_...`) out of its definition; empty if that cannot be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, type_name))
        return store.hash_rihs01(type_name)
    except Exception:
        # Definitions of foreign recorders may be anything; a bag without hashes still opens.
        return ""


def _texts(data: bytes, start: int, count: int) -> tuple[list[bytes], int]:
    """Length-prefixed texts from an offset on; raises struct.error where they are cut."""
    found = []
    for _ in range(count):
        (size,) = struct.unpack_from("<I", data, start)
        found.append(data[start + 4 : start + 4 + size])
        start += 4 + size
    return found, start


class _Mcap:
    """Reads one MCAP file record by record."""

    def __init__(self, path: Path, state: State) -> None:
        self.path, self.state = path, state
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, Channel] = {}

    def _schema(self, data: bytes) -> None:
        (number,) = struct.unpack_from("<H", data)
        (name, encoding, text), _ = _texts(data, 2, 3)
        self._schemas[number] = (name.decode(), encoding.decode(), text.decode())

    def _channel(self, data: bytes) -> None:
        number, schema = struct.unpack_from("<HH", data)
        if number in self._channels:
            return
        (topic, _), at = _texts(data, 4, 2)
        (size,) = struct.unpack_from("<I", data, at)
        metadata, at, end = {}, at + 4, at + 4 + size
        while at < end:
            (key, value), at = _texts(data, at, 2)
            metadata[key.decode()] = value.decode()
        name, encoding, text = self._schemas.get(schema, ("", "", ""))
        qos = parse_qos(metadata.get("offered_qos_profiles", ""))
        known = metadata.get("topic_type_hash", "") or type_hash(name, text)
        self._channels[number] = Channel(
            topic.decode(), name, text, known, tuple(qos), encoding == "ros2idl"
        )

    def _take(self, op: int, data: bytes) -> Message | None:
        """One record that is no chunk."""
        if op == _SCHEMA:
            self._schema(data)
        elif op == _CHANNEL:
            self._channel(data)
        elif op == _RECORD_MESSAGE:
            number, _, stamp_ns, _ = _MESSAGE.unpack_from(data)
            if number in self._channels:
                return self._channels[number], stamp_ns, data[_MESSAGE.size :]
        return None

    def _records(self, data: bytes) -> Iterator[Message]:
        """Messages of a chunk's content, also of one that is cut off."""
        at = 0
        while at + _HEAD.size <= len(data):
            op, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if at + size > len(data):
                return
            message = self._take(op, data[at : at + size])
            if message is not None:
                yield message
            at += size

    def _chunk(self, data: bytes, cut: bool) -> Iterator[Message]:
        _, _, size, crc = _CHUNK.unpack_from(data)
        (name,), at = _texts(data, _CHUNK.size, 1)
        compression, content = name.decode(), data[at + 8 :]
        self.state.zstd |= compression == "zstd"
        if cut and compression == "zstd":
            content = zstd.ZstdDecompressor().decompress(content)
        elif cut and compression:
            return
        elif not cut:
            content = DECOMPRESSORS[compression](content, size)
            if crc and crc32(content) != crc:
                raise ValueError("checksum")
        yield from self._records(content)

    def _whole_or_not(self, data: bytes, cut: bool) -> Iterator[Message]:
        try:
            yield from self._chunk(data, cut)
        except (KeyError, ValueError, RuntimeError, EOFError, struct.error, zstd.ZstdError):
            if not cut:
                self.state.damaged_chunks += 1

    def messages(self) -> Iterator[Message]:
        with open(self.path, "rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise BagError(f"{self.path}: not an MCAP file")
            yield from self._from(stream, self.path.stat().st_size)

    def _from(self, stream: BinaryIO, end: int) -> Iterator[Message]:
        at = stream.tell()
        while True:
            head = stream.read(_HEAD.size)
            op, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            cut = at + _HEAD.size + size > end
            if op == 0 or (cut and op != _RECORD_CHUNK):
                break
            if op == _FOOTER:
                stream.seek(size, 1)
                self.state.whole = stream.read() == MAGIC
                return
            if op in (_SCHEMA, _CHANNEL, _RECORD_MESSAGE):
                with contextlib.suppress(struct.error, ValueError, KeyError):
                    message = self._take(op, stream.read(size))
                    if message is not None:
                        yield message
            elif op == _RECORD_CHUNK:
                yield from self._whole_or_not(stream.read(min(size, end)), cut)
                if cut:
                    break
            at += _HEAD.size + size
            stream.seek(at)
        self.state.lost_bytes = end - at


class _Sqlite:
    """Reads a copy of one SQLite file."""

    def __init__(self, path: Path, state: State) -> None:
        self.path, self.state = path, state

    def messages(self) -> Iterator[Message]:
        with tempfile.TemporaryDirectory(prefix="heli_repair_") as folder:
            copy = Path(folder) / self.path.name
            for tail in ("", "-wal", "-journal"):
                source = self.path.with_name(self.path.name + tail)
                if source.is_file():
                    shutil.copyfile(source, copy.with_name(copy.name + tail))
                    self.state.whole = not tail or (self.state.whole and not source.stat().st_size)
            self._fit(copy)
            with contextlib.closing(sqlite3.connect(copy)) as database:
                yield from self._read(database)

    def _fit(self, copy: Path) -> None:
        """Tell a cut-off copy its real number of pages; SQLite refuses it whole otherwise.

        File format: https://www.sqlite.org/fileformat2.html, page size at 16, pages at 28.
        """
        log = copy.with_name(f"{copy.name}-wal")
        with open(copy, "r+b") as stream:
            head = stream.read(100)
            if len(head) < 100 or (log.is_file() and log.stat().st_size):
                return
            (page,) = struct.unpack_from(">H", head, 16)
            (claimed,) = struct.unpack_from(">I", head, 28)
            page = 65536 if page == 1 else page
            end = copy.stat().st_size
            if not page or end >= claimed * page:
                return
            self.state.whole = False
            self.state.lost_bytes = end % page
            self.state.notes.append(f"{self.path.name}: {claimed - end // page} pages are missing")
            stream.truncate(end // page * page)
            stream.seek(28)
            stream.write(struct.pack(">I", end // page))

    def _read(self, database: sqlite3.Connection) -> Iterator[Message]:
        try:
            channels = self._channels(database)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self.state.whole = False
            self.state.notes.append(f"{self.path.name}: {reason(error)}")
            return
        newest = -1
        for way in ("ASC", "DESC"):
            query = f"{_ROWS} WHERE id > ? ORDER BY id {way}"
            try:
                for number, topic, stamp_ns, raw in database.execute(query, (newest,)):
                    newest = number if way == "ASC" else newest
                    if topic in channels and raw is not None:
                        yield channels[topic], stamp_ns, raw
                return
            except sqlite3.DatabaseError as error:
                self.state.whole = False
                if way == "ASC":
                    self.state.notes.append(f"{self.path.name}: {reason(error)}")

    def _channels(self, database: sqlite3.Connection) -> dict[int, Channel]:
        def table(name: str) -> list[dict[str, Any]]:
            cursor = database.execute(f"SELECT * FROM {name}")
            names = [column[0] for column in cursor.description]
            return [dict(zip(names, row, strict=True)) for row in cursor]

        definitions: dict[str, dict[str, Any]] = {}
        with contextlib.suppress(sqlite3.OperationalError):
            definitions = {row["topic_type"]: row for row in table("message_definitions")}
        if not database.execute("SELECT count(*) FROM metadata").fetchone()[0]:
            self.state.whole = False
        found = {}
        for row in table("topics"):
            known = definitions.get(row["type"], {})
            text = known.get("encoded_message_definition", "")
            found[row["id"]] = Channel(
                row["name"],
                row["type"],
                text,
                row.get("type_description_hash") or type_hash(row["type"], text),
                tuple(parse_qos(row.get("offered_qos_profiles", ""))),
                known.get("encoding") == "ros2idl",
            )
        return found


def salvage(path: Path, state: State) -> Iterator[Message]:
    """Messages of a storage file in the order in which they were written.

    Parameters
    ----------
    path : Path
        An .mcap or .db3 file; it is only read.
    state : State
        Filled while the messages are read.

    Yields
    ------
    Channel, int, bytes
        Topic, stamp (ns), serialised message.

    Raises
    ------
    BagError
        The file is neither, or cannot be read at all.
    """
    readers: dict[str, type[_Mcap | _Sqlite]] = {".mcap": _Mcap, ".db3": _Sqlite}
    reader = readers.get(path.suffix)
    if reader is None:
        raise BagError(f"{path}: neither an .mcap nor a .db3 file")
    try:
        for channel, stamp_ns, raw in reader(path, state).messages():
            # rosbag2 may have compressed every message by itself; CDR never begins like that.
            plain = zstd.decompress(raw) if raw[:4] == _ZSTD_MAGIC else raw
            yield channel, stamp_ns, plain
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {reason(error)}") from error
