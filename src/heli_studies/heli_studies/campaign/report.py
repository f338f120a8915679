# SPDX-License-Identifier: Apache-2.0
"""report.html and figures of a campaign's folder, with the flight report's look."""

import math
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from markupsafe import Markup
from numpy.typing import NDArray

from heli_core.folders import write_whole
from heli_core.metrics import PaperMetric
from heli_core.rcl_yaml import ParameterError
from heli_flight.report.data import Chart, Panel, Trace
from heli_flight.report.figures import write_figures
from heli_flight.report.page import PageHeader, filled
from heli_flight.report.tables import ReportTable
from heli_flight.scoring import SOURCE_NAMES, SOURCES, figures_of
from heli_studies.campaign.run import (
    ROWS,
    SPEC_NAME,
    Sensitivity,
    Store,
    Summary,
    WorstFlight,
    about_of,
    bounds_of,
    cases,
    explained_variance,
    judged_figures,
    sensitivities,
    summary_of,
    worst_flights,
)
from heli_studies.campaign.spec import (
    CAUSE,
    FIGURE,
    INPUT,
    SENTENCE,
    FlightEnding,
    Spec,
    spec_of,
    write_rerun_files,
)

# -------------------------------------------------------------------------------------------------
# Charts of a campaign: distributions beside the bounds, and what goes with what.
# -------------------------------------------------------------------------------------------------

MARGIN, DISTRIBUTIONS, SPREAD = "margin", "distributions", "spread"
_ROLES = {"navigation": "nav", "truth": "truth"}
_BINS = 40
_ROOM, _FAR, _USUAL = 1.15, 2.0, 0.99
"""Of the bound: how far a histogram reaches at least; at most, unless this share is beyond."""
_STRONGEST = 4
Array = NDArray[np.float64]


def column(table: pa.Table, name: str) -> Array:
    """A column of figures (N,); NaN where a flight has none."""
    if name not in table.column_names:
        return np.full(table.num_rows, math.nan)
    return np.array([math.nan if v is None else v for v in table[name].to_pylist()], dtype=float)


def margin_chart(judged_flights: Sequence[WorstFlight], bounds: str) -> Chart:
    """How near the flights come to a bound: of the worst judged figure of each."""
    shares = np.array([case.share for case in judged_flights])
    caption = (
        "Of each flight the judged figure that is the largest part of its bound. A flight right of "
        "1 is outside; one that was lost has no figure and is counted as beyond every bound."
    )
    shown = {"worst judged figure": ("nav", shares)}
    panels = [_cumulative(shown, 1.0, bounds, len(judged_flights))]
    return Chart(
        "margin", "How near the flights come to a bound", caption, panels, MARGIN,
        x_quantity="largest judged figure as a part of its bound", x_unit="", time=False,
    )  # fmt: skip


def distribution_charts(table: pa.Table, metrics: Sequence[PaperMetric]) -> list[Chart]:
    """Of each metric its histogram and its cumulative distribution, from both records."""
    return [_distribution(table, metric) for metric in metrics]


def _distribution(table: pa.Table, metric: PaperMetric) -> Chart:
    figures = {
        SOURCE_NAMES[source]: (_ROLES[source], column(table, f"{FIGURE}{metric.key} ({source})"))
        for source in SOURCES
    }
    caption = "Largest magnitude in the scored windows, a value a flight."
    words = ""
    if metric.bounded:
        words = f"{metric.bound_name}: {metric.bound_text}"
        caption += f" Bound: {metric.bound_text} ({metric.source})."
    panels = [
        _histogram(figures, metric.paper, words, metric.unit),
        _cumulative(figures, metric.paper, words, table.num_rows),
    ]
    title = metric.label[:1].upper() + metric.label[1:]
    key = f"dist_{metric.key}"
    return Chart(
        key,
        title,
        caption,
        panels,
        DISTRIBUTIONS,
        x_quantity=metric.label,
        x_unit=metric.unit,
        time=False,
    )


Figures = Mapping[str, tuple[str, Array]]


def _histogram(figures: Figures, bound: float, words: str, unit: str) -> Panel:
    """Counts over values, the bound in sight; what is far beyond stands in the last bin."""
    known = [values[np.isfinite(values)] for _, values in figures.values()]
    every = np.concatenate([*known, np.zeros(1)])
    most, usual = float(every.max()), float(np.quantile(every, _USUAL))
    reach = most if not words else max(_ROOM * bound, min(most, max(usual, _FAR * bound)))
    edges = np.linspace(0.0, reach or 1.0, _BINS + 1)
    traces, highest = [], 1.0
    for (label, (role, _)), values in zip(figures.items(), known, strict=True):
        counts, _ = np.histogram(np.minimum(values, edges[-1]), edges)
        highest = max(highest, float(counts.max()))
        x, y = np.repeat(edges, 2), np.concatenate(([0], np.repeat(counts, 2), [0]))
        traces.append(Trace(x, y.astype(float), label, role))
    if words:
        traces.append(_upright(bound, 1.06 * highest, words))
    beyond = int((every > edges[-1]).sum())
    note = f"{beyond} up to {most:.3g} {unit} in the last bin" if beyond else ""
    return Panel("flights", "", traces, y_range=(0.0, 1.06 * highest), note=note)


def _upright(bound: float, height: float, label: str) -> Trace:
    ends = np.array([0.0, height])
    return Trace(np.full(2, bound), ends, label, "bound", "dash", width=2.2)


def _cumulative(figures: Figures, bound: float, words: str, count: int) -> Panel:
    """Share of all flights at or below a value; those without a figure are never below."""
    traces = []
    for label, (role, values) in figures.items():
        known = np.sort(values[np.isfinite(values)])
        end = max([*known[-1:], _ROOM * bound if words else 0.0])  # beyond the bound, to show it
        x = np.concatenate(([0.0], np.repeat(known, 2), [end]))
        steps = np.arange(len(known) + 1) / max(count, 1)
        traces.append(Trace(x, np.repeat(steps, 2), label, role))
    if words:
        traces.append(_upright(bound, 1.0, words))
    return Panel("share of flights", "", traces, y_range=(0.0, 1.03))


def failure_chart(inputs: Mapping[str, Sequence[object]], failed: Sequence[bool]) -> Chart:
    """Where in the dispersed ranges the flights that failed are, beside all."""
    bad = np.array(failed, dtype=bool)
    panels = []
    for name, column in inputs.items():
        if isinstance(column[0], str) or not bad.any():
            continue
        values = np.array(column, dtype=float)
        low, span = float(values.min()), float(np.ptp(values))
        if span == 0.0:
            continue
        panels.append(
            Panel(
                "share",
                "",
                [
                    _shares((values - low) / span, "all flights", "muted"),
                    _shares((values[bad] - low) / span, "outside or not flown to the end", "bad"),
                ],
                y_range=(0.0, 1.03),
                note=f"{name}: {low:.4g} to {low + span:.4g}",
            )  # fmt: skip
        )
    caption = (
        "Cumulative shares over each input's flown range. An input that has nothing to do with "
        "failing has two lines that lie together; where the second climbs, flights fail."
    )
    return Chart(
        "failures", "Where the flights that failed are", caption, panels, SPREAD,
        x_quantity="input, as a part of its flown range", x_unit="", time=False,
    )  # fmt: skip


def _shares(values: Array, label: str, role: str) -> Trace:
    known = np.sort(values)
    x = np.concatenate(([0.0], np.repeat(known, 2), [1.0]))
    y = np.concatenate((np.repeat(np.arange(len(known) + 1) / len(known), 2),))
    return Trace(x, y, label, role)


def scatter_charts(
    inputs: Mapping[str, Sequence[object]],
    figures: Mapping[str, tuple[PaperMetric, Array]],
    strongest: Mapping[str, Sequence[Sensitivity]],
    failed: Sequence[bool],
) -> list[Chart]:
    """The strongest pairs of an input and a figure, a point a flight.

    Parameters
    ----------
    inputs : mapping
        Name to one value a flight.
    figures : mapping
        Name of a figure to its metric and values (N,).
    strongest : mapping
        Name of a figure to the inputs' influences, the strongest first.
    failed : sequence of bool
    """
    pairs = [
        (abs(one.rank_correlation), figure, one)
        for figure, influences in strongest.items()
        for one in influences
        if math.isfinite(one.rank_correlation) and not isinstance(inputs[one.name][0], str)
    ]
    pairs.sort(key=lambda pair: -pair[0])
    bad = np.array(failed, dtype=bool)
    charts: list[Chart] = []
    drawn = set()
    for _, name, one in pairs:
        metric, values = figures[name]
        if metric.key in drawn or len(charts) == _STRONGEST:
            continue
        drawn.add(metric.key)
        x = np.array(inputs[one.name], dtype=float)
        ends = np.array([x.min(), x.max()])
        traces = [
            Trace(x[~bad], values[~bad], "flight inside all bounds", "nav", "points"),
            Trace(x[bad], values[bad], "flight outside one", "bad", "points"),
        ]
        if metric.bounded:
            traces.append(
                Trace(ends, np.full(2, metric.paper), "bound", "bound", "dash", width=1.2)
            )
        title = f"{metric.label[:1].upper()}{metric.label[1:]} over {one.name}"
        caption = f"Rank correlation {one.rank_correlation:+.2f}; a point a flight, {name}."
        highest = max(float(np.nanmax(values)), metric.paper if metric.bounded else 0.0)
        panel = Panel(
            metric.label, metric.unit, [t for t in traces if t.x.size], height=1.6,
            y_range=(0.0, 1.06 * highest),
        )  # fmt: skip
        key = f"pair_{metric.key}"
        charts.append(
            Chart(key, title, caption, [panel], SPREAD, x_quantity=one.name, x_unit="", time=False)
        )
    return charts


# -------------------------------------------------------------------------------------------------
# A campaign's folder, read for its report: finished or not.
# -------------------------------------------------------------------------------------------------

WORST = "worst"
SHOWN = 10
"""Worst cases that are told."""


@dataclass(frozen=True)
class CampaignFolder:
    """A campaign's folder, read.

    Attributes
    ----------
    folder : Path
    about : mapping
        As of `about_of`.
    table : pa.Table
        Rows.
    summary : Summary
    cases : sequence of WorstFlight
    again : mapping
        Number of a worst case to the file that flies it again.
    why_not : str
        Why there are none of these; empty if there are.
    damaged : sequence of Path
        Files whose rows cannot be used: their flights are missing.
    """

    folder: Path
    about: Mapping[str, Any]
    table: pa.Table
    summary: Summary
    cases: Sequence[WorstFlight]
    again: Mapping[int, Path]
    why_not: str
    damaged: Sequence[Path] = ()

    @property
    def inputs(self) -> dict[str, list[object]]:
        """Name of each dispersed parameter to one value a flight."""
        names = [name for name in self.table.column_names if name.startswith(INPUT)]
        return {name.removeprefix(INPUT): self.table[name].to_pylist() for name in names}

    @property
    def figures(self) -> dict[str, tuple[PaperMetric, Array]]:
        """Judged figures: name to its metric and a value a flight."""
        judged = judged_figures(self.table, self.about["flown"])
        return {
            name.removeprefix(FIGURE): (metric, column(self.table, name))
            for name, (metric, _) in judged.items()
        }

    @property
    def metrics(self) -> tuple[PaperMetric, ...]:
        """What is scored, with what bounds it."""
        return bounds_of(self.about["flown"])

    @property
    def missing(self) -> int:
        """Flights of the spec that have no row yet."""
        return int(self.about["flights"]) - self.table.num_rows


def read_campaign(folder: Path) -> CampaignFolder:
    """Read a campaign's folder, finished or not, and write the files that fly its worst again.

    Raises
    ------
    ParameterError
        It holds no campaign, or none of its flights has ended.
    """
    about = about_of(folder)
    store = Store(folder, flights=about["flights"])
    table, damaged = store.table(), store.damaged()
    if not table.num_rows:
        raise ParameterError(f"{folder}: no flight has ended yet; --resume flies them")
    judged_flights = cases(table, about["flown"])
    numbers = [case.number for case in worst_flights(judged_flights, SHOWN)]
    again, why_not = _again(folder, about, numbers)
    return CampaignFolder(
        folder,
        about,
        table,
        summary_of(table, about["flown"]),
        judged_flights,
        again,
        why_not,
        damaged,
    )


def _again(
    folder: Path, about: Mapping[str, Any], numbers: Sequence[int]
) -> tuple[dict[int, Path], str]:
    spec = _spec(folder, about)
    if spec is None:
        return {}, (
            f"The spec {about['file']} is gone or has changed: no files to fly these again."
        )
    try:
        written = write_rerun_files(spec, numbers, folder / WORST)
    except (ParameterError, OSError) as error:
        return {}, f"No files to fly these again: {error}."
    return {int(path.parent.name.rpartition("_")[2]): path for path in written}, ""


def _spec(folder: Path, about: Mapping[str, Any]) -> Spec | None:
    """The spec that was flown: the user's file, or the copy; None if both are others by now."""
    for file in (Path(about["file"]), folder / SPEC_NAME):
        try:
            # What is no file, such as a FIFO, would hold this up.
            spec = spec_of(file) if file.is_file() else None
            if spec is not None and spec.identity == about["spec"]:
                return spec
        except (ParameterError, OSError):
            continue
    return None


# -------------------------------------------------------------------------------------------------
# Tables of a campaign's report.
# -------------------------------------------------------------------------------------------------

_SURE = 0.01
"""Correlations that chance makes less often than so stand out."""
_NONE = "–"


def percent(share: float) -> str:
    """A share as per cent with three digits, however small."""
    return f"{100.0 * share:.3g} %"


def _number(value: float) -> str:
    return _NONE if math.isnan(value) else f"{value:.3g}".replace("-", "−")


def quantiles_table(campaign: CampaignFolder) -> ReportTable:
    """Quantiles of each figure from each record, its bound, and how many flights are beyond."""
    head = ["metric", "median", "95 %", "99 %", "largest", "bound", "outside", "record"]
    rows = []
    for name, values in campaign.summary.quantiles.items():
        key, _, source = name.removesuffix(")").partition(" (")
        metric = next(m for m in campaign.metrics if m.key == key)
        figures = column(campaign.table, FIGURE + name)
        beyond = int((figures > metric.paper).sum())
        rows.append(
            [
                f"{metric.label}, {metric.unit}", *map(_number, values),
                f"{metric.paper:g}" if metric.bounded else _NONE,
                _coloured(beyond), SOURCE_NAMES[source],
            ]
        )  # fmt: skip
    caption = (
        "Quantiles over the flights that ended in the air, largest magnitude in the scored "
        "windows. Ground truth decides where the receiver can know it (rtk)."
    )
    return ReportTable(head, rows, caption)


def _coloured(count: int) -> str:
    return Markup('<span class="{}">{}</span>').format("out" if count else "in", count)


def causes_table(campaign: CampaignFolder) -> ReportTable:
    """How the flights ended."""
    outside = sum(case.failed for case in campaign.cases if case.cause == FlightEnding.FLOWN)
    rows = [
        [str(cause), str(count), _share(count, campaign), _example(campaign, str(cause))]
        for cause, count in Counter(campaign.table[CAUSE].to_pylist()).most_common()
    ]
    if outside:
        rows.append(
            ["of those flown, outside the bounds", str(outside), _share(outside, campaign), ""]
        )
    return ReportTable(["how they ended", "flights", "share", "first of them"], rows)


def _share(count: int, campaign: CampaignFolder) -> str:
    return percent(count / campaign.table.num_rows)


def _example(campaign: CampaignFolder, cause: str) -> str:
    causes, sentences = campaign.table[CAUSE].to_pylist(), campaign.table[SENTENCE].to_pylist()
    return next(s for c, s in zip(causes, sentences, strict=True) if c == cause)


def correlations_table(
    campaign: CampaignFolder, strongest: Mapping[str, Sequence[Sensitivity]]
) -> ReportTable | None:
    """Influence of each input on each judged figure; None if nothing can be said."""
    inputs = campaign.inputs
    figures = [name for name, influences in strongest.items() if influences]
    if not inputs or not figures:
        return None
    by_name = {f: {one.name: one for one in strongest[f]} for f in figures}
    rows: list[list[str]] = [
        [name, *(_correlation(by_name[figure][name]) for figure in figures)] for name in inputs
    ]
    shares = [explained_variance(inputs, campaign.figures[figure][1]) for figure in figures]
    rows.append(["all together explain", *(_NONE if math.isnan(s) else f"{s:.0%}" for s in shares)])
    caption = (
        "Spearman's rank correlation of each input with each judged figure over the flights that "
        f"ended in the air; strong print where chance makes one as large in less than {_SURE:.0%}. "
        "Last row: share of the ranks' variance that the inputs explain linearly together "
        "(adjusted); the rest is what the seed draws, wind and noise, and what is not monotonic. "
        "Of a choice between names: the root of the share of variance between them."
    )
    return ReportTable(["input", *figures], rows, caption)


def _correlation(one: Sensitivity) -> str:
    if math.isnan(one.rank_correlation):
        return _NONE
    text = f"{one.rank_correlation:+.2f}".replace("-", "−")
    return Markup("<strong>{}</strong>").format(text) if one.p_value < _SURE else text


def worst_table(campaign: CampaignFolder) -> ReportTable:
    """The worst cases, each with the command that flies it again."""
    rows = []
    for case in worst_flights(campaign.cases, SHOWN):
        figure = "" if not case.figure else f"{case.figure} {_number(case.value)}"
        share = _NONE if math.isnan(case.share) else f"{percent(case.share)} of its bound"
        what = f"{figure}, {share}" if figure else case.sentence or _NONE
        again = campaign.again.get(case.number)
        command = Markup("<code>{}</code>").format(
            f"./heli hover --params {shlex.quote(str(again))}") if again else _NONE  # fmt: skip
        how = "outside" if case.failed and case.cause == FlightEnding.FLOWN else case.cause
        rows.append([str(case.number), str(case.seed), how, what, command])
    return ReportTable(["flight", "seed", "end", "farthest", "fly it again"], rows, words=True)


def dispersed_table(campaign: CampaignFolder) -> ReportTable:
    """Distribution and flown range of each parameter."""
    rows = []
    inputs = campaign.inputs
    for name, how in campaign.about["disperse"].items():
        values: list[Any] = inputs.get(name, [])
        rows.append([name, how, _range(values) if values else _NONE])
    return ReportTable(["parameter", "distribution", "flown"], rows, words=True)


def _range(values: list[Any]) -> str:
    if isinstance(values[0], str):
        return ", ".join(sorted(set(values)))
    return f"{_end(min(values))} to {_end(max(values))}"


def _end(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


# -------------------------------------------------------------------------------------------------
# Report.
# -------------------------------------------------------------------------------------------------

PAGE, FIGURES = "report.html", "figures"
STEPS = 3
_DIGITS = 12
_TITLES = {
    "result": "Result",
    "margin": "How near to the bounds",
    "distributions": "Distributions beside the bounds",
    "spread": "What explains the spread",
    "worst": "Worst cases",
    "dispersed": "What was dispersed",
}
_AGAIN = (
    "Each command flies the same flight through the graph of nodes, recorded in full, with a "
    "report of its own. A flight whose parameters were refused has none."
)


def write_page(campaign: CampaignFolder, folder: Path, progress: Callable[[int], None]) -> Path:
    """Write report.html and figures/ into a folder; returns the page.

    Raises
    ------
    ParameterError
        The folder cannot be written.
    """
    strongest = {
        name: sensitivities(campaign.inputs, v) for name, (_, v) in campaign.figures.items()
    }
    failed = [case.failed for case in campaign.cases]
    bounds = figures_of(campaign.metrics)
    charts = [
        *([margin_chart(campaign.cases, bounds)] if bounds else []),
        *distribution_charts(campaign.table, campaign.metrics),
        failure_chart(campaign.inputs, failed),
        *scatter_charts(campaign.inputs, campaign.figures, strongest, failed),
    ]
    charts = [chart for chart in charts if chart.has_data]
    progress(1)
    links = dict(_TITLES)
    for key in ("margin", "distributions"):
        if key not in {chart.section for chart in charts}:
            links.pop(key)
    text = filled(
        "campaign.html",
        _head(campaign, links),
        charts,
        quantiles=quantiles_table(campaign),
        causes=causes_table(campaign),
        conditions=_conditions(campaign),
        correlations=correlations_table(campaign, strongest),
        worst=worst_table(campaign),
        again=campaign.why_not or _AGAIN,
        dispersed=dispersed_table(campaign),
    )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / PAGE, text)
        progress(2)
        write_figures(charts, _conditions(campaign), folder / FIGURES)
    except OSError as error:
        raise ParameterError(f"{folder}: cannot be written: {error.strerror or error}") from None
    progress(STEPS)
    return folder / PAGE


def _head(campaign: CampaignFolder, links: Mapping[str, str]) -> PageHeader:
    flown = campaign.about["flown"]
    return PageHeader(
        kind="Campaign report · simulation",
        title=f"Campaign: {flown['scenario']}, {campaign.table.num_rows} flights",
        heading=f"Campaign of {campaign.table.num_rows} flights: {flown['scenario']}",
        verdicts=_verdicts(campaign),
        facts=_facts(campaign),
        links=links,
    )


def _verdicts(campaign: CampaignFolder) -> list[tuple[str, str, str]]:
    summary = campaign.summary
    low, high = summary.interval
    bounds = figures_of(campaign.metrics)
    inside = f"inside {bounds}" if bounds else "flown to the end; nothing bounds them"
    outside = f"outside {bounds} or" if bounds else ""
    sure = f"95 % confidence: {percent(low)} to {percent(high)} (Clopper, Pearson)"
    if summary.failed:
        mark, tone = "✗", "bad"
        words = (
            f"{summary.failed} of {summary.flights} flights {outside} not flown to the "
            f"end: {percent(summary.failed / summary.flights)}; {sure}."
        )
    else:
        mark, tone = "✓", "good"
        words = f"All {summary.flights} flights {inside}; share that fails, {sure}."
    verdict_rows = [(mark, tone, words)]
    if campaign.missing:
        words = f"{campaign.missing} of {campaign.about['flights']} flights have no row yet."
        verdict_rows.append(("–", "", f"{words} `heli campaign ... --resume` flies them."))
    if campaign.damaged:
        names = ", ".join(f"{ROWS}/{part.name}" for part in campaign.damaged[:SHOWN])
        words = f"Damaged, not counted: {names}"
        more = len(campaign.damaged) - SHOWN
        verdict_rows.append(("✗", "bad", words + (f" and {more} more." if more > 0 else ".")))
    return verdict_rows


def _facts(campaign: CampaignFolder) -> list[tuple[str, str]]:
    flown = campaign.about["flown"]
    return [
        ("Scenario", f"{flown['scenario']}, {flown['duration_s']:g} s"),
        ("World", Path(flown["world"]).stem),
        ("Control preset", Path(flown["laws"]).stem),
        ("GPS", flown["gps"]),
        ("Sampling", flown["sampling"].replace("_", " ")),
        ("Dispersed", f"{len(campaign.about['disperse'])} parameters"),
        ("Not lost", campaign.summary.survived.words),
        ("Sources", campaign.about["commit"][:_DIGITS]),
    ]


def _conditions(campaign: CampaignFolder) -> str:
    flown = campaign.about["flown"]
    return (
        f"simulated: {campaign.table.num_rows} flights of {flown['scenario']}, "
        f"{flown['duration_s']:g} s, world {Path(flown['world']).stem}, GPS {flown['gps']}, "
        f"{flown['sampling'].replace('_', ' ')} sampling; "
        f"sources {campaign.about['commit'][:_DIGITS]}"
    )


def as_dict(campaign: CampaignFolder, page: Path) -> dict[str, Any]:
    """For --json."""
    return {
        "report": str(page),
        "figures": sorted(str(path) for path in (page.parent / FIGURES).iterdir()),
        "flights": campaign.summary.flights,
        "missing": campaign.missing,
        "damaged": list(map(str, campaign.damaged)),
        "failed": campaign.summary.failed,
        "interval": list(campaign.summary.interval),
        "worst": {str(number): str(path) for number, path in campaign.again.items()},
    }
