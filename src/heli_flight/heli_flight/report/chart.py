# SPDX-License-Identifier: Apache-2.0
"""A chart as data: what is drawn, told once for the page (Plotly) and for the paper (Matplotlib).

Colours are roles; each backend and theme has its own palette, all from Okabe and Ito's colours,
which people with any colour vision tell apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

MAX_POINTS = 1600
"""Points per trace on the page; beyond that the envelope is kept."""

# Role: colour on white, colour on black.
PALETTE: dict[str, tuple[str, str]] = {
    "nav": ("#0072B2", "#56B4E9"),
    "truth": ("#D55E00", "#E69F00"),
    "reference": ("#222222", "#EDEDED"),
    "bound": ("#AA3377", "#E79AC6"),
    "rival": ("#E69F00", "#F0E442"),
    "green": ("#009E73", "#2FC79B"),
    "sky": ("#56B4E9", "#8CCBF2"),
    "purple": ("#CC79A7", "#CC79A7"),
    "muted": ("#8A8A8A", "#8F979E"),
    "good": ("#009E73", "#2FC79B"),
    "warn": ("#E69F00", "#F0E442"),
    "bad": ("#D55E00", "#FF7A45"),
}


@dataclass(frozen=True)
class Trace:
    """One line, step, band or set of points.

    Attributes
    ----------
    x, y : (N,) ndarray
    label : str
        Name in the legend; an empty one keeps it out.
    role : str
        Key of PALETTE.
    kind : str
        "line", "dash", "dot", "band" (between y and y2), "points" or "bar" (thick segments).
    y2 : (N,) ndarray, optional
        Lower edge of a band.
    width : float
        Line width, px.
    """

    x: np.ndarray
    y: np.ndarray
    label: str
    role: str
    kind: str = "line"
    y2: np.ndarray | None = None
    width: float = 1.4


@dataclass(frozen=True)
class Panel:
    """One pair of axes; panels of a chart stand below each other.

    Attributes
    ----------
    y_label : str
        Quantity and unit.
    traces : sequence of Trace
    height : float
        Relative to the chart's other panels.
    y_range, x_range : pair of float, optional
        An x_range of its own unties the panel from the others' x axis.
    y_ticks : sequence of str, optional
        Names of the lanes at y = 0, 1, 2, ...
    log_y : bool
    note : str
        Written above the panel.
    """

    y_label: str
    traces: Sequence[Trace]
    height: float = 1.0
    y_range: tuple[float, float] | None = None
    x_range: tuple[float, float] | None = None
    y_ticks: Sequence[str] = ()
    log_y: bool = False
    note: str = ""


@dataclass(frozen=True)
class Band:
    """A stretch of flight time of which something was recorded, shaded in charts over time.

    Attributes
    ----------
    start_s, end_s : float
        Flight time; equal ends: a moment.
    kind : str
        "mode" (along the upper edge), "health" (along the lower edge), "fault", "failsafe".
    name : str
        Short, for a legend.
    role : str
        Key of PALETTE.
    told : str
        A sentence more, for a table; or empty.
    of : str
        What a fault is of, which names its lane of the timeline; empty for other kinds.
    """

    start_s: float
    end_s: float
    kind: str
    name: str
    role: str
    told: str = ""
    of: str = ""


@dataclass(frozen=True)
class Chart:
    """A figure.

    Attributes
    ----------
    key : str
        Name of its files and its anchor.
    title, caption : str
        The caption is a sentence or two; conditions are added by the page.
    panels : sequence of Panel
    section : str
        Where on the page it stands.
    paper : str
        The paper's figure that it redraws ("Fig. 5"), or empty.
    x_label : str
    time : bool
        Whether x is flight time, so that its zoom is shared with the other charts of time.
    spans : sequence of (start, end)
        Shaded stretches of x: the scored phases.
    bands : sequence of Band, optional
        What was recorded of modes, faults, failsafes; None: not settled yet (`with_bands`).
    log_x, square : bool
        square: equal scales and a 1 m grid.
    """

    key: str
    title: str
    caption: str
    panels: Sequence[Panel]
    section: str
    paper: str = ""
    x_label: str = "flight time, s"
    time: bool = True
    spans: Sequence[tuple[float, float]] = ()
    log_x: bool = False
    square: bool = False
    bands: Sequence[Band] | None = None

    @property
    def has_data(self) -> bool:
        """Whether anything is drawn besides bounds and references."""
        traces = [trace for panel in self.panels for trace in panel.traces]
        drawn = [trace for trace in traces if trace.role not in ("bound", "reference")]
        return any(bool(np.isfinite(trace.y).any()) for trace in drawn)


def with_bands(charts: Sequence[Chart], bands: Sequence[Band]) -> list[Chart]:
    """The charts, those over flight time with the bands, but for those that have their own."""
    return [
        replace(chart, bands=tuple(bands)) if chart.time and chart.bands is None else chart
        for chart in charts
    ]


def unit_of(label: str) -> str:
    """Unit in an axis' label, what stands behind the last comma: "v_z, m/s"; empty for none."""
    unit = label.rpartition(", ")[2] if ", " in label else ""
    return "" if unit == "1" else unit


FEW_DECADES = 2.0
"""A logarithmic axis over at most so many decades has ticks between the powers of ten."""


def decades(values: Sequence[np.ndarray]) -> float:
    """Decades from the smallest to the largest positive value; 0 if there is none."""
    flat = np.concatenate([np.ravel(v) for v in values]) if values else np.empty(0)
    positive = flat[np.isfinite(flat) & (flat > 0.0)]
    return float(np.log10(positive.max() / positive.min())) if positive.size else 0.0


def largest(values: np.ndarray) -> float:
    """Largest magnitude of the finite values, 0 if there is none."""
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max()) if finite.size else 0.0


def beyond(x: np.ndarray, lines: Sequence[np.ndarray], reach: float, unit: str) -> str:
    """Where lines over flight time leave an axis to +-reach, for a note; empty if they do not."""
    if not len(x):
        return ""
    magnitude = np.max(np.abs([np.nan_to_num(line) for line in lines]), axis=0)
    at = int(np.argmax(magnitude))
    if magnitude[at] <= reach:
        return ""
    space = "" if unit == "°" else " "
    return f"to {magnitude[at]:.1f}{space}{unit} at {x[at]:.1f} s, beyond this axis"


def limits(x: np.ndarray, value: float, label: str, role: str = "bound") -> Trace:
    """Dashed lines at +value and -value over the range of x."""
    ends = np.array([x[0], x[-1], np.nan, x[0], x[-1]], float)
    levels = np.array([value, value, np.nan, -value, -value])
    return Trace(ends, levels, label, role, "dash", width=1.2)


def level(
    x: np.ndarray, value: float, label: str, role: str = "bound", kind: str = "dash"
) -> Trace:
    """A horizontal line over the range of x."""
    return Trace(np.array([x[0], x[-1]], float), np.full(2, value), label, role, kind, width=1.2)


def envelope(columns: Sequence[np.ndarray], points: int = MAX_POINTS) -> np.ndarray:
    """Indices that keep the extremes of every column, and its gaps.

    Parameters
    ----------
    columns : sequence of (N,) ndarray
        Signals that are drawn over the same samples; NaN is a gap.
    points : int
        About how many indices are wanted.

    Returns
    -------
    (M,) ndarray of int
        Ascending; all N if N <= points. Each bucket of neighbouring samples gives the largest and
        the smallest sample of each column, and a gap if it has one.
    """
    n = len(columns[0])
    if n <= points:
        return np.arange(n)
    size = -(-n * 2 * len(columns) // points)
    buckets = -(-n // size)
    starts = np.arange(buckets) * size
    kept = [np.array([0, n - 1])]
    for column in columns:
        padded = np.full(buckets * size, column[-1], float)
        padded[:n] = column
        table = padded.reshape(buckets, size)
        gap = np.isnan(table)
        kept.append(starts + np.argmax(np.where(gap, -np.inf, table), axis=1))
        kept.append(starts + np.argmin(np.where(gap, np.inf, table), axis=1))
        partly = gap.any(axis=1)
        kept.append((starts + np.argmax(gap, axis=1))[partly])
    return np.unique(np.minimum(np.concatenate(kept), n - 1))


def thinned(trace: Trace, points: int = MAX_POINTS, planar: bool = False) -> Trace:
    """The trace with at most about `points` samples and the same envelope.

    Parameters
    ----------
    trace : Trace
    points : int
    planar : bool
        True if x is no time axis: then x keeps its extremes, too.
    """
    columns = [trace.y] if trace.y2 is None else [trace.y, trace.y2]
    if planar:
        columns.append(trace.x)
    keep = envelope(columns, points)
    if keep.size == len(trace.x):
        return trace
    y2 = None if trace.y2 is None else trace.y2[keep]
    return Trace(trace.x[keep], trace.y[keep], trace.label, trace.role, trace.kind, y2, trace.width)
