# SPDX-License-Identifier: Apache-2.0
"""Charts as Plotly's figures. Colours stay roles; the page's script paints them for its theme.

The dictionaries are what Plotly.js reads (https://plotly.com/javascript/reference/).
"""

import base64
import html
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from heli_flight.report.data import (
    FEW_DECADES,
    Chart,
    Panel,
    Trace,
    decades,
    thinned,
)

_GAP_PX = 26.0
_OWN_AXIS_GAP_PX = 66.0
_PANEL_PX = 175.0
_TIME_LIMIT_S = 1e4
_Json = dict[str, Any]


def with_indices(text: str) -> str:
    """Text as HTML with a_s, v_z, d_int as symbols with indices."""
    return re.sub(r"\b([a-z])_([a-z]+)\b", r"<i>\1</i><sub>\2</sub>", html.escape(text))


def figure(chart: Chart) -> _Json:
    """A chart as {data, layout, ...} for the page's script; arrays are Plotly's base64.

    Returns
    -------
    dict
        key, data, layout, panels (weights that set the height), height (px; 0: by the panels),
        time, square, bands.
    """
    in_legend: set[str] = set()
    data = [
        {**made, "xaxis": f"x{_number(row)}", "yaxis": f"y{_number(row)}"}
        for row, panel in enumerate(chart.panels)
        for trace in panel.traces
        for made in _traces(thinned(trace, planar=_planar(chart)), chart, panel, in_legend)
    ]
    return {
        "key": chart.key,
        "data": data,
        "layout": _layout(chart),
        "panels": [panel.height for panel in chart.panels],
        "time": chart.time,
        "square": chart.square or chart.is_to_scale,
        "height": chart.height_px,
        "bands": [asdict(band) for band in chart.bands or ()],
    }


def page_data(charts: Sequence[Chart]) -> _Json:
    """Charts for a page: `figures`, of which arrays and bands that are alike are there once.

    A trace's x and y are numbers of `arrays`, a figure's bands the number of a list of `bands`.
    """
    figures = [figure(chart) for chart in charts]
    arrays: list[Any] = []
    bands: list[Any] = []
    known: dict[str, int] = {}

    def place(value: Any, among: list[Any]) -> int:
        key = json.dumps(value, sort_keys=True)
        if key not in known:
            known[key] = len(among)
            among.append(value)
        return known[key]

    for drawn in figures:
        for trace in drawn["data"]:
            trace |= {axis: place(trace[axis], arrays) for axis in ("x", "y")}
        drawn["bands"] = place(drawn["bands"], bands)
    return {"figures": figures, "arrays": arrays, "bands": bands}


def _number(row: int) -> str:
    """What Plotly puts behind the letter of an axis: nothing for the first."""
    return "" if row == 0 else str(row + 1)


def _layout(chart: Chart) -> _Json:
    """The chart's axes, spans and notes."""
    lowest = max((i for i, p in enumerate(chart.panels) if p.x_range is None), default=0)
    along = chart.time or chart.log_x
    layout: _Json = {"hovermode": "x unified" if along else "closest"}
    shapes, notes = [], []
    for row, (panel, domain) in enumerate(zip(chart.panels, _domains(chart.panels), strict=True)):
        end = _number(row)
        x_axis, y_axis = _x_axis(chart, panel, row, lowest), _y_axis(chart, panel)
        layout[f"xaxis{end}"] = {"anchor": f"y{end}", "domain": [0.0, 1.0], **x_axis}
        layout[f"yaxis{end}"] = {"anchor": f"x{end}", "domain": list(domain), **y_axis}
        for start, stop in chart.spans if panel.x_range is None else ():
            shapes.append(
                {
                    "type": "rect",
                    "layer": "below",
                    "line": {"width": 0},
                    "x0": start,
                    "x1": stop,
                    "y0": 0,
                    "y1": 1,
                    "xref": f"x{end}",
                    "yref": f"y{end} domain",
                }  # fmt: skip
            )
        if panel.note:
            notes.append(
                {
                    "text": html.escape(panel.note),
                    "xref": f"x{end} domain",
                    "yref": f"y{end} domain",
                    "x": 1,
                    "y": 1,
                    "yshift": 2,
                    "xanchor": "right",
                    "yanchor": "bottom",
                    "showarrow": False,
                    "font": {"size": 11},
                }  # fmt: skip
            )
    return {**layout, "shapes": shapes, "annotations": notes}


def _domains(panels: Sequence[Panel]) -> list[tuple[float, float]]:
    """Bottom and top of each panel as shares of the chart's height, the first at the top."""
    gap_px = _OWN_AXIS_GAP_PX if any(panel.x_range for panel in panels) else _GAP_PX
    heights = [_PANEL_PX * panel.height for panel in panels]
    whole = sum(heights) + gap_px * (len(panels) - 1)
    tops = whole - np.cumsum([0.0, *(height + gap_px for height in heights[:-1])])
    return [
        (float(max(0.0, top - height) / whole), float(top / whole))
        for top, height in zip(tops, heights, strict=True)
    ]


def _x_axis(chart: Chart, panel: Panel, row: int, lowest: int) -> _Json:
    axis: _Json = {}
    if row == lowest or panel.x_range is not None:
        axis["title"] = {"text": html.escape(chart.x_label), "standoff": 8}
    else:
        axis["showticklabels"] = False
    if chart.time:
        axis["unifiedhovertitle"] = {"text": "%{x:.2f} s"}
    elif chart.log_x:
        axis["unifiedhovertitle"] = {"text": f"%{{x:.3g}} {_shown(chart.x_unit)}"}
    if panel.x_range is not None:
        axis["range"] = list(panel.x_range)
    elif row > 0:
        axis["matches"] = "x"
    if chart.log_x:
        axis |= _log_axis([t.x for p in chart.panels for t in p.traces])
    if _planar(chart):
        axis |= {"scaleanchor": f"y{_number(row)}", "scaleratio": 1, "constrain": "domain"}
    if chart.square:
        axis["dtick"] = 1.0
    return axis


def _y_axis(chart: Chart, panel: Panel) -> _Json:
    axis: _Json = {"title": {"text": with_indices(panel.y_label), "standoff": 6}}
    if panel.y_range is not None:
        axis["range"] = [float(np.log10(v)) if panel.log_y else v for v in panel.y_range]
    if panel.log_y:
        ends = panel.y_range
        axis |= _log_axis([np.array(ends)] if ends else [t.y for t in panel.traces])
    if panel.y_ticks:
        names = [html.escape(name) for name in panel.y_ticks]
        axis |= {"tickvals": list(range(len(names))), "ticktext": names}
        axis |= {"showgrid": False, "zeroline": False, "fixedrange": True}
    if _planar(chart):
        axis["constrain"] = "domain"
    if chart.square:
        axis["dtick"] = 1.0
    return axis


def _planar(chart: Chart) -> bool:
    """Whether both axes are lengths of the same scale."""
    return chart.square or chart.is_to_scale


def _log_axis(values: list[np.ndarray]) -> _Json:
    """Powers of ten over many decades; over few also what lies between, as plain numbers."""
    if decades(values) > FEW_DECADES:
        return {"type": "log", "exponentformat": "power", "dtick": 1}
    return {"type": "log", "tickformat": "~g"}


def _array(values: np.ndarray, dtype: str) -> _Json:
    """An array as Plotly reads it: little-endian bytes in base64."""
    raw = np.ascontiguousarray(values, dtype=f"<{dtype}").tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(raw).decode("ascii")}


def _traces(trace: Trace, chart: Chart, panel: Panel, in_legend: set[str]) -> Iterator[_Json]:
    """A trace of ours as one of Plotly's, a band as two."""
    wide = chart.time and bool(np.nanmax(np.abs(trace.x), initial=0.0) > _TIME_LIMIT_S)
    shown = bool(trace.label) and trace.label not in in_legend
    in_legend.add(trace.label)
    label = html.escape(trace.label)
    base: _Json = {
        "type": "scatter", "x": _array(trace.x, "f8" if wide else "f4"),
        "y": _array(trace.y, "f4"), "mode": "lines", "name": label,
        "meta": {"role": trace.role}, "showlegend": shown,
        "legendgroup": label or trace.role, "line": {"width": trace.width},
        "connectgaps": False, "hovertemplate": _hover_text(trace, chart, panel),
    }  # fmt: skip
    if trace.kind in ("dash", "dot"):
        base["line"]["dash"] = trace.kind
        if trace.role == "bound" or not trace.label:
            base["hoverinfo"] = "skip"
    elif trace.kind == "points":
        base |= {"mode": "markers", "marker": {"size": 9, "symbol": "cross"}}
    elif trace.kind == "bar":
        base["hoverinfo"] = "name"
    elif trace.kind == "band" and trace.y2 is not None:
        edge = {"hoverinfo": "skip", "line": {"width": 0}}
        yield base | edge | {"y": _array(trace.y2, "f4"), "showlegend": False}
        base |= edge | {"fill": "tonexty", "meta": {"role": trace.role, "fill": True}}
    yield base


def _shown(unit: str) -> str:
    """A unit behind a number; nothing behind one that has none."""
    return "" if unit == "1" else html.escape(unit)


def _hover_text(trace: Trace, chart: Chart, panel: Panel) -> str:
    """What the pointer is told of a point: numbers with their units, and the trace's name."""
    name = html.escape(trace.label or trace.role)
    if trace.kind == "bar":
        return f"{name}: %{{x:.2f}} s<extra></extra>"
    if not chart.time and trace.kind in ("dash", "dot") and np.ptp(trace.x) == 0.0:
        return f"{name}: %{{x:.3g}} {_shown(chart.x_unit)}<extra></extra>"
    value = f"%{{y:.4g}} {_shown(panel.unit)}".rstrip()
    if chart.time or chart.log_x:
        return value
    at = f"%{{x:.4g}} {_shown(chart.x_unit)}".rstrip()
    return f"{at}: {value}<extra>{name}</extra>"
