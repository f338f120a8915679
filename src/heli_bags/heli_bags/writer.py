# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 folder that is being written: storage files, splitting, metadata.yaml. No rclpy."""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2.metadata import dump_qos_v9

from heli_bags.files import McapFile, SqliteFile, StorageFile
from heli_parameters.printable import printable

BAG_VERSION = 9
METADATA = "metadata.yaml"
SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}
_RESERVE = ".reserve"
# Room for index and metadata of hours of flight, given back when the disk is full.
_RESERVE_BYTES = 2 * 2**20
# At most that much is lost when the disk fills up, however fast the messages come.
_FLUSH_BYTES = 2**19
_NEVER_NS = 2**63 - 1


class BagError(Exception):
    """A bag cannot be written or read; the message is one line that names it."""


def reason(error: Exception) -> str:
    """Why a file could not be written or read, in a few words."""
    strerror = getattr(error, "strerror", None)
    lines = str(error).strip().splitlines()
    return printable(str(strerror or (lines[0] if lines else type(error).__name__)))


def custom_data(entries: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Names and texts of entries `name: text`; `none` says nothing.

    Raises
    ------
    BagError
        An entry has no name.
    """
    pairs = []
    for entry in entries:
        name, colon, text = entry.partition(":")
        if entry == "none":
            continue
        if not colon or not name.strip():
            raise BagError(f"custom_data: {entry!r} is not allowed; allowed: 'name: text', or none")
        pairs.append((name.strip(), text.strip()))
    return tuple(pairs)


@dataclass(frozen=True)
class Format:
    """How a bag is stored.

    Attributes
    ----------
    storage : str
        "mcap" or "sqlite3".
    zstd : bool
        Compress the chunks (MCAP only).
    split_bytes, split_ns : int
        Begin a new file at this size or after this span of stamps; 0 for never.
    custom_data : tuple of (str, str)
        Names and texts for metadata.yaml.
    """

    storage: str = "mcap"
    zstd: bool = False
    split_bytes: int = 0
    split_ns: int = 0
    custom_data: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.storage not in SUFFIXES:
            raise BagError(f"storage: {self.storage} is none of {', '.join(SUFFIXES)}")
        if self.zstd and self.storage != "mcap":
            raise BagError(f"compression: zstd is for storage mcap, not for {self.storage}")


@dataclass(frozen=True)
class Channel:
    """One topic of a bag: full name, type, definition (ros2msg or ros2idl), hash, QoS."""

    topic: str
    type: str
    definition: str
    hash: str
    qos: tuple[Qos, ...] = ()
    idl: bool = False


@dataclass
class _Part:
    """What metadata.yaml says of one file."""

    path: str
    start_ns: int = _NEVER_NS
    end_ns: int = 0
    counts: dict[int, int] = field(default_factory=dict)

    def info(self) -> dict[str, Any]:
        count = sum(self.counts.values())
        return {
            "path": self.path,
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": max(0, self.end_ns - self.start_ns) if count else 0},
            "message_count": count,
        }


def _profiles(connection: Connection) -> list[Any]:
    """Offered QoS profiles; all connections of a rosbag2 have them."""
    return list(getattr(connection.ext, "offered_qos_profiles", ()))


class BagFolder:
    """Writes messages into a new rosbag2 folder.

    The folder opens everywhere after `close`; before, all that the last `flush` confirmed can be
    restored, whatever happens to the process. After half a megabyte it flushes by itself. Finished
    files of a split bag are in metadata.yaml at once.

    Parameters
    ----------
    folder : path
        Must not exist.
    channels : sequence of Channel
    form : Format

    Raises
    ------
    BagError
        The folder exists or cannot be written.
    """

    def __init__(
        self, folder: str | Path, channels: Sequence[Channel], form: Format | None = None
    ) -> None:
        self.folder, self.form = Path(folder), form or Format()
        if self.folder.exists():
            raise BagError(f"{folder}: exists already; a bag needs a new folder")
        self._connections = [self._connection(i + 1, c) for i, c in enumerate(channels)]
        self._parts: list[_Part] = []
        self._file: StorageFile | None = None
        self._unflushed_bytes = 0
        try:
            self.folder.mkdir(parents=True)
            with open(self.folder / _RESERVE, "xb") as reserve:
                os.posix_fallocate(reserve.fileno(), 0, _RESERVE_BYTES)
            self._begin_file()
        except (OSError, sqlite3.Error) as error:
            self.abandon()
            shutil.rmtree(self.folder, ignore_errors=True)
            raise BagError(f"{folder}: cannot be written: {reason(error)}") from error

    def _connection(self, number: int, channel: Channel) -> Connection:
        kind = MessageDefinitionFormat.IDL if channel.idl else MessageDefinitionFormat.MSG
        return Connection(
            number,
            channel.topic,
            channel.type,
            MessageDefinition(kind, channel.definition),
            channel.hash,
            0,
            ConnectionExtRosbag2("cdr", list(channel.qos)),
            self,
        )

    def _begin_file(self) -> None:
        suffix = SUFFIXES[self.form.storage]
        path = self.folder / f"{self.folder.name}_{len(self._parts)}{suffix}"
        self._parts.append(_Part(path.name))
        mcap = self.form.storage == "mcap"
        file = McapFile(path, self.form.zstd) if mcap else SqliteFile(path)
        self._file = file
        known: set[str] = set()
        for connection in self._connections:
            if connection.msgtype not in known:
                file.add_msgtype(connection)
                known.add(connection.msgtype)
            profiles = dump_qos_v9(_profiles(connection))
            file.add_connection(connection, yaml.safe_dump(profiles, sort_keys=False).strip())
        # Definitions reach the disk before the first message.
        file.flush()

    def write(self, number: int, stamp_ns: int, raw: bytes) -> None:
        """Write a serialised message of channel `number` (0 is the first).

        Raises
        ------
        OSError, sqlite3.Error
            The disk is full or gone; call `give_up` then.
        """
        part = self._parts[-1]
        if self._due(part, stamp_ns):
            self.split()
            part = self._parts[-1]
        assert self._file is not None
        self._file.write(self._connections[number], stamp_ns, raw)
        part.counts[number] = part.counts.get(number, 0) + 1
        if stamp_ns < part.start_ns:
            part.start_ns = stamp_ns
        if stamp_ns > part.end_ns:
            part.end_ns = stamp_ns
        self._unflushed_bytes += len(raw)
        if self._unflushed_bytes > _FLUSH_BYTES:
            self.flush()

    def _due(self, part: _Part, stamp_ns: int) -> bool:
        """Whether this message belongs into a new file."""
        if not part.counts:
            return False
        if self.form.split_ns and stamp_ns - part.start_ns >= self.form.split_ns:
            return True
        full = self.form.split_bytes
        return bool(full) and self._file is not None and self._file.size >= full

    def split(self) -> None:
        """Finish the present file and begin the next."""
        self._end_file()
        self._write_metadata()
        self._begin_file()

    def flush(self) -> None:
        """Hand everything to the operating system; what it confirms outlives this process.

        Raises
        ------
        OSError, sqlite3.Error
            The disk is full or gone; call `give_up` then.
        """
        if self._file is not None:
            self._file.flush()
        self._unflushed_bytes = 0

    def _end_file(self) -> None:
        if self._file is not None:
            self._file.close(BAG_VERSION, yaml.safe_dump(self.information(), sort_keys=False))
            self._file = None

    def close(self) -> None:
        """Write index and metadata.

        Raises
        ------
        OSError, sqlite3.Error
            They could not be written; what the last `flush` confirmed can be restored.
        """
        self._drop_reserve()
        self._end_file()
        self._write_metadata()

    def give_up(self) -> int:
        """After a failed write: keep what the last `flush` confirmed and close the bag with that.

        Returns
        -------
        int
            Messages that are left out although `write` had taken them.

        Raises
        ------
        OSError, sqlite3.Error
            Not even that could be written.
        """
        part, lost = self._parts[-1], 0
        # First of all: without room not even the cut is certain.
        self._drop_reserve()
        if self._file is not None:
            kept = self._file.cut_back()
            now = {number: kept.get(number + 1, 0) for number in part.counts}
            lost = sum(part.counts.values()) - sum(now.values())
            part.counts = now
        if len(self._parts) > 1 and not sum(part.counts.values()):
            self.abandon()
            self._parts.pop()
            (self.folder / part.path).unlink(missing_ok=True)
        self.close()
        return lost

    def abandon(self) -> None:
        """Let go of the files without writing anything more."""
        if self._file is not None:
            with contextlib.suppress(OSError, sqlite3.Error, ValueError):
                self._file.abort()
            self._file = None

    def _drop_reserve(self) -> None:
        (self.folder / _RESERVE).unlink(missing_ok=True)

    def counts(self) -> list[int]:
        """Messages per channel."""
        return [
            sum(part.counts.get(number, 0) for part in self._parts)
            for number in range(len(self._connections))
        ]

    def information(self) -> dict[str, Any]:
        """Content of metadata.yaml below its first key (rosbag2 version 9)."""
        parts = [part for part in self._parts if part.counts] or self._parts[:1]
        start_ns, end_ns = min(p.start_ns for p in parts), max(p.end_ns for p in parts)
        counts = self.counts()
        return {
            "version": BAG_VERSION,
            "storage_identifier": self.form.storage,
            "duration": {"nanoseconds": max(0, end_ns - start_ns) if sum(counts) else 0},
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "message_count": sum(counts),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": c.topic,
                        "type": c.msgtype,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": dump_qos_v9(_profiles(c)),
                        "type_description_hash": c.digest,
                    },
                    "message_count": count,
                }
                for c, count in zip(self._connections, counts, strict=True)
            ],
            # Compressed MCAP chunks are the file's affair: this speaks of rosbag2's own layer.
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [part.path for part in parts],
            "files": [part.info() for part in parts],
            "custom_data": dict(self.form.custom_data) or None,
            "ros_distro": "jazzy",
        }

    def _write_metadata(self) -> None:
        content = {"rosbag2_bagfile_information": self.information()}
        new = self.folder / f"{METADATA}.new"
        new.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        new.replace(self.folder / METADATA)
