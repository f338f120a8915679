# SPDX-License-Identifier: Apache-2.0
"""Flights beside each other: where their parameters differ, and their figures in one table."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from rich.console import Console

from heli_core.folders import write_whole
from heli_core.metrics import CLIMB_METRICS, METRICS, NONE, PATH, PaperMetric
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import euler_angles
from heli_core.rows import REFERENCE
from heli_flight.flight_file import identity, own_parameters, packaged
from heli_flight.layers import FLIGHT_SECTION
from heli_flight.record import FlightRecord
from heli_flight.report.data import Chart, Panel, Trace, bands_beside, with_bands
from heli_flight.report.page import PageHeader, filled
from heli_flight.report.tables import ReportTable, mark
from heli_flight.report.write import RecordedFlight, recorded
from heli_flight.result import Verdict, climb_cell, phases, verdict
from heli_flight.scoring import (
    DECIDES,
    NAVIGATION,
    SOURCE_NAMES,
    STRETCHES,
    TRUTH,
    TRUTH_LESS_DRIFT,
    Score,
    errors,
    sources_of,
)
from heli_flight.terminal import FittingTable, table

# -------------------------------------------------------------------------------------------------
# Diff.
# -------------------------------------------------------------------------------------------------

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
    flight: RecordedFlight

    @property
    def place(self) -> str:
        """Where it was read."""
        return str(self.path) if self.path else f"in memory ({self.flight.how})"

    @property
    def gps(self) -> str:
        """The receiver that it flew with."""
        return self.flight.settings.gps

    @property
    def partial(self) -> str:
        """Why only a part of it can be judged, one sentence; empty if all can."""
        return self.flight.result.partial(self.gps)


@dataclass(frozen=True)
class Difference:
    """A parameter, or an entry of one, that is not the same in all flights.

    Attributes
    ----------
    name : str
        Section and key; of a longer array with the entry's index, row by row, from 0.
    packaged : str
        What the package has for these flights' scenarios, receivers, worlds and control preset.
    values : sequence of str
        One per flight.
    """

    name: str
    packaged: str
    values: Sequence[str]


@dataclass(frozen=True)
class MetricComparison:
    """A metric over one stretch from one record, of all flights; None where it was not taken."""

    stretch: str
    metric: PaperMetric
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
            "paper": self.metric.as_dict()["paper"],
            "flights": [
                None if s is None else {"max": s.max, "rms": s.rms, "inside": s.as_dict()["inside"]}
                for s in self.scores
            ],
            "change": self.change,
        }


@dataclass(frozen=True)
class FlightDiff:
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
    metrics: Sequence[MetricComparison]
    climb: Sequence[tuple[str, Sequence[str]]]

    @property
    def names(self) -> list[str]:
        """What the flights are called."""
        return [named.name for named in self.flights]

    @property
    def exit_code(self) -> int:
        """0 if each record is the flight's and whole; what was flown is compared, not judged."""
        ends = {named.flight.result.verdict(named.gps) for named in self.flights}
        return int(not ends.isdisjoint({Verdict.FORGED, Verdict.PARTIAL}))

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
                    "forged": named.flight.result.forged,
                    "partial": named.partial,
                    "verdict": named.flight.result.verdict(named.gps).value,
                    "coverage": named.flight.result.coverage(named.gps).as_dict(),
                    "exit_code": named.flight.result.exit_code(named.gps),
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


def diff(
    paths: Sequence[Path], read: Callable[[int, int], None] = lambda done, n: None
) -> FlightDiff:
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


def beside(flights: Sequence[Named]) -> FlightDiff:
    """Lay flights beside each other that have been read; two to `MOST`, each with its own name."""
    return FlightDiff(flights, _parameters(flights), _metrics(flights), _climb(flights))


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
    identities = [_identity(named.flight) for named in flights]
    rows = [
        Difference(key, ABSENT, values)
        for key in dict.fromkeys(key for one in identities for key in one)
        if len(set(values := [one.get(key, ABSENT) for one in identities])) > 1
    ]
    parameters = [own_parameters(named.flight.settings) for named in flights]
    defaults = [packaged(named.flight.settings) for named in flights]
    for section, key in dict.fromkeys(name for one in parameters for name in one):
        flown: list[Any] = [one.get((section, key)) for one in parameters]
        if all(np.array_equal(flown[0], value) for value in flown[1:]):
            continue
        before = [one.get(section, {}).get(key) for one in defaults]
        rows += _rows(f"{section}.{key}", flown, before)
    return rows


def _identity(flight: RecordedFlight) -> dict[str, str]:
    """Scenario, receiver, world, preset, mode, seed, controller, length, sources: as text."""
    facts = identity(flight.settings, ())
    number, blank, more = flight.commit.partition(" ")
    commit = f"{number[:_COMMIT_DIGITS]}{blank}{more}" or "not recorded"
    facts |= {"rate_hz": flight.settings.rate.hz, "commit": commit}
    return {
        f"{FLIGHT_SECTION}.{key}": text(value) for key, value in facts.items() if key != "changed"
    }  # fmt: skip


def _rows(name: str, values: Sequence[Any], before: Sequence[Any]) -> list[Difference]:
    """One row, or of a longer array one for each entry that differs."""
    sizes = {np.size(value) for value in (*values, *before)}
    if len(sizes) > 1 or sizes.pop() <= _SHORT_ARRAY or any(v is None for v in values):
        return [Difference(name, _joined(before), [text(value) for value in values])]
    shape = np.shape(values[0])
    table = np.array([np.ravel(value) for value in values])
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


def _metrics(flights: Sequence[Named]) -> list[MetricComparison]:
    """What decides first; drift-corrected truth where a standalone receiver flew."""
    kinds = {named.flight.settings.scenario.kind for named in flights}
    every = (m for kind, row in METRICS.items() if kind in kinds for m in row)
    metrics = [_metric_of(flights, metric) for metric in every]
    known = {s for named in flights for s in sources_of(named.flight.settings.gps)}
    rows = []
    for stretch in sorted(STRETCHES, key=lambda name: name != DECIDES):
        for metric in metrics:
            for source in (s for s in SOURCE_NAMES if s in known):
                scores = [_score(named.flight, stretch, metric, source) for named in flights]
                if any(scores):
                    rows.append(MetricComparison(stretch, metric, source, scores))
    return rows


def _metric_of(flights: Sequence[Named], metric: PaperMetric) -> PaperMetric:
    """A metric with what bounds it in all flights that have it; with none where they differ."""
    known = {m for named in flights for m in named.flight.settings.scenario.metrics
             if m.key == metric.key}  # fmt: skip
    return known.pop() if len(known) == 1 else replace(metric, paper=math.inf, source=NONE)


def _score(flight: RecordedFlight, stretch: str, metric: PaperMetric, source: str) -> Score | None:
    if source == TRUTH_LESS_DRIFT and source not in sources_of(flight.settings.gps):
        return None
    return flight.result.figures.find(stretch, metric.key, source)


def _climb(flights: Sequence[Named]) -> list[tuple[str, list[str]]]:
    """Figures of the climb, by the record that each is measured from, and of the ground."""
    per_flight: list[Mapping[str, str]] = []
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
        per_flight.append({**climb, **ground})
    return [
        (name, [one.get(name, ABSENT) for one in per_flight])
        for name in order
        if any(name in one for one in per_flight)
    ]


# -------------------------------------------------------------------------------------------------
# Charts of flights laid over each other, a colour each.
# -------------------------------------------------------------------------------------------------

ROLES = ("nav", "truth", "green", "purple", "bound", "muted")
"""Colours of the flights in turn."""
_ANGLES = ("roll", "pitch", "yaw")
_ACTUATORS = ("lateral", "longitudinal", "pedal", "collective")
# By key of an error: quantity and unit.
_PLACES = {"longitudinal": ("longitudinal", "m"), "lateral": ("lateral", "m"),
           "altitude": ("down", "m")}  # fmt: skip
_ON_PATH = {"position": ("distance", "m"), "heading": ("heading error", "°")}


def charts(flights: Sequence[Named]) -> list[Chart]:
    """Position error, altitude, attitude and its error, actuators; those that have data.

    What the flights are about comes first: of attitude tests, which hold no position, the attitude.
    """
    path = _kinds(flights) == {PATH}
    place = [_position(flights, source, path) for source in (TRUTH, NAVIGATION)]
    place.append(_altitude(flights))
    attitude, actuators = [_attitude(flights), _attitude_error(flights)], [_actuators(flights)]
    if _about_attitude(flights):
        drawn = [*reversed(attitude), *actuators, *reversed(place)]
    else:
        drawn = [*place, *attitude, *actuators]
    return [chart for chart in drawn if chart.has_data]


def _kinds(flights: Sequence[Named]) -> set[str]:
    return {named.flight.settings.scenario.kind for named in flights}


def _about_attitude(flights: Sequence[Named]) -> bool:
    return _kinds(flights) == {"attitude"}


def _overlaid(
    flights: Sequence[Named], signal: Callable[[FlightRecord], np.ndarray]
) -> list[Trace]:
    return [
        Trace(named.flight.record.time_s, signal(named.flight.record), named.name, role, width=1.2)
        for named, role in zip(flights, ROLES, strict=False)
    ]  # fmt: skip


def _position(flights: Sequence[Named], source: str, path: bool) -> Chart:
    kind, axes = (PATH, _ON_PATH) if path else ("hover", _PLACES)

    def of(key: str) -> Callable[[FlightRecord], np.ndarray]:
        return lambda record: errors(record, source, kind)[key]

    return Chart(
        f"position_{source}",
        f"Position error, {SOURCE_NAMES[source]}",
        "Against the point of the path at that moment."
        if path
        else "Position less the reference, in the frame of the reference's heading; an attitude "
        "test holds no position.",
        [Panel(*axis, _overlaid(flights, of(key))) for key, axis in axes.items()],
        "position",
    )


def _altitude(flights: Sequence[Named]) -> Chart:
    traces = _overlaid(flights, lambda r: -_known(r.truth_pos_ned_m, r.nav_pos_ned_m)[:, 2])
    first = flights[0].flight.record
    wanted = -first.reference[:, REFERENCE.pos][:, 2]
    of = f"reference of {flights[0].name}"
    traces.append(Trace(first.time_s, wanted, of, "reference", "dash", width=1.2))
    caption = (
        f"By {SOURCE_NAMES[TRUTH]}, where it was recorded, else by the {SOURCE_NAMES[NAVIGATION]}."
    )
    return Chart("altitude", "Altitude", caption, [Panel("altitude", "m", traces, 1.4)], "position")


def _attitude(flights: Sequence[Named]) -> Chart:
    def of(axis: int) -> Callable[[FlightRecord], np.ndarray]:
        return lambda r: np.degrees(euler_angles(_known(r.truth_q_nb, r.nav_q_nb)))[:, axis]

    caption = (
        f"By {SOURCE_NAMES[TRUTH]}, where it was recorded, else by the {SOURCE_NAMES[NAVIGATION]}."
    )
    panels = [Panel(name, "°", _overlaid(flights, of(i))) for i, name in enumerate(_ANGLES)]
    return Chart("attitude", "Attitude", caption, panels, "attitude")


def _attitude_error(flights: Sequence[Named]) -> Chart:
    def of(key: str) -> Callable[[FlightRecord], np.ndarray]:
        def error(record: FlightRecord) -> np.ndarray:
            known = np.isfinite(record.truth_q_nb).any()
            return errors(record, TRUTH if known else NAVIGATION, "attitude")[key]

        return error

    panels = [Panel(f"{name} error", "°", _overlaid(flights, of(name))) for name in _ANGLES[:2]]
    caption = "Roll and pitch less what was commanded."
    return Chart("attitude_error", "Attitude error", caption, panels, "attitude")


def _actuators(flights: Sequence[Named]) -> Chart:
    def of(channel: int) -> Callable[[FlightRecord], np.ndarray]:
        return lambda record: record.u[:, channel]

    panels = [Panel(name, "", _overlaid(flights, of(i)), 0.8) for i, name in enumerate(_ACTUATORS)]
    return Chart("actuators", "Actuators", "Commands to the servos.", panels, "actuators")


def _known(truth: np.ndarray, navigation: np.ndarray) -> np.ndarray:
    return truth if np.isfinite(truth).any() else navigation


# -------------------------------------------------------------------------------------------------
# Flights beside each other on one page, with the flight report's look, and at the terminal.
# -------------------------------------------------------------------------------------------------

PAGE = "diff.html"
_TITLES = {
    "parameters": "What differs",
    "metrics": "Figures side by side",
    "position": "Position and altitude",
    "attitude": "Attitude",
    "actuators": "Actuators",
    "read": "What was read",
}
_HOW = "Largest magnitude (rms); ✓ inside, ✗ outside the bound."
_SAME_BELOW = 5e-4
_BOUND = "bound"


def write_diff(comparison: FlightDiff, page: Path) -> None:
    """Write the page.

    Raises
    ------
    OSError
        It cannot be written.
    """
    write_whole(page, render(comparison))


def render(comparison: FlightDiff) -> str:
    """The page as text."""
    drawn = with_bands(
        charts(comparison.flights),
        bands_beside({named.name: named.flight.bands for named in comparison.flights}),
    )
    sections = ["parameters", "metrics", *dict.fromkeys(chart.section for chart in drawn), "read"]
    names = " and ".join((", ".join(comparison.names[:-1]), comparison.names[-1]))
    head = PageHeader(
        kind="Flights compared · simulation",
        title=f"{names} compared",
        heading=names,
        verdicts=[_verdict(named) for named in comparison.flights],
        facts=[(named.name, _fact(named)) for named in comparison.flights],
        links={key: _TITLES[key] for key in sections},
        files=False,
    )
    return filled(
        "diff.html",
        head,
        drawn,
        parameters=_parameter_table(comparison),
        metrics=_metric_tables(comparison),
        notes=[f"{n.name}: {note}" for n in comparison.flights for note in _notes(n)],
        paths=[f"{n.name}: {n.place}" for n in comparison.flights],
    )


def print_diff(comparison: FlightDiff, console: Console) -> None:
    """The same tables in text."""
    differing = [[row.name, row.packaged, *row.values] for row in comparison.parameters]
    if differing:
        head = ["parameter", "packaged default", *comparison.names]
        console.print(_text_table("What differs", head, differing, console))
    else:
        console.print("no parameter differs")
    for stretch in dict.fromkeys(row.stretch for row in comparison.metrics):
        title = f"{STRETCHES[stretch].capitalize()}: largest magnitude (rms)"
        figures = [
            [
                *_about(row),
                *(ABSENT if s is None else _plain(s) for s in row.scores),
                *_changed(row),
            ]
            for row in _of(comparison, stretch)
        ]
        console.print(_text_table(title, ["metric", *_head(comparison)[1:]], figures, console))
    if comparison.climb:
        climb = [[name, *cells] for name, cells in comparison.climb]
        head = ["figure", *comparison.names]
        console.print(_text_table("Climb and ground", head, climb, console))
    console.print("! outside the bound")
    for named in comparison.flights:
        console.print(_verdict(named)[2], soft_wrap=True, markup=False)
        for note in _notes(named):
            console.print(f"note: {named.name}: {note}", soft_wrap=True, markup=False)


def _text_table(
    title: str, head: Sequence[str], rows: Iterable[Sequence[str]], console: Console
) -> FittingTable:
    made = table(title, console)
    for name in head:
        made.add_column(name)
    for row in rows:
        made.add_row(*row)
    return made


def _verdict(named: Named) -> tuple[str, str, str]:
    result, settings = named.flight.result, named.flight.settings
    if result.forged:
        return "✗", "bad", f"{named.name}: forged: {result.forged}"
    if result.lost:
        return "✗", "bad", f"{named.name}: lost after {result.flown_s:.2f} s: {result.lost}"
    if named.partial:
        return "✗", "bad", f"{named.name}: partial: {named.partial}"
    sentence = f"{named.name}: {verdict(result, settings, DECIDES)}"
    marks = {Verdict.INSIDE: ("✓", "good"), Verdict.OUTSIDE: ("✗", "bad")}
    mark_and_tone = marks.get(result.verdict(settings.gps), ("–", ""))
    return *mark_and_tone, sentence


def _fact(named: Named) -> str:
    flight = named.flight
    settings = flight.settings
    seed = "seed not recorded" if flight.assumed else f"seed {settings.seed}"
    law = settings.nodes["inner_loop"]["controller"]
    return (
        f"{settings.scenario_name}, {flight.result.flown_s:.2f} s, {law}, "
        f"world {Path(settings.world).stem}, GPS {settings.gps}, {seed}, {flight.how}"
    )


def _notes(named: Named) -> Sequence[str]:
    return [*named.flight.result.notes, *named.flight.missing]


def _parameter_table(comparison: FlightDiff) -> ReportTable:
    rows = [
        [Markup("<code>{}</code>").format(row.name), row.packaged, *row.values]
        for row in comparison.parameters
    ]
    caption = (
        "Parameters that are not the same in all flights; packaged: of their scenario, receiver, "
        "world and control preset. Entries of arrays are counted from 0."
    )
    return ReportTable(
        ["parameter", "packaged default", *comparison.names], rows, caption, words=True
    )


def _of(comparison: FlightDiff, stretch: str) -> Iterable[MetricComparison]:
    return (row for row in comparison.metrics if row.stretch == stretch)


def _head(comparison: FlightDiff) -> list[str]:
    more = ["change"] if len(comparison.flights) == 2 else []
    return ["", "measured from", _BOUND, *comparison.names, *more]


def _about(row: MetricComparison) -> list[str]:
    metric = row.metric
    bound = metric.bound_text.split()[0]
    return [f"{metric.label}, {metric.unit}", SOURCE_NAMES[row.source], bound]


def _changed(row: MetricComparison) -> list[str]:
    """The last cell of a comparison of two, none of more."""
    if len(row.scores) != 2:
        return []
    if row.change is None:
        return [ABSENT]
    return ["same" if abs(row.change) < _SAME_BELOW else f"{100.0 * row.change:+.1f} %"]


def _metric_tables(comparison: FlightDiff) -> list[ReportTable]:
    tables = []
    for stretch in dict.fromkeys(row.stretch for row in comparison.metrics):
        rows = [
            [*_about(row), *(ABSENT if s is None else _cell(s) for s in row.scores), *_changed(row)]
            for row in _of(comparison, stretch)
        ]
        whens = {phases(n.flight.settings, stretch) for n in comparison.flights}
        when = f", {whens.pop()}" if len(whens) == 1 else ""
        decides = " This table decides the exit codes of the flights." * (stretch == DECIDES)
        caption = f"{STRETCHES[stretch].capitalize()}{when}. {_HOW}{decides}"
        tables.append(ReportTable(_head(comparison), rows, caption))
    if comparison.climb:
        rows = [[name, *cells] for name, cells in comparison.climb]
        tables.append(ReportTable(["", *comparison.names], rows, "Climb and ground."))
    return tables


def _cell(score: Score) -> Markup:
    size = Markup("{:.3f} <small>({:.3f})</small>").format(score.max, score.rms)
    return size + " " + mark(score.inside) if score.metric.bounded else size


def _plain(score: Score) -> str:
    return f"{score.max:.3f} ({score.rms:.3f}){'' if score.inside else ' !'}"
