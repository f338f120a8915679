# SPDX-License-Identifier: Apache-2.0
"""`heli bag repair`: a bag that was never closed, or cut off, into one that opens everywhere."""

import re
import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from heli_bags.check import listed_files, storage_files, trouble
from heli_bags.folder import BagError, BagFolder, Channel, Format, reason
from heli_bags.salvage import State, salvage


@dataclass
class Repair:
    """Outcome of a repair.

    Attributes
    ----------
    source, folder : str
        The damaged bag (untouched, or where it was moved to) and the new one.
    trouble : str
        What was wrong.
    counts : dict
        Messages restored per topic.
    duration_s : float
        Time between the first and the last of them.
    lost_bytes, damaged_chunks : int
        What no message could be read from.
    notes : list of str
    """

    source: str
    folder: str
    trouble: str
    counts: dict[str, int] = field(default_factory=dict)
    duration_s: float = 0.0
    lost_bytes: int = 0
    damaged_chunks: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Messages restored."""
        return sum(self.counts.values())

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "messages": self.messages}


def _order(path: Path) -> tuple[int, str]:
    """Files of a split bag by their number."""
    number = re.search(r"_(\d+)$", path.stem)
    return (int(number.group(1)) if number else -1, path.name)


def _files(bag: Path) -> list[Path]:
    """Storage files of a bag, listed ones first, in the order of writing."""
    if bag.is_file():
        return [bag]
    files = sorted(storage_files(bag), key=_order)
    listed = listed_files(bag)
    first = [bag / name for name in listed if bag / name in files]
    return [*first, *(path for path in files if path not in first)]


class _Survey:
    """First pass: which channels there are, how much, how damaged."""

    def __init__(self, files: list[Path], progress: Callable[[int], None]) -> None:
        self.channels: dict[Channel, int] = {}
        self.states = []
        self.total = 0
        for path in files:
            state = State()
            for channel, _, _ in salvage(path, state):
                self.channels.setdefault(channel, len(self.channels))
                self.total += 1
                progress(self.total)
            self.states.append(state)


def _target(bag: Path, out: Path | None, in_place: bool) -> Path:
    if out is not None and in_place:
        raise BagError("--out and --in-place: give one of them, not both")
    if out is None and not in_place:
        stem = bag.stem if bag.is_file() else bag.name
        out = bag.with_name(f"{stem}_repaired")
    if out is not None and out.exists():
        raise BagError(f"{out}: exists already; name a new folder with --out")
    if in_place and bag.is_file():
        raise BagError(f"{bag}: --in-place is for a bag's folder")
    return out or bag


def _aside(bag: Path) -> Path:
    """Move a damaged bag out of the way; returns where it is now."""
    number, backup = 0, bag.with_name(f"{bag.name}_damaged")
    while backup.exists():
        number += 1
        backup = bag.with_name(f"{bag.name}_damaged{number}")
    bag.rename(backup)
    return backup


def repair(
    bag: Path,
    out: Path | None = None,
    in_place: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Repair | None:
    """Restore all complete messages of a damaged bag, with index and metadata.

    Parameters
    ----------
    bag : Path
        rosbag2 folder or one of its files; it is never changed.
    out : Path, optional
        New folder; default <bag>_repaired.
    in_place : bool
        Move the damaged bag to <bag>_damaged and put the new one where it was.
    progress : callable
        Gets messages done and messages in all (0 while that is not known).

    Returns
    -------
    Repair or None
        None: nothing is wrong with the bag, nothing was written.

    Raises
    ------
    BagError
        Not a bag, nothing to restore, or the new folder cannot be written.
    """
    if not bag.exists():
        raise BagError(f"{bag}: does not exist")
    wrong, files = trouble(bag), _files(bag)
    if not files:
        raise BagError(f"{bag}: not a bag: it holds neither an .mcap nor a .db3 file")
    bag = bag.resolve()
    target = _target(bag, out, in_place)
    survey = _Survey(files, lambda done: progress(done, 0))
    damaged = sum(state.damaged_chunks for state in survey.states)
    if not wrong and not damaged and all(state.whole for state in survey.states):
        return None
    if not survey.total:
        raise BagError(f"{bag}: holds no message that can be read")
    files = [path.resolve() for path in files]
    source = bag
    if in_place:
        source = _aside(bag)
        files = [source / path.name for path in files]
    result = Repair(str(source), str(target), wrong or "damaged inside")
    result.lost_bytes = sum(state.lost_bytes for state in survey.states)
    result.damaged_chunks = damaged
    result.notes = [note for state in survey.states for note in state.notes]
    storage = "sqlite3" if files[0].suffix == ".db3" else "mcap"
    form = Format(storage, storage == "mcap" and any(state.zstd for state in survey.states))
    try:
        _copy(files, survey, target, form, result, progress)
    except BagError:
        if in_place and not target.exists():
            source.rename(target)
        raise
    return result


def _copy(
    files: list[Path],
    survey: _Survey,
    target: Path,
    form: Format,
    result: Repair,
    progress: Callable[[int, int], None],
) -> None:
    """Second pass: every message into the new bag, file by file."""
    new = BagFolder(target, list(survey.channels), form)
    first_ns, last_ns, done, since_flush = 2**63 - 1, 0, 0, 0
    try:
        for path in files:
            if since_flush:
                new.split()
                since_flush = 0
            for channel, stamp_ns, raw in salvage(path, State()):
                new.write(survey.channels[channel], stamp_ns, raw)
                first_ns, last_ns = min(first_ns, stamp_ns), max(last_ns, stamp_ns)
                done, since_flush = done + 1, since_flush + 1
                progress(done, survey.total)
        new.close()
    except (OSError, sqlite3.Error) as error:
        new.abandon()
        shutil.rmtree(target, ignore_errors=True)
        kept = "the damaged bag is as it was"
        raise BagError(f"{target}: cannot be written: {reason(error)}; {kept}") from error
    counts = new.counts()
    result.counts = {c.topic: counts[number] for c, number in survey.channels.items()}
    result.duration_s = (last_ns - first_ns) / 1e9
