# SPDX-License-Identifier: Apache-2.0
"""What a node leaves to its successor, should it be killed and started again. No ROS.

After each step a node writes into a file of its own what it would need to go on: two records in
turn, so that a record that was cut off leaves the one before. The file is mapped into memory: it
outlives the process, and nothing waits for a disk.
"""

import mmap
import os
import pickle
import struct
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = "HELI_MEMORY"
"""Environment variable: the folder of these files. Where it is set, nodes are started again."""
_RECORD_BYTES = 8 << 20
"""Of a record; what is not written takes no space."""
_HEAD = struct.Struct("<qqq")  # number, tick, length
_NONE = 0


RESTARTS = "restarts"
"""Of these files, that of who was started again: a name a line."""


def respawns() -> bool:
    """Whether a node of this process that dies is started again."""
    return bool(os.environ.get(FOLDER))


@dataclass(frozen=True)
class HandoverRecord:
    """The newest record: tick of the step, and what was kept then."""

    tick: int
    content: Any


class HandoverFile:
    """The file of one node.

    Parameters
    ----------
    path : Path
        Made at the first record.

    Attributes
    ----------
    too_long : bool
        Whether what should have been kept did not fit.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._lasting = path, path.with_suffix(".lasting")
        self._map: mmap.mmap | None = None
        self._number = 0
        self.too_long = False

    def keep(self, tick: int, content: Any) -> None:
        """Write a record; what can be pickled, of at most 8 MB."""
        raw = pickle.dumps(content, pickle.HIGHEST_PROTOCOL)
        self.too_long = _HEAD.size + len(raw) > _RECORD_BYTES
        if self.too_long:
            return
        if self._map is None:
            self._map = self._open()
        number = self._number + 1
        at = (number % 2) * _RECORD_BYTES
        body = at + _HEAD.size
        # Not a whole record until its number stands there, which is written last.
        self._map[body : body + len(raw)] = raw
        self._map[at : at + _HEAD.size] = _HEAD.pack(number, tick, len(raw))
        self._number = number

    def load(self) -> HandoverRecord | None:
        """The newest whole record; None if there is none."""
        if not self._path.exists():
            return None
        self._map = self._open()
        heads = [_HEAD.unpack_from(self._map, i * _RECORD_BYTES) for i in range(2)]
        newest = max(range(2), key=lambda i: heads[i][0])
        self._number, tick, length = heads[newest]
        if self._number == _NONE:
            return None
        body = newest * _RECORD_BYTES + _HEAD.size
        return HandoverRecord(tick, pickle.loads(self._map[body : body + length]))

    def keep_lasting(self, content: Any) -> None:
        """Keep what took long to work out, beside the records; what was kept before is replaced."""
        fresh = self._lasting.with_suffix(".new")
        fresh.write_bytes(pickle.dumps(content, pickle.HIGHEST_PROTOCOL))
        fresh.replace(self._lasting)

    def lasting(self) -> Any:
        """What was kept by `keep_lasting`; None for nothing."""
        return pickle.loads(self._lasting.read_bytes()) if self._lasting.exists() else None

    def _open(self) -> mmap.mmap:
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            os.ftruncate(descriptor, 2 * _RECORD_BYTES)
            return mmap.mmap(descriptor, 2 * _RECORD_BYTES)
        finally:
            os.close(descriptor)


def note_restart(folder: Path, name: str) -> None:
    """Say for all nodes of the flight that one of them is started again."""
    with open(folder / RESTARTS, "a", encoding="utf-8") as file:
        file.write(f"{name}\n")


class Restarts:
    """What `note_restart` has said by now, read again when there is more of it."""

    def __init__(self) -> None:
        folder = os.environ.get(FOLDER)
        self._path = Path(folder) / RESTARTS if folder else None
        self._size = 0

    def news(self) -> Mapping[str, int]:
        """How often nodes were started again; empty as long as nothing new has been said."""
        if self._path is None:
            return {}
        try:
            size = self._path.stat().st_size
        except OSError:
            return {}
        if size == self._size:
            return {}
        self._size = size
        return Counter(self._path.read_text(encoding="utf-8").split())


class Successors:
    """Whether one of some nodes is started again, from now on, and its successor not met yet.

    Parameters
    ----------
    names : iterable of str
        The nodes.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self._restarts = Restarts()
        self._noted = self._met = 0
        self.due()
        self.meet()

    def due(self) -> bool:
        """Whether `note_restart` has named one of them more often than `meet` was called."""
        if news := self._restarts.news():
            self._noted = sum(news.get(name, 0) for name in self._names)
        return self._noted > self._met

    def meet(self) -> None:
        """Whoever was due has come."""
        self._met = self._noted


def handover_file_of(name: str) -> HandoverFile | None:
    """The memory of a node of this process; None where nobody is started again."""
    folder = os.environ.get(FOLDER)
    return HandoverFile(Path(folder) / f"{name}.memory") if folder else None
