# SPDX-License-Identifier: Apache-2.0
"""`heli.diff`: flights beside each other."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli.arguments import in_python, refused
from heli.flight import NAVIGATION, WINDOWS, Flight, MetricsByName, as_dataframe, html_table
from heli_core.rcl_yaml import ParameterError
from heli_flight.report import diff as beside

if TYPE_CHECKING:
    import pyarrow

    from heli_flight.report.diff import MetricComparison

_SAME_BELOW = 5e-4
ABSENT = "-"


@dataclass(frozen=True)
class Compared:
    """One metric of all flights.

    Attributes
    ----------
    name, label, unit : str
    paper : float
        The largest that the paper shows; of a path, a goal.
    source, stretch : str
        As of a `Metric`.
    values, rms : tuple of float or None
        Of each flight the largest magnitude and the rms; None where it was not taken.
    inside : tuple of bool or None
        Whether each flight's value is inside the paper's.
    change : float or None
        Of two flights the second value over the first, less 1; None of more.
    """

    name: str
    label: str
    unit: str
    paper: float
    source: str
    stretch: str
    values: tuple[float | None, ...]
    rms: tuple[float | None, ...]
    inside: tuple[bool | None, ...]
    change: float | None

    def __str__(self) -> str:
        cells = (ABSENT if value is None else f"{value:.3g}" for value in self.values)
        more = "" if self.change is None else f" ({_changed(self.change)})"
        return f"{' / '.join(cells)} {self.unit}{more}"


class ComparedMetrics(MetricsByName[Compared]):
    """Metrics of all flights by name, from the state estimate over the scored windows.

    Parameters
    ----------
    rows : sequence of Beside
        Of every record and stretch.
    source, stretch : str
        Which of them this mapping shows; others by `of`.
    """

    def __init__(
        self, rows: Sequence[MetricComparison], source: str = NAVIGATION, stretch: str = WINDOWS
    ) -> None:
        self._rows, self.source, self.stretch = rows, source, stretch
        self._by_name = {
            row.metric.key: _compared(row)
            for row in rows
            if (row.source, row.stretch) == (source, stretch)
        }

    def of(self, source: str = NAVIGATION, stretch: str = WINDOWS) -> ComparedMetrics:
        """The same flights measured from another record, or over another stretch.

        Raises
        ------
        ParameterError
            There is none of that name.
        """
        known = {(row.source, row.stretch) for row in self._rows}
        for what, name, place in (("source", source, 0), ("stretch", stretch, 1)):
            names = sorted({pair[place] for pair in known})
            if name not in names:
                raise refused(what, name, ", ".join(names))
        if (source, stretch) not in known:
            of_it = sorted(pair[1] for pair in known if pair[0] == source)
            raise refused("stretch", stretch, f"of {source}: {', '.join(of_it)}")
        return ComparedMetrics(self._rows, source, stretch)


class Diff:
    """Flights beside each other: what `heli.diff` gives.

    Attributes
    ----------
    names : tuple of str
        What the flights are called.
    parameters : mapping of name to tuple of str
        Only those that are not the same in all flights: `section.name`, each flight's value as a
        table shows it. First what the flight was (`flight.seed`, `flight.world` ...).
    metrics : ComparedMetrics
        By name: `diff.metrics["altitude"].values`, `.change`; `.of("truth", "whole")`.
    partial : mapping of name to str
        Flights of which only a part was recorded, and what is missing, one sentence.
    """

    def __init__(self, flight_diff: beside.FlightDiff) -> None:
        self._flight_diff = flight_diff
        self.names = tuple(flight_diff.names)
        self.parameters: Mapping[str, tuple[str, ...]] = {
            row.name: tuple(row.values) for row in flight_diff.parameters
        }
        self.packaged: Mapping[str, str] = {
            row.name: row.packaged for row in flight_diff.parameters
        }
        self.metrics = ComparedMetrics(flight_diff.metrics)
        lacking = {named.name: named.partial for named in flight_diff.flights}
        self.partial: Mapping[str, str] = {name: why for name, why in lacking.items() if why}

    @cached_property
    def columns(self) -> dict[str, list[Any]]:
        """Every metric of every flight, one below the other."""
        columns: dict[str, list[Any]] = {
            key: []
            for key in ("flight", "metric", "source", "stretch", "unit", "paper", "max", "rms",
                        "inside")
        }  # fmt: skip
        for row in self._flight_diff.metrics:
            for name, score in zip(self.names, row.scores, strict=True):
                score_cells = (
                    (None, None, None) if score is None else (score.max, score.rms, score.inside)
                )
                about = row.metric.key, row.source, row.stretch, row.metric.unit, row.metric.paper
                for column, cell in zip(
                    columns.values(), (name, *about, *score_cells), strict=True
                ):
                    column.append(cell)
        return columns

    def to_arrow(self) -> pyarrow.Table:
        """The metrics as a table of pyarrow: a row per flight, metric, record and stretch."""
        import pyarrow

        return pyarrow.table(self.columns)

    def to_dataframe(self) -> Any:
        """The same as a DataFrame of pandas; ImportError with a sentence where there is none."""
        return as_dataframe(self.to_arrow())

    @in_python
    def page(self, path: str | os.PathLike[str] = "diff.html") -> Path:
        """Write the page of `heli diff`: tables, and every flight in each chart; needs no network.

        Parameters
        ----------
        path : path
            Must end in .html; a file that is there is replaced.

        Raises
        ------
        ParameterError
            It cannot be written.
        """
        from heli_flight.report.diff import write_diff

        page = Path(path)
        if page.suffix != ".html":
            raise ParameterError(f"path {page}: its name must end in .html")
        try:
            page.parent.mkdir(parents=True, exist_ok=True)
            write_diff(self._flight_diff, page)
        except OSError as error:
            raise ParameterError(f"path {page}: cannot be written: {error.strerror}") from None
        return page

    def _tables(self) -> list[tuple[str, list[str], list[list[str]]]]:
        """Title, head and rows of what differs, and of the metrics that decide."""
        differing = [
            [name, self.packaged[name], *values] for name, values in self.parameters.items()
        ]
        pair = len(self.names) == 2
        figures = []
        for m in self.metrics.values():
            cells = [
                ABSENT if value is None else f"{value:.3f}{'' if inside else ' !'}"
                for value, inside in zip(m.values, m.inside, strict=True)
            ]
            last = [ABSENT if m.change is None else _changed(m.change)] if pair else []
            bound = f"{m.paper:g}" if math.isfinite(m.paper) else ABSENT
            figures.append([f"{m.name}, {m.unit}", bound, *cells, *last])
        more = ["change"] if pair else []
        return [
            ("what differs", ["parameter", "packaged", *self.names], differing),
            (
                "largest magnitude, navigation, scored windows (! outside the bound)",
                ["metric", "bound", *self.names, *more],
                figures,
            ),
        ]

    def __repr__(self) -> str:
        parts = []
        for title, head, rows in self._tables():
            if not rows:
                parts.append(f"{title}: nothing")
                continue
            widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
            parts.append(title)
            for row in [head, *rows]:
                cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
                parts.append("  ".join(cells).rstrip())
        parts += [f"PARTIAL: {name}: {why}" for name, why in self.partial.items()]
        return "\n".join(parts)

    def _repr_html_(self) -> str:
        tables = "".join(
            html_table(head, rows, title) if rows else f"<p>{title}: nothing</p>"
            for title, head, rows in self._tables()
        )
        return tables + "".join(
            f"<p><b>PARTIAL: {escape(name)}: {escape(why)}</b></p>"
            for name, why in self.partial.items()
        )


def _compared(row: MetricComparison) -> Compared:
    metric, scores = row.metric, row.scores
    return Compared(
        metric.key,
        metric.label,
        metric.unit,
        metric.paper,
        row.source,
        row.stretch,
        tuple(None if s is None else float(s.max) for s in scores),
        tuple(None if s is None else float(s.rms) for s in scores),
        tuple(None if s is None else bool(s.inside) for s in scores),
        row.change,
    )


def _changed(change: float) -> str:
    return "same" if abs(change) < _SAME_BELOW else f"{100.0 * change:+.1f} %"


@in_python
def diff(*flights: Flight | str | os.PathLike[str], names: Sequence[str] | None = None) -> Diff:
    """Lay flights beside each other: parameters that differ, metrics, a page with charts.

    Parameters
    ----------
    *flights : Flight, or path
        Two to six: flights, folders of flights, or rosbag2 folders.
    names : sequence of str, optional
        What they are called, each another name; default: their folders, `flight 1`, `flight 2` of
        those that lie nowhere.

    Returns
    -------
    Diff

    Raises
    ------
    ParameterError, FlightError
        Each with one sentence.

    Examples
    --------
    >>> found = heli.diff(heli.fly(seed=1), heli.fly(seed=1, laws="hinf"))
    >>> found.parameters, found.metrics["altitude"].change
    >>> found.page("diff.html")
    """
    if not 2 <= len(flights) <= beside.MOST:
        raise refused("flights", len(flights), f"two to {beside.MOST} flights")
    read = [_read(one) for one in flights]
    called = _default_names(read) if names is None else _given_names(names, len(read))
    return Diff(
        beside.beside(
            [
                beside.Named(name, flight.folder or place, flight._flown)
                for name, (flight, place) in zip(called, read, strict=True)
            ]
        )
    )


def _given_names(names: Any, count: int) -> list[str]:
    """The names as text, each another one."""
    called = list(map(str, names)) if isinstance(names, (list, tuple)) else []
    if len(called) != count or len(set(called)) < count:
        raise refused("names", names, f"a list of {count} names that differ")
    return called


def _read(flight_or_folder: Any) -> tuple[Flight, Path | None]:
    from heli.flying import load

    if isinstance(flight_or_folder, Flight):
        return flight_or_folder, None
    if isinstance(flight_or_folder, (str, os.PathLike)):
        return load(flight_or_folder), Path(flight_or_folder)
    raise refused("flights", flight_or_folder, "flights, or folders of flights")


def _default_names(read: Sequence[tuple[Flight, Path | None]]) -> list[str]:
    folders = [place or flight.folder for flight, place in read]
    known = [folder for folder in folders if folder is not None]
    folder_names = iter(beside.names_of(known) if known else ())
    return [
        f"flight {i + 1}" if folder is None else next(folder_names)
        for i, folder in enumerate(folders)
    ]
