# SPDX-License-Identifier: Apache-2.0
"""Scores of a flight beside the paper's figures (section 4).

Each metric is given twice: as the paper measured it, from the on-board navigation record, and from
ground truth, which only a simulation has. The paper's numbers are from flight; ours are from
simulation.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scenario import Scenario
from heli_math.rotations import euler_angles

SOURCES = ("navigation", "truth")


@dataclass(frozen=True)
class Metric:
    """One number of the paper and where it comes from."""

    key: str
    label: str
    unit: str
    paper: float
    source: str


METRICS: Mapping[str, tuple[Metric, ...]] = {
    "hover": (
        Metric("v_z", "vertical speed - reference", "m/s", 0.18, "Fig. 5"),
        Metric("v_x", "forward speed", "m/s", 0.30, "Fig. 6"),
        Metric("v_y", "lateral speed", "m/s", 0.30, "Fig. 7"),
        Metric("altitude", "altitude error", "m", 0.40, "Fig. 8"),
        Metric("lateral", "lateral position error", "m", 1.02, "Fig. 9"),
        Metric("longitudinal", "longitudinal position error", "m", 0.65, "Fig. 9"),
    ),
    "attitude": (
        Metric("roll", "roll error", "deg", 1.7, "Fig. 4"),
        Metric("pitch", "pitch error", "deg", 1.7, "Fig. 4"),
    ),
}


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


def heading_frame(vector_ned: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """Rotate (N, 3) NED vectors into the frame of the headings psi (N,): forward, right, down."""
    c, s = np.cos(psi), np.sin(psi)
    forward = c * vector_ned[:, 0] + s * vector_ned[:, 1]
    right = -s * vector_ned[:, 0] + c * vector_ned[:, 1]
    return np.column_stack((forward, right, vector_ned[:, 2]))


def _errors(record: FlightRecord, source: str, kind: str) -> dict[str, np.ndarray]:
    """Error signals (N,) per metric key, in the metric's unit."""
    if source == "navigation":
        pos, vel, q = record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb
    else:
        pos, vel, q = record.truth_pos_ned_m, record.truth_vel_ned_mps, record.truth_q_nb
    euler = euler_angles(q)
    if kind == "attitude":
        error = np.degrees(euler[:, :2] - record.setpoint[:, :2])
        return {"roll": error[:, 0], "pitch": error[:, 1]}
    pos_h = heading_frame(pos - record.reference[:, :3], record.reference[:, 6])
    vel_h = heading_frame(vel - record.reference[:, 3:6], record.reference[:, 6])
    return {
        "v_z": vel_h[:, 2],
        "v_x": vel_h[:, 0],
        "v_y": vel_h[:, 1],
        "altitude": pos_h[:, 2],
        "lateral": pos_h[:, 1],
        "longitudinal": pos_h[:, 0],
    }


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
        errors = _errors(record, source, scenario.kind)
        for metric in METRICS[scenario.kind]:
            e = errors[metric.key][mask]
            scores.append(
                Score(metric, source, float(np.abs(e).max()), float(np.sqrt(np.mean(e * e))))
            )
    return scores
