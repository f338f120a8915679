# SPDX-License-Identifier: Apache-2.0
"""Bags' files within the budget: what is decompressed, counted and joined before it is made.

The readers of `rosbags` make what a bag's bytes ask for. They have no setting for how much that may
be, so ours stand in front: a stream that gives no record above the budget, decompression that stops
at it, a database without views. What is refused is a FileError (`heli_core.foreign_files`).
"""

import contextlib
import os
import sqlite3
import struct
import tempfile
import zlib
from collections.abc import Collection, Generator, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, cast

import apsw
import lz4.frame
import yaml
import zstandard
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import Reader, metadata, reader, storage_mcap, storage_sqlite3
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from heli_bags.writer import METADATA, SUFFIXES
from heli_core.foreign_files import (
    FileCause,
    FileError,
    budget_bytes,
    compose_yaml,
    load_yaml,
    open_regular,
    read_yaml,
    too_large,
    within_budget,
)

PACKED = ".zstd"
"""Behind the name of a file that was compressed as a whole."""
MESSAGE_SHARE = 8
"""A message that is taken apart has this part of the budget: its fields are objects."""
_OVERLAP_SHARE = 2
# What a record of a chunk costs beside its bytes.
_RECORD_BYTES = 100
# What is kept of a message beside its numbers.
_ROW_BYTES = 256
_HEAD = struct.Struct("<BQ")
MOST_TOPICS, MOST_DEFINITIONS, _MOST_QOS_KEYS = 4096, 1 << 21, 2000
_PIECE = 1 << 20
# What a file may become on the disk: bags' own data become a tenth, zeros a thirty-thousandth.
_MOST_RATIO = 16


def storage_of(path: Path) -> str:
    """Suffix of a storage file, `.mcap` or `.db3`, also of a compressed one; empty for others."""
    suffix = Path(path.stem).suffix if path.suffix == PACKED else path.suffix
    return suffix if suffix in SUFFIXES.values() else ""


def most_expanded(size: int) -> int:
    """Bytes that compressed data of a size may become, on the disk or one after the other."""
    return max(budget_bytes(), _MOST_RATIO * size)


class Kept:
    """How much of a bag's messages is kept: a few bytes may expand to any number of messages.

    Parameters
    ----------
    bag : Path
        Folder or file.
    """

    def __init__(self, bag: Path) -> None:
        files = [bag] if bag.is_file() else [path for path in bag.iterdir() if storage_of(path)]
        self._left = most_expanded(sum(file.stat().st_size for file in files))

    def keep(self, size: int) -> None:
        """Count a message of a size, bytes; raises FileError above what a bag may become."""
        self._left -= size + _ROW_BYTES
        if self._left < 0:
            raise too_large("what is kept of its messages")


# -------------------------------------------------------------------------------------------------
# Decompression.
# -------------------------------------------------------------------------------------------------


def _zstd() -> zstandard.ZstdDecompressor:
    # A window is memory, too.
    return zstandard.ZstdDecompressor(max_window_size=max(1 << 10, budget_bytes()))


def _of_zstd(data: bytes, most: int) -> bytes:
    with _zstd().stream_reader(data, read_across_frames=True) as stream:
        return stream.read(most)


def _of_lz4(data: bytes, most: int) -> bytes:
    return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most)


_EXPANDERS = {"": lambda data, most: data, "zstd": _of_zstd, "lz4": _of_lz4}


def chunk_content(data: bytes, compression: str, size: int, crc: int = 0) -> bytes:
    """Uncompressed content of an MCAP chunk.

    Parameters
    ----------
    data : bytes
    compression : str
        Empty, "lz4" or "zstd".
    size : int
        Bytes that the chunk says it has.
    crc : int
        CRC-32 of the content; 0 for none.

    Raises
    ------
    FileError
        Above the budget, of another size or sum than it says, or of another compression; the
        libraries raise what they raise on damaged bytes.
    """
    within_budget(size, "a chunk")
    if compression not in _EXPANDERS:
        raise FileError(FileCause.SYNTAX, f"a chunk is compressed by {compression!r:.20}")
    content = _EXPANDERS[compression](data, size + 1)
    if len(content) != size:
        raise FileError(FileCause.SYNTAX, f"a chunk has not the {size} bytes that it says")
    if crc and zlib.crc32(content) != crc:
        raise FileError(FileCause.SYNTAX, "a chunk has another checksum than it says")
    _check_records(content)
    return content


def _check_records(content: bytes) -> None:
    """Raise FileError for a chunk whose records, an object each, are above the budget."""
    left = budget_bytes() - len(content)
    most = left // _RECORD_BYTES
    if len(content) // _HEAD.size <= most:
        return
    at = count = 0
    while at + _HEAD.size <= len(content):
        at += _HEAD.size + _HEAD.unpack_from(content, at)[1]
        count += 1
        if count > most:
            raise too_large(f"a chunk of {len(content) / 2**20:.0f} MB in {count} records or more")


def expanded(data: bytes, most: int | None = None) -> bytes:
    """What a zstd frame holds, as far as it goes; raises FileError above the budget.

    Parameters
    ----------
    data : bytes
    most : int, optional
        Bytes; default: what a message may have.
    """
    limit = budget_bytes() // MESSAGE_SHARE if most is None else most
    content = bytearray()
    with _zstd().stream_reader(data) as stream:
        try:
            while len(content) <= limit and (piece := stream.read(min(_PIECE, limit + 1))):
                content += piece
        except zstandard.ZstdError:
            if not content:
                raise
    if len(content) > limit:
        raise too_large("a compressed message", most=limit)
    return bytes(content)


def checked_message(raw: bytes) -> bytes:
    """The bytes of a message that is to be taken apart; raises FileError if they are too many."""
    within_budget(len(raw), "a message", share=MESSAGE_SHARE)
    return raw


def expand_file(path: Path, to: Path, cut: bool = False) -> bool:
    """Expand a file that was compressed as a whole; True if it is whole.

    Parameters
    ----------
    path, to : Path
    cut : bool
        Take what there is of a damaged one.

    Raises
    ------
    FileError
        It becomes too large, or is damaged and not to be cut.
    """
    with open_regular(path) as packed, open(to, "wb") as plain:
        most, done = most_expanded(os.fstat(packed.fileno()).st_size), 0
        try:
            with _zstd().stream_reader(packed, read_across_frames=True, closefd=False) as stream:
                while piece := stream.read(_PIECE):
                    done += len(piece)
                    if done > most:
                        raise too_large("what it expands to", path, most)
                    plain.write(piece)
        except zstandard.ZstdError as error:
            if not cut:
                raise FileError(FileCause.SYNTAX, f"no zstd file: {error}", path) from None
            return False
    return True


# -------------------------------------------------------------------------------------------------
# A bag whose files were compressed as wholes (`ros2 bag record --compression-mode file`).
# -------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def unpacked(bag: Path) -> Iterator[Path]:
    """The bag itself, or a copy of one whose files are compressed; the copy is gone afterwards.

    Raises
    ------
    FileError
        metadata.yaml cannot be read, or a file is damaged or becomes too large.
    """
    if bag.is_file() and bag.suffix == PACKED:
        with tempfile.TemporaryDirectory(prefix="heli_bag_") as folder:
            plain = Path(folder) / bag.stem
            expand_file(bag, plain)
            yield plain
        return
    content = read_yaml(bag / METADATA) if bag.is_dir() else {}
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    mode = about.get("compression_mode") if isinstance(about, dict) else None
    if not isinstance(about, dict) or str(mode).lower() != "file":
        yield bag
        return
    with tempfile.TemporaryDirectory(prefix="heli_bag_") as folder:
        _unpack(bag, Path(folder), about)
        yield Path(folder)


def _unpack(bag: Path, folder: Path, about: dict[str, Any]) -> None:
    if about.get("compression_format") != "zstd":
        problem = f"its files are compressed by {about.get('compression_format')!r:.20}"
        raise FileError(FileCause.SYNTAX, f"{problem}; allowed: zstd")
    listed = about.get("relative_file_paths")
    names = [Path(str(name)).name for name in listed] if isinstance(listed, list) else []
    if len(names) > MOST_TOPICS:
        raise FileError(FileCause.TOO_MANY, f"it lists {len(names)} files")
    for name in names:
        if name.endswith(PACKED):
            expand_file(bag / name, folder / Path(name).stem)
        else:
            os.symlink((bag / name).resolve(), folder / name)
    about = {**about, "compression_mode": "", "compression_format": ""}
    about["relative_file_paths"] = [name.removesuffix(PACKED) for name in names]
    text = yaml.safe_dump({"rosbag2_bagfile_information": about}, sort_keys=False)
    (folder / METADATA).write_text(text, encoding="utf-8")


# -------------------------------------------------------------------------------------------------
# The readers of `rosbags`, each with the budget in front.
# -------------------------------------------------------------------------------------------------


def bounded_qos(profiles: Any) -> list[Qos]:
    """QoS profiles of a bag, of which a text is YAML; raises FileError."""
    if isinstance(profiles, str) and profiles:
        return list(_qos_of_text(profiles))
    return _parse_qos(profiles)


@lru_cache(maxsize=256)
def _qos_of_text(text: str) -> tuple[Qos, ...]:
    """A bag's topics have few different ones."""
    compose_yaml(text, "offered_qos_profiles")
    if text.count(":") > _MOST_QOS_KEYS:
        raise FileError(FileCause.TOO_MANY, "a topic has too many QoS profiles")
    return tuple(_parse_qos(text))


class _Yaml:
    """In the place of ruamel's reader, which is written in Python: libyaml's, ten times as fast."""

    def __init__(self, typ: str) -> None:
        assert typ == "safe"

    def load(self, text: str) -> Any:
        return load_yaml(text, METADATA)


_parse_qos = metadata.parse_qos
# These have no parameter for it; `test_the_library_s_readers_ask_the_budget` tells if they change.
storage_mcap.DECOMPRESSORS.update(
    {
        name: lambda data, size, name=name: chunk_content(data, name, size)  # type: ignore[misc]
        for name in _EXPANDERS
    }
)
for _module in (storage_mcap, storage_sqlite3, reader):
    vars(_module)["parse_qos"] = bounded_qos
vars(reader)["YAML"] = _Yaml


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


class _Mcap(McapReader):
    """One MCAP file."""

    def open(self) -> None:
        open_regular(cast(Path, self.path)).close()
        super().open()

    def _open(self) -> None:
        self.bio = cast(BinaryIO, _Stream(cast(BinaryIO, self.bio)))
        super()._open()
        _check_topics(self.connections)
        _check_overlap(self.chunks)


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
    """One SQLite file."""

    def open(self) -> None:
        open_regular(cast(Path, self.path)).close()
        apsw.connection_hooks.append(_limited)
        try:
            super().open()
        finally:
            apsw.connection_hooks.remove(_limited)

    def _open(self) -> None:
        check_database(cast(apsw.Connection, self.dbconn))
        super()._open()
        _check_topics(self.connections)


class _Folder(reader.DirectoryReader):
    """A bag's folder with metadata.yaml; its messages may be compressed one by one."""

    STORAGE_PLUGINS = {"mcap": _Mcap, "sqlite3": _Sqlite}
    _by_message = False

    def open(self) -> None:
        read_yaml(cast(Path, self.path) / METADATA)
        super().open()
        _check_topics(self.connections)
        self._by_message = self.metadata.compression_mode == "message"
        # Then their bytes come as they are, and are expanded here.
        self.metadata = self.metadata._replace(compression_mode=None)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        for connection, stamp_ns, data in super().messages(connections, start, stop):
            yield connection, stamp_ns, expanded(data) if self._by_message else data


class BudgetReader(Reader):
    """A bag's folder or file; what asks for more than the budget is a FileError."""

    STORAGE_PLUGINS = {"dir": _Folder, ".mcap": _Mcap, ".db3": _Sqlite}


@contextlib.contextmanager
def budgeted(path: Path) -> Iterator[BudgetReader]:
    """The reader of a bag, not yet open, whatever its files' compression; raises FileError."""
    with unpacked(path) as plain:
        yield BudgetReader(plain)
