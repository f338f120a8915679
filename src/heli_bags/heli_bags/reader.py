# SPDX-License-Identifier: Apache-2.0
"""A bag of the graph as arrays (NED/FRD), without ROS; also bags that `ros2 bag record` made."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.typesys import Stores, get_typestore

from heli_bags.check import advice, listed_files, storage_files
from heli_bags.folder import SUFFIXES, BagError, reason
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.frames import Datum
from heli_msgs_bridge.messages import CHANNELS, Decoder, MessageError
from heli_msgs_bridge.reference_message import decode_reference


@dataclass(frozen=True)
class Stream:
    """Messages of one topic: stamps (N,) int64 ns and the cores' arrays (N, size)."""

    stamp_ns: NDArray[np.int64]
    rows: NDArray[np.float64]


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
    references : list of Trajectory
    remarks : list of Remark
        In the order of their stamps; of the bag's aircraft, though /diagnostics carries others.
    refused : dict
        Topic to number of messages that could not be used.
    reasons : dict
        Topic to why the first of them could not.
    foreign : list of str
        Topics that are not of the graph.
    """

    streams: dict[str, Stream] = field(default_factory=dict)
    references: list[Trajectory] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    foreign: list[str] = field(default_factory=list)


def _graph_name(recorded: str, msgtype: str) -> str | None:
    """Relative name of a recorded topic whatever its namespace; None if it is not of the graph."""
    fitting = [
        topic.name
        for topic in topics.TABLE
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
    found = []
    for status in message.status:
        namespace, _, node = status.name.rpartition("/")
        if not namespaces or namespace.strip("/") in namespaces:
            facts = {pair.key: pair.value for pair in status.values}
            found.append(Remark(stamp_ns, node, int(status.level), status.message, facts))
    return found


class _Collector:
    """Fills a Bag message by message."""

    def __init__(self, datum: Datum | None) -> None:
        self.bag = Bag()
        self.namespaces: frozenset[str] = frozenset()
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._datum = datum
        self._decoders: dict[str, Decoder] = {}
        self._stamps: dict[str, list[int]] = {}
        self._rows: dict[str, list[NDArray[np.float64]]] = {}

    def _decoder(self, name: str) -> Decoder:
        if name not in self._decoders:
            type_name = topics.BY_NAME[name].type
            datum = self._datum if name == topics.GPS_FIX else None
            self._decoders[name] = Decoder(
                name, datum, lambda raw: self._store.deserialize_cdr(raw, type_name)
            )
            self._stamps[name], self._rows[name] = [], []
        return self._decoders[name]

    def take(self, name: str, raw: bytes) -> None:
        """One message of the graph."""
        type_name = topics.BY_NAME[name].type
        try:
            if name == topics.REFERENCE:
                message = self._store.deserialize_cdr(raw, type_name)
                self.bag.references.append(decode_reference(message))
            elif name == topics.DIAGNOSTICS:
                self.bag.remarks += _remarks(
                    self._store.deserialize_cdr(raw, type_name), self.namespaces
                )
            elif name in CHANNELS and (name != topics.GPS_FIX or self._datum is not None):
                decoder = self._decoder(name)
                row = decoder.decode(raw).copy()
                self._stamps[name].append(decoder.stamp_ns)
                self._rows[name].append(row)
        except MessageError as error:
            self.bag.reasons.setdefault(name, str(error).removeprefix(f"{name}: "))
            self.bag.refused[name] = self.bag.refused.get(name, 0) + 1

    def finish(self) -> Bag:
        """Lists into arrays, ordered by stamp."""
        for name, rows in self._rows.items():
            stamps = np.array(self._stamps[name], dtype=np.int64)
            order = np.argsort(stamps, kind="stable")
            array = np.array(rows).reshape(len(rows), CHANNELS[name].size)
            self.bag.streams[name] = Stream(stamps[order], array[order])
        self.bag.remarks.sort(key=lambda remark: remark.stamp_ns)
        return self.bag


def require_whole(path: Path) -> None:
    """Raise BagError, in one line, for what is no bag or one that needs `heli bag repair`."""
    if not path.exists():
        raise BagError(f"{path}: does not exist")
    try:
        if path.is_dir() and not storage_files(path) and not listed_files(path):
            raise BagError(f"{path}: not a readable bag: it holds neither .mcap nor .db3 files")
        if path.is_file() and path.suffix not in SUFFIXES.values():
            raise BagError(f"{path}: not a readable bag: neither folder nor .mcap nor .db3 file")
        said = advice(path)
    except OSError as error:
        raise BagError(f"{path}: not a readable bag: {reason(error)}") from error
    if said:
        raise BagError(f"{path}: not a readable bag: {said}")


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
    collector = _Collector(datum)
    try:
        with Reader(path) as reader:
            names = {c.id: _graph_name(c.topic, c.msgtype) for c in reader.connections}
            collector.namespaces = _namespaces({c.topic: names[c.id] for c in reader.connections})
            collector.bag.foreign = sorted(
                c.topic for c in reader.connections if names[c.id] is None
            )
            for connection, _, raw in reader.messages():
                name = names[connection.id]
                if name is not None:
                    collector.take(name, raw)
    except (ReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise BagError(f"{path}: not a readable bag: {reason(error)}") from error
    return collector.finish()
