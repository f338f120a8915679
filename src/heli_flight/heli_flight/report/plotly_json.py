# SPDX-License-Identifier: Apache-2.0
"""Charts as Plotly's JSON. Colours stay roles; the page's script paints them for its theme."""

import base64
import html
import re
from typing import Any

import numpy as np

from heli_flight.report.chart import Chart, Panel, Trace, thinned

_GAP_PX = 26.0
_OWN_AXIS_GAP_PX = 66.0
_PANEL_PX = 175.0
_TIME_LIMIT_S = 1e4


def encoded(values: np.ndarray, wide: bool = False) -> dict[str, str]:
    """An array as Plotly reads it: base64 of little-endian 32-bit floats, 64-bit if wide."""
    kind = "f8" if wide else "f4"
    data = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    return {"dtype": kind, "bdata": base64.b64encode(data).decode("ascii")}


def with_indices(text: str) -> str:
    """Text as HTML with a_s, v_z, d_int as symbols with indices."""
    return re.sub(r"\b([a-z])_([a-z]+)\b", r"<i>\1</i><sub>\2</sub>", html.escape(text))


def figure(chart: Chart) -> dict[str, Any]:
    """A chart as {data, layout, ...} for the page's script.

    Returns
    -------
    dict
        key, data, layout, panels (weights that set the height), time, square.
    """
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"hovermode": "x unified" if chart.time else "closest", "shapes": []}
    layout["annotations"] = []
    shared = _shared_axis(chart)
    tops = _domains(chart)
    seen: set[str] = set()
    for i, panel in enumerate(chart.panels):
        end = "" if i == 0 else str(i + 1)
        layout[f"xaxis{end}"] = _x_axis(chart, panel, i, shared)
        layout[f"yaxis{end}"] = _y_axis(chart, panel, tops[i], end)
        if panel.note:
            layout["annotations"].append(_note(panel.note, end, tops[i][1]))
        layout["shapes"] += [_span(span, end) for span in chart.spans if panel.x_range is None]
        for trace in panel.traces:
            data += _traces(thinned(trace, planar=chart.square), chart, end, seen)
    return {
        "key": chart.key,
        "data": data,
        "layout": layout,
        "panels": [panel.height for panel in chart.panels],
        "time": chart.time,
        "square": chart.square,
    }


def _domains(chart: Chart) -> list[tuple[float, float]]:
    """Bottom and top of each panel as shares of the plot's height, the first panel on top."""
    gap_px = _OWN_AXIS_GAP_PX if any(panel.x_range for panel in chart.panels) else _GAP_PX
    heights = [_PANEL_PX * panel.height for panel in chart.panels]
    total = sum(heights) + gap_px * (len(heights) - 1)
    domains, top = [], total
    for height in heights:
        domains.append((round((top - height) / total, 4), round(top / total, 4)))
        top -= height + gap_px
    return domains


def _shared_axis(chart: Chart) -> int:
    """Index of the lowest panel on the common x axis: it carries the labels."""
    return max((i for i, p in enumerate(chart.panels) if p.x_range is None), default=0)


def _x_axis(chart: Chart, panel: Panel, i: int, shared: int) -> dict[str, Any]:
    end = "" if i == 0 else str(i + 1)
    axis: dict[str, Any] = {"anchor": f"y{end}"}
    own = panel.x_range is not None
    if i == shared or own:
        axis["title"] = {"text": chart.x_label, "standoff": 8}
    else:
        axis["showticklabels"] = False
    if own and panel.x_range is not None:
        axis["range"] = list(panel.x_range)
    elif i:
        axis["matches"] = "x"
    if chart.log_x:
        axis.update(type="log", exponentformat="power", dtick=1)
    if chart.square:
        axis.update(dtick=1.0, scaleanchor=f"y{end}", scaleratio=1, constrain="domain")
    return axis


def _y_axis(chart: Chart, panel: Panel, domain: tuple[float, float], end: str) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "title": {"text": with_indices(panel.y_label), "standoff": 6},
        "domain": domain,
    }
    axis["anchor"] = f"x{end}"
    if panel.y_range is not None:
        axis["range"] = [float(np.log10(v)) if panel.log_y else v for v in panel.y_range]
    if panel.log_y:
        axis.update(type="log", exponentformat="power", dtick=1)
    if panel.y_ticks:
        axis.update(tickvals=list(range(len(panel.y_ticks))), ticktext=list(panel.y_ticks))
        axis.update(showgrid=False, zeroline=False, fixedrange=True)
    if chart.square:
        axis.update(dtick=1.0, constrain="domain")
    return axis


def _span(span: tuple[float, float], end: str) -> dict[str, Any]:
    return {
        "type": "rect", "xref": f"x{end}", "yref": f"y{end} domain", "layer": "below",
        "x0": span[0], "x1": span[1], "y0": 0, "y1": 1, "line": {"width": 0}, "name": "span",
    }  # fmt: skip


def _note(text: str, end: str, top: float) -> dict[str, Any]:
    return {
        "text": text, "xref": f"x{end} domain", "yref": "paper", "x": 1, "y": top, "yshift": 2,
        "xanchor": "right", "yanchor": "bottom", "showarrow": False, "font": {"size": 11},
    }  # fmt: skip


def _traces(trace: Trace, chart: Chart, end: str, seen: set[str]) -> list[dict[str, Any]]:
    """A trace of ours as one of Plotly's, a band as two."""
    wide = chart.time and bool(np.nanmax(np.abs(trace.x), initial=0.0) > _TIME_LIMIT_S)
    shown = bool(trace.label) and trace.label not in seen
    if trace.label:
        seen.add(trace.label)
    base: dict[str, Any] = {
        "type": "scatter", "x": encoded(trace.x, wide), "y": encoded(trace.y), "mode": "lines",
        "xaxis": f"x{end}", "yaxis": f"y{end}", "name": trace.label, "meta": {"role": trace.role},
        "legendgroup": trace.label or trace.role, "showlegend": shown,
        "line": {"width": trace.width}, "connectgaps": False,
    }  # fmt: skip
    if trace.kind in ("dash", "dot"):
        base["line"]["dash"] = trace.kind
        if trace.role == "bound" or not trace.label:
            base["hoverinfo"] = "skip"
    elif trace.kind == "points":
        base["mode"], base["marker"] = "markers", {"size": 9, "symbol": "cross"}
    elif trace.kind == "bar":
        base["hoverinfo"] = "name"
        base["hovertemplate"] = f"{trace.label or trace.role}: %{{x:.2f}} s<extra></extra>"
    elif trace.kind == "band" and trace.y2 is not None:
        lower = dict(base, y=encoded(trace.y2), showlegend=False, hoverinfo="skip")
        lower["line"] = {"width": 0}
        base["meta"] = {"role": trace.role, "fill": True}
        base.update(fill="tonexty", hoverinfo="skip", line={"width": 0})
        return [lower, base]
    if chart.time and trace.kind in ("line", "dash"):
        base["hovertemplate"] = "%{y:.4g}"
    return [base]
