# SPDX-License-Identifier: Apache-2.0
"""Scores of a flight beside the paper's figures (section 4); of a path, beside goals of ours.

Each metric is given over two stretches of the flight: **whole**, from engagement to the end, the
climb included, against the reference as commanded; and **windows**, the scenario's
`score.windows_s`, hover alone. And from several records: the on-board navigation record, as the
paper measured; ground truth, which only a simulation has; and, of positions, ground truth without
the receiver's drift at engagement, which is what the control can be judged by. The paper's numbers
are from flight; ours are from simulation.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from heli_core import metrics
from heli_core.metrics import (
    METRICS,
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
from heli_flight.record import FlightRecord
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
]

NAVIGATION, TRUTH, TRUTH_LESS_DRIFT = "navigation", "truth", "truth_less_drift"
SOURCES = (NAVIGATION, TRUTH)
"""Records that every metric is measured from."""
SOURCE_NAMES = {
    NAVIGATION: "navigation record",
    TRUTH: "ground truth",
    TRUTH_LESS_DRIFT: "truth less drift at engagement",
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
        """True if the largest magnitude is inside the paper's figure, or the goal."""
        return bool(self.max <= self.metric.paper)

    @property
    def name(self) -> str:
        """Key and record, as result.json lists what is outside."""
        return f"{self.metric.key} ({self.source})"

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {
            **asdict(self.metric),
            "stretch": self.stretch,
            "measured_from": self.source,
            "max": self.max,
            "rms": self.rms,
            "inside": self.inside,
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
    """

    whole: Sequence[Score] = ()
    windows: Sequence[Score] = ()
    climb: Sequence[ClimbFigure] = ()
    ground: Sequence[GroundFigure] = ()

    @property
    def all(self) -> list[Score]:
        """Scores of both stretches, in the order of `STRETCHES`."""
        return [score for stretch in STRETCHES for score in self.of(stretch)]

    def of(self, stretch: str) -> Sequence[Score]:
        """Scores over one of `STRETCHES`."""
        return {WHOLE: self.whole, WINDOWS: self.windows}[stretch]

    def finite(self) -> "Figures":
        """Without what could not be measured: a record that is not in a bag is NaN."""
        whole, windows = (
            [score for score in self.of(stretch) if math.isfinite(score.max)]
            for stretch in (WHOLE, WINDOWS)
        )
        return Figures(whole, windows, self.climb, self.ground)

    def find(self, stretch: str, key: str, source: str) -> Score | None:
        """One score, None if it was not taken."""
        matches = (s for s in self.of(stretch) if (s.metric.key, s.source) == (key, source))
        return next(matches, None)


def figures_of(kind: str) -> str:
    """Whose figures a kind of flight is held against, in words."""
    return "the goals" if kind == PATH else "the paper's figures"


def decides(source: str, gps: str) -> bool:
    """Whether what is measured from a record counts for a verdict.

    The navigation record always counts, as in the paper. Ground truth counts where the receiver can
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
    """What the navigation record's position (3,), NED, is off by once it has settled, m.

    None if the flight ended before, or one of the two was not recorded.
    """
    since_s = record.time_s - record.time_s[:1]
    return metrics.drift_at_engagement(since_s, record.nav_pos_ned_m, record.truth_pos_ned_m)


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


def score(record: FlightRecord, scenario: Scenario) -> Figures:
    """Figures of a flight, every metric from every record over both stretches.

    Parameters
    ----------
    record : FlightRecord
    scenario : Scenario
        Gives the metrics and the windows.

    Returns
    -------
    Figures
    """
    error_signals = {source: errors(record, source, scenario.kind) for source in SOURCE_NAMES}
    scores: dict[str, list[Score]] = {}
    for stretch in STRETCHES:
        mask = counted(record, scenario, stretch)
        scores[stretch] = [
            Score(metric, source, *size(error_signals[source][metric.key][mask]), stretch)
            for source in SOURCE_NAMES
            for metric in METRICS[scenario.kind]
            if metric.key in error_signals[source] and mask.any()
        ]
    climb = [
        figure
        for source, height_m in (_heights_m(record) if scenario.kind == "hover" else {}).items()
        for figure in climb_figures(record.time_s, height_m, record.reference, source)
    ]
    ground = [] if scenario.gear is None else ground_figures(record, scenario.gear)
    return Figures(scores[WHOLE], scores[WINDOWS], climb, ground)


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
