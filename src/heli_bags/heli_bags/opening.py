# SPDX-License-Identifier: Apache-2.0
"""The door through which every reader opens a bag: whether it is whole, what of it can be read.

A bag holds what its recorder heard: topics of types that nobody here knows, without definition, of
another serialisation; two flights, if the plant was configured again while the recorder went on.
What cannot be read is named and counted, and hides nothing else. No rclpy.
"""

import contextlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from heli_bags.bag_clock import WINDOW_NS, is_stream
from heli_bags.bag_files import BagFiles, Bounds, Place, budgeted, information
from heli_bags.storage import MOST_TOPICS, PACKED, Kept, checked_message, storage_of
from heli_bags.storage_files import named_in
from heli_bags.writer import METADATA, BagCause, BagError, reason
from heli_core.foreign_files import FileCause, FileError
from heli_core.rcl_yaml import printable
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of

# -------------------------------------------------------------------------------------------------
# Whether a bag is whole, in words for the user; found without reading its messages.
# -------------------------------------------------------------------------------------------------


def storage_files(bag: Path) -> list[Path]:
    """The .mcap and .db3 files of a folder, also those that are compressed as wholes."""
    return sorted(p for p in bag.iterdir() if storage_of(p) and p.is_file())


def listed_files(bag: Path) -> list[str]:
    """Names of the files that metadata.yaml lists; empty if there is none that can be read."""
    try:
        paths = information(bag)["relative_file_paths"]
        return [Path(str(path)).name for path in paths]
    except (FileError, TypeError, LookupError):
        return []


class TroubleKind(Enum):
    """What is wrong with a bag's files."""

    NO_MCAP = "a file is no MCAP file"
    CUT_OFF = "a file is cut off"
    NEVER_CLOSED = "a database was never closed"
    MISSING = "a file is missing"
    UNLISTED = "a file is not in the list of files"
    UNREADABLE = "the list of files cannot be read"


class Trouble(NamedTuple):
    """What is wrong, with which files, and in words."""

    kind: TroubleKind
    names: tuple[str, ...]
    sentence: str


def _file_trouble(path: Path) -> Trouble | None:
    name = path.name
    if path.suffix == PACKED:
        return None
    if path.suffix == ".mcap":
        with open(path, "rb") as stream:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                return Trouble(TroubleKind.NO_MCAP, (name,), f"{name} is no MCAP file")
            size = path.stat().st_size
            stream.seek(max(0, size - len(MCAP0_MAGIC)))
            whole = size > 2 * len(MCAP0_MAGIC) and stream.read() == MCAP0_MAGIC
        return None if whole else Trouble(TroubleKind.CUT_OFF, (name,), f"{name} is cut off")
    for tail in ("-wal", "-journal"):
        log = path.with_name(path.name + tail)
        if log.is_file() and log.stat().st_size:
            return Trouble(TroubleKind.NEVER_CLOSED, (name,), f"{name} was never closed")
    return None


def trouble_of(bag: Path) -> Trouble | None:
    """What is wrong with a bag that `heli bag repair` can restore; None if nothing is.

    Parameters
    ----------
    bag : Path
        rosbag2 folder or a storage file.
    """
    files = [bag] if bag.is_file() else storage_files(bag)
    for path in files:
        problem = _file_trouble(path)
        if problem:
            return problem
    if bag.is_file() or not files:
        return None
    if not (bag / METADATA).is_file():
        return Trouble(TroubleKind.MISSING, (METADATA,), f"{METADATA} is missing")
    try:
        information(bag)
    except FileError as error:
        where = f"{METADATA}, line {error.line}" if error.line else METADATA
        return Trouble(TroubleKind.UNREADABLE, (METADATA,), f"{where}: {error.problem}")
    listed = listed_files(bag)
    absent = [name for name in listed if not (bag / name).is_file()]
    if absent:
        sentence = f"{', '.join(absent)} of {METADATA} is missing"
        return Trouble(TroubleKind.MISSING, tuple(absent), sentence)
    unlisted = tuple(sorted({path.name for path in files} - set(listed)))
    if unlisted:
        sentence = f"{METADATA} does not list {', '.join(unlisted)}"
        return Trouble(TroubleKind.UNLISTED, unlisted, sentence)
    return None


def trouble(bag: Path) -> str:
    """The same in words; empty if nothing is."""
    what = trouble_of(bag)
    return what.sentence if what else ""


def advice(bag: Path) -> str:
    """One sentence on what is wrong and what restores it; empty if nothing is."""
    problem = trouble(bag)
    return f"{problem}; 'heli bag repair {bag}' restores what can be" if problem else ""


# -------------------------------------------------------------------------------------------------
# What readers raise on damaged bytes, as one sentence. No rclpy.
#
# The readers of `rosbags` and `mcap` trust a bag's bytes: on damaged ones they raise whatever the
# line at hand raises. So everything that they raise is taken for damage, and nothing of ours is.
# -------------------------------------------------------------------------------------------------

_Item = TypeVar("_Item")
_END = object()
ABOVE = (FileCause.TOO_LARGE, FileCause.TOO_MANY, FileCause.SPARSE)
_NEEDS_WORDS = (
    LookupError, AttributeError, TypeError, AssertionError, ArithmeticError, MemoryError,
    RecursionError,
)  # fmt: skip


def damage(path: Path, error: Exception) -> BagError:
    """The error for the user: one line that names the bag."""
    if isinstance(error, BagError):
        return error
    if isinstance(error, FileError):
        cause = BagCause.TOO_LARGE if error.cause in ABOVE else BagCause.DAMAGED
        return BagError(f"{path}: not a readable bag: {error}", cause)
    why = reason(error)
    if isinstance(error, _NEEDS_WORDS) and type(error).__module__ == "builtins":
        # Their texts are for programmers: a name, or nothing.
        kind = type(error).__name__
        why = f"it is damaged ({kind if why == kind else f'{kind}: {why}'})"
    return BagError(f"{path}: not a readable bag: {why}", BagCause.DAMAGED)


def guarded(path: Path, items: Iterable[_Item]) -> Iterator[_Item]:
    """The items of a library's iterator, whose every complaint is a BagError.

    Parameters
    ----------
    path : Path
        The bag, for the sentence.
    items : iterable
        What the library yields.
    """
    try:
        iterator = iter(items)
    except Exception as error:
        raise damage(path, error) from error
    while True:
        try:
            item = next(iterator, _END)
        except Exception as error:
            raise damage(path, error) from error
        if item is _END:
            return
        yield item  # type: ignore[misc]


def require_whole(path: Path) -> None:
    """Raise BagError, in one line, for what is no bag or one that needs `heli bag repair`."""
    if not path.exists():
        raise BagError(f"{path}: does not exist", BagCause.MISSING)
    try:
        if path.is_dir() and not storage_files(path) and not listed_files(path):
            sentence = f"{path}: not a readable bag: it holds neither .mcap nor .db3 files"
            raise BagError(sentence, BagCause.NO_BAG)
        if path.is_file() and not storage_of(path):
            sentence = f"{path}: not a readable bag: neither folder nor .mcap nor .db3 file"
            raise BagError(sentence, BagCause.NO_BAG)
        problem = advice(path)
    except OSError as error:
        raise damage(path, error) from error
    if problem:
        raise BagError(f"{path}: not a readable bag: {problem}", BagCause.NOT_WHOLE)


# -------------------------------------------------------------------------------------------------
# Types of topics.
# -------------------------------------------------------------------------------------------------

_IDL_PART = f"{'=' * 80}\n"


@lru_cache(maxsize=1)
def _standard() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


class _Unknown(Exception):
    """Why messages of a type cannot be taken apart."""


@lru_cache(maxsize=MOST_TOPICS)
def _store(type_name: str, kind: MessageDefinitionFormat, text: str, digest: str) -> Typestore:
    """What takes messages of a recorded type apart; raises _Unknown."""
    if kind == MessageDefinitionFormat.NONE:
        if type_name not in _standard().fielddefs:
            raise _Unknown(f"the bag has no definition of {type_name}" if type_name else "no type")
        return _standard()
    store = get_typestore(Stores.EMPTY)
    try:
        types: dict[str, Any] = {}
        if kind == MessageDefinitionFormat.MSG:
            types.update(get_types_from_msg(text, type_name))
        elif text.startswith(f"{_IDL_PART}IDL: "):
            for part in text.split(_IDL_PART)[1:]:
                types.update(get_types_from_idl(part.partition("\n")[2]))
        else:
            types.update(get_types_from_idl(text))
        # Not every recorder writes the definitions of what a type is made of.
        todo = list(types)
        while todo:
            for _, described in types[todo.pop()][1]:
                for name in named_in(described) - types.keys():
                    types[name] = _standard().fielddefs[name]
                    todo.append(name)
        store.register(types)
        known = store.hash_rihs01(type_name)
    except KeyError as error:
        raise _Unknown(f"its definition of {type_name} lacks {error}") from None
    except Exception:
        # Definitions of foreign recorders may be anything, and the parsers raise anything.
        raise _Unknown(f"its definition of {type_name} cannot be read") from None
    if digest and digest != known:
        raise _Unknown(f"its definition of {type_name} is not that of its messages: {digest:.20}")
    return store


def _store_of(connection: Connection) -> Typestore:
    """The same of a topic; raises _Unknown."""
    form = BagReader.form(connection)
    if form:
        raise _Unknown(form)
    definition = connection.msgdef
    return _store(connection.msgtype, definition.format, definition.data, connection.digest)


# -------------------------------------------------------------------------------------------------
# Flights of a bag: where its clock goes back, another one begins.
#
# Messages are looked at in the order in which they were written, before anything is sorted. One
# topic tells the time: /clock, else a stream of the graph, else the topic with most messages. Of a
# bag whose times are the wall clock's its stamps tell it. One message of another time is none of
# it; two in a row are.
# -------------------------------------------------------------------------------------------------

# A stream of one sender comes in order; of what else there is nobody knows.
_BACK_NS, _BACK_OF_OTHERS_NS = NS_PER_S // 10, NS_PER_S
_FIRST, _BEYOND = (-1, 0, 0), (1 << 63, 0, 0)
# Messages by which a bag's kind of time is told, and the bytes of a message with a stamp.
_LOOKED_AT, _LEAST_STAMPED = 20, 12


@dataclass(frozen=True)
class BagSpan:
    """One of the flights of a bag: stamps of the bag, ns, of its first message and behind its last.

    Where its messages were written tells them from those of another flight of the same stamps.
    """

    start_ns: int
    end_ns: int
    bounds: Bounds | None = None


def restarts(times_ns: NDArray[np.int64], back_ns: int) -> list[int]:
    """Numbers of the messages with which time begins anew.

    Parameters
    ----------
    times_ns : (N,) ndarray of int64
        In the order of writing.
    back_ns : int
        By how much it goes back at least.
    """
    t = times_ns
    later = np.flatnonzero(np.diff(t) < -back_ns) + 1
    return [
        int(i)
        for i in later
        if 1 < i < len(t) - 1
        and t[i] < t[i - 2] - back_ns
        and t[i] <= t[i + 1] < t[i - 1] - back_ns
    ]


_CLOCK_TYPE = topics.BY_NAME[topics.CLOCK].type
_STREAMS = [name for name in topics.SENDING_ORDER if is_stream(name)]


def _rank(c: Connection) -> int:
    """0 for a clock, then the graph's streams; behind them what is none."""
    if c.msgtype == _CLOCK_TYPE:
        return 0
    for place, name in enumerate(_STREAMS, 1):
        if c.topic.endswith(f"/{name}") and c.msgtype == topics.BY_NAME[name].type:
            return place
    return len(_STREAMS) + 1


def _teller(connections: Sequence[Connection]) -> Connection | None:
    """The topic that tells the time, if any has messages."""
    held = [c for c in connections if c.msgcount]
    return min(held, key=lambda c: (_rank(c), -c.msgcount), default=None)


class _Order(NamedTuple):
    """A topic's messages in the order of writing."""

    places: list[tuple[Place, NDArray[np.int64]]]
    log_ns: NDArray[np.int64]

    def place(self, number: int) -> Place:
        for piece, inside in self.places:
            if number < len(inside):
                return (*piece, int(inside[number]))
            number -= len(inside)
        return _BEYOND


def _order_of(files: BagFiles, connection: Connection) -> _Order:
    pieces = list(files.written([connection]))
    places = [(piece, rows.inside) for piece, rows in pieces]
    times = [rows.log_ns for _, rows in pieces] or [np.zeros(0, np.int64)]
    return _Order(places, np.concatenate(times))


def flights_of(files: BagFiles) -> list[BagSpan]:
    """Flights of an open bag, in the order in which they were recorded; at least one."""
    whole = [BagSpan(files.start_time, files.end_time)]
    teller = _teller(files.connections)
    if teller is None:
        return whole
    order = _order_of(files, teller)
    ours = _rank(teller) <= len(_STREAMS)
    if ours and _is_wall_time(files, teller):
        return _by_stamps(files, teller) or whole
    back_ns = _BACK_NS if ours else _BACK_OF_OTHERS_NS
    begins = restarts(order.log_ns, back_ns)
    if not begins:
        return whole
    spans = [part for part in np.split(order.log_ns, begins) if part.size]
    cuts = {
        c.id: _cuts(files, c, teller, [order.place(i) for i in begins]) for c in files.connections
    }
    return [
        BagSpan(
            int(part.min()), int(part.max()) + 1, {c: (at[k], at[k + 1]) for c, at in cuts.items()}
        )
        for k, part in enumerate(spans)
    ]


def _cuts(
    files: BagFiles, c: Connection, teller: Connection, places: Sequence[Place]
) -> list[Place]:
    """Where a topic's flights begin and end: where its own time goes back, if it does as often."""
    if c.id != teller.id and c.msgcount:
        own = _order_of(files, c)
        begins = restarts(own.log_ns, _BACK_NS)
        if len(begins) == len(places):
            places = [own.place(i) for i in begins]
    return [_FIRST, *places, _BEYOND]


def _is_wall_time(files: BagFiles, teller: Connection) -> bool:
    """Whether the bag's times are not those of its stamps, as the first messages have it."""
    rows = islice(files.messages([teller]), _LOOKED_AT)
    away = [abs(log_ns - stamp_of(raw)) > WINDOW_NS for _, log_ns, raw in rows if _has_stamp(raw)]
    return 2 * sum(away) > len(away)


def _has_stamp(raw: bytes) -> bool:
    return len(raw) >= _LEAST_STAMPED


def _by_stamps(files: BagFiles, teller: Connection) -> list[BagSpan]:
    """Flights of a bag in wall time, which goes on while the stamps go back."""
    pairs = [
        (log_ns, stamp_of(raw)) for _, log_ns, raw in files.messages([teller]) if _has_stamp(raw)
    ]
    times = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    begins = [int(times[i, 0]) for i in restarts(times[:, 1], _BACK_NS)]
    edges = [files.start_time, *begins, files.end_time]
    return [BagSpan(a, b) for a, b in zip(edges, edges[1:], strict=False)] if begins else []


# -------------------------------------------------------------------------------------------------
# The door.
# -------------------------------------------------------------------------------------------------


def bag_of(path: Path) -> Path:
    """The bag of a flight's folder, or the path itself."""
    return path / "bag" if (path / "bag").is_dir() else path


@dataclass(frozen=True)
class UnreadTopic:
    """Messages of a bag that cannot be read, and why."""

    topic: str
    messages: int
    why: str

    def __str__(self) -> str:
        return f"{self.topic or 'no topic'}: {self.messages} messages cannot be read: {self.why}"


class BagReader:
    """An open bag; whatever the libraries raise on damaged bytes is a BagError.

    Attributes
    ----------
    connections : list of Connection
        Topics, also those that cannot be read.
    message_count : int
        Messages of all flights.
    flights : list of BagSpan
        In the order of recording; one, unless the clock goes back.
    flight : BagSpan
        The one that is read.
    start_time, end_time : int
        Its stamps of the bag, ns, of the first message and behind the last.
    remarks : list of str
        What to know of it: which of several flights is read.
    """

    def __init__(self, path: Path, files: BagFiles, flight: int | None = None) -> None:
        self._path, self._files, self._kept = path, files, Kept(path)
        try:
            self.connections = files.connections
            self.flights = flights_of(files)
        except Exception as error:
            raise damage(path, error) from error
        count = len(self.flights)
        if flight is not None and not 1 <= flight <= count:
            held = "1 flight" if count == 1 else f"{count} flights"
            raise BagError(f"{path}: it holds {held}; --flight {flight} is none", BagCause.OPTION)
        self.flight = self.flights[count - 1 if flight is None else flight - 1]
        self.message_count = files.message_count
        self.start_time, self.end_time = self.flight.start_ns, self.flight.end_ns
        self.remarks: list[str] = []
        if count > 1:
            which = "the last" if flight is None else f"number {flight}"
            span = " to ".join(f"{t / NS_PER_S:.2f}" for t in (self.start_time, self.end_time))
            self.remarks.append(
                f"its clock goes back: it holds {count} flights; read is {which}, {span} s of the "
                "bag; --flight N names one"
            )
        self._is_part = count > 1 and flight is None
        self._lost: dict[str, tuple[int, str]] = {}
        for name, missing in files.missing.items():
            self._lose(name, missing, f"{METADATA} counts them, the files do not hold them")
        if files.nameless > 0:
            self._lose("", files.nameless, "they are of no topic of the bag")

    def _lose(self, topic: str, count: int, why: str) -> None:
        before, first = self._lost.get(topic, (0, why))
        self._lost[topic] = before + count, first

    def lose(self, connection: Connection, error: Exception) -> None:
        """Count a message that could not be taken apart; the first one's error is told."""
        why = str(error).removeprefix(f"{self._path}: ").removeprefix("not a readable bag: ")
        self._lose(connection.topic, 1, why)

    def unread(self, connections: Collection[Connection] = ()) -> list[UnreadTopic]:
        """What of the topics (of all, if none is named) cannot be read, as far as is known now."""
        chosen_ones = connections or self.connections
        found = []
        for c in chosen_ones:
            why = self.obstacle(c)
            if why and c.msgcount:
                found.append(UnreadTopic(c.topic, c.msgcount, why))
        return [*found, *self.lost(chosen_ones)]

    def lost(self, connections: Collection[Connection]) -> list[UnreadTopic]:
        """What of the topics was listed and is not there, or could not be taken apart."""
        names = {c.topic for c in connections} | {""}
        return [UnreadTopic(name, *row) for name, row in self._lost.items() if name in names]

    def shortfall(self, connections: Collection[Connection] = ()) -> list[str]:
        """Why less was read of the topics than the bag lists, and nobody asked for less."""
        part = self.remarks if self._is_part else []
        return [*part, *map(str, self.unread(connections))]

    def shortfall_of_files(self, connections: Collection[Connection]) -> list[str]:
        """The same for whoever takes no message apart."""
        part = self.remarks if self._is_part else []
        return [*part, *map(str, self.lost(connections))]

    @staticmethod
    def form(connection: Connection) -> str:
        """Why a topic's messages are not in the form that ROS gives them; empty if they are."""
        kind = cast(ConnectionExtRosbag2, connection.ext).serialization_format
        return "" if kind == "cdr" else f"its messages are {printable(kind) or 'of no known form'}"

    def obstacle(self, connection: Connection) -> str:
        """Why a topic's messages cannot be taken apart; empty if they can."""
        try:
            _store_of(connection)
        except _Unknown as error:
            return str(error)
        return ""

    @property
    def duration(self) -> int:
        """Time between the first message and behind the last, ns."""
        return max(0, self.end_time - self.start_time)

    def messages(
        self,
        connections: Collection[Connection] = (),
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Connection, stamp of the bag (ns), bytes; of the flight, in the order of the stamps."""
        whole = len(self.flights) == 1
        counts: Counter[int] = Counter()
        first, beyond = start, stop
        if not whole and self.flight.bounds is None:
            first = max(self.start_time, first or 0)
            beyond = min(self.end_time, self.end_time if beyond is None else beyond)
        rows = self._files.messages(connections, first, beyond, self.flight.bounds)
        for c, stamp_ns, raw in guarded(self._path, rows):
            counts[c.id] += 1
            yield c, stamp_ns, raw
        if whole and start is None and stop is None:
            for c in connections or self.connections:
                if counts[c.id] < c.msgcount:
                    why = f"the files list {c.msgcount} and hold {counts[c.id]}"
                    self._lose(c.topic, c.msgcount - counts[c.id], why)

    def keep(self, raw: bytes, cost: int = 1) -> None:
        """Count a message of which so many times its bytes are kept; BagError if it is too much."""
        try:
            self._kept.keep(len(raw) * cost)
        except FileError as error:
            raise damage(self._path, error) from error

    def deserialize(self, connection: Connection, raw: bytes) -> Any:
        """The message object; raises BagError."""
        try:
            store = _store_of(connection)
        except _Unknown as error:
            sentence = f"{self._path}: {connection.topic} cannot be read: {error}"
            raise BagError(sentence, BagCause.TOPIC) from None
        try:
            return store.deserialize_cdr(checked_message(raw), connection.msgtype)
        except Exception as error:
            raise damage(self._path, error) from error


@contextlib.contextmanager
def opened(path: Path, flight: int | None = None) -> Iterator[BagReader]:
    """Reader of a bag, whoever recorded it.

    Parameters
    ----------
    path : Path
        rosbag2 folder, one of its files, or a flight's folder with `bag/`.
    flight : int, optional
        Which flight of it, from 1 on; default: the last.

    Raises
    ------
    BagError
        Not a bag, cut off, or unreadable; no such flight: one line that names it.
    """
    path = bag_of(path)
    require_whole(path)
    with contextlib.ExitStack() as stack:
        try:
            files = stack.enter_context(budgeted(path))
            files.open()
        except Exception as error:
            raise damage(path, error) from error
        stack.callback(files.close)
        yield BagReader(path, files, flight)


def chosen(
    reader: BagReader, path: Path, names: Sequence[str] = (), exclude: Sequence[str] = ()
) -> list[Connection]:
    """Connections of the named topics, of all if none is named.

    Raises
    ------
    BagError
        The bag has no such topic, or one that is named cannot be read.
    """
    present = {c.topic for c in reader.connections}

    def full(name: str) -> str:
        for candidate in (name, f"/{name}"):
            if candidate in present:
                return candidate
        raise BagError(
            f"{bag_of(path)}: holds no topic {name}; it holds {', '.join(sorted(present))}",
            BagCause.TOPIC,
        )

    wanted = {full(name) for name in names} or present
    left_out = {full(name) for name in exclude}
    return [c for c in reader.connections if c.topic in wanted - left_out]


def require_readable(reader: BagReader, path: Path, names: Sequence[str] = ()) -> None:
    """Raise BagError, in one line, if a topic that is named cannot be read."""
    for c in chosen(reader, path, names) if names else ():
        why = reader.obstacle(c)
        if why:
            sentence = f"{bag_of(path)}: {c.topic} cannot be read: {why}"
            raise BagError(sentence, BagCause.TOPIC)
