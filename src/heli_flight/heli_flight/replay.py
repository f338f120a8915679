# SPDX-License-Identifier: Apache-2.0
"""Where a flight's record is, and what is in it, whole or cut off."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from heli_bags.check import listed_files, storage_files, trouble
from heli_bags.folder import SUFFIXES, BagError
from heli_bags.reader import Bag, read_bag
from heli_bags.repair import repair
from heli_flight.errors import FlightError
from heli_flight.loop.flight_file import NAME
from heli_flight.loop.record_file import NAME as RECORD
from heli_flight.loop.settings import Settings
from heli_msgs_bridge import topics
from heli_msgs_bridge.frames import Datum, datum

# Of the flights in a folder, so many are named.
_NAMED = 4


@dataclass(frozen=True)
class Place:
    """Where a flight lies.

    Attributes
    ----------
    record : Path
        Its bag (folder or file), or its record.npz.
    beside : Path
        Folder in which params.yaml, result.json and report.html are, if they are.
    """

    record: Path
    beside: Path

    @property
    def is_bag(self) -> bool:
        """False for the record of a flight of one process."""
        return self.record.name != RECORD


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return path.suffix in SUFFIXES.values()
    return path.is_dir() and bool(storage_files(path) or listed_files(path))


def _is_flight(path: Path) -> bool:
    return _is_bag(path / "bag") or (path / RECORD).is_file()


def place_of(path: Path) -> Place:
    """Where the record of a flight is: of its folder, its bag, or a bag's file.

    Raises
    ------
    FlightError
        There is no such folder, or no flight in it; one line.
    """
    try:
        return _place_of(path)
    except OSError as error:
        raise FlightError(f"{path}: cannot be read: {error.strerror}") from None


def _place_of(path: Path) -> Place:
    if not path.exists():
        raise FlightError(f"{path}: there is no such flight")
    if _is_bag(path / "bag"):
        return Place(path / "bag", path)
    if (path / RECORD).is_file():
        return Place(path / RECORD, path)
    if path.name == RECORD and path.is_file():
        return Place(path, path.resolve().parent)
    if _is_bag(path):
        # Beside the bag, or of one of its files, beside the folder of these.
        near = path.resolve().parent
        known = next((p for p in (near, near.parent) if (p / NAME).is_file()), near)
        return Place(path, known)
    if path.is_file():
        raise FlightError(f"{path}: not a flight: neither a bag's file (.mcap, .db3) nor {RECORD}")
    inside = [one.name for one in sorted(path.iterdir()) if _is_flight(one)]
    if inside:
        more = " ..." if len(inside) > _NAMED else ""
        names = f"{', '.join(islice(inside, _NAMED))}{more}"
        raise FlightError(f"{path}: holds several flights: name one ({names})")
    raise FlightError(f"{path}: not a flight: it holds neither a bag nor {RECORD}")


def bag_at(
    path: Path, settings: Settings, progress: Callable[[int, int], None]
) -> tuple[Bag, Sequence[str]]:
    """A bag's content, and what to know of it; of one that was cut off, what can be restored.

    Parameters
    ----------
    path : Path
        rosbag2 folder or one of its files; it is never changed.
    settings : Settings
        Give the origin of fixes.
    progress : callable
        Told messages done and in all while a bag is restored.

    Raises
    ------
    BagError
        Nothing can be read of it; one line.
    FlightError
        It holds no flight, or several aircraft; one line.
    """
    plant = settings.nodes["plant"]
    axes = ("latitude_deg", "longitude_deg", "altitude_m")
    origin = datum(*(plant[f"origin.{axis}"] for axis in axes))
    notes: list[str] = []
    wrong = trouble(path)
    if not wrong:
        try:
            bag = read_bag(path, origin)
        except BagError as error:
            # Its file has begin and end; what lies between may still be restored in parts.
            wrong = str(error).removeprefix(f"{path}: ")
    if wrong:
        bag, more = _restored(path, origin, progress)
        notes.append(f"The bag is not whole ({wrong}): shown is what could be restored{more}.")
    _refuse_none(path, bag)
    if "," in bag.aircraft:
        raise FlightError(f"{path}: holds several aircraft ({bag.aircraft}): a replay shows one")
    return bag, notes


def _restored(path: Path, origin: Datum, progress: Callable[[int, int], None]) -> tuple[Bag, str]:
    """What can be restored of a damaged bag, in a copy that is gone again, and what is lost."""
    with tempfile.TemporaryDirectory(prefix="heli_replay_") as folder:
        copy = Path(folder) / "bag"
        done = repair(path, copy, progress=progress)
        try:
            bag = read_bag(copy if done else path, origin)
        except BagError as error:
            raise BagError(str(error).replace(str(copy), str(path))) from None
    lost = done.lost_bytes if done else 0
    return bag, f", {lost} bytes hold no whole message" if lost else ""


def _refuse_none(path: Path, bag: Bag) -> None:
    shown = [bag.streams.get(name) for name in (topics.TRUTH_ODOM, topics.ODOM)]
    if not any(stream is not None and stream.stamp_ns.size for stream in shown):
        other = f"; of other kinds: {', '.join(bag.foreign)}" if bag.foreign else ""
        raise FlightError(
            f"{path}: holds neither {topics.TRUTH_ODOM} nor {topics.ODOM}: no flight{other}"
        )
