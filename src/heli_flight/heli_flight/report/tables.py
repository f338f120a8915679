# SPDX-License-Identifier: Apache-2.0
"""The report's tables: the flight beside others, and the margins of its design."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from heli_flight.loop.result import climb_cell, phases
from heli_flight.loop.scoring import (
    DECIDES,
    METRICS,
    SETTLED_S,
    SOURCE_NAMES,
    SOURCES,
    STRETCHES,
    TRUTH_LESS_DRIFT,
    WHOLE,
    WINDOWS,
    Figures,
    errors,
    sources_of,
)
from heli_flight.report.bands import HEALTH
from heli_flight.report.data import LEVELS, Report
from heli_flight.report.design import Design
from heli_flight.report.paper_charts import (
    ADS33_HORIZONTAL_M,
    ADS33_VERTICAL_M,
    LAWS,
    NONLINEAR_M,
    PD_PID_M,
)
from heli_math.climb import CLIMB_METRICS, OVERSHOOT_S, commanded_climb
from heli_math.paper_metrics import ATTITUDE_DEG, BY_KEY, PATH, size
from heli_parameters.parameters import Parameter

_ADS33 = {
    "lateral": ADS33_HORIZONTAL_M,
    "longitudinal": ADS33_HORIZONTAL_M,
    "altitude": ADS33_VERTICAL_M,
}
_MOST_EVENTS = 200
_NONE = "–"
_UNKNOWN = np.full(1, np.nan)


@dataclass(frozen=True)
class Table:
    """A table for the page's templates.

    Attributes
    ----------
    head : sequence of str
    rows : sequence of sequences of str
        Text, or `Markup` where a cell holds more than text; the first cell names the row.
    caption : str
        A sentence above it.
    words : bool
        True if the cells are sentences rather than numbers.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: bool = False


def result_tables(report: Report) -> list[Table]:
    """This flight beside the paper, over each stretch that was scored, and its climb."""
    make = {"attitude": _attitude_rows, PATH: _path_rows}.get(report.kind, _hover_rows)
    tables = []
    for stretch, name in STRETCHES.items():
        if report.result.figures.of(stretch):
            head, rows = make(report, stretch)
            said = _SAID[stretch, report.kind]
            caption = f"{name.capitalize()}, {phases(report.settings, stretch)}. {said}"
            if stretch == DECIDES:
                caption += " This table decides the exit code."
            tables.append(Table(head, rows, caption))
    if tables and TRUTH_LESS_DRIFT in _sources(report):
        tables[0] = replace(tables[0], caption=f"{tables[0].caption} {_LESS_DRIFT}")
    if report.result.figures.climb:
        tables.append(_climb_table(report))
    if report.result.figures.ground:
        tables.append(_ground_table(report))
    return tables


_HOW = (
    "Largest magnitude (rms); ✓ inside, ✗ outside the paper's figure. The paper measured from its "
    "navigation record; only a simulation knows the truth."
)
_SAID = {
    (WHOLE, "hover"): (
        "From engagement to the end, the climb included, against the reference as commanded, which "
        f"starts and stops at once. {_HOW}"
    ),
    (WHOLE, "attitude"): (
        f"From engagement to the end, the start included, when level is commanded at once. {_HOW}"
    ),
    (WINDOWS, "hover"): "Hover alone: without the start, the climb and what follows it.",
    (WINDOWS, "attitude"): "Without the start.",
    (WHOLE, PATH): (
        "From engagement to the end, against the point of the path at that moment. Largest "
        "magnitude (rms); ✓ inside, ✗ outside the goal. The paper flies no paths."
    ),
    (WINDOWS, PATH): "Without the start.",
}
_LESS_DRIFT = (
    f"Truth less drift at engagement: ground truth moved by what the navigation record's position "
    f"was off by at {SETTLED_S:g} s, when its own start is over. That is the receiver's drift at "
    "engagement, from which the record counts; what the receiver drifts later is still in it."
)


def _sources(report: Report) -> tuple[str, ...]:
    return sources_of(report.settings.gps)


def _ground_table(report: Report) -> Table:
    rows = [
        [
            f.metric.label,
            f"{f.cell} {'✓' if f.inside else '✗'}",
            f"{f.metric.goal:g} {f.metric.unit}",
        ]
        for f in report.result.figures.ground
    ]
    caption = (
        "From the ground to the ground; ✓ inside, ✗ outside the goal. When the skids touch is "
        "found from ground truth, the height from the navigation record. The paper begins in the "
        "air: the goals are ours."
    )
    return Table(["", "this flight", "goal"], rows, caption)


def _climb_table(report: Report) -> Table:
    sources = _sources(report)
    found = {(f.metric.key, f.source): f for f in report.result.figures.climb}
    rows = [
        [metric.label, *(climb_cell(found.get((metric.key, source))) for source in sources)]
        for metric in CLIMB_METRICS
    ]
    climb = commanded_climb(report.record.reference)
    caption = "The climb."
    if climb is not None:
        old_m, new_m = round(climb.old_m, 1), round(climb.new_m, 1)
        caption = (
            f"The climb, commanded: from {old_m:g} to {new_m:g} m in "
            f"{climb.duration_s(report.record.time_s):.2f} s. Overshoot: beyond the new height "
            f"within {OVERSHOOT_S:g} s of the reference's arrival. Time: from the command's start "
            f"until within {BY_KEY['altitude'].paper:g} m of the new height. The paper gives no "
            "figure for it."
        )
    return Table(["", *(SOURCE_NAMES[source] for source in sources)], rows, caption)


def _cell(largest: float, rms: float, bound: float | None) -> Markup:
    value = Markup("{:.2f} <small>({:.2f})</small>").format(largest, rms)
    return value if bound is None else value + " " + mark(largest <= bound)


def mark(inside: bool) -> Markup:
    """A tick or a cross that needs no colour."""
    return Markup('<span class="{}">{}</span>').format(*(("in", "✓") if inside else ("out", "✗")))


def _of_paper(value: str, source: str) -> Markup:
    return Markup("{} <small>{}</small>").format(value, source)


def _scored(figures: Figures, stretch: str, key: str, source: str, bound: float) -> str:
    found = figures.find(stretch, key, source)
    return _NONE if found is None else _cell(found.max, found.rms, bound)


def _hover_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    sources = _sources(report)
    head = ["", *(SOURCE_NAMES[s] for s in sources), "paper", "[8] PD-PID", "[17] nonlinear",
            "ADS-33E desired"]  # fmt: skip
    rows = []
    for metric in METRICS["hover"]:
        ads = _ADS33.get(metric.key)
        place = metric.key in ("lateral", "longitudinal")
        cells = [
            _scored(report.result.figures, stretch, metric.key, s, metric.paper) for s in sources
        ]
        rows.append(
            [
                f"{metric.label}, {metric.unit}",
                *cells,
                _of_paper(f"{metric.paper:.2f}", metric.source),
                f"{PD_PID_M:.2f}" if place else _NONE,
                f"{NONLINEAR_M:.2f}" if place else _NONE,
                f"{ads:.2f}" if ads is not None else _NONE,
            ]
        )
    rows.append(_distance_row(report, stretch))
    return head, rows


def _path_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    sources = _sources(report)
    rows = [
        [
            f"{metric.label}, {metric.unit}",
            *(
                _scored(report.result.figures, stretch, metric.key, s, metric.paper)
                for s in sources
            ),
            f"{metric.paper:.2f}",
        ]
        for metric in METRICS[PATH]
    ]
    return ["", *(SOURCE_NAMES[s] for s in sources), "goal"], rows


def _distance_row(report: Report, stretch: str) -> list[str]:
    """Horizontal distance from the reference, which [8] and [17] may have meant."""
    scored = report.counted(stretch)
    cells = []
    for source in _sources(report):
        found = errors(report.record, source, "hover")
        error = np.hypot(*(found.get(k, _UNKNOWN) for k in ("longitudinal", "lateral")))
        if not np.isfinite(error).any():
            cells.append(_NONE)
            continue
        cells.append(_cell(*size(error[scored]), None))
    return [
        "horizontal distance, m", *cells, _NONE, f"{PD_PID_M:.2f}", f"{NONLINEAR_M:.2f}", _NONE,
    ]  # fmt: skip


def _attitude_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    head = ["", *(SOURCE_NAMES[s] for s in SOURCES), "paper"]
    flights = [(report.controller, report.result.figures, "")]
    if report.rival is not None:
        flights.append((report.rival.controller, report.rival.figures, report.rival.lost))
    rows = []
    for law, figures, lost in flights:
        bound, source = ATTITUDE_DEG.get(law, ATTITUDE_DEG["hinf"])
        for metric in METRICS["attitude"] if figures.of(stretch) else ():
            cells = [_scored(figures, stretch, metric.key, s, bound) for s in SOURCES]
            label = f"{metric.label} under {LAWS.get(law, law)}, °"
            if lost:
                label += " (lost)"
            rows.append([label, *cells, _of_paper(f"{bound:.1f}", source)])
    return head, rows


def event_table(report: Report) -> Table | None:
    """What the nodes said, when it changed; None if nobody said anything."""
    if not report.events:
        return None
    rows = [
        [f"{event.time_s:.2f}", event.node, LEVELS[event.level], event.message]
        for event in report.events[:_MOST_EVENTS]
    ]
    left = len(report.events) - len(rows)
    more = f" The first {len(rows)}; {left} more are in the bag." if left else ""
    head = ("flight time, s", "node", "health", "message")
    return Table(head, rows, f"Changes of health.{more}", words=True)


def band_table(report: Report) -> Table | None:
    """Modes, faults and failsafes with their times, as charts shade them; None without any."""
    shaded = [band for band in report.bands if band.kind != HEALTH]
    if not shaded:
        return None
    rows = [
        [f"{band.start_s:.2f}", f"{band.end_s:.2f}", band.kind, band.name, band.told]
        for band in sorted(shaded, key=lambda band: band.start_s)[:_MOST_EVENTS]
    ]
    left = len(shaded) - len(rows)
    more = f" The first {len(rows)} of {len(shaded)}." if left else ""
    head = ("from, s", "to, s", "what", "name", "told")
    return Table(head, rows, f"Shaded in the charts over time.{more}", words=True)


def margin_table(design: Design) -> Table:
    """Norm and margins of the three loops."""
    head = ["", *(loop.name for loop in design.loops)]
    loops = design.loops

    def row(label: str, values: Sequence[str]) -> list[str]:
        return [label, *values]

    rows = [
        row(Markup("‖wind → h‖<sub>∞</sub>"), [f"{loop.norm:.4f}" for loop in loops]),
        row("its frequency, rad/s", [f"{loop.norm_frequency:.2f}" for loop in loops]),
        row("slowest mode, rad/s", [f"{loop.stability:.3f}" for loop in loops]),
    ]
    for where in ("input", "output"):
        margins = [getattr(loop, f"disk_{where}") for loop in loops]
        name = f"disk margin, all channels, plant {where}"
        rows.append(row(name, [f"{m.alpha:.2f}" for m in margins]))
        words = [f"±{m.gain_db:.1f} dB, {m.phase_deg:.0f}°" for m in margins]
        rows.append(row(Markup("<small>guarantees together</small>"), words))
    for i, channel in enumerate(("lateral", "longitudinal", "pedal")):
        values = [loop.channels_input[i] for loop in loops]
        words = [
            f"{_db(m.gain_up_db)}, {_limited(m.phase_deg, '°', 0)}, "
            f"{_limited(1e3 * m.delay_s, ' ms', 0)}"
            for m in values
        ]
        rows.append(row(f"{channel}: gain, phase, delay margin", words))
    bound, said = design.bound, "It is designed without a bound γ."
    if bound is not None:
        said = f"γ = {bound.gamma:.4f}, infimum γ* = {bound.gamma_star:.4f} ({bound.of})."
    caption = (
        f"Attitude law: {LAWS.get(design.controller, design.controller)}. {said} As flown: sampled "
        f"at {design.rate_hz} Hz, with servos and transport delay."
    )
    return Table(head, rows, caption)


def _db(value: float) -> str:
    return f"{value:.1f} dB" if np.isfinite(value) else "∞"


def _limited(value: float, unit: str, digits: int) -> str:
    return f"{value:.{digits}f}{unit}" if np.isfinite(value) else "∞"


def parameter_table(rows: Sequence[Parameter], values: Mapping[str, Any]) -> Table:
    """Resolved parameters of one node with unit and meaning."""
    known = {row.name: row for row in rows}
    lines = []
    for name, value in values.items():
        row = known.get(name)
        unit, meaning = (row.unit, row.description) if row else ("", "")
        lines.append([Markup("<code>{}</code>").format(name), _value(value), unit, meaning])
    return Table(("parameter", "value", "unit", "meaning"), lines, words=True)


def _value(value: Any) -> str:
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else value
    if isinstance(value, int | float):
        return f"{value:.10g}"
    items = value.ravel().tolist() if isinstance(value, np.ndarray) else list(value)
    return ", ".join(_value(item) for item in items)
