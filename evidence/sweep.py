# SPDX-License-Identifier: Apache-2.0
"""The one loop of the experiments: every place of their axes on every seed, by the campaign engine.

An experiment declares its axes (worlds, receivers, variants) at the function that flies one flight:

    @over(world=("paper", "honest"), gps=("rtk", "standalone"))
    def flown(world: str, gps: str, seed: int) -> dict[str, Any]:
        "Figures of a flight."

`flown.places(options)` then flies all flights on the workers and gives, place by place, what they
were; the experiment makes its rows of that, and `print_result` prints them. Flights are the same
on any number of workers. `--rows DIR`, or the variable HELI_ROWS, keeps what has been flown, a
folder for each sweep, and goes on with it.
"""

import hashlib
import json
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any, Generic, TypeVar

from evidence.options import parser_with_seeds
from heli_core.errors import FlightError
from heli_core.rcl_yaml import ParameterError
from heli_flight.settings import sources_commit
from heli_flight.terminal import long_steps
from heli_studies.campaign.run import ROWS, Store
from heli_studies.campaign.spec import NUMBER
from heli_studies.campaign.workers import Rows, flier, tasks

Figures = TypeVar("Figures")
Point = Mapping[str, Any]
"""A place: by axis one of its values."""
FIGURES = "figures"
"""Column of a flight's figures, pickled: they come back as they were."""
ABOUT = "sweep.json"
_CHUNK = 4


@dataclass(frozen=True)
class Options:
    """What a command line asks for.

    Attributes
    ----------
    seeds : list of int
        Of wind and sensors.
    workers : int
        Processes that fly; up to 1: this one.
    rows : Path or None
        Where what has been flown is kept.
    """

    seeds: list[int]
    workers: int = 1
    rows: Path | None = None


@dataclass(frozen=True)
class Place(Generic[Figures]):
    """What was flown at a place.

    Attributes
    ----------
    point : mapping
    flights : list
        Figures of each flight, in the order of the seeds.
    """

    point: Point
    flights: list[Figures]


@dataclass(frozen=True)
class Sweep(Generic[Figures]):
    """Axes, and how one flight is flown. On workers it is found again by module and name.

    Attributes
    ----------
    axes : mapping of str to sequence
        The last one runs fastest.
    flight : callable
        Takes a value of each axis and the `seed` by name; gives the figures of that flight, which
        follow from these alone.
    """

    axes: Mapping[str, Sequence[Any]]
    flight: Callable[..., Figures]

    def __call__(self, **values: Any) -> Figures:
        """Fly one."""
        return self.flight(**values)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, str]]:
        return _declared, (self.home, self.flight.__name__)

    @property
    def home(self) -> str:
        """Module that declares it, by the name that imports it in another process, too."""
        home = self.flight.__module__
        spec = sys.modules[home].__spec__ if home == "__main__" else None
        return home if spec is None else spec.name

    @property
    def points(self) -> list[Point]:
        """Every place of the axes."""
        every = product(*self.axes.values())
        return [dict(zip(self.axes, values, strict=True)) for values in every]

    def places(
        self, options: Options, points: Sequence[Point] | None = None
    ) -> Iterator[Place[Figures]]:
        """Fly, and give what was found at each place, in their order, as soon as it is there.

        Parameters
        ----------
        options : Options
        points : sequence of mapping or None
            Places instead of all of the axes.

        Raises
        ------
        ParameterError
            `options.rows` holds rows of other flights or other sources, or cannot be written.
        FlightError
            A flight ends its process each time.
        """
        points = self.points if points is None else points
        batch = FlightsOfSweep(self, tuple(points), tuple(options.seeds))
        store, figures = None, dict[int, bytes]()
        if options.rows is not None:
            store = _store(options.rows / batch.name, batch.identity)
            store.done()  # takes files away that cannot be read
            figures = _figures(store.table().to_pylist())
        todo, flown = tasks(batch, set(figures)), len(figures)
        workers = min(options.workers, len(todo))
        steps = long_steps(f"{batch.name}, flights", batch.count, flown)
        with flier(workers if workers > 1 else 0) as fly, steps as progress:
            coming = fly(batch, todo)
            for i, point in enumerate(points):
                numbers = range(i * len(options.seeds), (i + 1) * len(options.seeds))
                while not figures.keys() >= set(numbers):
                    rows = next(coming)
                    figures |= _figures(rows)
                    flown += len(rows)
                    if store is not None:
                        store.put(rows)
                    progress(flown, f"{len(points)} places")
                yield Place(point, [pickle.loads(figures.pop(number)) for number in numbers])


@dataclass(frozen=True)
class FlightsOfSweep:
    """The flights of a sweep, numbered for the campaign engine: all seeds of the first place first.

    Attributes
    ----------
    sweep : Sweep
    points : tuple of mapping
    seeds : tuple of int
    chunk : int
        Flights of a task.
    """

    sweep: Sweep[Any]
    points: tuple[Point, ...]
    seeds: tuple[int, ...]
    chunk: int = _CHUNK

    @property
    def count(self) -> int:
        """Flights of it."""
        return len(self.points) * len(self.seeds)

    @property
    def name(self) -> str:
        """Of the experiment and its function."""
        return f"{self.sweep.home.rpartition('.')[2]}_{self.sweep.flight.__name__}"

    @property
    def identity(self) -> str:
        """What tells these flights from others of the same sources, SHA-256."""
        text = repr((self.sweep.home, self.name, self.points, self.seeds))
        return hashlib.sha256(text.encode()).hexdigest()

    def fly(self, numbers: Sequence[int]) -> Rows:
        """Number and figures of these flights."""
        return [{NUMBER: number, FIGURES: pickle.dumps(self._flown(number))} for number in numbers]

    def killed(self, number: int) -> dict[str, Any]:
        """Raises FlightError: without a flight's figures there is no row of its place."""
        place, seed = divmod(number, len(self.seeds))
        raise FlightError(
            f"{self.name}: {dict(self.points[place])}, seed {self.seeds[seed]}: the process that "
            "flew it ended each time"
        )

    def _flown(self, number: int) -> Any:
        place, seed = divmod(number, len(self.seeds))
        return self.sweep.flight(**self.points[place], seed=self.seeds[seed])


def over(**axes: Sequence[Any]) -> Callable[[Callable[..., Figures]], Sweep[Figures]]:
    """Make a function that flies one flight a sweep over these axes and the seeds."""

    def declared(flight: Callable[..., Figures]) -> Sweep[Figures]:
        return Sweep(axes, flight)

    return declared


def print_result(
    doc: str | None,
    experiment: Callable[..., Mapping[str, Any]],
    seeds: str = "1..20",
    tables: Callable[[Mapping[str, Any]], str] | None = None,
    **lists: str,
) -> int:
    """The main of an experiment: read the options, print its result as JSON; exit code.

    Parameters
    ----------
    doc : str or None
        Of the module; its first line is the help's.
    experiment : callable
        From `Options`, and the further ones by name, to what is printed.
    seeds : str
        Default of `--seeds`.
    tables : callable or None
        Makes Markdown of it, which is printed unless `--json` is given.
    **lists : str
        Further options, values with commas between, and their defaults.
    """
    parser = parser_with_seeds(doc, seeds)
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--workers", type=int, default=cores, metavar="N",
                        help="processes that fly (default: one per core; 1: this one)")  # fmt: skip
    parser.add_argument("--rows", type=Path, default=os.environ.get("HELI_ROWS"), metavar="DIR",
                        help="keep what is flown here, and go on with what is there "
                        "(default: the variable HELI_ROWS)")  # fmt: skip
    for name, default in lists.items():
        parser.add_argument(f"--{name}", default=default, help=f"default: {default}")
    if tables is not None:
        parser.add_argument("--json", action="store_true", help="print JSON instead of Markdown")
    arguments = parser.parse_args()
    chosen = {name: getattr(arguments, name).split(",") for name in lists}
    try:
        content = experiment(Options(arguments.seeds, arguments.workers, arguments.rows), **chosen)
    except (ParameterError, FlightError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if tables is None or arguments.json:
        print(json.dumps(content, indent=2))
    else:
        print(tables(content))
    return 0


def _declared(home: str, name: str) -> Any:
    """The sweep of a module, in whichever process."""
    return getattr(import_module(home), name)


def _figures(rows: Rows) -> dict[int, bytes]:
    return {row[NUMBER]: row[FIGURES] for row in rows}


def _store(folder: Path, identity: str) -> Store:
    """A folder of rows, new or with those of the same flights by the same sources."""
    about, file = {"flights": identity, "commit": sources_commit()}, folder / ABOUT
    try:
        if not folder.exists():
            (folder / ROWS).mkdir(parents=True)
            file.write_text(json.dumps(about), encoding="utf-8")
        if json.loads(file.read_text(encoding="utf-8")) != about:
            raise ParameterError(
                f"--rows: {folder}: holds other flights, or of other sources; allowed: the same, "
                "or another folder"
            )
    except (OSError, ValueError) as error:
        raise ParameterError(f"--rows: {folder}: {error}") from None
    return Store(folder, fixed=(NUMBER,))
