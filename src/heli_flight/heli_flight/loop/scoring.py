# SPDX-License-Identifier: Apache-2.0
"""Scores of a flight beside the paper's figures (section 4).

Each metric is given twice: as the paper measured it, from the on-board navigation record, and from
ground truth, which only a simulation has. The paper's numbers are from flight; ours are from
simulation.
"""

from dataclasses import asdict, dataclass

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scenario import Scenario
from heli_math.paper_metrics import METRICS, Metric, attitude_errors, hover_errors

__all__ = ["METRICS", "SOURCES", "Metric", "Score", "errors", "score"]

SOURCES = ("navigation", "truth")


@dataclass(frozen=True)
class Score:
    """A metric of one flight: largest magnitude and rms over the scored stretches."""

    metric: Metric
    source: str
    max: float
    rms: float

    @property
    def inside(self) -> bool:
        """True if the largest magnitude is inside the paper's figure."""
        return bool(self.max <= self.metric.paper)

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {
            **asdict(self.metric),
            "measured_from": self.source,
            "max": self.max,
            "rms": self.rms,
            "inside": self.inside,
        }


def errors(record: FlightRecord, source: str, kind: str) -> dict[str, np.ndarray]:
    """Error signals (N,) per metric key, in the metric's unit.

    Parameters
    ----------
    record : FlightRecord
    source : str
        One of SOURCES.
    kind : str
        "hover" or "attitude".
    """
    if source == "navigation":
        pos, vel, q = record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb
    else:
        pos, vel, q = record.truth_pos_ned_m, record.truth_vel_ned_mps, record.truth_q_nb
    if kind == "attitude":
        return attitude_errors(q, record.setpoint)
    return hover_errors(pos, vel, record.reference)


def score(record: FlightRecord, scenario: Scenario) -> list[Score]:
    """Scores of a flight, every metric from navigation and from truth.

    Parameters
    ----------
    record : FlightRecord
    scenario : Scenario
        Gives the metrics and the scored stretches.

    Returns
    -------
    list of Score
        Empty if the flight ended before the first scored stretch.
    """
    mask = scenario.scored(record.time_s)
    if not mask.any():
        return []
    scores = []
    for source in SOURCES:
        found = errors(record, source, scenario.kind)
        for metric in METRICS[scenario.kind]:
            e = found[metric.key][mask]
            scores.append(
                Score(metric, source, float(np.abs(e).max()), float(np.sqrt(np.mean(e * e))))
            )
    return scores
