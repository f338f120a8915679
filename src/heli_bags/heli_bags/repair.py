# SPDX-License-Identifier: Apache-2.0
"""`heli bag repair`: a bag that was never closed, or cut off, into one that opens everywhere."""

import contextlib
import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import McapRecord
from mcap.writer import MCAP0_MAGIC
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from heli_bags.bag_files import bounded_qos, check_database, in_order, listed_counts
from heli_bags.opening import ABOVE, damage, listed_files, storage_files, trouble
from heli_bags.storage import (
    MOST_DEFINITIONS,
    MOST_TOPICS,
    PACKED,
    chunk_content,
    expand_file,
    expanded,
    storage_of,
)
from heli_bags.writer import BagCause, BagChannel, BagError, BagFolder, Format, reason
from heli_core.foreign_files import (
    FileCause,
    FileError,
    budget_bytes,
    open_regular,
    within_budget,
)

# -------------------------------------------------------------------------------------------------
# Every complete message of a storage file that was cut off or never closed. The file stays as is.
#
# MCAP (specification: https://mcap.dev/spec): records are read one after the other until one is
# not
# whole; of a chunk that is cut off the whole messages are taken, also out of a zstd stream.
# SQLite: a
# copy with its write-ahead log or rollback journal is opened; rows are read from both ends of the
# table towards a damaged page.
# -------------------------------------------------------------------------------------------------

# Every record begins with its opcode and length. Framed here, because the library's reader stops
# with an exception where a file is cut off, and we go on with what there is.
_HEAD = struct.Struct("<BQ")
_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
}
# On damaged bytes the libraries raise whatever the line at hand raises.
_DAMAGED = (Exception,)
# Of stamps: SQLite holds no larger number.
_MOST_NS = 2**63 - 1
_ROWS = "SELECT id, topic_id, timestamp, data FROM messages"

Message = tuple[BagChannel, int, bytes]


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
        Chunks, or compressed messages, whose checksum or compression is wrong.
    nameless : int
        Messages of no topic of the bag, or that are no bytes.
    zstd : bool
        The chunks are compressed.
    """

    whole: bool = False
    lost_bytes: int = 0
    damaged_chunks: int = 0
    nameless: int = 0
    zstd: bool = False
    notes: list[str] = field(default_factory=list)


@lru_cache(maxsize=MOST_TOPICS)
def type_hash(type_name: str, definition: str) -> str:
    """Hash of a type (`RIHS01_...`) out of its definition; empty if that cannot be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition, type_name))
        return store.hash_rihs01(type_name)
    except Exception:
        # Definitions of foreign recorders may be anything; a bag without hashes still opens.
        return ""


def _record(opcode: int, data: bytes) -> McapRecord | None:
    """The record with this content, if it is of a kind that messages are restored from."""
    stream = ReadDataStream(BytesIO(data))
    if opcode == Opcode.MESSAGE:
        return records.Message.read(stream, len(data))
    reader = _READERS.get(opcode)
    return None if reader is None else reader(stream)


def _content(chunk: records.Chunk, cut: bool) -> bytes:
    """Uncompressed content of a chunk, as much of it as there is if the chunk is cut off."""
    if not cut:
        size, crc = chunk.uncompressed_size, chunk.uncompressed_crc
        return chunk_content(chunk.data, chunk.compression, size, crc)
    if chunk.compression == "zstd":
        return expanded(chunk.data, budget_bytes())
    return b"" if chunk.compression else chunk.data


def _refuse_large(error: Exception) -> None:
    """Pass over what is damaged, but not what is above the budget: that is no damage."""
    if isinstance(error, FileError) and error.cause in ABOVE:
        raise error


class _McapRepair:
    """Reads one MCAP file record by record."""

    def __init__(self, path: Path, state: State) -> None:
        self.path, self.state = path, state
        self._schemas: dict[int, records.Schema] = {}
        self._channels: dict[int, BagChannel] = {}
        self._texts: set[str] = set()

    def _add(self, channel: records.Channel) -> None:
        if channel.id in self._channels:
            return
        schema = self._schemas.get(channel.schema_id)
        name, encoding, text = "", "", ""
        if schema is not None:
            # Of foreign recorders it may be no text: its bytes go through as they are.
            name, encoding = schema.name, schema.encoding
            text = schema.data.decode(errors="surrogateescape")
        self._texts.add(text)
        many = len(self._channels) >= MOST_TOPICS
        if many or sum(map(len, self._texts)) > MOST_DEFINITIONS:
            raise FileError(FileCause.TOO_MANY, "it has too many topics or too long definitions")
        self._channels[channel.id] = BagChannel(
            channel.topic,
            name,
            text,
            channel.metadata.get("topic_type_hash", "") or type_hash(name, text),
            tuple(bounded_qos(channel.metadata.get("offered_qos_profiles", ""))),
            encoding,
            channel.message_encoding,
        )

    def _take(self, opcode: int, data: bytes) -> Message | None:
        """One record that is no chunk."""
        record = _record(opcode, data)
        if isinstance(record, records.Schema):
            self._schemas[record.id] = record
        elif isinstance(record, records.Channel):
            self._add(record)
        elif isinstance(record, records.Message):
            if record.channel_id in self._channels:
                return self._channels[record.channel_id], record.log_time, record.data
            self.state.nameless += 1
        return None

    def _records(self, data: bytes) -> Iterator[Message]:
        """Messages of a chunk's content, also of one that is cut off."""
        at = 0
        while at + _HEAD.size <= len(data):
            opcode, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if at + size > len(data):
                return
            message = self._take(opcode, data[at : at + size])
            if message is not None:
                yield message
            at += size

    def _chunk(self, data: bytes, cut: bool) -> Iterator[Message]:
        """Messages of a chunk; a damaged one, or one cut off too early, has none."""
        try:
            chunk = records.Chunk.read(ReadDataStream(BytesIO(data)))
            self.state.zstd |= chunk.compression == "zstd"
            yield from self._records(_content(chunk, cut))
        except _DAMAGED as error:
            _refuse_large(error)
            if not cut:
                self.state.damaged_chunks += 1

    def messages(self) -> Iterator[Message]:
        with open_regular(self.path) as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise BagError(f"{self.path}: not an MCAP file", BagCause.NO_BAG)
            yield from self._from(stream, self.path.stat().st_size)

    def _from(self, stream: BinaryIO, end: int) -> Iterator[Message]:
        at = stream.tell()
        while True:
            head = stream.read(_HEAD.size)
            opcode, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            cut = at + _HEAD.size + size > end
            if opcode == 0 or (cut and opcode != Opcode.CHUNK):
                break
            if opcode == Opcode.FOOTER:
                stream.seek(size, 1)
                self.state.whole = stream.read(len(MCAP0_MAGIC) + 1) == MCAP0_MAGIC
                return
            if cut:
                size = min(size, end - at, budget_bytes())
            within_budget(size, "a record")
            if opcode == Opcode.CHUNK:
                yield from self._chunk(stream.read(size), cut)
                if cut:
                    break
            elif opcode == Opcode.MESSAGE or opcode in _READERS:
                try:
                    message = self._take(opcode, stream.read(size))
                except _DAMAGED as error:
                    _refuse_large(error)
                    message = None
                if message is not None:
                    yield message
            at += _HEAD.size + size
            stream.seek(at)
        self.state.lost_bytes = end - at


class _SqliteRepair:
    """Reads a copy of one SQLite file."""

    def __init__(self, path: Path, state: State) -> None:
        self.path, self.state = path, state

    def messages(self) -> Iterator[Message]:
        with tempfile.TemporaryDirectory(prefix="heli_repair_") as folder:
            copy = Path(folder) / self.path.name
            for tail in ("", "-wal", "-journal"):
                source = self.path.with_name(self.path.name + tail)
                if source.is_file():
                    open_regular(source).close()
                    shutil.copyfile(source, copy.with_name(copy.name + tail))
                    self.state.whole = not tail or (self.state.whole and not source.stat().st_size)
            self._fit(copy)
            with contextlib.closing(sqlite3.connect(copy)) as database:
                database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(budget_bytes(), 10**9))
                check_database(database)
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
        except _DAMAGED as error:
            _refuse_large(error)
            self.state.whole = False
            self.state.notes.append(f"{self.path.name}: {reason(error)}")
            return
        newest = -1
        for way in ("ASC", "DESC"):
            query = f"{_ROWS} WHERE id > ? ORDER BY id {way}"
            try:
                for number, topic, stamp_ns, raw in database.execute(query, (newest,)):
                    newest = number if way == "ASC" else newest
                    if topic in channels and isinstance(raw, bytes):
                        yield channels[topic], stamp_ns, raw
                    else:
                        self.state.nameless += 1
                return
            except sqlite3.DatabaseError as error:
                self.state.whole = False
                if way == "ASC":
                    self.state.notes.append(f"{self.path.name}: {reason(error)}")

    def _channels(self, database: sqlite3.Connection) -> dict[int, BagChannel]:
        def table(name: str) -> list[dict[str, Any]]:
            cursor = database.execute(f"SELECT * FROM {name}")
            names = [column[0] for column in cursor.description]
            return [dict(zip(names, row, strict=True)) for row in cursor]

        definitions: dict[str, dict[str, Any]] = {}
        with contextlib.suppress(sqlite3.OperationalError):
            definitions = {row["topic_type"]: row for row in table("message_definitions")}
        # Before Humble there was no such table, later a row is the last that is written.
        with contextlib.suppress(sqlite3.OperationalError):
            if not database.execute("SELECT count(*) FROM metadata").fetchone()[0]:
                self.state.whole = False
        channels = {}
        for row in table("topics"):
            known = definitions.get(row["type"], {})
            text = known.get("encoded_message_definition", "")
            channels[row["id"]] = BagChannel(
                str(row["name"] or ""),
                str(row["type"] or ""),
                str(text),
                row.get("type_description_hash") or type_hash(row["type"], text),
                tuple(bounded_qos(row.get("offered_qos_profiles", ""))),
                str(known.get("encoding", "")),
                str(row.get("serialization_format") or "cdr"),
            )
        return channels


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
    readers: dict[str, type[_McapRepair | _SqliteRepair]] = {
        ".mcap": _McapRepair,
        ".db3": _SqliteRepair,
    }
    reader = readers.get(storage_of(path))
    if reader is None:
        raise BagError(f"{path}: neither an .mcap nor a .db3 file", BagCause.NO_BAG)
    try:
        with _plain(path) as (plain, is_whole):
            yield from _salvaged(reader(plain, state), state)
        state.whole = state.whole and is_whole
    except FileError as error:
        raise damage(path, error) from error
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {reason(error)}", BagCause.DAMAGED) from error


@contextlib.contextmanager
def _plain(path: Path) -> Iterator[tuple[Path, bool]]:
    """A file as it is, or a copy of one that is compressed as a whole, and whether that is whole"""
    if path.suffix != PACKED:
        yield path, True
        return
    with tempfile.TemporaryDirectory(prefix="heli_repair_") as folder:
        plain = Path(folder) / path.stem
        is_whole = expand_file(path, plain, cut=True)
        yield plain, is_whole


def _salvaged(reader: _McapRepair | _SqliteRepair, state: State) -> Iterator[Message]:
    """Messages with a time that can be one, and plain bytes."""
    for channel, stamp_ns, raw in reader.messages():
        if not (isinstance(stamp_ns, int) and 0 <= stamp_ns <= _MOST_NS):
            state.damaged_chunks += 1
            continue
        # rosbag2 may have compressed every message by itself; CDR never begins like that.
        try:
            plain = expanded(raw) if raw[:4] == zstandard.FRAME_HEADER else raw
        except zstandard.ZstdError:
            state.damaged_chunks += 1
            continue
        yield channel, stamp_ns, plain


# -------------------------------------------------------------------------------------------------
# Repair.
# -------------------------------------------------------------------------------------------------


@dataclass
class Repair:
    """Outcome of a repair.

    Attributes
    ----------
    source, folder : str
        The damaged bag (untouched, or where it was moved to) and the new one.
    trouble : str
        What was wrong.
    counts : dict
        Messages restored per topic.
    duration_s : float
        Time between the first and the last of them.
    lost_bytes, damaged_chunks, nameless : int
        What no message could be read from, and messages of no topic.
    missing : dict
        Topic to how many messages metadata.yaml counts more than were restored.
    notes : list of str
    """

    source: str
    folder: str
    trouble: str
    counts: dict[str, int] = field(default_factory=dict)
    duration_s: float = 0.0
    lost_bytes: int = 0
    damaged_chunks: int = 0
    nameless: int = 0
    missing: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Messages restored."""
        return sum(self.counts.values())

    @property
    def is_whole(self) -> bool:
        """Whether all that the bag says it held is restored.

        A message that was being written when the recorder ended was never whole.
        """
        return not (self.missing or self.damaged_chunks or self.nameless)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "messages": self.messages, "whole": self.is_whole}


def _files(bag: Path) -> list[Path]:
    """Storage files of a bag, listed ones first, in the order of writing."""
    if bag.is_file():
        return [bag]
    files = sorted(storage_files(bag), key=in_order)
    listed = listed_files(bag)
    first = [bag / name for name in listed if bag / name in files]
    return [*first, *(path for path in files if path not in first)]


class _Survey:
    """First pass: which channels there are, how much, how damaged."""

    def __init__(self, files: list[Path], progress: Callable[[int], None]) -> None:
        self.channels: dict[BagChannel, int] = {}
        self.states = []
        self.total = 0
        for path in files:
            state = State()
            for channel, _, _ in salvage(path, state):
                self.channels.setdefault(channel, len(self.channels))
                self.total += 1
                progress(self.total)
            self.states.append(state)


def _target(bag: Path, out: Path | None, in_place: bool) -> Path:
    if out is not None and in_place:
        raise BagError("--out and --in-place: give one of them, not both", BagCause.OPTION)
    if out is None and not in_place:
        stem = bag.stem if bag.is_file() else bag.name
        out = bag.with_name(f"{stem}_repaired")
    if out is not None and out.exists():
        raise BagError(f"{out}: exists already; name a new folder with --out", BagCause.EXISTS)
    if in_place and bag.is_file():
        raise BagError(f"{bag}: --in-place is for a bag's folder", BagCause.OPTION)
    return out or bag


def _aside(bag: Path) -> Path:
    """Move a damaged bag out of the way; returns where it is now."""
    number, backup = 0, bag.with_name(f"{bag.name}_damaged")
    while backup.exists():
        number += 1
        backup = bag.with_name(f"{bag.name}_damaged{number}")
    bag.rename(backup)
    return backup


def repair(
    bag: Path,
    out: Path | None = None,
    in_place: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Repair | None:
    """Restore all complete messages of a damaged bag, with index and metadata.

    Parameters
    ----------
    bag : Path
        rosbag2 folder or one of its files; it is never changed.
    out : Path, optional
        New folder; default <bag>_repaired.
    in_place : bool
        Move the damaged bag to <bag>_damaged and put the new one where it was.
    progress : callable
        Gets messages done and messages in all (0 while that is not known).

    Returns
    -------
    Repair or None
        None: nothing is wrong with the bag, nothing was written.

    Raises
    ------
    BagError
        Not a bag, nothing to restore, or the new folder cannot be written.
    """
    if not bag.exists():
        raise BagError(f"{bag}: does not exist", BagCause.MISSING)
    wrong, files = trouble(bag), _files(bag)
    if not files:
        sentence = f"{bag}: not a bag: it holds neither an .mcap nor a .db3 file"
        raise BagError(sentence, BagCause.NO_BAG)
    bag = bag.resolve()
    target = _target(bag, out, in_place)
    listed = listed_counts(bag)
    survey = _Survey(files, lambda done: progress(done, 0))
    damaged = sum(state.damaged_chunks for state in survey.states)
    if not wrong and not damaged and all(state.whole for state in survey.states):
        return None
    if not survey.total:
        raise BagError(f"{bag}: holds no message that can be read", BagCause.NOTHING_LEFT)
    files = [path.resolve() for path in files]
    source = bag
    if in_place:
        source = _aside(bag)
        files = [source / path.name for path in files]
    result = Repair(str(source), str(target), wrong or "damaged inside")
    result.lost_bytes = sum(state.lost_bytes for state in survey.states)
    result.damaged_chunks = damaged
    result.nameless = sum(state.nameless for state in survey.states)
    result.notes = [note for state in survey.states for note in state.notes]
    storage = "sqlite3" if storage_of(files[0]) == ".db3" else "mcap"
    form = Format(storage, storage == "mcap" and any(state.zstd for state in survey.states))
    try:
        _copy(files, survey, target, form, result, progress)
    except BagError:
        if in_place and not target.exists():
            source.rename(target)
        raise
    short = {name: number - result.counts.get(name, 0) for name, number in listed.items()}
    result.missing = {name: number for name, number in short.items() if number > 0}
    return result


def _copy(
    files: list[Path],
    survey: _Survey,
    target: Path,
    form: Format,
    result: Repair,
    progress: Callable[[int, int], None],
) -> None:
    """Second pass: every message into the new bag, file by file."""
    new = BagFolder(target, list(survey.channels), form)
    first_ns, last_ns, done, since_flush = 2**63 - 1, 0, 0, 0
    try:
        for path in files:
            if since_flush:
                new.split()
                since_flush = 0
            for channel, stamp_ns, raw in salvage(path, State()):
                new.write(survey.channels[channel], stamp_ns, raw)
                first_ns, last_ns = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
                done, since_flush = done + 1, since_flush + 1
                progress(done, survey.total)
        new.close()
    except (OSError, sqlite3.Error) as error:
        new.abandon()
        shutil.rmtree(target, ignore_errors=True)
        kept = "the damaged bag is as it was"
        sentence = f"{target}: cannot be written: {reason(error)}; {kept}"
        raise BagError(sentence, BagCause.UNWRITABLE) from error
    counts = new.counts()
    for channel, number in survey.channels.items():  # of one topic there may be several
        result.counts[channel.topic] = result.counts.get(channel.topic, 0) + counts[number]
    result.duration_s = (last_ns - first_ns) / 1e9
