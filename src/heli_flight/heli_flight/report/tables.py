# SPDX-License-Identifier: Apache-2.0
"""The report's tables: the flight beside others, and the margins of its design."""

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from heli_flight.loop.scoring import METRICS, SOURCES, Score
from heli_flight.report.data import LEVELS, Report
from heli_flight.report.design import Design
from heli_flight.report.paper_charts import (
    ADS33_HORIZONTAL_M,
    ADS33_VERTICAL_M,
    HINF_DEG,
    LAWS,
    NONLINEAR_M,
    PD_PID_M,
    PID_DEG,
)
from heli_parameters.parameters import Parameter

_ADS33 = {
    "lateral": ADS33_HORIZONTAL_M,
    "longitudinal": ADS33_HORIZONTAL_M,
    "altitude": ADS33_VERTICAL_M,
}
_MOST_EVENTS = 200
_NONE = "–"
_COLUMNS = {"navigation": "navigation record", "truth": "ground truth"}


def table(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str) -> str:
    """An HTML table; cells are HTML already, head and caption are text."""
    told = f'<p class="told">{html.escape(caption)}</p>' if caption else ""
    heads = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in head)
    body = "".join(
        f'<tr><th scope="row">{row[0]}</th>' + "".join(f"<td>{c}</td>" for c in row[1:]) + "</tr>"
        for row in rows
    )
    return (
        f'{told}<div class="scroll" tabindex="0"><table>'
        f"<thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def result_table(report: Report) -> str:
    """This flight beside the paper, and the conditions under it."""
    make = _attitude_rows if report.kind == "attitude" else _hover_rows
    head, rows = make(report)
    caption = (
        "Largest magnitude (rms) in the scored phases. ✓ inside, ✗ outside the paper's figure. "
        "The paper measured from its navigation record; only a simulation knows the truth."
    )
    condition = f'<p class="conditions">{html.escape(report.conditions)}</p>'
    if not rows:
        return f"<p>Not scored: nothing was recorded in a scored phase.</p>{condition}"
    return table(head, rows, caption) + condition


def _cell(largest: float, rms: float, bound: float | None) -> str:
    value = f"{largest:.2f} <small>({rms:.2f})</small>"
    if bound is None:
        return value
    inside = largest <= bound
    return f"{value} {mark(inside)}"


def mark(inside: bool) -> str:
    """A tick or a cross that needs no colour."""
    return '<span class="in">✓</span>' if inside else '<span class="out">✗</span>'


def _scored(report: Report, scores: Sequence[Score], key: str, source: str, bound: float) -> str:
    found = next((s for s in scores if (s.metric.key, s.source) == (key, source)), None)
    return _NONE if found is None else _cell(found.max, found.rms, bound)


def _hover_rows(report: Report) -> tuple[list[str], list[list[str]]]:
    head = ["", *(_COLUMNS[s] for s in SOURCES), "paper", "[8] PD-PID", "[17] nonlinear",
            "ADS-33E desired"]  # fmt: skip
    if not report.result.scores:
        return head, []
    rows = []
    for metric in METRICS["hover"]:
        ads = _ADS33.get(metric.key)
        place = metric.key in ("lateral", "longitudinal")
        cells = [
            _scored(report, report.result.scores, metric.key, s, metric.paper) for s in SOURCES
        ]
        rows.append(
            [
                f"{html.escape(metric.label)}, {metric.unit}",
                *cells,
                f"{metric.paper:.2f} <small>{metric.source}</small>",
                f"{PD_PID_M:.2f}" if place else _NONE,
                f"{NONLINEAR_M:.2f}" if place else _NONE,
                f"{ads:.2f}" if ads is not None else _NONE,
            ]
        )
    rows.append(_distance_row(report))
    return head, rows


def _distance_row(report: Report) -> list[str]:
    """Horizontal distance from the reference, which [8] and [17] may have meant."""
    scored = report.settings.scenario.scored(report.record.time_s)
    cells = []
    for source in SOURCES:
        error = np.hypot(*report.position_error(source)[scored, :2].T)
        if not np.isfinite(error).any():
            cells.append(_NONE)
            continue
        cells.append(_cell(float(np.max(error)), float(np.sqrt(np.mean(error**2))), None))
    return [
        "horizontal distance, m", *cells, _NONE, f"{PD_PID_M:.2f}", f"{NONLINEAR_M:.2f}", _NONE,
    ]  # fmt: skip


def _attitude_rows(report: Report) -> tuple[list[str], list[list[str]]]:
    head = ["", *(_COLUMNS[s] for s in SOURCES), "paper"]
    flights = [(report.controller, report.result.scores, "")]
    if report.rival is not None:
        flights.append((report.rival.controller, report.rival.scores, report.rival.lost))
    rows = []
    for law, scores, lost in flights:
        bound, source = (PID_DEG, "Fig. 3") if law == "pid" else (HINF_DEG, "Fig. 4")
        for metric in METRICS["attitude"] if scores else ():
            cells = [_scored(report, scores, metric.key, s, bound) for s in SOURCES]
            label = f"{html.escape(metric.label)} under {LAWS.get(law, law)}, °"
            if lost:
                label += " (lost)"
            rows.append([label, *cells, f"{bound:.1f} <small>{source}</small>"])
    return head, rows


def event_table(report: Report) -> str:
    """What the nodes said, when it changed."""
    if not report.events:
        return ""
    rows = [
        [f"{event.time_s:.2f}", *map(html.escape, (event.node, LEVELS[event.level], event.message))]
        for event in report.events[:_MOST_EVENTS]
    ]
    left = len(report.events) - len(rows)
    more = f" The first {len(rows)}; {left} more are in the bag." if left else ""
    told = table(("flight time, s", "node", "health", "message"), rows, f"Changes of health.{more}")
    return told.replace("<table>", '<table class="words">')


def margin_table(design: Design) -> str:
    """Norm and margins of the three loops."""
    head = ["", *(loop.name for loop in design.loops)]
    loops = design.loops

    def row(label: str, values: Sequence[str]) -> list[str]:
        return [label, *values]

    rows = [
        row("‖wind → h‖<sub>∞</sub>", [f"{loop.norm:.4f}" for loop in loops]),
        row("its frequency, rad/s", [f"{loop.norm_frequency:.2f}" for loop in loops]),
        row("slowest mode, rad/s", [f"{loop.stability:.3f}" for loop in loops]),
    ]
    for where in ("input", "output"):
        margins = [getattr(loop, f"disk_{where}") for loop in loops]
        name = f"disk margin, all channels, plant {where}"
        rows.append(row(name, [f"{m.alpha:.2f}" for m in margins]))
        words = [f"±{m.gain_db:.1f} dB, {m.phase_deg:.0f}°" for m in margins]
        rows.append(row("<small>guarantees together</small>", words))
    for i, channel in enumerate(("lateral", "longitudinal", "pedal")):
        values = [loop.channels_input[i] for loop in loops]
        words = [
            f"{_db(m.gain_up_db)}, {_limited(m.phase_deg, '°', 0)}, "
            f"{_limited(1e3 * m.delay_s, ' ms', 0)}"
            for m in values
        ]
        rows.append(row(f"{channel}: gain, phase, delay margin", words))
    caption = (
        f"Attitude law: {LAWS.get(design.controller, design.controller)}. γ = {design.gamma:.4f}, "
        f"infimum γ* = {design.gamma_star:.4f}. As flown: sampled at 100 Hz, with observer, "
        "prediction, servos and transport delay."
    )
    return table(head, rows, caption)


def _db(value: float) -> str:
    return f"{value:.1f} dB" if np.isfinite(value) else "∞"


def _limited(value: float, unit: str, digits: int) -> str:
    return f"{value:.{digits}f}{unit}" if np.isfinite(value) else "∞"


def parameter_table(rows: Sequence[Parameter], values: Mapping[str, Any]) -> str:
    """Resolved parameters of one node with unit and meaning."""
    known = {row.name: row for row in rows}
    lines = []
    for name, value in values.items():
        row = known.get(name)
        unit, meaning = (row.unit, row.description) if row else ("", "")
        cells = (_value(value), html.escape(unit), html.escape(meaning))
        lines.append([f"<code>{html.escape(name)}</code>", *cells])
    head = ("parameter", "value", "unit", "meaning")
    return table(head, lines, "").replace("<table>", '<table class="words">')


def _value(value: Any) -> str:
    if isinstance(value, bool | str):
        return html.escape(str(value).lower() if isinstance(value, bool) else value)
    if isinstance(value, int | float):
        return f"{value:.10g}"
    items = value.ravel().tolist() if isinstance(value, np.ndarray) else list(value)
    return ", ".join(_value(item) for item in items)
