# SPDX-License-Identifier: Apache-2.0
"""Serialised messages into a rosbag2 folder (MCAP), without a ROS installation. No rclpy here.

The file grows by chunks of 1 MiB, each complete in itself: what was chunked before a power cut or a
`kill -9` can be read again.
"""

import contextlib
from collections.abc import Iterable
from pathlib import Path

from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of

_BAG_VERSION = 9
_FOREVER = QosTime(9223372036, 854775807)
# A fix is stamped with its time of validity; in a bag it belongs where it arrived.
_LATE = (topics.GPS_FIX, topics.GPS_VELOCITY)


class BagError(Exception):
    """A bag cannot be written or read; the message is one line that names it."""


def _qos(topic: topics.Topic) -> Qos:
    durability = QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE
    return Qos(
        QosHistory.KEEP_LAST,
        1 if topic.latched else topics.DEPTH,
        QosReliability.RELIABLE,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


class BagRecorder:
    """Writes the graph's topics to a new bag.

    Parameters
    ----------
    folder : path
        rosbag2 folder to make; must not exist.
    names : iterable of str
        Topics of `topics.TABLE`.
    namespace : str
        Put before relative names, "/" by default.
    zstd : bool
        Compress the chunks.

    Raises
    ------
    BagError
        The folder exists or cannot be written.

    Attributes
    ----------
    counts : dict
        Messages written per topic.
    """

    def __init__(
        self, folder: str | Path, names: Iterable[str], namespace: str = "/", zstd: bool = False
    ) -> None:
        self.folder = Path(folder)
        if self.folder.exists():
            raise BagError(f"{folder}: exists already; a bag needs a new folder")
        store = get_typestore(Stores.ROS2_JAZZY)
        self._writer = Writer(self.folder, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
        if zstd:
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        try:
            self._writer.open()
        except OSError as error:
            raise BagError(f"{folder}: cannot be written: {error.strerror}") from error
        self._connections = {}
        for name in names:
            topic = topics.BY_NAME[name]
            full = name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"
            self._connections[name] = self._writer.add_connection(
                full, topic.type, typestore=store, offered_qos_profiles=[_qos(topic)]
            )
        self.counts = dict.fromkeys(self._connections, 0)
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._newest_ns = 0
        self._failed = ""

    def write(self, name: str, raw: bytes) -> None:
        """Write a serialised message, stamped in simulation time.

        Raises
        ------
        BagError
            The disk is full or gone; said once, later messages are dropped silently.
        """
        if self._failed:
            return
        stamp_ns = stamp_of(raw)
        if name in _LATE:
            stamp_ns = max(stamp_ns, self._newest_ns)
        elif stamp_ns > self._newest_ns:
            self._newest_ns = stamp_ns
        try:
            self._writer.write(self._connections[name], stamp_ns, raw)
        except OSError as error:
            self._failed = f"{self.folder}: recording stopped: {error.strerror}"
            raise BagError(self._failed) from error
        self.counts[name] += 1
        self._first.setdefault(name, stamp_ns)
        self._last[name] = max(stamp_ns, self._last.get(name, 0))

    def missing(self) -> list[str]:
        """Topics with a fixed rate of which a message of the middle or of the end has not come."""
        found = []
        for name, last in self._last.items():
            period_ns = topics.BY_NAME[name].every_ticks * topics.TICK_NS
            if not period_ns:
                continue
            expected = (last - self._first[name]) // period_ns + 1
            if self.counts[name] < expected or last <= self._newest_ns - period_ns:
                found.append(name)
        return found

    def close(self) -> None:
        """Write index and metadata; the bag opens everywhere then.

        Raises
        ------
        BagError
            They could not be written; the chunks that are on the disk stay readable.
        """
        try:
            self._writer.close()
        except OSError as error:
            with contextlib.suppress(OSError):
                self._writer.abort()
            raise BagError(f"{self.folder}: index not written: {error.strerror}") from error
