# SPDX-License-Identifier: Apache-2.0
"""Scores of a flight beside the paper's figures (section 4); of a path, beside goals of ours; of a
mission or an aircraft of the user's, beside the user's own bounds (`score.bounds`), if any.

Each metric is given over two stretches of the flight: **whole**, from engagement to the end, the
climb included, against the reference as commanded; and **windows**, the scenario's
`score.windows_s`, hover alone. And from several records: the on-board state estimate, as the
paper measured; ground truth, which only a simulation has; and, of positions, ground truth without
the receiver's drift at engagement, which is what the control can be judged by. The paper's numbers
are from flight; ours are from simulation. A stretch is judged only where its record has it: how
much of it that is stands beside the figures (`heli_core.coverage`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from heli_core import metrics
from heli_core.coverage import Coverage, Span, coverage_of, least
from heli_core.metrics import (
    GOAL,
    METRICS,
    OWN,
    PATH,
    POSITIONS,
    SETTLED_S,
    ClimbFigure,
    PaperMetric,
    attitude_errors,
    climb_figures,
    hover_errors,
    path_errors,
    size,
)
from heli_core.ticks import OF_100_HZ, TICKS_PER_S, Rate, seconds
from heli_flight.record import FlightRecord, record_until
from heli_flight.scenario import GroundFigure, Scenario, ground_figures

__all__ = [
    "DECIDES",
    "METRICS",
    "SETTLED_S",
    "SOURCES",
    "SOURCE_NAMES",
    "STRETCHES",
    "TRUTH_LESS_DRIFT",
    "WHOLE",
    "WINDOWS",
    "Figures",
    "PaperMetric",
    "Score",
    "counted",
    "decides",
    "drift_at_engagement",
    "errors",
    "figures_of",
    "score",
    "sources_of",
    "spans",
]

NAVIGATION, TRUTH, TRUTH_LESS_DRIFT = "navigation", "truth", "truth_less_drift"
SOURCES = (NAVIGATION, TRUTH)
"""Records that every metric is measured from."""
SOURCE_NAMES = {
    NAVIGATION: "state estimate",
    TRUTH: "ground truth",
    TRUTH_LESS_DRIFT: "drift-corrected",
}

WHOLE, WINDOWS = "whole", "windows"
STRETCHES = {WHOLE: "whole flight", WINDOWS: "scored windows"}
"""Stretches of a flight that are scored, the first figure first."""

DECIDES = WINDOWS
"""The stretch whose scores decide the exit code. This line alone chooses it."""


@dataclass(frozen=True)
class Score:
    """A metric of one flight: largest magnitude and rms over a stretch."""

    metric: PaperMetric
    source: str
    max: float
    rms: float
    stretch: str = WINDOWS

    @property
    def inside(self) -> bool:
        """True if the largest magnitude is inside its bound, or there is none."""
        return bool(self.max <= self.metric.paper)

    @property
    def name(self) -> str:
        """Key and record, as result.json lists what is outside."""
        return f"{self.metric.key} ({self.source})"

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {
            **self.metric.as_dict(),
            "stretch": self.stretch,
            "measured_from": self.source,
            "max": self.max,
            "rms": self.rms,
            "inside": self.inside if self.metric.bounded else None,
        }


@dataclass(frozen=True)
class Figures:
    """All figures of one flight.

    Attributes
    ----------
    whole : sequence of Score
        From engagement to the end, the climb included.
    windows : sequence of Score
        Over the scenario's windows; empty if the flight ended before the first one.
    climb : sequence of ClimbFigure
        Empty without a climb.
    ground : sequence of GroundFigure
        Empty for a flight that begins in the air.
    coverage : mapping of (str, str) to Coverage
        What of a stretch is in a record, by both, of `SOURCES`; empty: nobody has looked.
    until_s : float, optional
        Flight time from which on it flew where it was told to (`told_elsewhere`): not scored.
    """

    whole: Sequence[Score] = ()
    windows: Sequence[Score] = ()
    climb: Sequence[ClimbFigure] = ()
    ground: Sequence[GroundFigure] = ()
    coverage: Mapping[tuple[str, str], Coverage] = field(default_factory=dict)
    until_s: float | None = None

    @property
    def all(self) -> list[Score]:
        """Scores of both stretches, in the order of `STRETCHES`."""
        return [score for stretch in STRETCHES for score in self.of(stretch)]

    def of(self, stretch: str) -> Sequence[Score]:
        """Scores over one of `STRETCHES`."""
        return {WHOLE: self.whole, WINDOWS: self.windows}[stretch]

    def covered(self, gps: str, stretch: str | None = None) -> Coverage:
        """The least that a record that decides has of a stretch.

        None: of the windows, which decide the exit code, or, where these are whole, of the flight
        around them: what is said of a flight is said of all of it.
        """
        if stretch is None:
            windows, whole = self.covered(gps, WINDOWS), self.covered(gps, WHOLE)
            return windows if whole.is_whole or not windows.is_whole else whole
        return least(
            coverage
            for (of, source), coverage in self.coverage.items()
            if of == stretch and decides(source, gps)
        )

    def find(self, stretch: str, key: str, source: str) -> Score | None:
        """One score, None if it was not taken."""
        matches = (s for s in self.of(stretch) if (s.metric.key, s.source) == (key, source))
        return next(matches, None)


def figures_of(metrics: Iterable[PaperMetric]) -> str:
    """Whose bounds some metrics have, in words; empty where nothing bounds them."""
    sources = {metric.source for metric in metrics if metric.bounded}
    if not sources:
        return ""
    if OWN in sources:
        return "your bounds"
    return "the goals" if sources == {GOAL} else "the paper's figures"


def decides(source: str, gps: str) -> bool:
    """Whether what is measured from a record counts for a verdict.

    The state estimate always counts, as in the paper. Ground truth counts where the receiver can
    know it: with rtk. A standalone receiver drifts by 1 m.
    """
    return source == NAVIGATION or (source == TRUTH and gps == "rtk")


def sources_of(gps: str) -> tuple[str, ...]:
    """Records to be shown side by side: with a standalone receiver truth less its drift, too."""
    return SOURCES if gps == "rtk" else (*SOURCES, TRUTH_LESS_DRIFT)


def errors(record: FlightRecord, source: str, kind: str) -> dict[str, np.ndarray]:
    """Error signals (N,) per metric key, in the metric's unit.

    Parameters
    ----------
    record : FlightRecord
    source : str
        One of SOURCE_NAMES; the last one has positions only, and none in an attitude test or in a
        flight that ends before `SETTLED_S`.
    kind : str
        "hover", "attitude" or "path".
    """
    pos, vel, q = record.truth_pos_ned_m, record.truth_vel_ned_mps, record.truth_q_nb
    if source == NAVIGATION:
        pos, vel, q = record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb
    if source == TRUTH_LESS_DRIFT:
        drift = drift_at_engagement(record)
        if kind == "attitude" or drift is None:
            return {}
        if kind == PATH:
            return {"position": path_errors(pos + drift, q, record.reference)["position"]}
        all_errors = hover_errors(pos + drift, vel, record.reference)
        return {key: all_errors[key] for key in POSITIONS}
    if kind == "attitude":
        return attitude_errors(q, record.setpoint)
    if kind == PATH:
        return path_errors(pos, q, record.reference)
    return hover_errors(pos, vel, record.reference)


def drift_at_engagement(record: FlightRecord) -> np.ndarray | None:
    """What the state estimate's position (3,), NED, is off by once it has settled, m.

    None if the flight ended before, or one of the two was not recorded.
    """
    since_s = record.time_s - record.time_s[:1]
    return metrics.drift_at_engagement(since_s, record.nav_pos_ned_m, record.truth_pos_ned_m)


def spans(scenario: Scenario, stretch: str) -> list[Span]:
    """Begin and end, s, of each piece of a stretch that is within the flight as it was ordered."""
    end_s = seconds(scenario.n_ticks)
    asked = [(scenario.begin_s, end_s)] if stretch == WHOLE else scenario.windows_s
    return [(float(a), min(float(b), end_s)) for a, b in asked if a < min(b, end_s)]


def counted(record: FlightRecord, scenario: Scenario, stretch: str) -> np.ndarray:
    """Mask (N,) of the samples of a stretch.

    The whole flight begins with engagement: the first sample that has navigation (where it was
    recorded at all), reference and, in an attitude test, the command.
    """
    if stretch == WINDOWS:
        return scenario.scored(record.time_s)
    needed = [record.nav_pos_ned_m, record.reference]
    if scenario.kind == "attitude":
        needed.append(record.setpoint)
    known = [np.isfinite(array).all(axis=1) for array in needed]
    ready = np.all([mask for mask in known if mask.any()] or [np.ones(len(record), bool)], axis=0)
    mask = np.zeros(len(record), bool)
    mask[int(ready.argmax()) if len(record) else 0 :] = True
    return mask


def _starting(record: FlightRecord, mask: np.ndarray) -> np.ndarray:
    """Mask (N,) of the samples before a whole flight's first: there, but nothing is known yet."""
    before = np.cumsum(mask) == 0
    return before & (record.time_s < SETTLED_S)


def score(record: FlightRecord, scenario: Scenario, rate: Rate = OF_100_HZ) -> Figures:
    """Figures of a flight, every metric from every record over both stretches.

    Parameters
    ----------
    record : FlightRecord
        A record of two that it does not hold is NaN; of it there are no scores.
    scenario : Scenario
        Gives the metrics with their bounds, and the windows.
    rate : Rate
        At which it was flown.

    Returns
    -------
    Figures
    """
    until_s = told_elsewhere(record, scenario)
    if until_s is not None:
        scenario = scenario.cut_to(scenario.begin_s, until_s)
        record = record_until(record, until_s)
    error_signals = {source: errors(record, source, scenario.kind) for source in SOURCE_NAMES}
    known = {
        source: np.all([np.isfinite(error) for error in signals.values()], axis=0)
        for source, signals in error_signals.items()
        if signals
    }
    coverage: dict[tuple[str, str], Coverage] = {}
    scores: dict[str, list[Score]] = {stretch: [] for stretch in STRETCHES}
    for stretch in STRETCHES:
        mask, asked = counted(record, scenario, stretch), spans(scenario, stretch)
        start = _starting(record, mask) if stretch == WHOLE else np.zeros(len(record), bool)
        for source, finite in known.items():
            held = coverage_of(record.time_s[finite | start], asked, rate.tick_s)
            if source in SOURCES:
                coverage[stretch, source] = held
            # Of a whole record every row counts: a number that is not finite is outside.
            rows = mask if held.is_whole else mask & finite
            scores[stretch] += [
                Score(metric, source, *size(error_signals[source][metric.key][rows]), stretch)
                for metric in scenario.metrics
                if metric.key in error_signals[source] and rows.any()
            ]
    climb = [
        figure
        for source, height_m in (_heights_m(record) if scenario.kind == "hover" else {}).items()
        for figure in climb_figures(record.time_s, height_m, record.reference, source)
    ]
    ground = [] if scenario.gear is None else ground_figures(record, scenario.gear)
    return Figures(scores[WHOLE], scores[WINDOWS], climb, ground, coverage, until_s)


def told_elsewhere(record: FlightRecord, scenario: Scenario) -> float | None:
    """Flight time, s, from which on a test's aircraft flew as a pilot had told it to.

    What it then flies is another mission than the scenario's, whose bounds say nothing of it. None
    if nobody told it anything; of a path, whose commands are a part of it; and where a failsafe
    led away.
    """
    if scenario.kind == PATH or record.commanded is None or not record.commanded.any():
        return None
    first = int(record.commanded.argmax())
    if record.failsafe is not None:
        about = record.failsafe[max(0, first - TICKS_PER_S) : first + TICKS_PER_S]
        if (about != "NONE").any():
            return None
    return float(record.time_s[first])


def _heights_m(record: FlightRecord) -> dict[str, np.ndarray]:
    """Heights (N,), up, by record."""
    heights = {
        NAVIGATION: -record.nav_pos_ned_m[:, 2],
        TRUTH: -record.truth_pos_ned_m[:, 2],
    }
    drift = drift_at_engagement(record)
    if drift is not None:
        heights[TRUTH_LESS_DRIFT] = heights[TRUTH] - drift[2]
    return heights
