# SPDX-License-Identifier: Apache-2.0
"""Charts as Plotly's figures. Colours stay roles; the page's script paints them for its theme."""

import html
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from heli_flight.report.chart import FEW_DECADES, Chart, Panel, Trace, decades, thinned

_GAP_PX = 26.0
_OWN_AXIS_GAP_PX = 66.0
_PANEL_PX = 175.0
_TIME_LIMIT_S = 1e4


def with_indices(text: str) -> str:
    """Text as HTML with a_s, v_z, d_int as symbols with indices."""
    return re.sub(r"\b([a-z])_([a-z]+)\b", r"<i>\1</i><sub>\2</sub>", html.escape(text))


def figure(chart: Chart) -> dict[str, Any]:
    """A chart as {data, layout, ...} for the page's script; arrays are Plotly's base64.

    Returns
    -------
    dict
        key, data, layout, panels (weights that set the height), time, square.
    """
    drawn = _panels_of(chart)
    seen: set[str] = set()
    for row, panel in enumerate(chart.panels, start=1):
        traces = [
            made
            for trace in panel.traces
            for made in _traces(thinned(trace, planar=chart.square), chart, seen)
        ]
        drawn.add_traces(traces, rows=row, cols=1)
    content = drawn.to_plotly_json()
    return {
        "key": chart.key,
        "data": content["data"],
        "layout": content["layout"],
        "panels": [panel.height for panel in chart.panels],
        "time": chart.time,
        "square": chart.square,
    }


def _panels_of(chart: Chart) -> go.Figure:
    """The chart's axes, spans and notes, without its traces."""
    rows = len(chart.panels)
    gap_px = _OWN_AXIS_GAP_PX if any(panel.x_range for panel in chart.panels) else _GAP_PX
    heights = [_PANEL_PX * panel.height for panel in chart.panels]
    drawn = make_subplots(
        rows=rows, cols=1, row_heights=heights,
        vertical_spacing=gap_px / (sum(heights) + gap_px * (rows - 1)),
    )  # fmt: skip
    lowest = max((i for i, p in enumerate(chart.panels, 1) if p.x_range is None), default=1)
    for row, panel in enumerate(chart.panels, start=1):
        drawn.update_xaxes(_x_axis(chart, panel, row, lowest), row=row, col=1)
        drawn.update_yaxes(_y_axis(chart, panel), row=row, col=1)
        for start, end in chart.spans if panel.x_range is None else ():
            drawn.add_vrect(
                start, end, row=row, col=1, layer="below", line_width=0,
                exclude_empty_subplots=False,
            )  # fmt: skip
        if panel.note:
            drawn.add_annotation(
                text=panel.note, row=row, col=1, xref="x domain", yref="y domain", x=1, y=1,
                yshift=2, xanchor="right", yanchor="bottom", showarrow=False, font_size=11,
            )  # fmt: skip
    drawn.update_layout(template=None, hovermode="x unified" if chart.time else "closest")
    return drawn


def _x_axis(chart: Chart, panel: Panel, row: int, lowest: int) -> dict[str, Any]:
    axis: dict[str, Any] = {}
    if row == lowest or panel.x_range is not None:
        axis["title"] = {"text": chart.x_label, "standoff": 8}
    else:
        axis["showticklabels"] = False
    if panel.x_range is not None:
        axis["range"] = list(panel.x_range)
    elif row > 1:
        axis["matches"] = "x"
    if chart.log_x:
        axis |= _log_axis([t.x for p in chart.panels for t in p.traces])
    if chart.square:
        end = "" if row == 1 else str(row)
        axis |= {"dtick": 1.0, "scaleanchor": f"y{end}", "scaleratio": 1, "constrain": "domain"}
    return axis


def _y_axis(chart: Chart, panel: Panel) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": with_indices(panel.y_label), "standoff": 6}}
    if panel.y_range is not None:
        axis["range"] = [float(np.log10(v)) if panel.log_y else v for v in panel.y_range]
    if panel.log_y:
        ends = panel.y_range
        axis |= _log_axis([np.array(ends)] if ends else [t.y for t in panel.traces])
    if panel.y_ticks:
        axis |= {"tickvals": list(range(len(panel.y_ticks))), "ticktext": list(panel.y_ticks)}
        axis |= {"showgrid": False, "zeroline": False, "fixedrange": True}
    if chart.square:
        axis |= {"dtick": 1.0, "constrain": "domain"}
    return axis


def _log_axis(values: list[np.ndarray]) -> dict[str, Any]:
    """Powers of ten over many decades; over few also what lies between, as plain numbers."""
    if decades(values) > FEW_DECADES:
        return {"type": "log", "exponentformat": "power", "dtick": 1}
    return {"type": "log", "tickformat": "~g"}


def _traces(trace: Trace, chart: Chart, seen: set[str]) -> Iterator[go.Scatter]:
    """A trace of ours as one of Plotly's, a band as two."""
    wide = chart.time and bool(np.nanmax(np.abs(trace.x), initial=0.0) > _TIME_LIMIT_S)
    shown = bool(trace.label) and trace.label not in seen
    seen.add(trace.label)
    base: dict[str, Any] = {
        "x": trace.x.astype("f8" if wide else "f4"), "y": trace.y.astype("f4"), "mode": "lines",
        "name": trace.label, "meta": {"role": trace.role}, "showlegend": shown,
        "legendgroup": trace.label or trace.role, "line": {"width": trace.width},
        "connectgaps": False,
    }  # fmt: skip
    if trace.kind in ("dash", "dot"):
        base["line"]["dash"] = trace.kind
        if trace.role == "bound" or not trace.label:
            base["hoverinfo"] = "skip"
    elif trace.kind == "points":
        base |= {"mode": "markers", "marker": {"size": 9, "symbol": "cross"}}
    elif trace.kind == "bar":
        told = f"{trace.label or trace.role}: %{{x:.2f}} s<extra></extra>"
        base |= {"hoverinfo": "name", "hovertemplate": told}
    elif trace.kind == "band" and trace.y2 is not None:
        edge = {"hoverinfo": "skip", "line": {"width": 0}}
        yield go.Scatter(base | edge | {"y": trace.y2.astype("f4"), "showlegend": False})
        base |= edge | {"fill": "tonexty", "meta": {"role": trace.role, "fill": True}}
    if chart.time and trace.kind in ("line", "dash"):
        base["hovertemplate"] = "%{y:.4g}"
    yield go.Scatter(base)
