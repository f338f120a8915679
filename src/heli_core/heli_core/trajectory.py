# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories: way points in time, position interpolated, velocity held in between."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import copy, fill, njit
from heli_core.rows import REFERENCE

MAX_POINTS = 4096


class TrajectoryError(ValueError):
    """The reference cannot be flown; the message says which point and why."""


@dataclass(frozen=True)
class Trajectory:
    """Way points over time; before the first and after the last one the aircraft hovers there.

    Attributes
    ----------
    start_ns : int
        Stamp from which `times_ns` count.
    times_ns : (N,) int64 ndarray
        Strictly increasing, ns.
    points : (N, 7) float64 ndarray
        A `heli_core.rows.REFERENCE` each: position NED m, velocity NED m/s from this point to the
        next, heading rad (0 is north).

    Raises
    ------
    TrajectoryError
        Shapes, numbers or times that cannot be flown.
    """

    start_ns: int
    times_ns: NDArray[np.int64]
    points: NDArray[np.float64]

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.times_ns, dtype=np.int64)
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if times.ndim != 1 or points.shape != (times.size, REFERENCE.size):
            raise TrajectoryError(
                f"{times.size} times and points of shape {points.shape}; "
                f"expected (N,) and (N, {REFERENCE.size})"
            )
        if not 1 <= times.size <= MAX_POINTS:
            raise TrajectoryError(f"{times.size} points; allowed are 1 to {MAX_POINTS}")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if bad.size:
            raise TrajectoryError(f"point {bad[0]} is not finite: {points[bad[0]].tolist()}")
        late = np.flatnonzero(np.diff(times) <= 0)
        if late.size:
            raise TrajectoryError(f"time of point {late[0] + 1} does not increase")
        object.__setattr__(self, "times_ns", times)
        object.__setattr__(self, "points", points)

    @classmethod
    def hover(cls, pos_ned_m: NDArray[np.float64], psi_rad: float) -> "Trajectory":
        """Stand at pos_ned_m (3,) with heading psi_rad."""
        return cls(0, np.zeros(1, np.int64), np.r_[pos_ned_m, 0.0, 0.0, 0.0, psi_rad][None])

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """The reference (7,) at a stamp, ns."""
        row = np.empty(REFERENCE.size)
        reference_at(stamp_ns - self.start_ns, self.times_ns, self.points, row)
        return row


@njit
def _last_passed(time_ns, times_ns):
    """Index of the last way point that is not later than time_ns; -1: none."""
    before, after = -1, times_ns.size
    while after - before > 1:
        middle = (before + after) // 2
        if times_ns[middle] <= time_ns:
            before = middle
        else:
            after = middle
    return before


@njit
def reference_at(time_ns, times_ns, points, out):
    """Reference (7,) at time_ns after the trajectory's start; written to out.

    Position is interpolated linearly between way points, velocity and heading are those of the
    way point last passed.
    """
    i = _last_passed(time_ns, times_ns)
    row = points[max(i, 0)]
    copy(out, row)
    if i < 0 or i == times_ns.size - 1:
        fill(out[REFERENCE.vel], 0.0)
        return
    fraction = (time_ns - times_ns[i]) / (times_ns[i + 1] - times_ns[i])
    for j in range(3):
        out[j] = points[i, j] + fraction * (points[i + 1, j] - points[i, j])
