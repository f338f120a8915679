# SPDX-License-Identifier: Apache-2.0
"""Any rosbag2 bag: opened with one-line errors, listed, its messages as tables. No rclpy."""

import contextlib
import csv
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from heli_bags.check import storage_files
from heli_bags.damage import damage, guarded
from heli_bags.folder import BagError, reason
from heli_bags.message_text import flatten
from heli_bags.reader import named, require_whole
from heli_parameters.printable import printable


def bag_of(path: Path) -> Path:
    """The bag of a flight's folder, or the path itself."""
    return path / "bag" if (path / "bag").is_dir() else path


class BagReader:
    """An open bag; whatever the library raises on damaged bytes is a BagError.

    Attributes
    ----------
    connections : list of Connection
        Topics.
    message_count, start_time, end_time : int
        Messages; stamps of the bag, ns, of the first and behind the last.
    """

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self._path, self._reader = path, reader
        try:
            self.connections = list(reader.connections)
            self.message_count = reader.message_count
            self.start_time, self.end_time = reader.start_time, reader.end_time
        except Exception as error:
            raise damage(path, error) from error
        named(path, self.connections)
        told: tuple[Any, ...] = (self.message_count, self.start_time, self.end_time)
        for number in told:
            if not isinstance(number, int):
                said = f"{printable(repr(number))} is no number of messages and no time"
                raise BagError(f"{path}: not a readable bag: {said}")

    @property
    def duration(self) -> int:
        """Time between the first message and behind the last, ns."""
        return self.end_time - self.start_time

    def messages(
        self,
        connections: Collection[Connection] = (),
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Connection, stamp of the bag (ns), bytes; in the order of the stamps."""
        return guarded(self._path, self._reader.messages(connections, start, stop))

    def deserialize(self, raw: bytes, type_name: str) -> Any:
        """The message object."""
        try:
            return self._reader.deserialize(raw, type_name)
        except Exception as error:
            raise damage(self._path, error) from error


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BagReader]:
    """Reader of a bag, whoever recorded it.

    Parameters
    ----------
    path : Path
        rosbag2 folder, one of its files, or a flight's folder with `bag/`.

    Raises
    ------
    BagError
        Not a bag, cut off, or unreadable: one line that names it.
    """
    path = bag_of(path)
    require_whole(path)
    try:
        reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
        reader.open()
    except Exception as error:
        raise damage(path, error) from error
    with contextlib.closing(reader):
        yield BagReader(path, reader)


def chosen(
    reader: BagReader, path: Path, names: Sequence[str] = (), exclude: Sequence[str] = ()
) -> list[Connection]:
    """Connections of the named topics, of all if none is named.

    Raises
    ------
    BagError
        The bag has no such topic.
    """
    present = {c.topic for c in reader.connections}

    def full(name: str) -> str:
        for candidate in (name, f"/{name}"):
            if candidate in present:
                return candidate
        raise BagError(
            f"{bag_of(path)}: holds no topic {name}; it holds {', '.join(sorted(present))}"
        )

    wanted = {full(name) for name in names} or present
    left_out = {full(name) for name in exclude}
    return [c for c in reader.connections if c.topic in wanted - left_out]


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


@dataclass(frozen=True)
class BagInfo:
    """What a bag holds: see the attributes' names; times are stamps of the bag in seconds."""

    path: str
    storage: str
    files: list[str]
    size_bytes: int
    start_s: float
    duration_s: float
    messages: int
    topics: list[TopicInfo]


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
                )
            )
        return BagInfo(
            str(bag),
            "sqlite3" if files[0].suffix == ".db3" else "mcap",
            [file.name for file in files],
            sum(file.stat().st_size for file in files),
            reader.start_time / 1e9 if count else 0.0,
            span_s,
            count,
            rows,
        )


def bag_messages(
    path: Path, names: Sequence[str] = (), limit: int | None = None
) -> Iterator[tuple[str, str, int, Any]]:
    """Deserialised messages in the order of their stamps.

    Yields
    ------
    str, str, int, object
        Topic, type, stamp (ns), message.

    Raises
    ------
    BagError
    """
    with opened(path) as reader:
        connections = chosen(reader, path, names)
        for done, (c, stamp_ns, raw) in enumerate(reader.messages(connections=connections)):
            if limit is not None and done >= limit:
                return
            yield c.topic, c.msgtype, stamp_ns, reader.deserialize(raw, c.msgtype)


def write_csv(
    path: Path,
    folder: Path,
    names: Sequence[str] = (),
    progress: Callable[[int, int], None] = lambda done, total: None,
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
        Topics; all if empty.
    progress : callable
        Gets messages done and in all.

    Returns
    -------
    dict
        File name to number of rows.

    Raises
    ------
    BagError
    """
    with opened(path) as reader:
        connections = chosen(reader, path, names)
        total = sum(c.msgcount for c in connections)
        tables: dict[str, _Table] = {}
        try:
            for done, (c, stamp_ns, raw) in enumerate(reader.messages(connections=connections), 1):
                table = tables.get(c.topic)
                if table is None:
                    name = c.topic.strip("/").replace("/", "__") + ".csv"
                    table = tables[c.topic] = _Table(folder / name)
                table.add(stamp_ns, flatten(reader.deserialize(raw, c.msgtype)))
                progress(done, total)
        except OSError as error:
            raise BagError(f"{folder}: cannot be written: {reason(error)}") from error
        finally:
            for table in tables.values():
                table.close()
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
