# SPDX-License-Identifier: Apache-2.0
"""Charts of a campaign: distributions beside the bounds, and what goes with what."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from heli_flight.loop.scoring import SOURCE_NAMES, SOURCES, figures_of
from heli_flight.report.chart import Chart, Panel, Trace
from heli_flight.studies.dispersion.explain import Influence
from heli_flight.studies.dispersion.row import FIGURE
from heli_flight.studies.dispersion.worst import Case
from heli_math.paper_metrics import METRICS, Metric

MARGIN, DISTRIBUTIONS, SPREAD = "margin", "distributions", "spread"
_ROLES = {"navigation": "nav", "truth": "truth"}
_BINS = 40
_STRONGEST = 4
Array = NDArray[np.float64]


def column(table: pa.Table, name: str) -> Array:
    """A column of figures (N,); NaN where a flight has none."""
    if name not in table.column_names:
        return np.full(table.num_rows, math.nan)
    return np.array([math.nan if v is None else v for v in table[name].to_pylist()], dtype=float)


def margin_chart(found: Sequence[Case], kind: str) -> Chart:
    """How near the flights come to a bound: of the worst judged figure of each."""
    shares = np.array([case.share for case in found])
    caption = (
        "Of each flight the judged figure that is the largest part of its bound. A flight right of "
        "1 is outside; one that was lost has no figure and is counted as beyond every bound."
    )
    panels = [_cumulative({"worst judged figure": ("nav", shares)}, 1.0, kind, len(found))]
    return Chart(
        "margin", "How near the flights come to a bound", caption, panels, MARGIN,
        x_label="largest judged figure as a part of its bound", time=False,
    )  # fmt: skip


def distribution_charts(table: pa.Table, kind: str) -> list[Chart]:
    """Of each metric its histogram and its cumulative distribution, from both records."""
    return [_distribution(table, metric, kind) for metric in METRICS[kind]]


def _distribution(table: pa.Table, metric: Metric, kind: str) -> Chart:
    figures = {
        SOURCE_NAMES[source]: (_ROLES[source], column(table, f"{FIGURE}{metric.key} ({source})"))
        for source in SOURCES
    }
    caption = (
        "Largest magnitude in the scored windows, a value a flight. "
        f"{figures_of(kind).capitalize()} have {metric.paper:g} {metric.unit} ({metric.source})."
    )
    panels = [
        _histogram(figures, metric.paper),
        _cumulative(figures, metric.paper, kind, table.num_rows),
    ]
    title = metric.label[:1].upper() + metric.label[1:]
    label = f"{metric.label}, {metric.unit}"
    key = f"dist_{metric.key}"
    return Chart(key, title, caption, panels, DISTRIBUTIONS, x_label=label, time=False)


Figures = Mapping[str, tuple[str, Array]]


def _histogram(figures: Figures, bound: float) -> Panel:
    known = [values[np.isfinite(values)] for _, values in figures.values()]
    most = max((float(values.max()) for values in known if values.size), default=bound)
    edges = np.linspace(0.0, max(most, bound), _BINS + 1)
    traces, highest = [], 1.0
    for (label, (role, _)), values in zip(figures.items(), known, strict=True):
        counts, _ = np.histogram(values, edges)
        highest = max(highest, float(counts.max()))
        x, y = np.repeat(edges, 2), np.concatenate(([0], np.repeat(counts, 2), [0]))
        traces.append(Trace(x, y.astype(float), label, role))
    traces.append(_upright(bound, highest))
    return Panel("flights", traces, y_range=(0.0, 1.06 * highest))


def _upright(bound: float, height: float, label: str = "") -> Trace:
    ends = np.array([0.0, height])
    return Trace(np.full(2, bound), ends, label, "bound", "dash", width=1.2)


def _cumulative(figures: Figures, bound: float, kind: str, count: int) -> Panel:
    """Share of all flights at or below a value; those without a figure are never below."""
    traces = []
    for label, (role, values) in figures.items():
        known = np.sort(values[np.isfinite(values)])
        x = np.concatenate(([0.0], np.repeat(known, 2)))
        steps = np.arange(len(known) + 1) / max(count, 1)
        traces.append(Trace(x, np.repeat(steps, 2)[:-1], label, role))
    traces.append(_upright(bound, 1.0, figures_of(kind)))
    return Panel("share of flights", traces, y_range=(0.0, 1.03))


def failure_chart(inputs: Mapping[str, Sequence[object]], failed: Sequence[bool]) -> Chart:
    """Where in the dispersed ranges the flights that failed are, beside all."""
    bad = np.array(failed, dtype=bool)
    panels = []
    for name, told in inputs.items():
        if isinstance(told[0], str) or not bad.any():
            continue
        values = np.array(told, dtype=float)
        low, span = float(values.min()), float(np.ptp(values))
        if span == 0.0:
            continue
        panels.append(
            Panel(
                "share",
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
        x_label="input, as a part of its flown range", time=False,
    )  # fmt: skip


def _shares(values: Array, label: str, role: str) -> Trace:
    known = np.sort(values)
    x = np.concatenate(([0.0], np.repeat(known, 2), [1.0]))
    y = np.concatenate((np.repeat(np.arange(len(known) + 1) / len(known), 2),))
    return Trace(x, y, label, role)


def scatter_charts(
    inputs: Mapping[str, Sequence[object]],
    figures: Mapping[str, tuple[Metric, Array]],
    strongest: Mapping[str, Sequence[Influence]],
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
        for figure, found in strongest.items()
        for one in found
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
            Trace(ends, np.full(2, metric.paper), "bound", "bound", "dash", width=1.2),
        ]
        told = f"{metric.label[:1].upper()}{metric.label[1:]} over {one.name}"
        caption = f"Rank correlation {one.rank_correlation:+.2f}; a point a flight, {name}."
        highest = max(float(np.nanmax(values)), metric.paper)
        panel = Panel(
            f"{metric.label}, {metric.unit}", [t for t in traces if t.x.size], height=1.6,
            y_range=(0.0, 1.06 * highest),
        )  # fmt: skip
        key = f"pair_{metric.key}"
        charts.append(Chart(key, told, caption, [panel], SPREAD, x_label=one.name, time=False))
    return charts
