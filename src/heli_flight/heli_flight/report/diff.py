# SPDX-License-Identifier: Apache-2.0
"""Flights beside each other: where their parameters differ, and their figures in one table."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heli_flight.loop.flight_file import identity, own_parameters, packaged
from heli_flight.loop.flight_section import NODE_NAME
from heli_flight.loop.result import climb_cell
from heli_flight.loop.scoring import (
    DECIDES,
    SOURCE_NAMES,
    STRETCHES,
    TRUTH_LESS_DRIFT,
    Metric,
    Score,
    sources_of,
)
from heli_flight.report.from_bag import Recorded, recorded
from heli_math.climb import CLIMB_METRICS
from heli_math.paper_metrics import METRICS
from heli_parameters.parameters import ParameterError

MOST = 6
"""So many flights are told apart by colour."""
ABSENT = "–"
_SHORT_ARRAY = 4
_DIGITS = 6
_COMMIT_DIGITS = 10


@dataclass(frozen=True)
class Named:
    """A recorded flight and what it is called: by its folder; path None: it lies nowhere."""

    name: str
    path: Path | None
    flight: Recorded

    @property
    def place(self) -> str:
        """Where it was read."""
        return str(self.path) if self.path else f"in memory ({self.flight.how})"


@dataclass(frozen=True)
class Difference:
    """A parameter, or an entry of one, that is not the same in all flights.

    Attributes
    ----------
    name : str
        Section and key; of a longer array with the entry's index, row by row, from 0.
    packaged : str
        What the package has for these flights' scenarios, receivers, worlds and laws.
    values : sequence of str
        One per flight.
    """

    name: str
    packaged: str
    values: Sequence[str]


@dataclass(frozen=True)
class Beside:
    """A metric over one stretch from one record, of all flights; None where it was not taken."""

    stretch: str
    metric: Metric
    source: str
    scores: Sequence[Score | None]

    @property
    def change(self) -> float | None:
        """The second largest magnitude over the first, less 1; None unless there are two."""
        if len(self.scores) != 2:
            return None
        first, second = self.scores
        return None if first is None or second is None or not first.max else (
            second.max / first.max - 1.0
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "stretch": self.stretch,
            "key": self.metric.key,
            "measured_from": self.source,
            "unit": self.metric.unit,
            "paper": self.metric.paper,
            "flights": [
                None if s is None else {"max": s.max, "rms": s.rms, "inside": s.inside}
                for s in self.scores
            ],
            "change": self.change,
        }


@dataclass(frozen=True)
class Diff:
    """All that the page and the terminal show.

    Attributes
    ----------
    flights : sequence of Named
    parameters : sequence of Difference
    metrics : sequence of Beside
    climb : sequence of (str, sequence of str)
        Figures of climb and ground: what it is, and each flight's.
    """

    flights: Sequence[Named]
    parameters: Sequence[Difference]
    metrics: Sequence[Beside]
    climb: Sequence[tuple[str, Sequence[str]]]

    @property
    def names(self) -> list[str]:
        """What the flights are called."""
        return [named.name for named in self.flights]

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "flights": [
                {
                    "name": named.name,
                    "path": named.place,
                    "how": named.flight.how,
                    "flown_s": named.flight.result.flown_s,
                    "lost": named.flight.result.lost,
                    "exit_code": named.flight.result.exit_code(named.flight.settings.gps),
                    "missing": list(named.flight.missing),
                }
                for named in self.flights
            ],
            "parameters": [
                {"name": d.name, "packaged": d.packaged, "flights": list(d.values)}
                for d in self.parameters
            ],
            "metrics": [beside.as_dict() for beside in self.metrics],
            "climb_and_ground": [
                {"name": name, "flights": list(cells)} for name, cells in self.climb
            ],
        }


def diff(paths: Sequence[Path], read: Callable[[int, int], None] = lambda done, n: None) -> Diff:
    """Read flights and lay them beside each other.

    Parameters
    ----------
    paths : sequence of Path
        Two to `MOST`: folders of flights, or rosbag2 folders.
    read : callable, optional
        Told how many flights are read, and of how many.

    Raises
    ------
    ParameterError, FlightError
        Each with one line that names the file.
    """
    refuse_count(len(paths))
    names = names_of(paths)
    flights = []
    for name, path in zip(names, paths, strict=True):
        flights.append(Named(name, path, recorded(path)))
        read(len(flights), len(paths))
    return beside(flights)


def refuse_count(count: int) -> None:
    """Refuse so many flights, or so few.

    Raises
    ------
    ParameterError
    """
    if not 2 <= count <= MOST:
        raise ParameterError(f"name two to {MOST} flights, not {count}")


def beside(flights: Sequence[Named]) -> Diff:
    """Lay flights beside each other that have been read; two to `MOST`, each with its own name."""
    return Diff(flights, _parameters(flights), _metrics(flights), _climb(flights))


def names_of(paths: Sequence[Path]) -> list[str]:
    """Last parts of the paths, as many as tell them apart."""
    parts = [path.resolve().parts for path in paths]
    if len(set(parts)) < len(parts):
        raise ParameterError("a flight is named twice; name two that differ")
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(part[-count:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    return [str(path) for path in paths]


def _parameters(flights: Sequence[Named]) -> list[Difference]:
    """What differs: first what the flight was, then parameters by section."""
    told = [_identity(named.flight) for named in flights]
    rows = [
        Difference(key, ABSENT, values)
        for key in dict.fromkeys(key for one in told for key in one)
        if len(set(values := [one.get(key, ABSENT) for one in told])) > 1
    ]
    own = [own_parameters(named.flight.settings) for named in flights]
    defaults = [packaged(named.flight.settings) for named in flights]
    for section, key in dict.fromkeys(name for one in own for name in one):
        given: list[Any] = [one.get((section, key)) for one in own]
        if all(np.array_equal(given[0], value) for value in given[1:]):
            continue
        before = [one.get(section, {}).get(key) for one in defaults]
        rows += _rows(f"{section}.{key}", given, before)
    return rows


def _identity(flight: Recorded) -> dict[str, str]:
    """Scenario, receiver, world, laws, mode, seed, controller, length, sources: as text."""
    told = identity(flight.settings, ())
    number, blank, more = flight.commit.partition(" ")
    commit = f"{number[:_COMMIT_DIGITS]}{blank}{more}" or "not recorded"
    told |= {"rate_hz": flight.settings.rate.hz, "commit": commit}
    return {
        f"{NODE_NAME}.{key}": text(value) for key, value in told.items() if key != "changed"
    }  # fmt: skip


def _rows(name: str, given: Sequence[Any], before: Sequence[Any]) -> list[Difference]:
    """One row, or of a longer array one for each entry that differs."""
    sizes = {np.size(value) for value in (*given, *before)}
    if len(sizes) > 1 or sizes.pop() <= _SHORT_ARRAY or any(v is None for v in given):
        return [Difference(name, _joined(before), [text(value) for value in given])]
    shape = np.shape(given[0])
    table = np.array([np.ravel(value) for value in given])
    defaults = np.array([np.ravel(value) for value in before])
    return [
        Difference(
            f"{name}[{', '.join(str(int(k)) for k in np.unravel_index(i, shape))}]",
            _joined(defaults[:, i].tolist()),
            [text(value) for value in table[:, i].tolist()],
        )
        for i in range(table.shape[1])
        if len(set(table[:, i].tolist())) > 1
    ]


def _joined(values: Sequence[Any]) -> str:
    """The package's value; of flights of other scenarios or worlds each that there is."""
    return " or ".join(dict.fromkeys(text(value) for value in values))


def text(value: Any) -> str:
    """A parameter's value for a table's cell."""
    if value is None:
        return ABSENT
    if isinstance(value, np.ndarray | list | tuple):
        return ", ".join(text(item) for item in np.ravel(np.asarray(value, object)).tolist())
    if isinstance(value, bool | np.bool_):
        return str(bool(value)).lower()
    return f"{value:.{_DIGITS}g}" if isinstance(value, float | np.floating) else str(value)


def _metrics(flights: Sequence[Named]) -> list[Beside]:
    """What decides first; truth less drift where a standalone receiver flew."""
    kinds = {named.flight.settings.scenario.kind for named in flights}
    metrics = [m for kind, row in METRICS.items() if kind in kinds for m in row]
    known = {s for named in flights for s in sources_of(named.flight.settings.gps)}
    rows = []
    for stretch in sorted(STRETCHES, key=lambda name: name != DECIDES):
        for metric in metrics:
            for source in (s for s in SOURCE_NAMES if s in known):
                scores = [_score(named.flight, stretch, metric, source) for named in flights]
                if any(scores):
                    rows.append(Beside(stretch, metric, source, scores))
    return rows


def _score(flight: Recorded, stretch: str, metric: Metric, source: str) -> Score | None:
    if source == TRUTH_LESS_DRIFT and source not in sources_of(flight.settings.gps):
        return None
    return flight.result.figures.find(stretch, metric.key, source)


def _climb(flights: Sequence[Named]) -> list[tuple[str, list[str]]]:
    """Figures of the climb, by the record that each is measured from, and of the ground."""
    found: list[Mapping[str, str]] = []
    order = [
        f"{metric.label} ({SOURCE_NAMES[source]})"
        for metric in CLIMB_METRICS
        for source in SOURCE_NAMES
    ]
    for named in flights:
        figures = named.flight.result.figures
        known = sources_of(named.flight.settings.gps)
        climb = {
            f"{f.metric.label} ({SOURCE_NAMES[f.source]})": climb_cell(f)
            for f in figures.climb
            if f.source in known
        }
        ground = {
            f"{f.metric.label}, goal {f.metric.goal:g} {f.metric.unit}": f.cell
            for f in figures.ground
        }
        order += [name for name in ground if name not in order]
        found.append({**climb, **ground})
    return [
        (name, [one.get(name, ABSENT) for one in found])
        for name in order
        if any(name in one for one in found)
    ]
