# SPDX-License-Identifier: Apache-2.0
"""A bag of the graph as arrays (NED/FRD), without ROS; also bags that `ros2 bag record` made."""

import contextlib
import gc
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from heli_bags.bag_clock import LATE, WINDOW_NS
from heli_bags.opening import opened
from heli_bags.storage import checked_message
from heli_bags.writer import reason
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
    flights : int
        How many flights the bag holds: several if its clock goes back.
    notes : list of str
        What to know of the bag: which of its flights was read, what of the graph could not be.
    aircraft : str
        Namespace of the graph's topics (several: with commas between); empty for none.
    """

    streams: dict[str, Stream] = field(default_factory=dict)
    references: list[tuple[int, Trajectory]] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    foreign: list[str] = field(default_factory=list)
    flights: int = 1
    notes: list[str] = field(default_factory=list)
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

    def __init__(self, datum: Datum | None) -> None:
        self.bag = Bag()
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
            self.refuse(name, 1, str(error).removeprefix(f"{name}: "))

    def _deserialized(self, name: str, raw: bytes) -> Any:
        try:
            return self._store.deserialize_cdr(checked_message(raw), topics.BY_NAME[name].type)
        except Exception as error:
            # rosbags trusts the bytes: it raises whatever they lead to.
            problem = f"cannot be deserialised: {reason(error)}"
            raise MessageError(problem, MessageCause.UNREADABLE, topic=name) from error

    def refuse(self, name: str, count: int, why: str) -> None:
        """Count messages of a topic that could not be used."""
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
                self.refuse(name, int(np.count_nonzero(~fits)), why)
            stamps, array = times[fits, 1], array[fits]
            order = np.argsort(stamps, kind="stable")
            sums = None
            if name == topics.TRUTH_ODOM:
                sums = np.frombuffer(b"".join(self._sums), SUM)[fits][order]
            self.bag.streams[name] = self._once(name, Stream(stamps[order], array[order], sums))
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

    def _once(self, name: str, stream: Stream) -> Stream:
        """A stream without messages that are in the bag twice, which are counted."""
        again = np.zeros(stream.stamp_ns.size, dtype=bool)
        if again.size:
            again[1:] = stream.stamp_ns[1:] == stream.stamp_ns[:-1]
            again[1:] &= (stream.rows[1:] == stream.rows[:-1]).all(axis=1)
        if stream.sums is not None:
            again[1:] &= stream.sums[1:] == stream.sums[:-1]
        if not again.any():
            return stream
        self.bag.notes.append(f"{name}: {np.count_nonzero(again)} messages are in it twice")
        sums = None if stream.sums is None else stream.sums[~again]
        return Stream(stream.stamp_ns[~again], stream.rows[~again], sums)

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


def read_bag(path: str | Path, datum: Datum | None = None, flight: int | None = None) -> Bag:
    """Read a bag of the graph.

    Parameters
    ----------
    path : path
        rosbag2 folder (MCAP or SQLite).
    datum : Datum, optional
        Origin for `gps/fix`; without it fixes are left out.
    flight : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Returns
    -------
    Bag

    Raises
    ------
    BagError
        Not a bag, cut off, or unreadable; no such flight: one line that names it.
    """
    with _uncollected():
        return _read(Path(path), datum, flight)


def _read(path: Path, datum: Datum | None, flight: int | None) -> Bag:
    """As `read_bag`."""
    collector = _Collector(datum)
    with opened(path, flight) as reader:
        names = {c.id: _graph_name(c.topic, c.msgtype) for c in reader.connections}
        collector.namespaces = _namespaces({c.topic: names[c.id] for c in reader.connections})
        bag = collector.bag
        bag.aircraft = ", ".join(sorted(collector.namespaces - {""}))
        collector.start_ns = reader.start_time
        bag.flights = len(reader.flights)
        bag.foreign = sorted(
            {
                c.topic
                for c in reader.connections
                if names[c.id] is None and _graph_name(c.topic, c.msgtype, topics.TOOLS) is None
            }
        )
        wanted = []
        for c in reader.connections:
            name = names[c.id]
            if name is None:
                continue
            why = reader.form(c)
            if why and c.msgcount:
                collector.refuse(name, c.msgcount, why)
            elif not why:
                wanted.append(c)
        for connection, bag_ns, raw in reader.messages(wanted) if wanted else ():
            name = str(names[connection.id])
            reader.keep(raw, _REMARK_COST if name == topics.DIAGNOSTICS else 1)
            collector.take(name, bag_ns, raw)
        finished = collector.finish()
        finished.notes = [
            *reader.remarks,
            *finished.notes,
            *(str(row) for row in reader.lost([c for c in reader.connections if names[c.id]])),
            *(
                f"{name}: {count} messages cannot be used: {finished.reasons[name]}"
                for name, count in finished.refused.items()
            ),
        ]
    return finished
