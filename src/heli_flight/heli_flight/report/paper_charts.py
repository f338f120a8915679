# SPDX-License-Identifier: Apache-2.0
"""The paper's figures 3 to 9, redrawn from a flight, each with the paper's bound drawn in."""

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scoring import SOURCE_NAMES, STRETCHES, errors
from heli_flight.report.bands import bands_of
from heli_flight.report.chart import Chart, Panel, Trace, beyond, largest, limits
from heli_flight.report.data import Report
from heli_math.paper_metrics import ATTITUDE_DEG, BY_KEY
from heli_math.rows import REFERENCE

PD_PID_M = 1.2
"""Hover position error of a PD-PID controller, the paper's reference [8]."""
NONLINEAR_M = 1.33
"""Hover position error of a nonlinear controller, the paper's reference [17]."""
ADS33_HORIZONTAL_M = 0.91
"""ADS-33E hover, desired performance: horizontal position."""
ADS33_VERTICAL_M = 0.61
"""ADS-33E hover, desired performance: altitude."""

SECTION = "paper"
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
        _velocity(report, "v_x", 0, "Forward speed", "v_x, m/s", _V_X),
        _velocity(report, "v_y", 1, "Lateral speed", "v_y, m/s", _V_Y),
        _altitude(report),
        _track(report),
    ]


def _line(report: Report, source: str, y: np.ndarray) -> Trace:
    width = 1.5 if source == "navigation" else 1.2
    return Trace(report.record.time_s, y, NAMES[source], _ROLES[source], width=width)


def _largest(report: Report, *keys: str) -> str:
    """Largest values of metrics over each stretch as a sentence for a caption."""
    told = []
    for stretch, name in STRETCHES.items():
        words = []
        for key in keys:
            found = [(source, report.score(key, source, stretch)) for source in report.sources()]
            parts = [f"{s.max:.2f} {s.metric.unit} ({NAMES[source]})" for source, s in found if s]
            if parts:
                prefix = f"{key} " if len(keys) > 1 else ""
                words.append(prefix + ", ".join(parts))
        if words:
            told.append(f"{name}: {'; '.join(words)}")
    return f"Largest, {'. In the '.join(told)}." if told else "Not scored."


def _velocity(report: Report, key: str, axis: int, title: str, y_label: str, what: str) -> Chart:
    metric = BY_KEY[key]
    lines = [_line(report, s, report.error(key, s)) for s in report.sources()]
    bound = limits(report.record.time_s, metric.paper, f"paper: ±{metric.paper:g} m/s")
    return Chart(
        f"{metric.source.lower().replace('. ', '')}_{key}",
        title,
        f"{what}; shaded: the scored windows. {_largest(report, key)}",
        [Panel(y_label, [*reversed(lines), bound])],
        SECTION,
        metric.source,
        spans=report.spans,
    )


def _vertical_speed(report: Report) -> Chart:
    """Fig. 5: v_z with its reference, and what is left of it, enlarged to the paper's bound."""
    r, metric = report.record, BY_KEY["v_z"]
    speeds = {"navigation": r.nav_vel_ned_mps[:, 2], "truth": r.truth_vel_ned_mps[:, 2]}
    sources = list(reversed(report.sources()))
    target = Trace(
        r.time_s, r.reference[:, REFERENCE.down_vel], "reference", "reference", "dash", width=1.2
    )
    errors = [_line(report, s, report.error("v_z", s)) for s in sources]
    bound = limits(r.time_s, metric.paper, f"paper: ±{metric.paper:g} m/s")
    reach = 2.2 * metric.paper
    return Chart(
        "fig5_v_z",
        "Vertical speed",
        "Speed downwards with its reference, and their difference in the range of hover; shaded: "
        f"the scored windows. {_largest(report, 'v_z')}",
        [
            Panel("v_z, m/s", [*(_line(report, s, speeds[s]) for s in sources), target]),
            Panel("v_z - reference, m/s", [*errors, bound], y_range=(-reach, reach)),
        ],
        SECTION,
        "Fig. 5",
        spans=report.spans,
    )


def _altitude(report: Report) -> Chart:
    r, metric = report.record, BY_KEY["altitude"]
    reference = -r.reference[:, REFERENCE.pos][:, 2]
    heights = {"navigation": -r.nav_pos_ned_m[:, 2], "truth": -r.truth_pos_ned_m[:, 2]}
    lines = [_line(report, s, heights[s]) for s in reversed(report.sources())]
    target = Trace(r.time_s, reference, "reference", "reference", "dash", width=1.2)
    ends = np.concatenate([r.time_s, [np.nan], r.time_s])
    tube = np.concatenate([reference + metric.paper, [np.nan], reference - metric.paper])
    bound = Trace(ends, tube, f"paper: ±{metric.paper:.2f} m", "bound", "dash", width=1.2)
    start, end, shown = _zoom(report)
    near = reference[(r.time_s >= start) & (r.time_s <= end)]
    middle = 0.5 * (near.min() + near.max())
    reach = 1.5 * metric.paper + 0.5 * float(np.ptp(near))
    return Chart(
        "fig8_altitude",
        "Altitude",
        f"Height above ground, and the {end - start:.0f} s about the "
        f"largest error of the {shown} enlarged. {_largest(report, 'altitude')}",
        [
            Panel("altitude, m", [*lines, target]),
            Panel(
                "altitude, m",
                [*lines, target, bound],
                y_range=(middle - reach, middle + reach),
                x_range=(start, end),
                note="enlarged",
            ),
        ],
        SECTION,
        "Fig. 8",
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
    x, y = BY_KEY["lateral"].paper, BY_KEY["longitudinal"].paper
    box = np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    turn = np.linspace(0.0, 2.0 * np.pi, 121)
    ads = ADS33_HORIZONTAL_M
    traces += [
        Trace(box[0] * x, box[1] * y, f"paper: ±{x:g} m, ±{y:g} m", "bound", "dash", width=1.8),
        Trace(PD_PID_M * np.sin(turn), PD_PID_M * np.cos(turn), "[8] 1.2 m", "green", "dot"),
        Trace(NONLINEAR_M * np.sin(turn), NONLINEAR_M * np.cos(turn), "[17] 1.33 m", "sky", "dot"),
        Trace(box[0] * ads, box[1] * ads, "ADS-33E desired", "muted", "dot"),
        Trace(np.zeros(1), np.zeros(1), "reference", "reference", "points"),
    ]
    span = 1.6 * max(NONLINEAR_M, x)
    far = max(max(largest(t.x), largest(t.y)) for t in traces[:-5])
    side = float(np.clip(1.1 * far, span, 50.0))
    return Chart(
        "fig9_track",
        "Horizontal track",
        "Position about the reference in the heading frame, on a 1 m grid; coloured: the scored "
        f"windows. {_largest(report, 'lateral', 'longitudinal')}",
        [Panel("forward, m", traces, y_range=(-side, side), x_range=(-side, side))],
        SECTION,
        "Fig. 9",
        x_label="to the right, m",
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
    return [_attitude(report, law, record, origin, scale) for law, record, origin in flights]


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
    """Scale of the enlargement: the largest scored error of the navigation record, deg."""
    scored = report.settings.scenario.scored(record.time_s)
    error = _attitude_error_deg(record, report.sources()[0])[scored]
    return max(0.05, 1.15 * largest(error))


def _attitude(
    report: Report, law: str, record: FlightRecord, origin: str, scale: tuple[float, float]
) -> Chart:
    paper, figure = ATTITUDE_DEG.get(law, ATTITUDE_DEG["hinf"])
    t = record.time_s
    panels = []
    for axis, name in enumerate(("roll", "pitch")):
        lines = [
            Trace(t, _attitude_error_deg(record, s)[:, axis], NAMES[s], _ROLES[s])
            for s in reversed(report.sources())
        ]
        bound = limits(t, paper, f"paper, {'PID' if law == 'pid' else 'H-infinity'}: ±{paper:g}°")
        note = beyond(t, [line.y for line in lines], scale[0], "°")
        reach = (-scale[0], scale[0])
        panels.append(Panel(f"{name} error, °", [*lines, bound], y_range=reach, note=note))
    source = report.sources()[0]
    error = _attitude_error_deg(record, source)
    close = [Trace(t, error[:, 0], "roll", "green"), Trace(t, error[:, 1], "pitch", "purple")]
    note = f"enlarged: {NAMES[source]}"
    panels.append(Panel("error, °", close, y_range=(-scale[1], scale[1]), note=note))
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
        SECTION,
        figure,
        spans=report.spans,
        bands=None if record is report.record else bands_of(record, report.settings),
    )
