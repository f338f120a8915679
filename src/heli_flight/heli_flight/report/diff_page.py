# SPDX-License-Identifier: Apache-2.0
"""Flights beside each other on one page, with the flight report's look, and at the terminal."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from markupsafe import Markup
from rich.console import Console

from heli_flight.loop.result import phases, verdict
from heli_flight.loop.scoring import DECIDES, SOURCE_NAMES, STRETCHES, Score
from heli_flight.report.bands import bands_beside
from heli_flight.report.chart import with_bands
from heli_flight.report.diff import ABSENT, Beside, Diff, Named
from heli_flight.report.diff_charts import charts
from heli_flight.report.page import Head, filled
from heli_flight.report.tables import Table, mark
from heli_flight.terminal import table
from heli_flight.text_table import FittingTable

PAGE = "diff.html"
_TITLES = {
    "parameters": "What differs",
    "metrics": "Figures side by side",
    "position": "Position and altitude",
    "attitude": "Attitude",
    "actuators": "Actuators",
    "read": "What was read",
}
_HOW = "Largest magnitude (rms); ✓ inside, ✗ outside the paper's figure, or the goal."
_SAME_BELOW = 5e-4
_PAPER = "paper or goal"


def write_diff(found: Diff, page: Path) -> None:
    """Write the page.

    Raises
    ------
    OSError
        It cannot be written.
    """
    page.write_text(render(found), encoding="utf-8")


def render(found: Diff) -> str:
    """The page as text."""
    drawn = with_bands(
        charts(found.flights),
        bands_beside({named.name: named.flight.bands for named in found.flights}),
    )
    sections = {chart.section for chart in drawn} | {"parameters", "metrics", "read"}
    names = " and ".join((", ".join(found.names[:-1]), found.names[-1]))
    head = Head(
        kind="Flights compared · simulation",
        title=f"{names} compared",
        heading=names,
        verdicts=[_verdict(named) for named in found.flights],
        facts=[(named.name, _fact(named)) for named in found.flights],
        links={key: title for key, title in _TITLES.items() if key in sections},
        files=False,
    )
    return filled(
        "diff.html",
        head,
        drawn,
        parameters=_parameter_table(found),
        metrics=_metric_tables(found),
        notes=[f"{n.name}: {said}" for n in found.flights for said in _notes(n)],
        paths=[f"{n.name}: {n.place}" for n in found.flights],
    )


def print_diff(found: Diff, console: Console) -> None:
    """The same tables in text."""
    differing = [[row.name, row.packaged, *row.values] for row in found.parameters]
    if differing:
        head = ["parameter", "packaged default", *found.names]
        console.print(_text_table("What differs", head, differing, console))
    else:
        console.print("no parameter differs")
    for stretch in dict.fromkeys(row.stretch for row in found.metrics):
        title = f"{STRETCHES[stretch].capitalize()}: largest magnitude (rms)"
        figures = [
            [
                *_about(row),
                *(ABSENT if s is None else _plain(s) for s in row.scores),
                *_changed(row),
            ]
            for row in _of(found, stretch)
        ]
        console.print(_text_table(title, ["metric", *_head(found)[1:]], figures, console))
    if found.climb:
        climb = [[name, *cells] for name, cells in found.climb]
        head = ["figure", *found.names]
        console.print(_text_table("Climb and ground", head, climb, console))
    console.print("! outside the paper's figure, or the goal")
    for named in found.flights:
        console.print(_verdict(named)[2], soft_wrap=True, markup=False)
        for said in _notes(named):
            console.print(f"note: {named.name}: {said}", soft_wrap=True, markup=False)


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
    if result.partial:
        return "✗", "bad", f"{named.name}: partial: {result.partial}"
    said = f"{named.name}: {verdict(result, settings, DECIDES)}"
    if not result.figures.of(DECIDES):
        return "–", "", said
    outside = result.judged(settings.gps, DECIDES)
    return "✗" if outside else "✓", "bad" if outside else "good", said


def _fact(named: Named) -> str:
    flight = named.flight
    told = flight.settings
    seed = "seed not recorded" if flight.assumed else f"seed {told.seed}"
    law = told.nodes["inner_loop"]["controller"]
    return (
        f"{told.scenario_name}, {flight.result.flown_s:.2f} s, {law}, "
        f"world {Path(told.world).stem}, GPS {told.gps}, {seed}, {flight.how}"
    )


def _notes(named: Named) -> Sequence[str]:
    return [*named.flight.result.notes, *named.flight.missing]


def _parameter_table(found: Diff) -> Table:
    rows = [
        [Markup("<code>{}</code>").format(row.name), row.packaged, *row.values]
        for row in found.parameters
    ]
    said = (
        "Parameters that are not the same in all flights; packaged: of their scenario, receiver, "
        "world and laws. Entries of arrays are counted from 0."
    )
    return Table(["parameter", "packaged default", *found.names], rows, said, words=True)


def _of(found: Diff, stretch: str) -> Iterable[Beside]:
    return (row for row in found.metrics if row.stretch == stretch)


def _head(found: Diff) -> list[str]:
    more = ["change"] if len(found.flights) == 2 else []
    return ["", "measured from", _PAPER, *found.names, *more]


def _about(row: Beside) -> list[str]:
    metric = row.metric
    return [f"{metric.label}, {metric.unit}", SOURCE_NAMES[row.source], f"{metric.paper:g}"]


def _changed(row: Beside) -> list[str]:
    """The last cell of a comparison of two, none of more."""
    if len(row.scores) != 2:
        return []
    if row.change is None:
        return [ABSENT]
    return ["same" if abs(row.change) < _SAME_BELOW else f"{100.0 * row.change:+.1f} %"]


def _metric_tables(found: Diff) -> list[Table]:
    tables = []
    for stretch in dict.fromkeys(row.stretch for row in found.metrics):
        rows = [
            [*_about(row), *(ABSENT if s is None else _cell(s) for s in row.scores), *_changed(row)]
            for row in _of(found, stretch)
        ]
        whens = {phases(n.flight.settings, stretch) for n in found.flights}
        when = f", {whens.pop()}" if len(whens) == 1 else ""
        decides = " This table decides the exit codes of the flights." * (stretch == DECIDES)
        said = f"{STRETCHES[stretch].capitalize()}{when}. {_HOW}{decides}"
        tables.append(Table(_head(found), rows, said))
    if found.climb:
        rows = [[name, *cells] for name, cells in found.climb]
        tables.append(Table(["", *found.names], rows, "Climb and ground."))
    return tables


def _cell(score: Score) -> Markup:
    size = Markup("{:.3f} <small>({:.3f})</small> ").format(score.max, score.rms)
    return size + mark(score.inside)


def _plain(score: Score) -> str:
    return f"{score.max:.3f} ({score.rms:.3f}){'' if score.inside else ' !'}"
