# SPDX-License-Identifier: Apache-2.0
"""The report's tables: the flight beside others, and the margins of its design."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from heli_core.metrics import (
    ATTITUDE_DEG,
    BY_KEY,
    CLIMB_METRICS,
    GOAL,
    OVERSHOOT_S,
    OWN,
    PATH,
    SETTLED_S,
    PaperMetric,
    commanded_climb,
    size,
)
from heli_core.parameters import Parameter
from heli_core.ticks import Rate
from heli_flight.report.charts import (
    ADS33_HORIZONTAL_M,
    ADS33_VERTICAL_M,
    LAWS,
    NONLINEAR_M,
    PD_PID_M,
    DesignNumbers,
)
from heli_flight.report.data import HEALTH, LEVELS, Report
from heli_flight.result import bound_head, climb_cell, phases
from heli_flight.scoring import (
    DECIDES,
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

# -------------------------------------------------------------------------------------------------
# Tables.
# -------------------------------------------------------------------------------------------------

_ADS33 = {
    "lateral": ADS33_HORIZONTAL_M,
    "longitudinal": ADS33_HORIZONTAL_M,
    "altitude": ADS33_VERTICAL_M,
}
_MOST_EVENTS = 200
_NONE = "–"
_UNKNOWN = np.full(1, np.nan)


@dataclass(frozen=True)
class ReportTable:
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


def result_tables(report: Report) -> list[ReportTable]:
    """This flight beside its bounds: the stretch that decides, the whole flight, the climb."""
    make = {"attitude": _attitude_rows, PATH: _path_rows}.get(report.kind, _hover_rows)
    tables = []
    for stretch in sorted(STRETCHES, key=lambda name: name != DECIDES):
        if report.result.figures.of(stretch):
            head, rows = make(report, stretch)
            when = phases(report.settings, stretch, report.result.figures.until_s)
            remark = _STRETCH_NOTES[stretch, report.kind]
            caption = f"{STRETCHES[stretch].capitalize()}, {when}. {remark}"
            if stretch == DECIDES:
                caption += f" This table decides the exit code. {_HOW}"
            lacking = report.result.coverage(report.settings.gps, stretch).sentence
            caption += f" Partial: {lacking}." if lacking else ""
            tables.append(ReportTable(head, rows, caption))
    if tables and TRUTH_LESS_DRIFT in _sources(report):
        tables[0] = replace(tables[0], caption=f"{tables[0].caption} {_LESS_DRIFT}")
    if report.result.figures.climb:
        tables.append(_climb_table(report))
    if report.result.figures.ground:
        tables.append(_ground_table(report))
    return tables


_HOW = (
    "Largest magnitude (rms); ✓ within, ✗ outside the bound. The paper measured from its "
    "state estimate; only a simulation knows the truth."
)
_STRETCH_NOTES = {
    (WHOLE, "hover"): (
        "From controller engagement to the end, climb included, against the commanded reference."
    ),
    (WHOLE, "attitude"): (
        "From controller engagement to the end, including the start, when level is commanded "
        "at once."
    ),
    (WINDOWS, "hover"): "Hover alone: without the start, the climb and what follows it.",
    (WINDOWS, "attitude"): "Without the start.",
    (
        WHOLE,
        PATH,
    ): "From controller engagement to the end, against the point of the path at that moment.",
    (WINDOWS, PATH): "Without the start. The paper flies no paths.",
}
_LESS_DRIFT = (
    f"Drift-corrected: ground truth minus the GPS offset at t = {SETTLED_S:g} s. Later GPS drift "
    "is still included."
)


def _sources(report: Report) -> tuple[str, ...]:
    return sources_of(report.settings.gps)


def _ground_table(report: Report) -> ReportTable:
    rows = [
        [
            f.metric.label,
            f"{f.cell} {'✓' if f.inside else '✗'}",
            f"{f.metric.goal:g} {f.metric.unit}",
        ]
        for f in report.result.figures.ground
    ]
    caption = (
        "From the ground to the ground; ✓ within, ✗ outside the goal. When the skids touch is "
        "found from ground truth, the height from the state estimate. The paper begins in the "
        "air: the goals are ours."
    )
    return ReportTable(["", "this flight", "goal"], rows, caption)


def _climb_table(report: Report) -> ReportTable:
    sources = _sources(report)
    figures = {(f.metric.key, f.source): f for f in report.result.figures.climb}
    rows = [
        [metric.label, *(climb_cell(figures.get((metric.key, source))) for source in sources)]
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
    return ReportTable(["", *(SOURCE_NAMES[source] for source in sources)], rows, caption)


def _cell(largest: float, rms: float, bound: float | None) -> Markup:
    value = Markup("{:.2f} <small>({:.2f})</small>").format(largest, rms)
    return value if bound is None else value + " " + mark(largest <= bound)


def mark(inside: bool) -> Markup:
    """A tick or a cross that needs no colour."""
    return Markup('<span class="{}">{}</span>').format(*(("in", "✓") if inside else ("out", "✗")))


def _of_paper(value: str, source: str) -> Markup:
    return Markup("{} <small>{}</small>").format(value, source)


def _scored(figures: Figures, stretch: str, key: str, source: str, bound: float | None) -> str:
    score = figures.find(stretch, key, source)
    return _NONE if score is None else _cell(score.max, score.rms, bound)


def _bound(metric: PaperMetric) -> float | None:
    return metric.paper if metric.bounded else None


def _bound_cell(metric: PaperMetric) -> str:
    """The bound, and the paper's figure that it is."""
    if not metric.bounded:
        return _NONE
    is_papers = metric.source not in (GOAL, OWN)
    return _of_paper(f"{metric.paper:.2f}", metric.source if is_papers else "")


def _hover_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    sources = _sources(report)
    metrics = report.settings.scenario.metrics
    head = ["", *(SOURCE_NAMES[s] for s in sources), bound_head(metrics), "[8] PD-PID",
            "[17] nonlinear", "ADS-33E desired"]  # fmt: skip
    rows = []
    for metric in metrics:
        ads = _ADS33.get(metric.key)
        place = metric.key in ("lateral", "longitudinal")
        cells = [
            _scored(report.result.figures, stretch, metric.key, s, _bound(metric)) for s in sources
        ]
        rows.append(
            [
                f"{metric.label}, {metric.unit}",
                *cells,
                _bound_cell(metric),
                f"{PD_PID_M:.2f}" if place else _NONE,
                f"{NONLINEAR_M:.2f}" if place else _NONE,
                f"{ads:.2f}" if ads is not None else _NONE,
            ]
        )
    rows.append(_distance_row(report, stretch))
    return head, rows


def _path_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    sources, metrics = _sources(report), report.settings.scenario.metrics
    rows = [
        [
            f"{metric.label}, {metric.unit}",
            *(
                _scored(report.result.figures, stretch, metric.key, s, _bound(metric))
                for s in sources
            ),
            _bound_cell(metric),
        ]
        for metric in metrics
    ]
    return ["", *(SOURCE_NAMES[s] for s in sources), bound_head(metrics)], rows


def _distance_row(report: Report, stretch: str) -> list[str]:
    """Horizontal distance from the reference, which [8] and [17] may have meant."""
    scored = report.counted(stretch)
    cells = []
    for source in _sources(report):
        axis_errors = errors(report.record, source, "hover")
        error = np.hypot(*(axis_errors.get(k, _UNKNOWN) for k in ("longitudinal", "lateral")))
        known = np.isfinite(error) & scored
        cells.append(_cell(*size(error[known]), None) if known.any() else _NONE)
    return [
        "horizontal distance, m", *cells, _NONE, f"{PD_PID_M:.2f}", f"{NONLINEAR_M:.2f}", _NONE,
    ]  # fmt: skip


def _attitude_rows(report: Report, stretch: str) -> tuple[list[str], list[list[str]]]:
    metrics = report.settings.scenario.metrics
    head = ["", *(SOURCE_NAMES[s] for s in SOURCES), bound_head(metrics)]
    flights = [(report.controller, report.result.figures, "")]
    if report.rival is not None:
        flights.append((report.rival.controller, report.rival.figures, report.rival.lost))
    rows = []
    for law, figures, lost in flights:
        bound, source = ATTITUDE_DEG.get(law, ATTITUDE_DEG["hinf"])
        for metric in metrics if figures.of(stretch) else ():
            # Each controller beside its own figure in the paper's test; else beside what bounds
            # them all.
            is_papers = metric.bounded and metric.source not in (GOAL, OWN)
            least = bound if is_papers else _bound(metric)
            cells = [_scored(figures, stretch, metric.key, s, least) for s in SOURCES]
            label = f"{metric.label} under {LAWS.get(law, law)}, °"
            if lost:
                label += " (lost)"
            told = _of_paper(f"{bound:.1f}", source) if is_papers else _bound_cell(metric)
            rows.append([label, *cells, told])
    return head, rows


def event_table(report: Report) -> ReportTable | None:
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
    return ReportTable(head, rows, f"Changes of health.{more}", words=True)


def band_table(report: Report) -> ReportTable | None:
    """Modes, faults and failsafes with their times, as charts shade them; None without any."""
    shaded = [band for band in report.bands if band.kind != HEALTH]
    if not shaded:
        return None
    rows = [
        [f"{band.start_s:.2f}", f"{band.end_s:.2f}", band.kind, band.name, band.detail]
        for band in sorted(shaded, key=lambda band: band.start_s)[:_MOST_EVENTS]
    ]
    left = len(shaded) - len(rows)
    more = f" The first {len(rows)} of {len(shaded)}." if left else ""
    head = ("from, s", "to, s", "what", "name", "told")
    return ReportTable(head, rows, f"Shaded in the charts over time.{more}", words=True)


def margin_table(design: DesignNumbers) -> ReportTable:
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
    bound, gamma_note = design.bound, "It is designed without a bound γ."
    if bound is not None:
        gamma_note = f"γ = {bound.gamma:.4f}, infimum γ* = {bound.gamma_star:.4f} ({bound.of})."
    caption = (
        f"Attitude controller: {LAWS.get(design.controller, design.controller)}. {gamma_note} "
        f"As flown: sampled at {design.rate_hz} Hz, with servos and transport delay."
    )
    return ReportTable(head, rows, caption)


def _db(value: float) -> str:
    return f"{value:.1f} dB" if np.isfinite(value) else "∞"


def _limited(value: float, unit: str, digits: int) -> str:
    return f"{value:.{digits}f}{unit}" if np.isfinite(value) else "∞"


def parameter_table(rows: Sequence[Parameter], values: Mapping[str, Any]) -> ReportTable:
    """Resolved parameters of one node with unit and meaning."""
    known = {row.name: row for row in rows}
    lines = []
    for name, value in values.items():
        row = known.get(name)
        unit, meaning = (row.unit, row.description) if row else ("", "")
        lines.append([Markup("<code>{}</code>").format(name), _value(value), unit, meaning])
    return ReportTable(("parameter", "value", "unit", "meaning"), lines, words=True)


def _value(value: Any) -> str:
    if isinstance(value, bool | str):
        return str(value).lower() if isinstance(value, bool) else value
    if isinstance(value, int | float):
        return f"{value:.10g}"
    items = value.ravel().tolist() if isinstance(value, np.ndarray) else list(value)
    return ", ".join(_value(item) for item in items)


# -------------------------------------------------------------------------------------------------
# What a flight's simulation holds and what it leaves out, by its parameters: in every report.
# -------------------------------------------------------------------------------------------------

_ALWAYS = (
    "Rigid body with six degrees of freedom, attitude as a quaternion, eq. (1) to (5).",
    "Main rotor with inflow and first-order flapping, eq. (6), (7); tail rotor, fuselage, fins.",
    "Yaw-rate gyro, eq. (8); servos of second order with limits of rate and travel; transport "
    "delay of the commands.",
    "Wind: mean over height, MIL-F-8785C Dryden turbulence, discrete gusts.",
    "IMU, magnetometer and barometer with noise and bias; GPS with noise, slow drift and latency.",
)
_NEVER = (
    "Blade dynamics beyond first-order flapping; the main rotor's wake on the tail rotor.",
    "Turbulence that decays in time as well as in space; wind that turns with height. MIL-F-8785C "
    "is made for forward flight; in hover it is a convention.",
    "Lever arms of the sensors.",
    "A real flight: the paper's numbers are from flight, all of this is computed.",
)
# Simulated where one of the parameters is not zero; else left out.
_BY_PARAMETER = (
    (("terms.flap_back",), "Flap-back: the disc tilts away from the air that moves across it."),
    (("terms.inflow",), "Dynamic inflow of the main rotor, three states."),
    (("terms.ground_effect",), "Ground effect."),
    (("terms.vortex_ring",), "Vortex-ring state in steep descent, as measured."),
    (("terms.rotor_speed",), "Rotor speed, engine and governor; without it the speed is constant."),
    (("terms.tail_authority",), "Stops and stall of the tail rotor."),
    (("terms.fuel",), "Fuel burnt, and the mass that goes with it."),
    (
        ("terms.servo_resolution", "terms.servo_dead_band", "terms.servo_load"),
        "Servos with steps, a dead band, and a rate that falls under load.",
    ),
    (
        ("wind.parts.main", "wind.parts.tail", "wind.parts.fuselage"),
        "Gusts that meet rotor, tail and fuselage one after the other.",
    ),
    (("wind.rotation",), "Air that turns: rotational gusts."),
    (("sensors.imu.vibration.rev_mps2", "sensors.imu.vibration.blade_mps2"),
     "Vibration of the rotor on the IMU."),
    (("sensors.imu.gyro_scale_sigma", "sensors.imu.accel_scale_sigma"),
     "Scale factors and misalignment of the IMU."),
    (("sensors.mag.power_field_t_per_w",), "Magnetic field of the drive's currents."),
    (("sensors.baro.wind_coefficients", "sensors.baro.wash_coefficient"),
     "Barometer in the wind and in the rotor's wash."),
    (("sensors.gps.multipath.sigma_m",), "GPS multipath."),
    (("sensors.gps.outage.interval_s",), "GPS outages."),
)  # fmt: skip


def _is_on(value: Any) -> bool:
    return bool(np.any(np.asarray(value, dtype=float) != 0.0))


def scope(plant: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """What is simulated and what is not, in sentences.

    Parameters
    ----------
    plant : mapping
        The plant's parameters in that flight.
    """
    holds: list[str] = []
    lacks: list[str] = []
    for keys, sentence in _BY_PARAMETER:
        on = any(_is_on(plant[key]) for key in keys)
        (holds if on else lacks).append(sentence)
    rate = f"{Rate.of_parameters(plant).hz} Hz"
    loop = f"The loop as it would fly: observer at {rate}, attitude controller at {rate}, "
    loop += "position controller at 50 Hz."
    return {"Simulated": (*_ALWAYS, loop, *holds), "Not simulated": (*lacks, *_NEVER)}
