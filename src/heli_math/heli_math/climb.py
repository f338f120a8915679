# SPDX-License-Identifier: Apache-2.0
"""Figures of a flight's climb: overshoot, time to the new height, lag behind the command.

The paper climbs at 2.5 m/s between two hovers and gives no figure for it, so none of these has a
bound. They are taken from the height beside the reference **as commanded**, which starts and stops
at once.
"""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from heli_math.paper_metrics import BY_KEY
from heli_math.rows import REFERENCE

Array = NDArray[np.float64]

OVERSHOOT_S = 10.0
"""How long after the reference's arrival an overshoot is looked for; later it is a gust's work."""


@dataclass(frozen=True)
class ClimbMetric:
    """One figure of a climb."""

    key: str
    label: str
    unit: str


_OVERSHOOT = ClimbMetric("climb_overshoot", "overshoot", "m")
_TIME = ClimbMetric("climb_time", "time to the new height", "s")
_LAG = ClimbMetric("climb_lag", "lag at half the climb", "s")
CLIMB_METRICS = (_OVERSHOOT, _TIME, _LAG)


@dataclass(frozen=True)
class ClimbFigure:
    """A figure of one flight's climb.

    Attributes
    ----------
    metric : ClimbMetric
    source : str
        What it is measured from.
    value : float or None
        In the metric's unit; None if the height was not reached.
    """

    metric: ClimbMetric
    source: str
    value: float | None

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {**asdict(self.metric), "measured_from": self.source, "value": self.value}


@dataclass(frozen=True)
class Climb:
    """A commanded change of height; a descent is one, too.

    Attributes
    ----------
    start, arrival : int
        Rows at which the reference leaves the old height and stands at the new one.
    old_m, new_m : float
        Heights, m, up.
    """

    start: int
    arrival: int
    old_m: float
    new_m: float

    @property
    def way(self) -> float:
        """1.0 upwards, -1.0 downwards."""
        return float(np.sign(self.new_m - self.old_m))

    def duration_s(self, time_s: Array) -> float:
        """How long the reference takes, s."""
        return float(time_s[self.arrival] - time_s[self.start])


def commanded_climb(reference: Array) -> Climb | None:
    """The first commanded climb that ends within the record; None without one.

    Parameters
    ----------
    reference : (N, 7) ndarray
        As commanded, `rows.REFERENCE`.
    """
    speed = np.nan_to_num(reference[:, REFERENCE.down_vel])
    edges = np.flatnonzero(np.diff(speed != 0.0)) + 1
    if speed.size and speed[0] != 0.0:
        edges = np.r_[0, edges]
    if edges.size < 2:
        return None
    start, arrival = int(edges[0]), int(edges[1])
    old_m, new_m = (-float(reference[i, REFERENCE.pos][2]) for i in (start, arrival))
    return Climb(start, arrival, old_m, new_m) if new_m != old_m else None


def climb_figures(
    time_s: Array, height_m: Array, reference: Array, source: str
) -> list[ClimbFigure]:
    """Figures of the first climb, in the order of `CLIMB_METRICS`.

    Parameters
    ----------
    time_s : (N,) ndarray
        Flight time.
    height_m : (N,) ndarray
        Up, from the same ground as the reference.
    reference : (N, 7) ndarray
        As commanded.
    source : str
        What the height is of.

    Returns
    -------
    list of ClimbFigure
        - overshoot, m: largest height beyond the new one until `OVERSHOOT_S` after the reference
          has arrived;
        - time to the new height, s: from the start of the commanded climb until the height is first
          within the paper's altitude figure of the new one;
        - lag, s: how much later than the reference the aircraft passes half of the climb.

        Empty without a climb that ends within the record, or without heights during it.
    """
    climb = commanded_climb(reference)
    if climb is None or not np.isfinite(height_m[climb.start : climb.arrival]).all():
        return []
    beyond = climb.way * (height_m - climb.new_m)
    near = climb.way * (height_m - 0.5 * (climb.old_m + climb.new_m)) >= 0.0
    asked = -reference[:, REFERENCE.pos][:, 2]
    asked_near = climb.way * (asked - 0.5 * (climb.old_m + climb.new_m)) >= 0.0
    until = time_s <= time_s[climb.arrival] + OVERSHOOT_S
    until[: climb.start] = False
    reached = _first(np.abs(beyond) <= BY_KEY["altitude"].paper, climb.start)
    passed, asked_at = _first(near, climb.start), _first(asked_near, climb.start)
    lag_s = None
    if passed is not None and asked_at is not None:
        lag_s = float(time_s[passed] - time_s[asked_at])
    return [
        ClimbFigure(_OVERSHOOT, source, float(max(0.0, np.nanmax(beyond[until])))),
        ClimbFigure(
            _TIME, source, None if reached is None else float(time_s[reached] - time_s[climb.start])
        ),
        ClimbFigure(_LAG, source, lag_s),
    ]


def _first(mask: NDArray[np.bool_], start: int) -> int | None:
    """First row from start on that is set."""
    found = np.flatnonzero(mask[start:])
    return int(found[0]) + start if found.size else None
