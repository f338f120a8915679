# SPDX-License-Identifier: Apache-2.0
"""Any rosbag2 bag: opened with one-line errors, listed, its messages as tables. No rclpy."""

import csv
import dataclasses
import json
import math
import struct
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from rosbags.interfaces import Connection

from heli_bags.opening import (
    BagReader,
    bag_of,
    chosen,
    opened,
    require_readable,
    storage_files,
)
from heli_bags.storage import storage_of
from heli_bags.writer import BagCause, BagError, reason

# -------------------------------------------------------------------------------------------------
# Messages as plain data, as text like `ros2 topic echo`, as one level of fields. No rclpy.
# -------------------------------------------------------------------------------------------------

_SHOWN, _MOST_VALUES = 128, 100_000
# What a message without fields has instead.
_PLACEHOLDER = "structure_needs_at_least_one_member"


def plain(value: Any, most: int | None = None) -> Any:
    """A message of rclpy or `rosbags` as dictionaries, lists, numbers and texts.

    Parameters
    ----------
    value : object
        The message, or a value of it.
    most : int, optional
        Elements of a sequence, of which more are "..."; default: all.

    Raises
    ------
    BagError
        All would be more than 100 000 values.
    """
    if most is None:
        _check_count(value)
    return _plain(value, most)


def _check_count(message: Any) -> None:
    """Raise BagError for a message of more values than are made objects of."""
    todo, count = [message], 0
    while todo:
        value = todo.pop()
        if isinstance(value, np.ndarray):
            count += value.size
        elif dataclasses.is_dataclass(value):
            todo += [getattr(value, f.name) for f in dataclasses.fields(value)]
        elif hasattr(value, "get_fields_and_field_types"):
            todo += [getattr(value, name) for name in value.get_fields_and_field_types()]
        elif isinstance(value, (list, tuple)):
            count += len(value)
            todo += value if count <= _MOST_VALUES else []
        elif isinstance(value, (array, bytes)):
            count += len(value)
        if count > _MOST_VALUES:
            sentence = f"a message has {count} values or more; allowed: {_MOST_VALUES}"
            raise BagError(sentence, BagCause.TOO_LARGE)


def _plain(value: Any, most: int | None) -> Any:
    if isinstance(value, np.ndarray):
        return _cut(value[:most].tolist(), len(value), most)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else _cut(list(value[:most]), len(value), most)
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if not f.name.startswith("__")]
        return {name: _plain(getattr(value, name), most) for name in names if name != _PLACEHOLDER}
    if hasattr(value, "get_fields_and_field_types"):
        names = list(value.get_fields_and_field_types())
        return {name: _plain(getattr(value, name), most) for name in names}
    if isinstance(value, (str, bool, int, float)) or value is None:
        return value
    return _cut([_plain(item, most) for item in value[:most]], len(value), most)


def _cut(shown: list[Any], size: int, most: int | None) -> list[Any]:
    """Long sequences cut, as `ros2 topic echo` does."""
    return shown if most is None or size <= most else [*shown, "..."]


def as_yaml(message: Any, full: bool = False) -> str:
    """Text of a message as `ros2 topic echo` prints it, with the closing `---`."""
    text = yaml.safe_dump(
        plain(message, None if full else _SHOWN),
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=False,
        width=10**6,
    )
    return f"{text}---"


def _finite(value: Any) -> Any:
    """Not-a-number and infinity as None: JSON has no such numbers."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_json(message: Any, **beside: Any) -> str:
    """One line of JSON with the message's fields; `beside` goes in front."""
    return json.dumps({**beside, **_finite(plain(message))}, allow_nan=False)


def flatten(message: Any) -> dict[str, Any]:
    """Every field on one level: `pose.pose.position.x`, `position[0]`."""
    fields: dict[str, Any] = {}
    _flatten(plain(message), "", fields)
    return fields


def _flatten(value: Any, name: str, fields: dict[str, Any]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _flatten(item, f"{name}.{key}" if name else key, fields)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _flatten(item, f"{name}[{index}]", fields)
    else:
        fields[name] = value


# -------------------------------------------------------------------------------------------------
# Tools.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag."""

    topic: str
    type: str
    messages: int
    rate_hz: float
    hash: str
    reliability: str
    durability: str
    unreadable: str
    """Why its messages cannot be taken apart; empty if they can."""


@dataclass(frozen=True)
class BagInfo:
    """What a bag holds: see the attributes' names; times are stamps of the bag in seconds.

    `flights` are begin and end of each flight, several if its clock goes back; start and duration
    are those of the last. `missing` says which messages are listed and not there.
    """

    path: str
    storage: str
    files: list[str]
    size_bytes: int
    start_s: float
    duration_s: float
    messages: int
    topics: list[TopicInfo]
    flights: list[tuple[float, float]]
    missing: list[str]


def bag_info(path: Path) -> BagInfo:
    """Describe a bag.

    Raises
    ------
    BagError
    """
    bag = bag_of(path)
    with opened(bag) as reader:
        files = [bag] if bag.is_file() else storage_files(bag)
        count = reader.message_count
        span_s = (reader.duration - 1) / 1e9 if count else 0.0
        rows = []
        for connection in sorted(reader.connections, key=lambda c: c.topic):
            profiles = getattr(connection.ext, "offered_qos_profiles", ())
            n = connection.msgcount
            rows.append(
                TopicInfo(
                    connection.topic,
                    connection.msgtype,
                    n,
                    (n - 1) / span_s if n > 1 and span_s > 0.0 else 0.0,
                    connection.digest,
                    profiles[0].reliability.name.lower() if profiles else "",
                    profiles[0].durability.name.lower() if profiles else "",
                    reader.obstacle(connection),
                )
            )
        return BagInfo(
            str(bag),
            "sqlite3" if storage_of(files[0]) == ".db3" else "mcap",
            [file.name for file in files],
            sum(file.stat().st_size for file in files),
            reader.start_time / 1e9 if count else 0.0,
            span_s,
            count,
            rows,
            [(f.start_ns / 1e9, (f.end_ns - 1) / 1e9) for f in reader.flights] if count else [],
            list(map(str, reader.lost(reader.connections))),
        )


def readable(reader: BagReader, path: Path, names: Sequence[str] = ()) -> list[Connection]:
    """Topics whose messages can be taken apart: the named ones, else all.

    Raises
    ------
    BagError
        The bag has no such topic, or one that is named cannot be read.
    """
    require_readable(reader, path, names)
    return [c for c in chosen(reader, path, names) if not reader.obstacle(c)]


def bag_messages(
    path: Path,
    names: Sequence[str] = (),
    limit: int | None = None,
    flight: int | None = None,
    shortfall: list[str] | None = None,
) -> Iterator[tuple[str, str, int, Any]]:
    """Deserialised messages in the order of their stamps.

    Parameters
    ----------
    path : Path
        The bag.
    names : sequence of str
        Topics; all that can be read if empty.
    limit : int, optional
        How many at most.
    flight : int, optional
        Which flight, from 1 on; default: the last.
    shortfall : list of str, optional
        Gets, at the end, why less was read than the bag lists; without it a message that cannot
        be taken apart is an error.

    Yields
    ------
    str, str, int, object
        Topic, type, stamp (ns), message.

    Raises
    ------
    BagError
    """
    with opened(path, flight) as reader:
        connections, done = readable(reader, path, names), 0
        for c, stamp_ns, raw in reader.messages(connections) if connections else ():
            if limit is not None and done >= limit:
                return
            message = taken_apart(reader, c, raw, shortfall is None)
            if message is not None:
                done += 1
                yield c.topic, c.msgtype, stamp_ns, message
        short = _shortfall(reader, path, names, done)
        if shortfall is not None:
            shortfall += short


def _shortfall(reader: BagReader, path: Path, names: Sequence[str], done: int) -> list[str]:
    """Why less was read than the bag lists; BagError where that is nothing at all."""
    connections = chosen(reader, path, names)
    unread = reader.unread(connections)
    if unread and not done:
        sentence = f"{bag_of(path)}: nothing of it can be read: {unread[0]}"
        raise BagError(sentence, BagCause.NOTHING_LEFT)
    return reader.shortfall(connections)


def taken_apart(reader: BagReader, connection: Connection, raw: bytes, strict: bool) -> Any:
    """The message object; None, and counted, where it cannot be, unless that is an error.

    Raises
    ------
    BagError
        It is strict, or the message is above the budget.
    """
    try:
        return reader.deserialize(connection, raw)
    except BagError as error:
        if strict or error.cause == BagCause.TOO_LARGE:
            raise
        reader.lose(connection, error)
        return None


def write_csv(
    path: Path,
    folder: Path,
    names: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
    flight: int | None = None,
    shortfall: list[str] | None = None,
) -> dict[str, int]:
    """Write one CSV file per topic: stamp of the bag (ns), then every field of the message.

    Elements of arrays and sequences get a column each (`position[0]`); a row of a shorter sequence
    leaves the rest empty.

    Parameters
    ----------
    path : Path
        The bag.
    folder : Path
        An existing folder.
    names : sequence of str
        Topics; all that can be read if empty.
    progress : callable
        Gets messages done and in all.
    flight : int, optional
        Which flight, from 1 on; default: the last.
    shortfall : list of str, optional
        Gets why there are fewer rows than the bag lists; without it a message that cannot be taken
        apart is an error.

    Returns
    -------
    dict
        File name to number of rows.

    Raises
    ------
    BagError
    """
    with opened(path, flight) as reader:
        connections = readable(reader, path, names)
        total = sum(c.msgcount for c in connections)
        tables: dict[str, _Table] = {}
        try:
            rows = reader.messages(connections) if connections else ()
            for done, (c, stamp_ns, raw) in enumerate(rows, 1):
                message = taken_apart(reader, c, raw, shortfall is None)
                progress(done, total)
                if message is None:
                    continue
                table = tables.get(c.topic)
                if table is None:
                    name = c.topic.strip("/").replace("/", "__") + ".csv"
                    table = tables[c.topic] = _Table(folder / name)
                try:
                    table.add(stamp_ns, flatten(message))
                except BagError as error:
                    sentence = f"{error}; it is on {c.topic}: name the topics to be written"
                    raise BagError(sentence, error.cause) from error
        except OSError as error:
            sentence = f"{folder}: cannot be written: {reason(error)}"
            raise BagError(sentence, BagCause.UNWRITABLE) from error
        finally:
            for table in tables.values():
                table.close()
        short = _shortfall(reader, path, names, len(tables))
        if shortfall is not None:
            shortfall += short
    return {table.path.name: table.rows for table in tables.values()}


class _Table:
    """A CSV file whose columns may become more while it is written."""

    def __init__(self, path: Path) -> None:
        self.path, self.rows = path, 0
        self._columns: dict[str, None] = {}
        self._grown = False
        self._stream = open(path, "w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._stream)

    def add(self, stamp_ns: int, fields: dict[str, Any]) -> None:
        """One row."""
        if not self.rows:
            self._columns = dict.fromkeys(fields)
            self._writer.writerow(["stamp_ns", *self._columns])
        elif fields.keys() - self._columns.keys():
            self._columns.update(dict.fromkeys(fields))
            self._grown = True
        self._writer.writerow([stamp_ns, *(fields.get(name, "") for name in self._columns)])
        self.rows += 1

    def close(self) -> None:
        """Finish the file; rows from before a column came are filled up."""
        self._stream.close()
        if not self._grown:
            return
        filled = self.path.with_name(f"{self.path.name}.new")
        with (
            open(self.path, newline="", encoding="utf-8") as old,
            open(filled, "w", newline="", encoding="utf-8") as new,
        ):
            writer, rows = csv.writer(new), csv.reader(old)
            next(rows)
            writer.writerow(["stamp_ns", *self._columns])
            for row in rows:
                writer.writerow([*row, *[""] * (1 + len(self._columns) - len(row))])
        filled.replace(self.path)


# -------------------------------------------------------------------------------------------------
# ULog, the format of PX4's flight logs: tables written into one file. No ROS.
#
# Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
# -------------------------------------------------------------------------------------------------

_MAGIC, _VERSION = b"ULog\x01\x12\x35", 1
_NAMES = {"u8": "uint64_t", "u4": "uint32_t", "i4": "int32_t", "f4": "float", "b1": "bool"}
_HEAD = [("size", "<u2"), ("kind", "S1"), ("number", "<u2")]
_INT32 = 2**31


@dataclass(frozen=True)
class LogTopic:
    """One topic of a log.

    Attributes
    ----------
    name : str
        Of the topic.
    fields : dict
        Name to (N,) or (N, size) array: bool, int32, uint32 or float32.
    present : (N,) ndarray of bool
        Rows that are written.
    """

    name: str
    fields: Mapping[str, NDArray[np.generic]]
    present: NDArray[np.bool_]


def ulog(
    time_us: NDArray[np.uint64],
    tables: Sequence[LogTopic],
    infos: Mapping[str, str],
    parameters: Mapping[str, int | float],
) -> bytes:
    """Content of a log.

    Parameters
    ----------
    time_us : (N,) ndarray of uint64
        Times of all tables' rows, us, ascending.
    tables : sequence of LogTopic
    infos : dict
        What is said of the whole log.
    parameters : dict
        An int outside int32 is written as a float, which has 24 bits.

    Returns
    -------
    bytes
    """
    first = int(time_us[0]) if time_us.size else 0
    parts = [_MAGIC, bytes([_VERSION]), struct.pack("<Q", first), _message(b"B", bytes(40))]
    for key, text in infos.items():
        raw = text.encode()
        parts.append(_message(b"I", _keyed(f"char[{len(raw)}] {key}") + raw))
    for key, value in parameters.items():
        whole = isinstance(value, int) and -_INT32 <= value < _INT32
        kind, code = ("int32_t", "<i") if whole else ("float", "<f")
        parts.append(_message(b"P", _keyed(f"{kind} {key}") + struct.pack(code, value)))
    blocks = [_block(number, table, time_us) for number, table in enumerate(tables)]
    for table, block in zip(tables, blocks, strict=True):
        parts.append(_message(b"F", _format(table.name, block.dtype)))
    for number, table in enumerate(tables):
        parts.append(_message(b"A", struct.pack("<BH", 0, number) + table.name.encode()))
    widths = [block.itemsize for block in blocks]
    raw_rows = [block.view(np.uint8).reshape(time_us.size, -1) for block in blocks]
    kept = np.repeat(np.column_stack([table.present for table in tables]), widths, axis=1)
    # Row by row, so that the messages of all topics are in the order of their times.
    parts.append(np.hstack(raw_rows)[kept].tobytes())
    return b"".join(parts)


def _message(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<Hc", len(content), kind) + content


def _keyed(key: str) -> bytes:
    raw = key.encode()
    return bytes([len(raw)]) + raw


def _block(number: int, table: LogTopic, time_us: NDArray[np.uint64]) -> NDArray[np.void]:
    """Data messages of a table, one per row."""
    columns = {"timestamp": time_us, **table.fields}
    layout = [(name, array.dtype, array.shape[1:]) for name, array in columns.items()]
    block = np.zeros(time_us.size, dtype=np.dtype([*_HEAD, *layout]))
    block["size"], block["kind"], block["number"] = block.itemsize - 3, b"D", number
    for name, column in columns.items():
        block[name] = column
    return block


def _format(name: str, dtype: np.dtype[np.void]) -> bytes:
    texts = []
    for column in (dtype.names or ())[len(_HEAD) :]:
        field = dtype[column]
        kind = _NAMES[field.base.str[1:]]
        size = f"[{field.shape[0]}]" if field.shape else ""
        texts.append(f"{kind}{size} {column};")
    return f"{name}:{''.join(texts)}".encode()
