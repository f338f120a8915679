# SPDX-License-Identifier: Apache-2.0
"""Charts as PNG and SVG files for a paper: white ground, one column wide, no interaction.

matplotlib is imported where a picture is drawn: a flight without pictures does not wait for it.
"""

from __future__ import annotations

import contextlib
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heli_flight.report.data import (
    FEW_DECADES,
    PALETTE,
    Band,
    Chart,
    Panel,
    Trace,
    decades,
    legend,
    thinned,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

# -------------------------------------------------------------------------------------------------
# Figures.
# -------------------------------------------------------------------------------------------------

_WIDTH_IN = 6.3
_PANEL_IN = 1.45
_DPI = 160
_POINTS = 1200
_LEGEND_CHARACTERS = 118
_STYLE: Any = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 9.5,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#444444",
    "axes.labelcolor": "#111111",
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.direction": "in",
    "ytick.direction": "in",
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "heli_flight",
    "path.simplify": True,
}
_DASHES = {"dash": (0, (5, 2.5)), "dot": (0, (1.2, 1.6))}


def write_figures(
    charts: Sequence[Chart],
    conditions: str,
    folder: Path,
    drawn: Callable[[int, int], None] = lambda done, total: None,
) -> list[Path]:
    """Write each chart as <key>.png and <key>.svg.

    Parameters
    ----------
    charts : sequence of Chart
    conditions : str
        Wind, sensors, seed: stands under every figure.
    folder : Path
        Made if missing; files of the same name are replaced.
    drawn : callable, optional
        Told how many charts are drawn, and of how many.

    Returns
    -------
    list of Path
        What was written.
    """
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with matplotlib.rc_context(_STYLE):
        for i, chart in enumerate(charts):
            drawn(i, len(charts))
            figure = draw(chart, conditions)
            for ending, extra in (("png", {"Software": None}), ("svg", {"Date": None})):
                path = folder / f"{chart.key}.{ending}"
                figure.savefig(path, dpi=_DPI, metadata=extra)
                written.append(path)
    drawn(len(charts), len(charts))
    return written


def draw(chart: Chart, conditions: str) -> Figure:
    """A chart as a figure for a paper; `conditions` stands under it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    heights = [panel.height for panel in chart.panels]
    columns, rows = _legend_shape(chart)
    plot_in = 4.6 if chart.square else _PANEL_IN * sum(heights) + 0.42 * (len(heights) - 1)
    top_in, bottom_in = 0.46 + 0.16 * rows, 0.92
    height_in = plot_in + top_in + bottom_in
    figure = Figure(figsize=(_WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    left = 0.14 if any(panel.y_ticks for panel in chart.panels) else 0.11
    axes = figure.subplots(
        len(heights), 1, squeeze=False,
        gridspec_kw={
            "height_ratios": heights, "left": left, "right": 0.975, "hspace": 0.34,
            "top": 1.0 - top_in / height_in, "bottom": bottom_in / height_in,
        },
    )[:, 0]  # fmt: skip
    shared = [i for i, panel in enumerate(chart.panels) if panel.x_range is None]
    span = _x_span(chart, shared)
    for i, (ax, panel) in enumerate(zip(axes, chart.panels, strict=True)):
        _panel(ax, chart, panel, span)
        if shared and i in shared and i != shared[-1]:
            ax.tick_params(which="both", labelbottom=False)
        else:
            ax.set_xlabel(chart.x_label, labelpad=2)
    _titles(figure, chart, axes, conditions, columns)
    return figure


def _legend_shape(chart: Chart) -> tuple[int, int]:
    """Columns and rows of the legend, so that the longest labels have room."""
    labels = {trace.label for panel in chart.panels for trace in panel.traces if trace.label}
    labels |= {band.name for band in legend(chart.bands or ())}
    if not labels:
        return 1, 0
    room = max(1, _LEGEND_CHARACTERS // (max(map(len, labels)) + 7))
    columns = min(len(labels), room)
    return columns, -(-len(labels) // columns)


def _x_span(chart: Chart, shared: Sequence[int]) -> tuple[float, float] | None:
    """Common range of x of the panels without one of their own."""
    x = [trace.x for i in shared for trace in chart.panels[i].traces if trace.x.size]
    if not x:
        return None
    return float(min(np.nanmin(v) for v in x)), float(max(np.nanmax(v) for v in x))


def _panel(ax, chart: Chart, panel: Panel, span: tuple[float, float] | None) -> None:
    ax.set_axisbelow(True)
    ax.grid(True)
    if chart.log_x:
        ax.set_xscale("log")
        _log_ticks(ax.xaxis, [t.x for p in chart.panels for t in p.traces])
    if panel.log_y:
        ax.set_yscale("log")
        ends = panel.y_range
        _log_ticks(ax.yaxis, [np.array(ends)] if ends else [t.y for t in panel.traces])
    for start, end in chart.spans if panel.x_range is None else ():
        ax.axvspan(start, end, color="#000000", alpha=0.045, linewidth=0)
    for band in (chart.bands or ()) if chart.time else ():
        _band(ax, band)
    for trace in panel.traces:
        _trace(ax, thinned(_cut(trace, panel), _POINTS, planar=chart.square))
    ax.set_ylabel(_with_indices(panel.y_label), labelpad=3)
    limits = panel.x_range or span
    if limits is not None:
        ax.set_xlim(*limits)
    if panel.y_range is not None:
        ax.set_ylim(*panel.y_range)
    if panel.y_ticks:
        ax.set_yticks(range(len(panel.y_ticks)), panel.y_ticks)
        ax.grid(False)
    if chart.square:
        ax.set_aspect("equal")
        from matplotlib.ticker import MultipleLocator

        ax.xaxis.set_major_locator(MultipleLocator(1.0))
        ax.yaxis.set_major_locator(MultipleLocator(1.0))
    if panel.note:
        ax.set_title(panel.note, loc="right", fontsize=7.5, color="#555555", pad=2.5)


def _band(ax, band: Band) -> None:
    """A mode along the upper edge, health along the lower one, a fault or failsafe over all."""
    colour, label = PALETTE[band.role][0], legend([band])[0].name
    if band.end_s - band.start_s <= 0.0:
        ax.axvline(band.start_s, color=colour, linewidth=1.0, label=label)
        return
    low, high = {"mode": (0.95, 1.0), "health": (0.0, 0.05)}.get(band.kind, (0.0, 1.0))
    alpha = 0.8 if high - low < 1.0 else 0.2
    ax.axvspan(
        band.start_s, band.end_s, low, high, color=colour, alpha=alpha, linewidth=0, label=label
    )


def _log_ticks(axis, values: Sequence[np.ndarray]) -> None:
    """Over few decades also what lies between the powers of ten, as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    span = decades(values)
    if span > FEW_DECADES:
        return
    between = [1.0, 2.0, 5.0] if span > 1.0 else list(np.arange(1.0, 10.0))
    axis.set_major_locator(LogLocator(subs=between))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _with_indices(text: str) -> str:
    """a_s, v_z, d_int as symbols with indices."""
    return re.sub(r"\b([a-z])_([a-z]+)\b", r"$\1_{\\mathrm{\2}}$", text)


def _cut(trace: Trace, panel: Panel) -> Trace:
    """What of a trace lies in the panel's own range of x: the enlargement keeps its detail."""
    if panel.x_range is None or trace.y2 is not None:
        return trace
    inside = ~((trace.x < panel.x_range[0] - 0.1) | (trace.x > panel.x_range[1] + 0.1))
    x, y = trace.x[inside], trace.y[inside]
    return Trace(x, y, trace.label, trace.role, trace.kind, None, trace.width) if x.size else trace


def _trace(ax, trace: Trace) -> None:
    colour = PALETTE[trace.role][0]
    label = trace.label or "_"
    width = 0.72 * trace.width
    if trace.kind == "band" and trace.y2 is not None:
        ax.fill_between(
            trace.x, trace.y2, trace.y, color=colour, alpha=0.18, linewidth=0, label=label
        )
    elif trace.kind == "points":
        ax.plot(trace.x, trace.y, "+", color=colour, markersize=8, label=label)
    elif trace.kind == "bar":
        ax.plot(trace.x, trace.y, color=colour, linewidth=8.0, label=label, solid_capstyle="butt")
    else:
        style = _DASHES.get(trace.kind, "-")
        ax.plot(trace.x, trace.y, color=colour, linewidth=width, linestyle=style, label=label)


def _titles(figure: Figure, chart: Chart, axes, conditions: str, columns: int) -> None:
    left, up = figure.subplotpars.left, 1.0 / figure.get_size_inches()[1]
    title = f"{chart.title} (as {chart.paper} of the paper)" if chart.paper else chart.title
    figure.text(left, 1.0 - 0.20 * up, title, fontsize=10, fontweight="bold", va="center")
    handles: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            if not label.startswith("_"):
                handles.setdefault(label, handle)
    if handles:
        legend = figure.legend(
            list(handles.values()), list(handles), loc="upper left", ncols=columns,
            bbox_to_anchor=(left, 1.0 - 0.29 * up), frameon=False, fontsize=7.5, borderaxespad=0.0,
            handlelength=1.8, columnspacing=1.2, borderpad=0.0,
        )  # fmt: skip
        for line in legend.get_lines():
            line.set_linewidth(min(line.get_linewidth(), 3.0))
    wrapped = "\n".join(textwrap.wrap(conditions, 142)[:3])
    figure.text(left, 0.08 * up, wrapped, fontsize=6.2, color="#666666", va="bottom")


# -------------------------------------------------------------------------------------------------
# How pictures look: fit for a paper, colours that the colour-blind can tell apart (Okabe and Ito).
#
# Lines also differ in style, so that they can be told apart in print.
# -------------------------------------------------------------------------------------------------

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#666666"

_RC: Any = {
    "font.family": "serif",
    "font.serif": ["STIXGeneral", "DejaVu Serif"],
    "mathtext.fontset": "stix",
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "lines.linewidth": 1.2,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
}


@contextlib.contextmanager
def picture(
    path: Path, rows: int, columns: int, size_in: tuple[float, float], **options
) -> Iterator:
    """Give a figure and its axes (rows, columns), write it to path at the end."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    with plt.rc_context(_RC):
        figure, axes = plt.subplots(rows, columns, figsize=size_in, squeeze=False, **options)
        yield figure, axes
        figure.savefig(path)
        plt.close(figure)
