# SPDX-License-Identifier: Apache-2.0
"""A bag of the graph as arrays (NED/FRD), without ROS; also bags that `ros2 bag record` made."""

import contextlib
import gc
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from heli_bags.storage import PACKED, Kept, budgeted, checked_message, storage_of
from heli_bags.writer import LATE, METADATA, WINDOW_NS, BagCause, BagError, reason
from heli_core.foreign_files import FileCause, FileError, read_yaml
from heli_core.rcl_yaml import printable
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import decode_reference, key_of
from heli_msgs_bridge.diagnostics import ways_of
from heli_msgs_bridge.frames import Datum
from heli_msgs_bridge.layouts import CHANNELS, MessageCause, MessageError
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.signatures import SUM, checksum

# -------------------------------------------------------------------------------------------------
# Whether a bag is whole, in words for the user; found without reading its messages.
# -------------------------------------------------------------------------------------------------


def storage_files(bag: Path) -> list[Path]:
    """The .mcap and .db3 files of a folder, also those that are compressed as wholes."""
    return sorted(p for p in bag.iterdir() if storage_of(p) and p.is_file())


def listed_files(bag: Path) -> list[str]:
    """Names of the files that metadata.yaml lists; empty if there is none that can be read."""
    try:
        content = read_yaml(bag / METADATA)
        paths = content["rosbag2_bagfile_information"]["relative_file_paths"]
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


# -------------------------------------------------------------------------------------------------
# Reader.
# -------------------------------------------------------------------------------------------------

# A bag may begin with the moment at which its first message arrived, not with its stamp.
_EARLY_NS = NS_PER_S // 10
# Texts, of which /diagnostics is made, become so many times their bytes.
_REMARK_COST = 8


@dataclass(frozen=True)
class Stream:
    """Messages of one topic: stamps (N,) int64 ns and the cores' arrays (N, size).

    Of the ground truth also the sums (N,) of their bytes (`heli_msgs_bridge.node_process`).
    """

    stamp_ns: NDArray[np.int64]
    rows: NDArray[np.float64]
    sums: NDArray[np.uint64] | None = None


@dataclass(frozen=True)
class Remark:
    """One status out of /diagnostics."""

    stamp_ns: int
    node: str
    level: int
    message: str
    facts: dict[str, str]


@dataclass
class Bag:
    """What a bag holds of the graph.

    Attributes
    ----------
    streams : dict
        Topic name (relative, as in `topics.TABLE`) to its Stream.
    references : list of (int, Trajectory)
        In the order in which they came, each with the time from which it counts, ns: as the outer
        loop tells it, else the bag's time of it.
    remarks : list of Remark
        In the order of their stamps; of the bag's aircraft, though /diagnostics carries others.
    refused : dict
        Topic to number of messages that could not be used.
    reasons : dict
        Topic to why the first of them could not.
    foreign : list of str
        Topics that are not of the graph.
    aircraft : str
        Namespace of the graph's topics (several: with commas between); empty for none.
    """

    streams: dict[str, Stream] = field(default_factory=dict)
    references: list[tuple[int, Trajectory]] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    foreign: list[str] = field(default_factory=list)
    aircraft: str = ""


def _graph_name(
    recorded: str, msgtype: str, table: tuple[topics.Topic, ...] = topics.TABLE
) -> str | None:
    """Relative name of a recorded topic whatever its namespace; None if it is not of the table."""
    fitting = [
        topic.name
        for topic in table
        if msgtype == topic.type and recorded.endswith(f"/{topic.name.lstrip('/')}")
    ]
    # "ground_truth/odom" and "excitation/actuators" end like "odom" and "actuators".
    return max(fitting, key=len, default=None)


def _namespaces(names: Mapping[str, str | None]) -> frozenset[str]:
    """Namespaces of the aircraft in a bag: those of its topics, by recorded and relative name."""
    return frozenset(
        recorded.removesuffix(name).strip("/")
        for recorded, name in names.items()
        if name is not None and not name.startswith("/")
    )


def _remarks(message: Any, namespaces: Collection[str]) -> list[Remark]:
    """What nodes of these namespaces say; without any, what all say."""
    stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
    remarks = []
    for status in message.status:
        namespace, _, node = status.name.rpartition("/")
        if not namespaces or namespace.strip("/") in namespaces:
            facts = {pair.key: pair.value for pair in status.values}
            remarks.append(Remark(stamp_ns, node, int(status.level), status.message, facts))
    return remarks


class _Collector:
    """Fills a Bag message by message."""

    def __init__(self, datum: Datum | None, kept: Kept) -> None:
        self.bag = Bag()
        self._kept = kept
        self.namespaces: frozenset[str] = frozenset()
        self.start_ns, self._end_ns, self._in_flight_time = 0, 0, False
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._datum = datum
        self._decoders: dict[str, Decoder] = {}
        self._stamps: dict[str, list[tuple[int, int]]] = {}
        self._remarks: list[tuple[int, Remark]] = []
        self._rows: dict[str, list[NDArray[np.float64]]] = {}
        self._sums: list[bytes] = []
        self._keys: list[int] = []

    def _decoder(self, name: str) -> Decoder:
        if name not in self._decoders:
            type_name = topics.BY_NAME[name].type
            datum = self._datum if name == topics.GPS_FIX else None
            self._decoders[name] = Decoder(
                name,
                datum,
                lambda raw: self._store.deserialize_cdr(checked_message(raw), type_name),
            )
            self._stamps[name], self._rows[name] = [], []
        return self._decoders[name]

    def take(self, name: str, bag_ns: int, raw: bytes) -> None:
        """One message of the graph, and the bag's time of it."""
        self._end_ns = max(self._end_ns, bag_ns)
        self._kept.keep(len(raw) * (_REMARK_COST if name == topics.DIAGNOSTICS else 1))
        try:
            if name == topics.REFERENCE:
                message = self._deserialized(name, raw)
                self.bag.references.append((bag_ns, decode_reference(message)))
                self._keys.append(key_of(message))
            elif name == topics.DIAGNOSTICS:
                remarks = _remarks(self._deserialized(name, raw), self.namespaces)
                self._remarks += [(bag_ns, remark) for remark in remarks]
            elif name in CHANNELS and (name != topics.GPS_FIX or self._datum is not None):
                decoder = self._decoder(name)
                row = decoder.decode(raw)[: CHANNELS[name].size].copy()
                self._stamps[name].append((bag_ns, decoder.stamp_ns))
                self._rows[name].append(row)
                if name == topics.TRUTH_ODOM:
                    self._sums.append(checksum(raw))
        except MessageError as error:
            self._refuse(name, 1, str(error).removeprefix(f"{name}: "))

    def _deserialized(self, name: str, raw: bytes) -> Any:
        try:
            return self._store.deserialize_cdr(checked_message(raw), topics.BY_NAME[name].type)
        except Exception as error:
            # rosbags trusts the bytes: it raises whatever they lead to.
            problem = f"cannot be deserialised: {reason(error)}"
            raise MessageError(problem, MessageCause.UNREADABLE, topic=name) from error

    def _refuse(self, name: str, count: int, why: str) -> None:
        self.bag.reasons.setdefault(name, why)
        self.bag.refused[name] = self.bag.refused.get(name, 0) + count

    def _is_in_flight_time(self) -> bool:
        """Whether the bag's times are those of the stamps, as our recorder writes them.

        `ros2 bag record` has the wall clock's unless it is told `--use-sim-time`.
        """
        times = [np.array(pairs, dtype=np.int64) for pairs in self._stamps.values() if pairs]
        if not times:
            return False
        both = np.concatenate(times)
        return bool(np.median(np.abs(both[:, 0] - both[:, 1])) <= WINDOW_NS)

    def _fits(self, name: str, bag_ns: int, stamp_ns: int) -> bool:
        """Whether a stamp is of the flight's time."""
        if not self._in_flight_time:
            return stamp_ns >= 0
        if name in LATE:
            # Other recorders put it where they heard it: seconds later if DDS had to repeat it.
            return self.start_ns - WINDOW_NS <= stamp_ns <= bag_ns + WINDOW_NS
        begun = stamp_ns >= self.start_ns - _EARLY_NS
        if name == topics.DIAGNOSTICS:
            # Said in order; on loaded cores heard seconds late, or before the messages that tell
            # the recorder the time. Put where it was heard it would change places with others.
            return begun and stamp_ns <= self._end_ns + WINDOW_NS
        return begun and abs(bag_ns - stamp_ns) <= WINDOW_NS

    def finish(self) -> Bag:
        """Lists into arrays, ordered by stamp; without messages stamped in another time."""
        self._in_flight_time = self._is_in_flight_time()
        for name, rows in self._rows.items():
            times = np.array(self._stamps[name], dtype=np.int64).reshape(-1, 2)
            array = np.array(rows).reshape(len(rows), CHANNELS[name].size)
            fits = np.array([self._fits(name, *pair) for pair in times.tolist()], dtype=bool)
            if not fits.all():
                at, stamp = times[np.argmin(fits)] / NS_PER_S
                why = f"stamped {stamp:.2f} s, recorded at {at:.2f} s"
                self._refuse(name, int(np.count_nonzero(~fits)), why)
            stamps, array = times[fits, 1], array[fits]
            order = np.argsort(stamps, kind="stable")
            sums = None
            if name == topics.TRUTH_ODOM:
                sums = np.frombuffer(b"".join(self._sums), SUM)[fits][order]
            self.bag.streams[name] = Stream(stamps[order], array[order], sums)
        self.bag.remarks = [
            remark
            if self._fits(topics.DIAGNOSTICS, bag_ns, remark.stamp_ns)
            else replace(remark, stamp_ns=bag_ns)
            for bag_ns, remark in self._remarks
        ]
        self.bag.remarks.sort(key=lambda remark: remark.stamp_ns)
        if not self._in_flight_time:
            self.bag.references = [(way.start_ns, way) for _, way in self.bag.references]
        self._date_references()
        return self.bag

    def _date_references(self) -> None:
        """Have references count from when they were followed, not from when they were recorded.

        On loaded cores that is seconds later, of flight time that runs ten times as fast.
        """
        followed_ns: dict[int, list[int]] = {}
        for since_ns, key in sorted({w for r in self.bag.remarks for w in ways_of(r.facts)}):
            followed_ns.setdefault(key, []).append(since_ns)
        for index, key in enumerate(self._keys):
            if followed_ns.get(key):
                way = self.bag.references[index][1]
                self.bag.references[index] = followed_ns[key].pop(0), way


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


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Pause the search for cyclic garbage: it would look through all that is read, many times."""
    paused = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if paused:
            gc.enable()


def read_bag(path: str | Path, datum: Datum | None = None) -> Bag:
    """Read a bag of the graph.

    Parameters
    ----------
    path : path
        rosbag2 folder (MCAP or SQLite).
    datum : Datum, optional
        Origin for `gps/fix`; without it fixes are left out.

    Returns
    -------
    Bag

    Raises
    ------
    BagError
        Not a bag, cut off, or unreadable: one line that names it.
    """
    path = Path(path)
    require_whole(path)
    with _uncollected():
        return _read(path, datum)


def _read(path: Path, datum: Datum | None) -> Bag:
    """A bag that is whole; raises as `read_bag`."""
    collector = _Collector(datum, Kept(path))
    with contextlib.ExitStack() as stack:
        try:
            reader = stack.enter_context(budgeted(path))
            reader.open()
        except Exception as error:
            raise damage(path, error) from error
        stack.enter_context(contextlib.closing(reader))
        names = {c.id: _graph_name(c.topic, c.msgtype) for c in named(path, reader.connections)}
        collector.namespaces = _namespaces({c.topic: names[c.id] for c in reader.connections})
        collector.bag.aircraft = ", ".join(sorted(collector.namespaces - {""}))
        collector.start_ns = reader.start_time
        collector.bag.foreign = sorted(
            c.topic
            for c in reader.connections
            if names[c.id] is None and _graph_name(c.topic, c.msgtype, topics.TOOLS) is None
        )
        for connection, bag_ns, raw in guarded(path, reader.messages()):
            name = names[connection.id]
            if name is not None:
                try:
                    collector.take(name, bag_ns, raw)
                except FileError as error:
                    raise damage(path, error) from error
    return collector.finish()


def named(path: Path, connections: Sequence[Connection]) -> Sequence[Connection]:
    """The connections of a bag; BagError where one is none: metadata.yaml may say anything."""
    for c in connections:
        texts = (c.topic, c.msgtype, c.digest)
        if not (all(isinstance(text, str) for text in texts) and isinstance(c.msgcount, int)):
            fields = ", ".join(printable(repr(value)) for value in (*texts, c.msgcount))
            sentence = f"{path}: not a readable bag: its list of topics is damaged: {fields}"
            raise BagError(sentence, BagCause.DAMAGED)
    return connections
