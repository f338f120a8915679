# SPDX-License-Identifier: Apache-2.0
"""Readers of logs: ArduPilot's DataFlash, PX4's ULog, tables (CSV, MATLAB) and bags with a map.

Each is bounded before it is read (`heli_core.foreign_files`) and makes the same of it: tables of
columns by message, of which the format's table in `signals` takes what it knows.
"""

import csv
import io
import re
import struct
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np

from heli_bags.opening import listed_files
from heli_bags.tools import bag_of, chosen, flatten, opened
from heli_core.foreign_files import FileError, read_bytes, within_budget
from heli_core.rcl_yaml import printable
from heli_core.rotations import euler_angles
from heli_msgs_bridge.frames import quat_enu_flu_to_ned_frd
from heli_studies.logs.maps import LogMap, read_map
from heli_studies.logs.signals import (
    BAG,
    DATAFLASH,
    ULOG,
    Array,
    FlightLog,
    LogCause,
    LogError,
    LoggedSignal,
    SignalSource,
    Sweep,
    message_of,
)

MOST_COLUMNS, MOST_ROWS = 1000, 20_000_000
_MOST_NAMES, _LONGEST = 20, 120  # names, characters of a sentence of somebody else's
_MOST_SWEEPS, _AT_ONCE = 1000, 100_000
_TEXT_BYTES = 60  # of Python for a line, or for a value of one
_US = 1e-6


@dataclass
class Tables:
    """What a reader makes of a file: columns (N,) by message, and what else it says.

    Attributes
    ----------
    format : str
    columns : dict
        By message: name of a column to its values; `TIME` is the time, s.
    sweeps, skipped_bytes, dropped_s, cut
        As in `FlightLog`.
    """

    format: str
    columns: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    sweeps: tuple[Sweep, ...] = ()
    skipped_bytes: int = 0
    dropped_s: float = 0.0
    cut: bool = False


TIME = " time_s"
"""Name of the column of times: none of a log's own has a blank in front."""


def read_log(path: Path, log_map: Path | None = None) -> FlightLog:
    """Read a log, by its ending.

    Parameters
    ----------
    path : Path
        .bin (ArduPilot), .ulg (PX4), .csv, .mat, or a rosbag2 (its folder, its file, a flight's).
    log_map : Path, optional
        YAML file that says what the columns are (`heli_studies.logs.maps`); .csv and .mat need one.

    Raises
    ------
    LogError, FileError, BagError, ParameterError
        One sentence that names the file and what is wrong.
    """
    ending = path.suffix.lower()
    mapped = None if log_map is None else read_map(log_map)
    if ending in _READERS:
        name, read, sources = _READERS[ending]
        content = read_bytes(path)
        try:
            tables = read(content, path)
        except (struct.error, IndexError, UnicodeDecodeError, OverflowError) as error:
            raise LogError(LogCause.DAMAGED, f"{path}: not a whole {name} log: {error}") from error
        size = len(content)
    elif ending in _TABLES:
        if mapped is None:
            raise LogError(
                LogCause.MAP_NEEDED,
                f"{path}: the columns of a {ending} file have no names that are known: --map FILE "
                "says what they are",
            )
        tables, size = _TABLES[ending](path, mapped), path.stat().st_size
        sources = ()
    elif _is_bag(path):
        tables, size = _of_bag(path, mapped)
        sources = BAG
    else:
        known = ", ".join((*_READERS, *_TABLES))
        raise LogError(
            LogCause.UNKNOWN_FORMAT, f"{path}: no log that is read: {known}, or a rosbag2 folder"
        )
    return _log(path, size, tables, sources if mapped is None else mapped.sources, mapped)


def _listed(names: Iterable[str]) -> str:
    """The first names of some, for a sentence."""
    return printable(", ".join(islice(names, _MOST_NAMES)))


def _rows_at(raw: np.ndarray, places: np.ndarray, dtype: np.dtype[Any]) -> np.ndarray:
    """The rows (N,) that begin at these places, a piece after the other: indices are large."""
    rows = np.empty((places.size, dtype.itemsize), np.uint8)
    for first in range(0, places.size, _AT_ONCE):
        piece = slice(first, first + _AT_ONCE)
        rows[piece] = raw[places[piece, None] + np.arange(dtype.itemsize)]
    return rows.view(dtype)[:, 0]


def _is_bag(path: Path) -> bool:
    bag = bag_of(path)
    return bag.suffix in (".mcap", ".db3") or (bag.is_dir() and bool(listed_files(bag)))


def _log(
    path: Path, size: int, tables: Tables, sources: Sequence[SignalSource], mapped: LogMap | None
) -> FlightLog:
    times = {name: columns[TIME] for name, columns in tables.columns.items() if TIME in columns}
    zero = min((float(t[0]) for t in times.values() if t.size), default=0.0)
    found: dict[str, LoggedSignal] = {}
    left_out: dict[str, int] = {}
    for source in sources:
        columns = tables.columns.get(source.message, {})
        if TIME not in columns or source.column not in columns:
            if mapped is not None:
                where = f" of {source.message}" if source.message else ""
                near = _listed(c for c in columns or tables.columns if c != TIME)
                raise LogError(
                    LogCause.NO_COLUMN,
                    f"{path}: no column {printable(source.column)}{printable(where)} for "
                    f"{source.signal}; there are {near}",
                )
            continue
        signal, lost = _signal(source, columns[TIME] - zero, columns[source.column])
        if lost:
            left_out[source.message] = max(lost, left_out.get(source.message, 0))
        known = found.get(source.signal)
        if signal.time_s.size > (known.time_s.size if known else 1):
            found[source.signal] = signal
    if not found:
        held = _listed(sorted(tables.columns)) or "nothing"
        raise LogError(
            LogCause.EMPTY,
            f"{path}: holds nothing that says how a helicopter moves; it holds {held}",
        )
    messages = tuple(
        message_of(name or path.name, t) for name, t in sorted(times.items()) if t.size
    )
    return FlightLog(
        str(path), tables.format, size, messages, found, tuple(
            Sweep(s.time_s - zero, s.axis, s.magnitude, s.start_hz, s.stop_hz, s.length_s)
            for s in tables.sweeps
        ), tables.skipped_bytes, tables.dropped_s, tables.cut, left_out,
    )  # fmt: skip


def _signal(source: SignalSource, time_s: Array, values: np.ndarray) -> tuple[LoggedSignal, int]:
    """A signal with rising times and finite values, and how many rows that left out."""
    value = source.factor * np.asarray(values, np.float64)
    good = np.isfinite(value) & np.isfinite(time_s)
    t = np.where(good, time_s, -np.inf)
    good &= t > np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])
    if source.signal == "psi":
        value = np.unwrap(np.where(good, value, 0.0))
    where = f"{source.message}.{source.column}" if source.message else source.column
    return LoggedSignal(source.signal, where, time_s[good], value[good]), int((~good).sum())


# -------------------------------------------------------------------------------------------------
# ArduPilot's DataFlash: 0xA3 0x95, the message's number, its fields. FMT (number 128) tells each
# message's length, name, types and labels. Source: AP_Logger/LogStructure.h (format characters).
# -------------------------------------------------------------------------------------------------

_HEAD, _FMT, _FMT_SIZE = b"\xa3\x95", 128, 89
_TYPES: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0),
    "H": ("<u2", 1.0), "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "c": ("<i2", 0.01), "C": ("<u2", 0.01),
    "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "M": ("u1", 1.0),
    "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "g": ("<f2", 1.0),
}  # fmt: skip
"""numpy's type and the factor of each format character."""
_INSTANCE = ("I", "C")
"""Labels of the number of a sensor or estimator: of several the first in the log is taken."""
_SIDS = ("Ax", "Mag", "FSt", "FSp", "TR")


@dataclass(frozen=True)
class _Format:
    name: str
    dtype: np.dtype[Any]
    factors: dict[str, float]


def dataflash(content: bytes, path: Path) -> Tables:
    """Tables of a DataFlash log."""
    formats: dict[int, _Format] = {}
    lengths, places = [0] * 256, [array("q") for _ in range(256)]
    lengths[_FMT] = _FMT_SIZE
    at, skipped, size = content.find(_HEAD), 0, len(content)
    if at < 0:
        raise LogError(LogCause.NOT_A_LOG, f"{path}: no DataFlash log: no message begins in it")
    skipped = at
    while at + 3 <= size:
        number = content[at + 2]
        length = lengths[number]
        if content[at : at + 2] != _HEAD or not length:
            behind = content.find(_HEAD, at + 1)
            skipped += (size if behind < 0 else behind) - at
            at = size if behind < 0 else behind
            continue
        if at + length > size:
            break
        if number == _FMT:
            told, described = _format(content[at : at + length])
            if described is not None and told != _FMT:
                lengths[told], formats[told] = described.dtype.itemsize, described
        else:
            places[number].append(at)
        at += length
    if not formats:
        raise LogError(LogCause.NOT_A_LOG, f"{path}: no DataFlash log: it describes no message")
    raw = np.frombuffer(content, np.uint8)
    tables = Tables("ArduPilot DataFlash", skipped_bytes=skipped, cut=at < size)
    for number, rows in enumerate(places):
        if rows:
            _gather(tables, formats[number], np.frombuffer(rows, np.int64), raw, path)
    if not tables.columns:
        raise LogError(LogCause.EMPTY, f"{path}: describes {len(formats)} messages and holds none")
    return tables


def _format(message: bytes) -> tuple[int, _Format | None]:
    """Number and form of the message that an FMT describes; None if it cannot be."""
    _, number, length, name, types, labels = struct.unpack("<3sBB4s16s64s", message)
    text = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, types, labels)]
    names = text[2].split(",")
    if len(names) != len(text[1]) or len(set(names)) != len(names) or "" in names:
        return number, None
    if not all(character in _TYPES for character in text[1]):
        return number, None
    fields = [("", "V3"), *((n, _TYPES[c][0]) for n, c in zip(names, text[1], strict=True))]
    dtype = np.dtype(fields)
    factors = {n: _TYPES[c][1] for n, c in zip(names, text[1], strict=True)}
    return number, _Format(text[0], dtype, factors) if dtype.itemsize == length else None


def _gather(tables: Tables, form: _Format, places: np.ndarray, raw: np.ndarray, path: Path) -> None:
    size = form.dtype.itemsize
    within_budget(places.size * size, f"{form.name}: messages", path)
    rows = _rows_at(raw, places, form.dtype)
    numbers = [n for n in form.factors if rows[n].dtype.kind in "iuf" and rows[n].ndim == 1]
    if form.name == "SIDS" and set(_SIDS) <= set(numbers) and "TimeUS" in numbers:
        tables.sweeps = tuple(
            Sweep(float(row["TimeUS"]) * _US, int(row["Ax"]), *(float(row[n]) for n in _SIDS[1:]))
            for row in islice(rows, _MOST_SWEEPS)
        )
    clock = next((n for n in ("TimeUS", "TimeMS") if n in numbers), None)
    if clock is None:
        return
    for label in _INSTANCE:
        if label in numbers and label == form.dtype.names[2]:  # type: ignore[index]
            rows = rows[rows[label] == rows[label][0]]
    columns: dict[str, np.ndarray] = {TIME: rows[clock] * (_US if clock == "TimeUS" else 1e-3)}
    for name in numbers:
        factor = form.factors[name]
        columns[name] = rows[name] if factor == 1.0 else rows[name] * factor
    tables.columns[form.name] = columns


# -------------------------------------------------------------------------------------------------
# PX4's ULog: a head, then messages of two bytes of size, a letter and content. 'F' describes a
# type, 'A' names a topic, 'D' is a row. Source: PX4's user guide, "ULog File Format".
# -------------------------------------------------------------------------------------------------

_MAGIC = b"ULog\x01\x12\x35"
_ULOG_HEAD, _DATA_APPENDED = 16, 1
_ULOG_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4",
    "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8",
    "bool": "?", "char": "S1",
}  # fmt: skip
_FIELD = re.compile(
    r"(?P<kind>[A-Za-z0-9_/]{1,80})(?:\[(?P<count>\d{1,5})\])? (?P<label>[A-Za-z0-9_]{1,80})"
)
_MOST_FIELDS, _DEEPEST = 4000, 8


def ulog(content: bytes, path: Path) -> Tables:
    """Tables of a ULog: of a topic with several instances the one with the lowest number."""
    if not content.startswith(_MAGIC) or len(content) < _ULOG_HEAD:
        raise LogError(LogCause.NOT_A_LOG, f"{path}: no ULog: it does not begin as one")
    described: dict[str, str] = {}
    topics: dict[int, tuple[str, int]] = {}
    places: dict[int, array[int]] = {}
    tables = Tables("PX4 ULog")
    at, size, ends = _ULOG_HEAD, len(content), [len(content)]
    while at + 3 <= size:
        length, kind = int.from_bytes(content[at : at + 2], "little"), content[at + 2 : at + 3]
        start, end = at + 3, at + 3 + length
        if end > ends[0] and len(ends) > 1:  # what was appended begins where the log was cut
            at = ends.pop(0)
            continue
        if end > size:
            break
        if kind == b"F":
            name, _, fields = content[start:end].decode("utf-8").partition(":")
            described[name] = fields
        elif kind == b"A" and length >= 3:
            number = int.from_bytes(content[start + 1 : start + 3], "little")
            topics[number] = content[start + 3 : end].decode("utf-8"), content[start]
        elif kind == b"D" and length >= 2:
            number = int.from_bytes(content[start : start + 2], "little")
            places.setdefault(number, array("q")).append(start + 2)
        elif kind == b"O" and length == 2:
            tables.dropped_s += int.from_bytes(content[start:end], "little") * 1e-3
        elif kind == b"B" and length == 40:
            _, flags, *offsets = struct.unpack("<8s8s3Q", content[start:end])
            flag = int.from_bytes(flags, "little")
            if flag & ~_DATA_APPENDED:
                raise LogError(
                    LogCause.UNSUPPORTED, f"{path}: a ULog of a form that is newer than this reader"
                )
            if flag & _DATA_APPENDED:
                ends = [*sorted(o for o in offsets if _ULOG_HEAD < o < size), size]
        elif not kind.isalpha() and kind != b"\0":
            tables.skipped_bytes += 3 + length
        at = end
    tables.cut = at < size
    raw = np.frombuffer(content, np.uint8)
    for number, (name, _) in sorted(topics.items(), key=lambda item: item[1][1]):
        rows = places.get(number)
        if rows and name not in tables.columns:
            dtype = np.dtype(_fields(name, described, path))
            _rows(tables, name, dtype, np.frombuffer(rows, np.int64), raw, path)
    if not tables.columns:
        raise LogError(LogCause.EMPTY, f"{path}: a ULog without a row")
    return tables


def _fields(
    name: str, described: Mapping[str, str], path: Path, before: str = "", deep: int = 0
) -> list[tuple[str, str]]:
    """numpy's fields of a type, nested ones and arrays flattened; padding at the end left out."""
    if name not in described or deep > _DEEPEST:
        raise LogError(LogCause.DAMAGED, f"{path}: type {printable(name)} is not described")
    found: list[tuple[str, str]] = []
    for part in filter(None, described[name].split(";")):
        match = _FIELD.fullmatch(part)
        if match is None:
            raise LogError(LogCause.DAMAGED, f"{path}: {printable(name)}: field {printable(part)}")
        kind, count, label = match["kind"], match["count"], match["label"]
        for i in range(int(count) if count else 1):
            full = f"{before}{label}[{i}]" if count else f"{before}{label}"
            if kind in _ULOG_TYPES:
                found.append((full, _ULOG_TYPES[kind]))
            else:
                found += _fields(kind, described, path, f"{full}.", deep + 1)
            if len(found) > _MOST_FIELDS:
                raise LogError(
                    LogCause.TOO_MANY,
                    f"{path}: {printable(name)} has more than {_MOST_FIELDS} fields",
                )
    while deep == 0 and found and found[-1][0].startswith("_padding"):
        found.pop()
    return found


def _rows(
    tables: Tables, name: str, dtype: np.dtype[Any], places: np.ndarray, raw: np.ndarray, path: Path
) -> None:
    size = dtype.itemsize
    if not size or "timestamp" not in (dtype.names or ()):
        return
    places = places[places + size <= raw.size]
    within_budget(places.size * size, f"{printable(name)}: rows", path)
    rows = _rows_at(raw, places, dtype)
    columns: dict[str, np.ndarray] = {TIME: rows["timestamp"] * _US}
    for label in dtype.names or ():
        if rows[label].dtype.kind in "iufb":
            columns[label] = rows[label]
    if {f"q[{i}]" for i in range(4)} <= set(columns):
        q = np.column_stack([columns[f"q[{i}]"] for i in range(4)]).astype(np.float64)
        columns |= _angles(q)
    tables.columns[name] = columns


def _angles(q_nb: Array) -> dict[str, Array]:
    """Columns roll, pitch, yaw, rad, of quaternions (N, 4) FRD to NED."""
    return dict(zip(("roll", "pitch", "yaw"), euler_angles(q_nb).T, strict=True))


_READERS: dict[str, tuple[str, Callable[[bytes, Path], Tables], tuple[SignalSource, ...]]] = {
    ".bin": ("DataFlash", dataflash, DATAFLASH),
    ".ulg": ("ULog", ulog, ULOG),
}


# -------------------------------------------------------------------------------------------------
# Tables whose columns a map names: CSV and MATLAB.
# -------------------------------------------------------------------------------------------------


_MARKS = (";", "\t", ",", " ")


def _of_csv(path: Path, mapped: LogMap) -> Tables:
    """Rows under a line of names, or without one: then columns are 0, 1, 2 ..."""
    content = read_bytes(path)
    within_budget(_TEXT_BYTES * content.count(b"\n"), "lines", path)
    try:
        text = content.decode("utf-8-sig")
        lines = [line for line in text.splitlines() if line.strip()]
        # in a row of numbers nothing else stands between them
        mark = next((m for m in _MARKS if m in lines[min(1, len(lines) - 1)]), ",")
        cells = next(csv.reader([lines[0]], delimiter=mark))
    except (UnicodeDecodeError, IndexError, csv.Error) as error:
        problem = "it is empty" if isinstance(error, IndexError) else str(error)
        raise LogError(LogCause.NOT_A_LOG, f"{path}: no CSV file: {problem}") from None
    if len(cells) > MOST_COLUMNS:
        problem = f"{len(cells)} columns; allowed: {MOST_COLUMNS}"
        raise LogError(LogCause.TOO_MANY, f"{path}: {problem}")
    headed = not all(_is_number(cell) for cell in cells)
    numbered = list(map(str, range(len(cells))))
    names = [c.strip().lstrip("#").strip() for c in cells] if headed else numbered
    wanted = {s.column for s in mapped.sources} | {mapped.time.column}
    used = [i for i, name in enumerate(names) if name in wanted]
    lines = lines[headed:]
    within_budget(8 * len(lines) * max(len(used), 1), "columns", path)
    values = _values(lines, mark, used, path) if used else np.zeros((0, 0))
    columns = {names[i]: values[:, k] for k, i in enumerate(used)}
    return _mapped_table("CSV", columns, mapped, path, names)


def _values(lines: Sequence[str], mark: str, used: Sequence[int], path: Path) -> Array:
    """Columns (N, k) of a table; NaN where there is no number."""
    try:
        return np.loadtxt(lines, delimiter=mark, usecols=used, ndmin=2, max_rows=MOST_ROWS)
    except ValueError:
        # a hole, or a word: slower, and of more memory
        within_budget(_TEXT_BYTES * len(lines) * len(used), "values", path)
    try:
        return np.genfromtxt(lines, delimiter=mark, usecols=used, ndmin=2, max_rows=MOST_ROWS)
    except ValueError as error:
        problem = shorten(str(error), _LONGEST)
        raise LogError(LogCause.DAMAGED, f"{path}: not a table: {problem}") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return not cell.strip()
    return True


def _of_mat(path: Path, mapped: LogMap) -> Tables:
    """Variables of a MATLAB file up to version 7: a column is NAME, or NAME[i] of a matrix."""
    from scipy.io import loadmat, whosmat

    content = read_bytes(path)
    try:
        shapes = {name: (shape, kind) for name, shape, kind in whosmat(io.BytesIO(content))}
        wanted = {s.column for s in mapped.sources} | {mapped.time.column}
        bare = {column.partition("[")[0] for column in wanted} & set(shapes)
        size = sum(8 * int(np.prod(shapes[name][0], dtype=np.float64)) for name in bare)
        within_budget(size, "variables", path)
        held = loadmat(io.BytesIO(content), variable_names=sorted(bare))
    except NotImplementedError:
        raise LogError(
            LogCause.UNSUPPORTED,
            f"{path}: a MATLAB 7.3 file, which is HDF5: write it by save(..., '-v7')",
        ) from None
    except FileError:
        raise
    except Exception as error:  # whatever a reader of broken bytes stumbles over
        problem = shorten(str(error), _LONGEST)
        raise LogError(LogCause.NOT_A_LOG, f"{path}: no MATLAB file: {problem}") from None
    columns: dict[str, np.ndarray] = {}
    for name in bare:
        array = np.asarray(held.get(name))
        if array.dtype.kind not in "iufb" or array.ndim > 2:
            continue
        array = np.atleast_2d(array)
        array = array.T if array.shape[0] == 1 else array
        columns[name] = array[:, 0]
        for i in range(min(array.shape[1], MOST_COLUMNS)):
            columns[f"{name}[{i}]"] = array[:, i]
    return _mapped_table("MATLAB", columns, mapped, path, list(shapes))


def _mapped_table(
    kind: str, columns: dict[str, np.ndarray], mapped: LogMap, path: Path, names: Iterable[str]
) -> Tables:
    time = mapped.time
    if not time.factor:
        raise LogError(LogCause.BAD_MAP, f"{path}: the map says nothing of the time of its rows")
    if time.column and time.column not in columns:
        raise LogError(
            LogCause.NO_COLUMN,
            f"{path}: no column {printable(time.column)} for the time; there are {_listed(names)}",
        )
    rows = max((c.size for c in columns.values()), default=0)
    clock = columns[time.column] * time.factor if time.column else np.arange(rows) * time.factor
    same = {name: c for name, c in columns.items() if c.size == clock.size}
    if clock.size > 1 and not np.any(np.diff(clock) > 0.0):
        raise LogError(LogCause.NO_TIME, f"{path}: {time.column}: its times do not rise")
    return Tables(kind, {"": {TIME: np.asarray(clock, np.float64), **same}})


_TABLES: dict[str, Callable[[Path, LogMap], Tables]] = {".csv": _of_csv, ".mat": _of_mat}


# -------------------------------------------------------------------------------------------------
# Bags: ours by `BAG`, those of others by a map.
# -------------------------------------------------------------------------------------------------


def _of_bag(path: Path, mapped: LogMap | None) -> tuple[Tables, int]:
    sources = BAG if mapped is None else mapped.sources
    wanted = {source.message for source in sources}
    tables = Tables("rosbag2")
    rows: dict[str, list[list[float]]] = {}
    labels: dict[str, list[str]] = {}
    with opened(path) as reader:
        there = {c.topic.lstrip("/"): c.topic for c in reader.connections}
        topics = {name: there[name] for name in wanted if name in there}
        if topics:
            names = {full: name for name, full in topics.items()}
            size = 0
            for c, stamp_ns, raw in reader.messages(chosen(reader, path, list(topics.values()))):
                fields = _numbers(flatten(reader.deserialize(c, raw)))
                name = names[c.topic]
                label = labels.setdefault(name, list(fields))
                size += 8 * len(label)
                within_budget(size, "the topics that are read", path)
                stamp_s = fields.get("header.stamp.sec", 0.0) + 1e-9 * fields.get(
                    "header.stamp.nanosec", 0.0
                )
                row = [stamp_s or stamp_ns * 1e-9, *(fields.get(n, np.nan) for n in label)]
                rows.setdefault(name, []).append(row)
    for name, values in rows.items():
        table = np.array(values)
        columns = dict(zip([TIME, *labels[name]], table.T, strict=True))
        tables.columns[name] = columns | _attitude(columns)
    if not tables.columns:
        raise LogError(
            LogCause.MAP_NEEDED,
            f"{path}: holds none of {', '.join(sorted(wanted))}: --map FILE says what its topics "
            f"are; it holds {_listed(sorted(there))}",
        )
    return tables, sum(f.stat().st_size for f in _files(bag_of(path)))


def _files(bag: Path) -> list[Path]:
    return [bag] if bag.is_file() else [f for f in bag.iterdir() if f.is_file()]


def _numbers(fields: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of a message by name; of arrays each."""
    found: dict[str, float] = {}
    for name, value in fields.items():
        if isinstance(value, (bool, int, float, np.number)):
            found[name] = float(value)
        if len(found) >= MOST_COLUMNS:
            break
    return found


def _attitude(columns: Mapping[str, np.ndarray]) -> dict[str, Array]:
    """roll, pitch, yaw of NED and FRD of the quaternion of a message by REP-103, if it has one."""
    for before in ("pose.pose.orientation", "pose.orientation", "orientation", "quaternion"):
        names = [f"{before}.{axis}" for axis in "xyzw"]
        if all(name in columns for name in names):
            q_xyzw = np.column_stack([columns[name] for name in names])
            q_nb = np.empty_like(q_xyzw)
            for q, out in zip(q_xyzw, q_nb, strict=True):
                quat_enu_flu_to_ned_frd(q, out)
            return _angles(q_nb)
    return {}
