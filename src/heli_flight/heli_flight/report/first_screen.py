# SPDX-License-Identifier: Apache-2.0
"""What a flight's page shows first: a sentence, four numbers, track and altitude, its data.

With a standalone receiver the numbers are of ground truth less the receiver's drift at engagement:
what the control can be judged by. Else of ground truth, or of the navigation record where there is
no ground truth.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from heli_core.metrics import PATH, PaperMetric
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import REFERENCE
from heli_flight.flight_file import NAME
from heli_flight.record import NAME as RECORD
from heli_flight.report.data import Chart, Panel, Report, Trace, largest
from heli_flight.result import RESULT, Verdict, sentence
from heli_flight.scoring import (
    DECIDES,
    NAVIGATION,
    SOURCE_NAMES,
    TRUTH,
    TRUTH_LESS_DRIFT,
    WHOLE,
    drift_at_engagement,
    errors,
)

SECTION = "first"
"""Of the two charts."""
_HEIGHT_PX = 300.0
_MARKS = {
    Verdict.INSIDE: ("✓", "good"),
    Verdict.MEASURED: ("–", ""),
    Verdict.NOT_SCORED: ("–", ""),
}
_NO_NUMBER = "–"
_SOURCES = {
    **SOURCE_NAMES,
    TRUTH_LESS_DRIFT: "ground truth, corrected for the GPS offset at t = 5 s",
}


@dataclass(frozen=True)
class Number:
    """One of the four.

    Attributes
    ----------
    label, value : str
        The value with its unit.
    note : str
        What it is beside: its bound, or what else there is to know.
    """

    label: str
    value: str
    note: str


def verdict_of(report: Report) -> tuple[str, str, str]:
    """Mark, class and sentence of a flight: what decides the exit code, and nothing else."""
    mark, tone = _MARKS.get(report.result.verdict(report.settings.gps), ("✗", "bad"))
    return mark, tone, f"{sentence(report.result, report.settings)}."


def source_of(report: Report) -> str:
    """The record that the numbers are measured from, of `SOURCE_NAMES`."""
    if not report.has_truth:
        return NAVIGATION
    is_drifting = report.settings.gps == "standalone" and report.kind != "attitude"
    return TRUTH_LESS_DRIFT if is_drifting and drift_at_engagement(report.record) is not None \
        else TRUTH  # fmt: skip


def told_of(report: Report) -> str:
    """What the numbers are measured from, and when: a sentence."""
    stretch = "scored windows" if _mask(report)[1] == DECIDES else "whole flight"
    return f"Largest in the {stretch}, by {_SOURCES[source_of(report)]}."


def numbers_of(report: Report) -> list[Number]:
    """Height, position, tilt and wind; of an attitude test roll and pitch error, tilt, wind."""
    if report.kind == "attitude":
        first = [_of_metric(report, metric) for metric in report.settings.scenario.metrics]
    else:
        first = [_height(report), _position(report)]
    return [*first, _tilt(report), _wind(report)]


def _mask(report: Report) -> tuple[np.ndarray, str]:
    """Rows of the scored windows; of the whole flight where there are none."""
    inside = report.counted(DECIDES)
    return (inside, DECIDES) if inside.any() else (report.counted(WHOLE), WHOLE)


def _most(report: Report, values: np.ndarray) -> float | None:
    """Largest magnitude over what is counted; None if nothing of it is known."""
    counted = np.abs(values[_mask(report)[0]])
    counted = counted[np.isfinite(counted)]
    return float(counted.max()) if counted.size else None


def _text(value: float | None, unit: str, digits: int = 2) -> str:
    if value is None:
        return _NO_NUMBER
    return f"{value:.{digits}f}{'' if unit == '°' else ' '}{unit}"


def _metric(report: Report, key: str) -> PaperMetric | None:
    return next((m for m in report.settings.scenario.metrics if m.key == key), None)


def _allowed(metric: PaperMetric | None) -> str:
    """Whose bound it is beside."""
    if metric is None or not metric.bounded:
        return "no bound"
    return f"{metric.bound_name}: {metric.bound_text}"


def _of_metric(report: Report, metric: PaperMetric) -> Number:
    error = errors(report.record, source_of(report), report.kind)[metric.key]
    label = metric.label[:1].upper() + metric.label[1:]
    return Number(label, _text(_most(report, error), "°"), _allowed(metric))


def _height(report: Report) -> Number:
    most = _most(report, errors(report.record, source_of(report), "hover")["altitude"])
    note = _allowed(_metric(report, "altitude")) if report.kind != PATH else "beside the path"
    return Number("Height error", _text(most, "m"), note)


def _position(report: Report) -> Number:
    if report.kind == PATH:
        away = errors(report.record, source_of(report), PATH)["position"]
        return Number("Off the path", _text(_most(report, away), "m"),
                      _allowed(_metric(report, "position")))  # fmt: skip
    error = errors(report.record, source_of(report), "hover")
    parts = []
    for key, word in (("lateral", "sideways"), ("longitudinal", "ahead")):
        metric, most = _metric(report, key), _most(report, error[key])
        of = f" of {metric.bound_text}" if metric is not None and metric.bounded else ""
        parts.append(f"{word} {_text(most, '' if of else 'm').strip()}{of}")
    away = np.hypot(error["lateral"], error["longitudinal"])
    return Number("Position error", _text(_most(report, away), "m"), ", ".join(parts))


def _tilt(report: Report) -> Number:
    record = report.record
    q_nb = record.truth_q_nb if report.has_truth else record.nav_q_nb
    upright = np.array([quat_to_R_nb(q)[2, 2] if np.isfinite(q).all() else np.nan for q in q_nb])
    tilt = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
    return Number("Tilt", _text(_most(report, tilt), "°", 1), "from level")


def _wind(report: Report) -> Number:
    speed = np.linalg.norm(report.record.wind_ned_mps, axis=1)
    known = speed[_mask(report)[0]]
    known = known[np.isfinite(known)]
    mean = f"mean {known.mean():.1f} m/s" if known.size else "not recorded"
    return Number("Wind", _text(_most(report, speed), "m/s", 1), mean)


# -------------------------------------------------------------------------------------------------
# Track and altitude.
# -------------------------------------------------------------------------------------------------


def charts_of(report: Report) -> list[Chart]:
    """Altitude over time and the track, small, of the record that the numbers are of."""
    return [_altitude(report), _track(report)] if len(report.record) else []


def _places_ned_m(report: Report) -> tuple[np.ndarray, np.ndarray]:
    """Where it was and where it should have been, the latter without the receiver's drift."""
    record, source = report.record, source_of(report)
    asked = record.reference[:, REFERENCE.pos]
    if source == NAVIGATION:
        return record.nav_pos_ned_m, asked
    drift = drift_at_engagement(record) if source == TRUTH_LESS_DRIFT else None
    return record.truth_pos_ned_m, asked - (0.0 if drift is None else drift)


def _role(report: Report) -> str:
    return "nav" if source_of(report) == NAVIGATION else "truth"


def _altitude(report: Report) -> Chart:
    time_s, (place, asked) = report.record.time_s, _places_ned_m(report)
    flown = Trace(time_s, -place[:, 2], "flown", _role(report), width=1.6)
    wanted = Trace(time_s, -asked[:, 2], "reference", "reference", "dash", width=1.2)
    return Chart(
        "first_altitude",
        "Altitude",
        "",
        [Panel("altitude", "m", [flown, wanted])],
        SECTION,
        spans=report.spans,
        height_px=_HEIGHT_PX,
    )


def _track(report: Report) -> Chart:
    """From above: about the reference where that hovers, else over the ground."""
    if report.kind == "hover":
        return _about_the_reference(report)
    place, asked = _places_ned_m(report)
    traces = [
        Trace(place[:, 1], place[:, 0], "flown", _role(report), width=1.6),
        Trace(asked[:, 1], asked[:, 0], "reference", "reference", "dash", width=1.2),
    ]
    middle = 0.5 * (np.nanmin(place[:, :2], axis=0) + np.nanmax(place[:, :2], axis=0))
    side = max(1.0, 1.15 * largest(np.concatenate([place, asked])[:, :2] - middle))
    (north, east) = ((float(m) - side, float(m) + side) for m in middle)
    return _from_above("Track over the ground", ("north", "east"), traces, east, north, side)


def _about_the_reference(report: Report) -> Chart:
    error = errors(report.record, source_of(report), "hover")
    scored = _mask(report)[0]
    right, ahead = error["lateral"], error["longitudinal"]
    traces = [
        Trace(right, ahead, "whole flight", "muted", width=0.8),
        Trace(np.where(scored, right, np.nan), np.where(scored, ahead, np.nan), "scored",
              _role(report), width=1.6),
    ]  # fmt: skip
    far = max(largest(right[scored]), largest(ahead[scored]))
    lateral, longitudinal = _metric(report, "lateral"), _metric(report, "longitudinal")
    if lateral and longitudinal and lateral.bounded and longitudinal.bounded:
        x, y = lateral.paper, longitudinal.paper
        corners = np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
        name = f"{lateral.bound_name}: ±{x:g} m, ±{y:g} m"
        traces.append(Trace(corners[0] * x, corners[1] * y, name, "bound", "dash", width=1.6))
        far = max(far, x, y)
    traces.append(Trace(np.zeros(1), np.zeros(1), "reference", "reference", "points"))
    side = float(np.clip(1.15 * far, 0.5, 50.0))
    axes, reach = ("forward", "to the right"), (-side, side)
    return _from_above("Track about the reference", axes, traces, reach, reach, side)


def _from_above(
    title: str,
    axes: tuple[str, str],
    traces: list[Trace],
    x_range: tuple[float, float],
    y_range: tuple[float, float],
    side: float,
) -> Chart:
    return Chart(
        "first_track",
        title,
        "",
        [Panel(axes[0], "m", traces, y_range=y_range, x_range=x_range)],
        SECTION,
        x_quantity=axes[1],
        x_unit="m",
        time=False,
        square=side <= 10.0,
        is_to_scale=True,
        height_px=_HEIGHT_PX,
    )


# -------------------------------------------------------------------------------------------------
# Where the data is.
# -------------------------------------------------------------------------------------------------

_DATA = {
    "bag": "bag (rosbag2)",
    RECORD: "record (numpy)",
    NAME: "parameters",
    RESULT: "result",
}


def data_beside(folder: Path) -> dict[str, str]:
    """Files of a flight that lie beside its page: what to link to, and its name."""
    return {name: words for name, words in _DATA.items() if (folder / name).exists()}
