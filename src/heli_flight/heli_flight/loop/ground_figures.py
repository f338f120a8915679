# SPDX-License-Identifier: Apache-2.0
"""Figures of a flight from the ground to the ground: how it left the skids and came back to them.

The goals are ours (the paper begins in the air). When the skids touch is found from ground truth
with the plant's own gear; what is measured on board stands in the modes.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.ground import GroundKernel, ground_contact
from heli_flight.loop.record import FlightRecord
from heli_math.rotations import euler_angles, quat_to_R_nb
from heli_math.rows import PLANT
from heli_math.ticks import TICKS_PER_S

_BRIEF_TICKS = TICKS_PER_S
"""Shorter stretches without contact are hops."""


@dataclass(frozen=True)
class GroundMetric:
    """One figure, and the largest one that is a success."""

    key: str
    label: str
    unit: str
    goal: float


_TAKEOFF_SKID = GroundMetric("takeoff_skid", "skid before lift-off", "m", 0.3)
_SPEED = GroundMetric("touch_down_speed", "speed of the touch-down", "m/s", 0.5)
_LANDING_SKID = GroundMetric("landing_skid", "skid after the touch-down", "m", 0.3)
_TILT = GroundMetric("touch_down_tilt", "largest tilt from the touch-down on", "deg", 15.0)
_HEIGHT = GroundMetric("takeoff_height", "height after the climb, off what was asked", "m", 0.4)
GROUND_METRICS = (_TAKEOFF_SKID, _HEIGHT, _SPEED, _LANDING_SKID, _TILT)


@dataclass(frozen=True)
class GroundFigure:
    """A figure of one flight.

    Attributes
    ----------
    metric : GroundMetric
    value : float or None
        In the metric's unit; None if it did not come to that.
    """

    metric: GroundMetric
    value: float | None

    @property
    def inside(self) -> bool:
        """True if it came to that and the goal is met."""
        return self.value is not None and self.value <= self.metric.goal

    @property
    def cell(self) -> str:
        """The figure as a table says it."""
        return "not reached" if self.value is None else f"{self.value:.2f} {self.metric.unit}"

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {**asdict(self.metric), "value": self.value, "inside": self.inside}


@dataclass(frozen=True)
class Gear:
    """What a scenario that begins on the ground is judged by: contact points, height asked, m."""

    ground: GroundKernel
    height_m: float


def touching(record: FlightRecord, ground: GroundKernel) -> NDArray[np.bool_]:
    """Mask (N,) of the samples of ground truth at which a skid touches."""
    touches, x = np.zeros(len(record), bool), np.zeros(PLANT.size)
    for i in range(len(record)):
        x[PLANT.pos], x[PLANT.quat] = record.truth_pos_ned_m[i], record.truth_q_nb[i]
        x[PLANT.vel] = quat_to_R_nb(record.truth_q_nb[i]).T @ record.truth_vel_ned_mps[i]
        touches[i] = ground_contact(x, ground)[1]
    return touches


def ground_figures(record: FlightRecord, gear: Gear) -> list[GroundFigure]:
    """Figures of a flight's longest stretch in the air and of what is before and behind it.

    Parameters
    ----------
    record : FlightRecord
        With ground truth.
    gear : Gear
    """
    flown = _longest(~touching(record, gear.ground))
    found: dict[GroundMetric, float] = {}
    if flown is not None:
        lift, touch = flown
        pos, tilt = record.truth_pos_ned_m, np.degrees(np.abs(euler_angles(record.truth_q_nb)))
        found[_TAKEOFF_SKID] = _farthest(pos[: lift + 1])
        height = _height(record)
        if height is not None:
            found[_HEIGHT] = abs(height - gear.height_m)
        if touch < len(record):
            found[_SPEED] = float(record.truth_vel_ned_mps[touch - 1, 2])
            found[_LANDING_SKID] = _farthest(pos[touch:])
            found[_TILT] = float(tilt[touch:, :2].max())
    metrics = [m for m in GROUND_METRICS if m != _HEIGHT or not _begins_by_hand(record)]
    return [GroundFigure(metric, found.get(metric)) for metric in metrics]


def _begins_by_hand(record: FlightRecord) -> bool:
    """A pilot has taken off, so no height was asked of a take-off."""
    if record.mode is None:
        return False
    began = record.mode[record.mode != "standing"]
    return bool(began.size and began[0] == "manual")


def _height(record: FlightRecord) -> float | None:
    """Height at which the climb was done, above the start, by the navigation record, m."""
    if record.mode is None:
        return None
    # Only a hover is open to a goal; a pilot who asks for one without end ends it within a tick.
    done = np.isin(record.mode, ("hover", "trajectory"))
    hovers = np.flatnonzero(done & np.isfinite(record.nav_pos_ned_m[:, 2]))
    began = np.flatnonzero((record.mode == "takeoff") & np.isfinite(record.nav_pos_ned_m[:, 2]))
    if not hovers.size or not began.size:
        return None
    down = record.nav_pos_ned_m[:, 2]
    return float(down[began[0]] - down[hovers[0]])


def _farthest(pos_ned_m: NDArray[np.float64]) -> float:
    """Largest horizontal distance of positions (N, 3) from the first one, m."""
    return float(np.hypot(*(pos_ned_m - pos_ned_m[0])[:, :2].T).max())


def _longest(mask: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and behind-last index of the longest run of True; None if it is brief."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    runs = edges.reshape(-1, 2)
    if not runs.size:
        return None
    first, behind = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return (int(first), int(behind)) if behind - first > _BRIEF_TICKS else None
