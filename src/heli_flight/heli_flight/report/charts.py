# SPDX-License-Identifier: Apache-2.0
"""What stands behind the paper's figures: wind, actuators, estimates, design, timeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heli_core.metrics import (
    ATTITUDE_DEG,
    BY_KEY,
    PATH,
    SETTLED_S,
    PaperMetric,
    heading_frame,
)
from heli_core.python_controller import INNER, OUTER
from heli_core.rotations import rotation_between
from heli_core.rows import ACTUATOR, REFERENCE
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.trim import TrimError
from heli_dynamics_sim.wind import log_law
from heli_flight.layers import AUTOPILOTS
from heli_flight.record import FlightRecord
from heli_flight.report.data import (
    FAILSAFE,
    FAULT,
    LEVELS,
    MODE,
    Band,
    Chart,
    Panel,
    Report,
    Trace,
    bands_of,
    beyond,
    largest,
    level,
    limits,
)
from heli_flight.scoring import SOURCE_NAMES, STRETCHES, drift_at_engagement, errors
from heli_flight.settings import Settings, own_laws
from heli_inner_hinf.controller_state import Actuation, ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.excitation import AXES

if TYPE_CHECKING:
    from heli_inner_hinf.loops import Loop, Model
    from heli_inner_hinf.tuning import LoopReport


# -------------------------------------------------------------------------------------------------
# The paper's figures 3 to 9, redrawn from a flight, each with the paper's bound drawn in.
# -------------------------------------------------------------------------------------------------

PD_PID_M = 1.2
"""Hover position error of a PD-PID controller, the paper's reference [8]."""
NONLINEAR_M = 1.33
"""Hover position error of a nonlinear controller, the paper's reference [17]."""
ADS33_HORIZONTAL_M = 0.91
"""ADS-33E hover, desired performance: horizontal position."""
ADS33_VERTICAL_M = 0.61
"""ADS-33E hover, desired performance: altitude."""

PAPER_SECTION = "paper"
NAMES = SOURCE_NAMES
LAWS = {
    "hinf_output": "H-infinity output feedback",
    "hinf": "H-infinity",
    "lqr": "LQR",
    "lqg": "LQG with integral action",
    "pid": "PID",
    "indi": "incremental inversion",
    "matrices": "given by its matrices",
}
_ROLES = {"navigation": "nav", "truth": "truth"}
_ZOOM_S = 5.0
_V_X = "Speed ahead in the heading frame"
_V_Y = "Speed to the right in the heading frame"


def paper_charts(report: Report) -> list[Chart]:
    """The figures that belong to the flight's scenario."""
    if not len(report.record):
        return []
    if report.kind == "attitude":
        return _attitude_charts(report)
    if report.kind != "hover":
        return []
    return [
        _vertical_speed(report),
        _velocity(report, "v_x", 0, "Forward speed", "v_x", _V_X),
        _velocity(report, "v_y", 1, "Lateral speed", "v_y", _V_Y),
        _altitude(report),
        _track(report),
    ]


def _line(report: Report, source: str, y: np.ndarray) -> Trace:
    width = 1.5 if source == "navigation" else 1.2
    return Trace(report.record.time_s, y, NAMES[source], _ROLES[source], width=width)


def _largest(report: Report, *keys: str) -> str:
    """Largest values of metrics over each stretch as a sentence for a caption."""
    sentences = []
    for stretch, name in STRETCHES.items():
        words = []
        for key in keys:
            scores = [(source, report.score(key, source, stretch)) for source in report.sources()]
            parts = [f"{s.max:.2f} {s.metric.unit} ({NAMES[source]})" for source, s in scores if s]
            if parts:
                prefix = f"{key} " if len(keys) > 1 else ""
                words.append(prefix + ", ".join(parts))
        if words:
            sentences.append(f"{name}: {'; '.join(words)}")
    return f"Largest, {'. In the '.join(sentences)}." if sentences else "Not scored."


def _velocity(report: Report, key: str, axis: int, title: str, quantity: str, what: str) -> Chart:
    metric = report.metric(key)
    lines = [_line(report, s, report.error(key, s)) for s in report.sources()]
    return Chart(
        f"{BY_KEY[key].source.lower().replace('. ', '')}_{key}",
        title,
        f"{what}; shaded: the scored windows. {_largest(report, key)}",
        [Panel(quantity, "m/s", [*reversed(lines), *_limits(report, metric)])],
        PAPER_SECTION,
        _redrawn(metric),
        spans=report.spans,
    )


def _limits(report: Report, metric: PaperMetric) -> list[Trace]:
    """Its bound on both sides; nothing where there is none."""
    if not metric.bounded:
        return []
    words = f"{metric.bound_name}: ±{metric.paper:g} {metric.unit}"
    return [limits(report.record.time_s, metric.paper, words)]


def _redrawn(metric: PaperMetric) -> str:
    """The paper's figure whose bound a chart has; empty for another bound."""
    return metric.source if metric.source == BY_KEY[metric.key].source else ""


def _vertical_speed(report: Report) -> Chart:
    """Fig. 5: v_z with its reference, and what is left of it, enlarged to the paper's bound."""
    r, metric = report.record, report.metric("v_z")
    speeds = {"navigation": r.nav_vel_ned_mps[:, 2], "truth": r.truth_vel_ned_mps[:, 2]}
    sources = list(reversed(report.sources()))
    target = Trace(
        r.time_s, r.reference[:, REFERENCE.down_vel], "reference", "reference", "dash", width=1.2
    )
    errors = [_line(report, s, report.error("v_z", s)) for s in sources]
    reach = 2.2 * (metric if metric.bounded else BY_KEY["v_z"]).paper
    return Chart(
        "fig5_v_z",
        "Vertical speed",
        "Speed downwards with its reference, and their difference in the range of hover; shaded: "
        f"the scored windows. {_largest(report, 'v_z')}",
        [
            Panel("v_z", "m/s", [*(_line(report, s, speeds[s]) for s in sources), target]),
            Panel(
                "v_z - reference",
                "m/s",
                [*errors, *_limits(report, metric)],
                y_range=(-reach, reach),
            ),
        ],
        PAPER_SECTION,
        _redrawn(metric),
        spans=report.spans,
    )


def _altitude(report: Report) -> Chart:
    r, metric = report.record, report.metric("altitude")
    reference = -r.reference[:, REFERENCE.pos][:, 2]
    heights = {"navigation": -r.nav_pos_ned_m[:, 2], "truth": -r.truth_pos_ned_m[:, 2]}
    lines = [_line(report, s, heights[s]) for s in reversed(report.sources())]
    target = Trace(r.time_s, reference, "reference", "reference", "dash", width=1.2)
    bound = []
    if metric.bounded:
        ends = np.concatenate([r.time_s, [np.nan], r.time_s])
        tube = np.concatenate([reference + metric.paper, [np.nan], reference - metric.paper])
        words = f"{metric.bound_name}: ±{metric.paper:.2f} m"
        bound.append(Trace(ends, tube, words, "bound", "dash", width=1.2))
    start, end, shown = _zoom(report)
    near = reference[(r.time_s >= start) & (r.time_s <= end)]
    middle = 0.5 * (near.min() + near.max())
    half = (metric if metric.bounded else BY_KEY["altitude"]).paper
    reach = 1.5 * half + 0.5 * float(np.ptp(near))
    return Chart(
        "fig8_altitude",
        "Altitude",
        f"Height above ground, and the {end - start:.0f} s about the "
        f"largest error of the {shown} enlarged. {_largest(report, 'altitude')}",
        [
            Panel("altitude", "m", [*lines, target]),
            Panel(
                "altitude",
                "m",
                [*lines, target, *bound],
                y_range=(middle - reach, middle + reach),
                x_range=(start, end),
                note="enlarged",
            ),
        ],
        PAPER_SECTION,
        _redrawn(metric),
        spans=report.spans,
    )


def _zoom(report: Report) -> tuple[float, float, str]:
    """Where the scored altitude error is largest: start, end (s), of which record."""
    r = report.record
    scored = report.settings.scenario.scored(r.time_s)
    source = report.sources()[0]
    error = np.abs(report.error("altitude", source))
    if scored.any():
        error = np.where(scored, error, 0.0)
    error = np.nan_to_num(error)
    centre = float(r.time_s[int(np.argmax(error))])
    first, last = float(r.time_s[0]), float(r.time_s[-1])
    for a, b in report.spans:
        if a <= centre <= b:
            first, last = a, b
    start = float(np.clip(centre - _ZOOM_S, first, max(first, last - 2.0 * _ZOOM_S)))
    return start, min(start + 2.0 * _ZOOM_S, last), NAMES[source]


def _track(report: Report) -> Chart:
    scored = report.settings.scenario.scored(report.record.time_s)
    traces: list[Trace] = []
    for source in report.sources():
        right, ahead = report.error("lateral", source), report.error("longitudinal", source)
        if not traces:
            words = f"whole flight ({NAMES[source]})"
            traces.append(Trace(right, ahead, words, "muted", width=0.8))
        right, ahead = (np.where(scored, error, np.nan) for error in (right, ahead))
        traces.append(Trace(right, ahead, NAMES[source], _ROLES[source], width=1.4))
    lateral, longitudinal = report.metric("lateral"), report.metric("longitudinal")
    is_bounded = lateral.bounded and longitudinal.bounded
    x, y = (lateral.paper, longitudinal.paper) if is_bounded else (PD_PID_M, PD_PID_M)
    box = np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    ads = ADS33_HORIZONTAL_M
    far = max(max(largest(t.x), largest(t.y)) for t in traces)
    if is_bounded:
        words = f"{lateral.bound_name}: ±{x:g} m, ±{y:g} m"
        traces.append(Trace(box[0] * x, box[1] * y, words, "bound", "dash", width=1.8))
    traces += [
        Trace(PD_PID_M * np.sin(turn), PD_PID_M * np.cos(turn), "[8] 1.2 m", "green", "dot"),
        Trace(NONLINEAR_M * np.sin(turn), NONLINEAR_M * np.cos(turn), "[17] 1.33 m", "sky", "dot"),
        Trace(box[0] * ads, box[1] * ads, "ADS-33E desired", "muted", "dot"),
        Trace(np.zeros(1), np.zeros(1), "reference", "reference", "points"),
    ]
    span = 1.6 * max(NONLINEAR_M, x)
    side = float(np.clip(1.1 * far, span, 50.0))
    return Chart(
        "fig9_track",
        "Horizontal track",
        "Position about the reference in the heading frame, on a 1 m grid; coloured: the scored "
        f"windows. {_largest(report, 'lateral', 'longitudinal')}",
        [Panel("forward", "m", traces, y_range=(-side, side), x_range=(-side, side))],
        PAPER_SECTION,
        _redrawn(lateral),
        x_quantity="to the right",
        x_unit="m",
        time=False,
        square=True,
    )


def _attitude_charts(report: Report) -> list[Chart]:
    """Fig. 3 (PID) and Fig. 4 (H-infinity), whichever of the two this flight is."""
    flights = [(report.controller, report.record, "this flight")]
    if report.rival is not None:
        again = "the same wind, sensors and seed, flown again in one process"
        flights.append((report.rival.controller, report.rival.record, again))
    flights.sort(key=lambda row: row[0] != "pid")
    scale = (
        max(_reach(report, record) for _, record, _ in flights),
        max(_scored_reach(report, record) for _, record, _ in flights),
    )
    return [
        _paper_charts_attitude(report, law, record, origin, scale)
        for law, record, origin in flights
    ]


def _attitude_error_deg(record: FlightRecord, source: str) -> np.ndarray:
    return np.column_stack(list(errors(record, source, "attitude").values()))


def _reach(report: Report, record: FlightRecord) -> float:
    """Common scale of Fig. 3 and Fig. 4, deg, so that they can be compared by eye.

    By the scored phases: a take-off or a loss before or after them does not squash what is judged.
    """
    scored = report.settings.scenario.scored(record.time_s)
    if not scored.any():
        scored = np.ones(len(record), bool)
    worst = max(largest(_attitude_error_deg(record, s)[scored]) for s in report.sources())
    return float(np.clip(1.08 * worst, 1.15 * ATTITUDE_DEG["pid"][0], 30.0))


def _scored_reach(report: Report, record: FlightRecord) -> float:
    """Scale of the enlargement: the largest scored error of the state estimate, deg."""
    scored = report.settings.scenario.scored(record.time_s)
    error = _attitude_error_deg(record, report.sources()[0])[scored]
    return max(0.05, 1.15 * largest(error))


def _attitude_bound(report: Report, key: str, law: str, time_s: np.ndarray) -> list[Trace]:
    """The controller's own figure for the paper's test; else the flight's bound, if it has one."""
    metric = report.metric(key)
    if not metric.bounded:
        return []
    if not _redrawn(metric):
        return [limits(time_s, metric.paper, f"{metric.bound_name}: ±{metric.paper:g}°")]
    paper = ATTITUDE_DEG.get(law, ATTITUDE_DEG["hinf"])[0]
    words = f"paper, {'PID' if law == 'pid' else 'H-infinity'}: ±{paper:g}°"
    return [limits(time_s, paper, words)]


def _paper_charts_attitude(
    report: Report, law: str, record: FlightRecord, origin: str, scale: tuple[float, float]
) -> Chart:
    figure = ATTITUDE_DEG.get(law, ATTITUDE_DEG["hinf"])[1]
    t = record.time_s
    panels = []
    for axis, name in enumerate(("roll", "pitch")):
        lines = [
            Trace(t, _attitude_error_deg(record, s)[:, axis], NAMES[s], _ROLES[s])
            for s in reversed(report.sources())
        ]
        bound = _attitude_bound(report, name, law, t)
        note = beyond(t, [line.y for line in lines], scale[0], "°")
        reach = (-scale[0], scale[0])
        panels.append(Panel(f"{name} error", "°", [*lines, *bound], y_range=reach, note=note))
    source = report.sources()[0]
    error = _attitude_error_deg(record, source)
    close = [Trace(t, error[:, 0], "roll", "green"), Trace(t, error[:, 1], "pitch", "purple")]
    note = f"enlarged: {NAMES[source]}"
    panels.append(Panel("error", "°", close, y_range=(-scale[1], scale[1]), note=note))
    scored = report.settings.scenario.scored(t)
    parts = []
    for source in report.sources():
        error = np.abs(_attitude_error_deg(record, source)[scored])
        if error.size and np.isfinite(error).all():
            roll, pitch = error.max(axis=0)
            parts.append(f"roll {roll:.2f}°, pitch {pitch:.2f}° ({NAMES[source]})")
    largest = f" Largest in the scored window (shaded): {'; '.join(parts)}." if parts else ""
    name = LAWS.get(law, law)
    return Chart(
        f"{figure.lower().replace('. ', '')}_attitude_{law}",
        f"Roll and pitch under {name}",
        f"Attitude minus command (0 in the paper) under {name}: {origin}.{largest}",
        panels,
        PAPER_SECTION,
        figure if _redrawn(report.metric("roll")) else "",
        spans=report.spans,
        bands=None if record is report.record else bands_of(record, report.settings),
    )


# -------------------------------------------------------------------------------------------------
# A path from above, its height, and how far the aircraft was from its point.
# -------------------------------------------------------------------------------------------------

PATH_SECTION = "path"


def path_charts(report: Report) -> list[Chart]:
    """Charts of a flight along a path."""
    if report.kind != PATH or not len(report.record):
        return []
    return [_from_above(report), _errors(report)]


def _positions(report: Report, source: str) -> np.ndarray:
    record = report.record
    return record.nav_pos_ned_m if source == "navigation" else record.truth_pos_ned_m


def _from_above(report: Report) -> Chart:
    """North over east, with equal scales."""
    places = {source: _positions(report, source) for source in report.sources()}
    wanted = report.record.reference[:, REFERENCE.pos]
    traces = [
        Trace(pos[:, 1], pos[:, 0], SOURCE_NAMES[source], _ROLES[source], width=1.4)
        for source, pos in places.items()
    ]
    traces.append(Trace(wanted[:, 1], wanted[:, 0], "path", "reference", "dash", width=1.2))
    around = wanted if np.isfinite(wanted).any() else np.concatenate(list(places.values()))
    middle = 0.5 * (np.nanmin(around[:, :2], axis=0) + np.nanmax(around[:, :2], axis=0))
    every = np.concatenate([wanted, *places.values()])[:, :2] - middle
    side = float(np.clip(1.1 * largest(every), 2.0, 500.0))
    north, east = ((float(m) - side, float(m) + side) for m in middle)
    return Chart(
        "path_from_above",
        "The path from above",
        "What was flown and the path, on a 1 m grid.",
        [Panel("north", "m", traces, y_range=north, x_range=east)],
        PATH_SECTION,
        x_quantity="east",
        x_unit="m",
        time=False,
        square=True,
    )


def _path_charts_reach(report: Report, lines: Sequence[Trace], goal: float) -> float:
    """End of an axis: by the scored phases, so that no take-off squashes what is judged."""
    scored = report.settings.scenario.scored(report.record.time_s)
    if not scored.any():
        scored = np.ones(len(report.record), bool)
    return 1.08 * max(1.08 * goal, *(largest(line.y[scored]) for line in lines))


def _errors(report: Report) -> Chart:
    """Height, distance and heading error over time, with the goals."""
    r, kinds = report.record, report.sources()
    by_source = {source: errors(r, source, PATH) for source in kinds}
    height = [
        Trace(r.time_s, -_positions(report, s)[:, 2], SOURCE_NAMES[s], _ROLES[s])
        for s in reversed(kinds)
    ]
    down = r.reference[:, REFERENCE.pos][:, 2]
    height.append(Trace(r.time_s, -down, "path", "reference", "dash", width=1.2))
    lines = {
        key: [
            Trace(r.time_s, by_source[s][key], SOURCE_NAMES[s], _ROLES[s]) for s in reversed(kinds)
        ]
        for key in ("position", "heading")
    }
    goals = report.metric("position"), report.metric("heading")
    away, turned = (goal.paper for goal in goals)
    names = tuple(goal.bound_name for goal in goals)
    reach = {"position": _path_charts_reach(report, lines["position"], away)}
    reach["heading"] = _path_charts_reach(report, lines["heading"], turned)
    notes = {
        key: beyond(r.time_s, [line.y for line in lines[key]], reach[key], unit)
        for key, unit in (("position", "m"), ("heading", "°"))
    }
    return Chart(
        "path_errors",
        "On the path",
        "Height; distance from the point of the path at that moment; heading less the path's.",
        [
            Panel("altitude", "m", height),
            Panel(
                "distance",
                "m",
                [*lines["position"], level(r.time_s, away, f"{names[0]}: {away:g} m")],
                y_range=(-0.05 * reach["position"], reach["position"]),
                note=notes["position"],
            ),
            Panel(
                "heading error",
                "°",
                [*lines["heading"], limits(r.time_s, turned, f"{names[1]}: ±{turned:g}°")],
                y_range=(-reach["heading"], reach["heading"]),
                note=notes["heading"],
            ),
        ],
        PATH_SECTION,
        spans=report.spans,
    )


# -------------------------------------------------------------------------------------------------
# Singular values and margins of the design that flew.
# -------------------------------------------------------------------------------------------------

_POINTS = 240


@dataclass(frozen=True)
class Bound:
    """What was asked of the worst case, and what can be had.

    Attributes
    ----------
    gamma, gamma_star : float
        The bound and its infimum, eq. (14).
    of : str
        What it bounds, in words.
    is_wind_to_h : bool
        Whether that is the norm from wind to h, whose singular values are drawn.
    """

    gamma: float
    gamma_star: float
    of: str
    is_wind_to_h: bool


@dataclass(frozen=True)
class LoopNumbers:
    """What a loop as flown is worth along or about one axis.

    Attributes
    ----------
    rejection_radps : float or None
        Disturbance rejection bandwidth: below it more than 3 dB are taken off; None: nowhere.
    peak_db, peak_radps : float
        Where it adds most to a disturbance.
    crossover_radps : float or None
        Of the attitude loop broken at the axis' actuator, the others closed; of the position loop
        broken at the commanded acceleration.
    """

    rejection_radps: float | None
    peak_db: float
    peak_radps: float
    crossover_radps: float | None


@dataclass(frozen=True)
class AxisNumbers(LoopNumbers):
    """The same of attitude, with its response to its command.

    Attributes
    ----------
    phase_bandwidth_radps, gain_bandwidth_radps : float or None
        As ADS-33E defines them.
    """

    phase_bandwidth_radps: float | None
    gain_bandwidth_radps: float | None


@dataclass(frozen=True)
class DesignNumbers:
    """The flown design's numbers.

    Attributes
    ----------
    controller : str
    bound : Bound or None
        That of the controller that flew; None for a controller that is designed without one.
    loops : sequence of LoopReport
        As flown: sampled, with servos and delay; before it, for state feedback: every state known,
        and with the observer (19).
    omega : sequence of (m,) ndarray
        Frequencies of each loop, rad/s.
    wind_to_h, wind_to_u : sequence of (m, 3) ndarray
        Singular values of each loop from wind (m/s).
    rate_hz : int
        At which the controller steps.
    axes : sequence of AxisNumbers
        Roll, pitch, yaw of the loop as flown; empty for an unstable one.
    position : sequence of LoopNumbers
        Forward, right, down; empty where no such loop flew, or the aircraft has no trim.
    """

    controller: str
    bound: Bound | None
    loops: list[LoopReport]
    omega: list[np.ndarray]
    wind_to_h: list[np.ndarray]
    wind_to_u: list[np.ndarray]
    rate_hz: int
    axes: Sequence[AxisNumbers] = ()
    position: Sequence[LoopNumbers] = ()


def flown_design(settings: Settings) -> DesignNumbers | None:
    """Analyse the inner loop of a flight; None for a controller whose linear form is not known.

    Raises
    ------
    ValueError
        As the design's parts raise it, each with a sentence.
    """
    if INNER in own_laws(settings) or settings.mode in AUTOPILOTS:
        return None
    if settings.nodes["plant"]["linear_model"]:
        return None  # its loop is with `heli design --aircraft`
    # python-control takes seconds to import: not before it is needed
    from heli_inner_hinf import tuning

    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    observer = settings.nodes["observer"]
    plant = PlantConfig.from_parameters(settings.nodes["plant"])
    aircraft = plant.helicopter
    actuation = Actuation(
        aircraft.servo_bandwidth_radps,
        aircraft.servo_damping,
        plant.rate.tick_s * plant.delay_ticks,
        plant.rate.tick_s,
    )
    feed = ObserverInput.from_parameters(observer)
    K = np.reshape(np.asarray(observer["K"], float), (3, 6))
    loops = tuning.loops_of(config, K, feed, actuation)
    if not loops:
        return None
    top = [0.999 * np.pi / loop.dt if loop.dt else 1e3 for loop in loops]
    omega = [np.geomspace(1e-2, end, _POINTS) for end in top]
    values = [tuning.singular_values(loop, w) for loop, w in zip(loops, omega, strict=True)]
    return DesignNumbers(
        config.controller,
        _bound(config),
        [tuning.analyse(loop) for loop in loops],
        omega,
        [hv for hv, _ in values],
        [uv for _, uv in values],
        plant.rate.hz,
        _axes(loops[-1]),
        _position(settings, loops[-1], tuning.model_of(config), actuation),
    )


def _position(
    settings: Settings, loop: Loop, model: Model, actuation: Actuation
) -> list[LoopNumbers]:
    from heli_analysis.handling.scoring import FrequencyResponse, rejection
    from heli_flight.position_axes import position_axes
    from heli_inner_hinf.tuning import crossover_radps
    from heli_outer_pd.analysis import Gains, open_loop

    plant, outer = settings.nodes["plant"], settings.nodes["outer_loop"]
    flown = settings.scenario.kind != "attitude" and OUTER not in own_laws(settings)
    if not flown or settings.rate.fold != 1 or loop.stability() >= 0.0:
        return []
    try:
        around = position_axes(plant, outer, loop, model)
    except TrimError:
        return []
    numbers = []
    for i, axis in enumerate(around.axes(actuation)):
        omega, broken = open_loop(axis, Gains.of(around.params, i))
        sensitivity = FrequencyResponse(omega, 1.0 / (1.0 + broken), np.ones(omega.size))
        rejected, crossover = rejection(sensitivity), crossover_radps(omega, broken)
        numbers.append(
            LoopNumbers(rejected.bandwidth_radps, rejected.peak_db, rejected.peak_radps, crossover)
        )
    return numbers


def _axes(loop: Loop) -> list[AxisNumbers]:
    from heli_analysis.handling.scoring import FrequencyResponse, bandwidth, rejection
    from heli_inner_hinf.tuning import attitude_responses, crossover_radps

    if loop.stability() >= 0.0:
        return []
    responses = attitude_responses(loop)
    numbers = []
    for axis in range(len(AXES)):
        known = np.ones(responses.omega_radps.size)
        rejected = rejection(
            FrequencyResponse(responses.omega_radps, responses.to_disturbance[axis], known)
        )
        answered = bandwidth(
            FrequencyResponse(responses.omega_radps, responses.to_command[axis], known)
        )
        numbers.append(
            AxisNumbers(
                rejected.bandwidth_radps,
                rejected.peak_db,
                rejected.peak_radps,
                crossover_radps(responses.omega_radps, responses.broken[axis]),
                answered.phase_radps,
                answered.gain_radps,
            )
        )
    return numbers


def _bound(config: AttitudeConfig) -> Bound | None:
    """The bound below which the controller was synthesised."""
    if config.output is not None:
        return Bound(
            config.output.gamma,
            config.output.gamma_star.value,
            "of output feedback; wind, load and noise to h and the integrals, weighted by `output`",
            False,
        )
    if config.controller == "hinf":
        synthesis = config.synthesis
        of = "of state feedback; wind to h"
        return Bound(synthesis.gamma, synthesis.gamma_star.value, of, True)
    return None


# -------------------------------------------------------------------------------------------------
# System charts.
# -------------------------------------------------------------------------------------------------

_ACTUATORS = ("lateral", "longitudinal", "pedal", "collective")
_ACTUATOR_ROLES = ("nav", "truth", "green", "rival")
_LEVEL_ROLES = ("good", "warn", "bad", "muted")
_AXES = ("north", "east", "down")
_LEAST_SHARE = 0.004
_LOOP_ROLES = ("muted", "green", "nav")


def flight_charts(report: Report) -> list[Chart]:
    """Charts over flight time: wind, actuators, estimates against truth."""
    if not len(report.record):
        return []
    charts = [_wind(report)] if report.has_wind else []
    charts += [_actuators(report)]
    if report.kind != "attitude":
        charts.append(_attitude(report))
    if report.has_truth:
        charts += [
            _position_estimate(report),
            _velocity_estimate(report),
            _attitude_estimate(report),
        ]
    return [*charts, _rotor(report)]


def _mean_wind_mps(height_m: NDArray[np.float64], plant: Mapping[str, Any]) -> NDArray[np.float64]:
    """Steady wind at heights, by the profile of the plant's parameters."""
    if plant["wind.profile"] == "log":
        w20_mps, z0_m = plant["wind.w20_mps"], plant["wind.roughness_m"]
        return np.array([log_law(h, w20_mps, z0_m) for h in height_m])
    heights, speeds = plant["wind.profile_altitude_m"], plant["wind.profile_speed_mps"]
    return np.interp(height_m, heights, speeds)


def _wind(report: Report) -> Chart:
    r, plant = report.record, report.settings.nodes["plant"]
    ahead, right, down = heading_frame(r.wind_ned_mps, r.reference[:, REFERENCE.psi]).T
    height = -r.truth_pos_ned_m[:, 2] if report.has_truth else -r.nav_pos_ned_m[:, 2]
    mean = _mean_wind_mps(height, plant)
    t = r.time_s
    return Chart(
        "wind",
        "Wind",
        "Velocity of the air at the aircraft, blowing towards: its horizontal speed beside the "
        "mean of the profile at the flown height, and its parts in the heading frame.",
        [
            Panel(
                "speed",
                "m/s",
                [
                    Trace(t, np.hypot(ahead, right), "wind at the aircraft", "nav"),
                    Trace(t, mean, "mean at this height", "reference", "dash"),
                ],
            ),
            Panel(
                "part",
                "m/s",
                [
                    Trace(t, ahead, "forward", "truth"),
                    Trace(t, right, "to the right", "green"),
                    Trace(t, down, "down", "purple"),
                ],
            ),
        ],
        "flight",
        spans=report.spans,
    )


def _actuators(report: Report) -> Chart:
    r = report.record
    limit = float(report.settings.nodes["inner_loop"]["actuator_limit"])
    traces = [
        Trace(r.time_s, r.u[:, i], name, _ACTUATOR_ROLES[i]) for i, name in enumerate(_ACTUATORS)
    ]
    used = largest(r.u)
    bound = limits(r.time_s, limit, f"limit: ±{limit:g}")
    return Chart(
        "actuators",
        "Actuators",
        "Commands to the servos, normalised to (-1, 1): the whole range with its limits, and "
        f"enlarged. Largest: {used:.2f}, that is {100.0 * used / limit:.0f} % of the limit.",
        [
            Panel("command", "", [*traces, bound], y_range=(-1.05, 1.05), note="whole range"),
            Panel(
                "command",
                "",
                traces[ACTUATOR.attitude],
                note="enlarged: lateral, longitudinal, pedal",
            ),
            Panel("command", "", [traces[ACTUATOR.col]], note="enlarged: collective"),
        ],
        "flight",
        spans=report.spans,
    )


def _attitude(report: Report) -> Chart:
    r = report.record
    command = np.degrees(np.unwrap(r.setpoint, axis=0))
    panels = []
    for axis, name in enumerate(("roll", "pitch", "heading")):
        traces = []
        for source in reversed(report.sources()):
            label = "state estimate" if source == "navigation" else "ground truth"
            role = "nav" if source == "navigation" else "truth"
            angle = np.degrees(np.unwrap(np.radians(report.euler_deg(source)[:, axis])))
            traces.append(Trace(r.time_s, angle, label, role))
        traces.append(Trace(r.time_s, command[:, axis], "command", "reference", "dash", width=1.0))
        panels.append(Panel(name, "°", traces))
    return Chart(
        "attitude",
        "Attitude",
        "Roll, pitch and heading beside what the outer loop commands.",
        panels,
        "flight",
        spans=report.spans,
    )


def _estimate(
    report: Report,
    error: np.ndarray,
    sigma: np.ndarray | None,
    what: str,
    unit: str,
    axes: tuple[str, ...] = _AXES,
):
    """Panels of the axes of estimate minus truth inside 3 sigma; and a sentence."""
    t, panels = report.record.time_s, []
    share = _share_inside(error, sigma)
    for axis, name in enumerate(axes):
        traces = []
        if share is not None and sigma is not None:
            edge = 3.0 * sigma[:, axis]
            traces.append(Trace(t, edge, "3 σ of the filter", "nav", "band", y2=-edge))
        traces.append(Trace(t, error[:, axis], "estimate - truth", "truth"))
        panels.append(Panel(name, unit, traces))
    if share is None:
        return panels, f"{what} error. The covariance was not recorded."
    return panels, f"{what}: estimate minus truth; {share:.1f} % of it inside 3 σ."


def _position_estimate(report: Report) -> Chart:
    """Position's error inside its sigma, and which sigma that is."""
    r = report.record
    error = r.nav_pos_ned_m - r.truth_pos_ned_m
    panels, caption = _estimate(report, error, r.nav_sigma_pos_m, "Position", "m")
    unknown = report.settings.nodes["observer"]["ekf.initial.drift_at_alignment_fraction"]
    if unknown == 1.0:
        caption += " σ is of the position in the world: the receiver's drift is in it."
    else:
        caption += (
            " σ is of the position as it counts from the alignment: what the receiver drifts from "
            "there on is in σ; what it was off by then is in the error, not in σ: no instrument on "
            "board can tell it."
        )
        offset = drift_at_engagement(r)
        if offset is not None:
            less = f"less its value at {SETTLED_S:g} s"
            panels = [
                replace(panel, traces=[*panel.traces, Trace(r.time_s, e - o, less, "green", "dot")])
                for panel, e, o in zip(panels, error.T, offset, strict=True)
            ]
            share = _share_inside(error - offset, r.nav_sigma_pos_m)
            if share is not None:
                caption += f" The error {less}: {share:.1f} % of it inside 3 σ."
    return Chart("estimate_position", "Position estimate", caption, panels, "estimate")


def _share_inside(error: np.ndarray, sigma: np.ndarray | None) -> float | None:
    """How much of an error, %, is inside 3 sigma; None where sigma was not recorded."""
    if sigma is None or not bool((sigma > 0.0).any()):
        return None
    inside = np.abs(error) <= 3.0 * sigma
    compared = inside[np.isfinite(error) & np.isfinite(sigma)]
    return 100.0 * float(compared.mean()) if compared.size else 0.0


def _velocity_estimate(report: Report) -> Chart:
    r = report.record
    error = r.nav_vel_ned_mps - r.truth_vel_ned_mps
    panels, caption = _estimate(report, error, r.nav_sigma_vel_mps, "Velocity", "m/s")
    return Chart("estimate_velocity", "Velocity estimate", caption, panels, "estimate")


def _attitude_estimate(report: Report) -> Chart:
    r = report.record
    error = np.degrees(rotation_between(r.truth_q_nb, r.nav_q_nb))
    sigma = None if r.nav_sigma_att_rad is None else np.degrees(r.nav_sigma_att_rad)
    axes = tuple(f"about {axis}" for axis in _AXES)
    panels, caption = _estimate(report, error, sigma, "Attitude", "°", axes)
    caption += " About down is the heading, which hover shows to the magnetometer only."
    return Chart("estimate_attitude", "Attitude estimate", caption, panels, "estimate")


def _rotor(report: Report) -> Chart:
    r, panels = report.record, []
    for axis, name in enumerate(("a_s", "b_s", "d_int")):
        traces = []
        if report.has_rotor_truth:
            traces.append(Trace(r.time_s, 1e3 * r.truth_rotor[:, axis], "ground truth", "truth"))
        traces.append(Trace(r.time_s, 1e3 * r.nav_rotor[:, axis], "estimate, eq. (19)", "nav"))
        panels.append(Panel(name, "mrad", traces))
    words = ""
    if report.has_rotor_truth:
        error = 1e3 * (r.nav_rotor - r.truth_rotor)
        error = error[np.isfinite(error).all(axis=1)]
        if len(error):
            rms = np.sqrt(np.mean(error**2, axis=0))
            words = f" Error, rms: {rms[0]:.2g}, {rms[1]:.2g}, {rms[2]:.2g} mrad."
    return Chart(
        "rotor",
        "Flapping and yaw gyro",
        "Longitudinal and lateral flapping a_s, b_s and the yaw gyro's integrator d_int: what the "
        f"reduced-order observer makes of them.{words}",
        panels,
        "estimate",
    )


def design_charts(design: DesignNumbers) -> list[Chart]:
    """Singular values from wind to the controlled output and to the actuators."""
    outputs, inputs = [], []
    roles = _LOOP_ROLES[-len(design.loops) :]
    for i, (loop, role) in enumerate(zip(design.loops, roles, strict=True)):
        w = design.omega[i]
        outputs.append(Trace(w, design.wind_to_h[i][:, 0], loop.name, role, width=1.8))
        inputs.append(Trace(w, design.wind_to_u[i][:, 0], loop.name, role, width=1.8))
    flown = design.loops[-1]
    for values in design.wind_to_h[-1].T[1:]:
        outputs.append(Trace(design.omega[-1], values, "", "nav", "dot", width=1.0))
    for values in design.wind_to_u[-1].T[1:]:
        inputs.append(Trace(design.omega[-1], values, "", "nav", "dot", width=1.0))
    w = design.omega[0]
    bound, highest, gamma_note = design.bound, float(np.max(design.wind_to_h[-1])), ""
    if bound is not None and not bound.is_wind_to_h:
        gamma_note = f" γ = {bound.gamma:.3g} is {bound.of}: no level of this chart."
    elif bound is not None:
        outputs += [
            level(w, bound.gamma, f"γ = {bound.gamma:.4f}"),
            level(w, bound.gamma_star, f"γ* = {bound.gamma_star:.4f}", "reference", "dot"),
        ]
        highest, gamma_note = max(bound.gamma, highest), f" γ is {bound.of}."
    if np.isfinite(flown.norm):
        highest = max(highest, flown.norm)
    top = 2.0 * highest
    return [
        Chart(
            "singular_values",
            "Singular values",
            "From wind (m/s) to the controlled output h, eq. (11), and to the actuators: the "
            "largest of each loop, and the smaller ones of the loop as flown (dotted)."
            f"{gamma_note}",
            [
                Panel("σ(wind → h)", "", outputs, log_y=True, y_range=(1e-3 * top, top)),
                Panel("σ(wind → u)", "", inputs, log_y=True, y_range=(1e-6, 1e-1)),
            ],
            "design",
            x_quantity="frequency",
            x_unit="rad/s",
            time=False,
            log_x=True,
        )
    ]


def timeline_charts(report: Report) -> list[Chart]:
    """Lanes: phase of the flight, actuators at their limit, and each node's health."""
    if not len(report.record):
        return []
    lanes: list[str] = []
    traces: list[Trace] = []
    named: set[str] = set()

    def add(lane: str, stretches: list[tuple[float, float]], label: str, role: str) -> None:
        if lane not in lanes:
            lanes.append(lane)
        if not stretches:
            return
        x = np.array([v for a, b in stretches for v in (a, b, np.nan)])
        y = np.full(x.size, float(lanes.index(lane)))
        traces.append(Trace(x, y, "" if label in named else label, role, "bar", width=13.0))
        named.add(label)

    climbing = np.abs(report.record.reference[:, REFERENCE.down_vel]) > 1e-6
    add("reference", _stretches(report, ~climbing), "hover", "nav")
    add("reference", _stretches(report, climbing), "climb", "muted")
    bands = report.bands or bands_of(report.record, report.settings, (), report.events)
    for band in bands:
        if band.kind == MODE:
            add("mode", [(band.start_s, band.end_s)], band.name, band.role)
    add("scored", report.spans, "scored", "purple")
    for band in bands:
        if band.kind == FAULT:
            add(f"fault: {band.of}", [_wide(report, band)], "a fault that was flown", band.role)
    for band in bands:
        if band.kind == FAILSAFE:
            add("failsafe", [_wide(report, band)], f"failsafe: {band.name}", band.role)
    limit = float(report.settings.nodes["inner_loop"]["actuator_limit"])
    at_limit = (np.abs(report.record.u) >= limit - 1e-9).any(axis=1)
    add("at limit", _stretches(report, at_limit), "an actuator at its limit", "bad")
    for node, stretches in _health(report).items():
        for value, (label, role) in enumerate(zip(LEVELS, _LEVEL_ROLES, strict=True)):
            add(node, stretches.get(value, []), label, role)
    health_note = "Health of each node, from /diagnostics." if report.events else (
        "One process has no nodes, so there is no health of nodes to show."
        if report.how.startswith("one process")
        else "No /diagnostics were recorded."
    )  # fmt: skip
    bottom, height = len(lanes) - 0.4, 0.2 * len(lanes)
    return [
        Chart(
            "timeline",
            "Timeline",
            f"Phase of the flight, scored stretches, actuators at their limit. {health_note}",
            [Panel("", "", traces, height, y_range=(bottom, -0.6), y_ticks=lanes)],
            "timeline",
            bands=(),
        )
    ]


def _wide(report: Report, band: Band) -> tuple[float, float]:
    """A band's start and end, s; a moment is drawn wide enough to be seen."""
    end_s = float(report.record.time_s[-1])
    return band.start_s, max(band.end_s, band.start_s + _LEAST_SHARE * end_s)


def _stretches(report: Report, mask: np.ndarray) -> list[tuple[float, float]]:
    """Start and end, s, of the runs of True in mask (N,)."""
    t = report.record.time_s
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    starts, ends = np.nonzero(edges == 1)[0], np.nonzero(edges == -1)[0] - 1
    return [(float(t[a]), float(t[b])) for a, b in zip(starts, ends, strict=True)]


def _health(report: Report) -> dict[str, dict[int, list[tuple[float, float]]]]:
    """Stretches of each level of each node."""
    end = float(report.record.time_s[-1])
    lanes: dict[str, dict[int, list[tuple[float, float]]]] = {}
    for node in dict.fromkeys(event.node for event in report.events):
        node_events = [event for event in report.events if event.node == node]
        after = [*(event.time_s for event in node_events[1:]), end]
        for event, until in zip(node_events, after, strict=True):
            # A fault of a moment is drawn wide enough to be seen; the table below has its length.
            shown = until if event.level == 0 else max(until, event.time_s + _LEAST_SHARE * end)
            stretch = (max(0.0, event.time_s), max(0.0, shown))
            lanes.setdefault(node, {}).setdefault(event.level, []).append(stretch)
    return lanes
