# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories: way points in time, position interpolated, velocity held in between."""

from dataclasses import dataclass

import numpy as np

from heli_math.jit import njit
from heli_outer_pd.position_law import N_REFERENCE

MAX_POINTS = 4096


class TrajectoryError(ValueError):
    """The reference cannot be flown; the message says which point and why."""


@dataclass(frozen=True)
class ReferenceTrajectory:
    """Way points over time; before the first and after the last one the aircraft hovers there.

    Attributes
    ----------
    times_ns : (N,) int64 ndarray
        Strictly increasing, ns after the trajectory's own start.
    points : (N, 7) float64 ndarray
        Position NED m, velocity NED m/s from this point to the next, heading rad.
    """

    times_ns: np.ndarray
    points: np.ndarray

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.times_ns, dtype=np.int64)
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        if times.ndim != 1 or points.shape != (times.size, N_REFERENCE):
            raise TrajectoryError(
                f"reference: {times.size} times and points of shape {points.shape}; "
                f"expected (N,) and (N, {N_REFERENCE})"
            )
        if not 1 <= times.size <= MAX_POINTS:
            raise TrajectoryError(f"reference: {times.size} points; allowed are 1 to {MAX_POINTS}")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if bad.size:
            raise TrajectoryError(f"reference: point {bad[0]} is not finite: {points[bad[0]]}")
        late = np.flatnonzero(np.diff(times) <= 0)
        if late.size:
            raise TrajectoryError(f"reference: time of point {late[0] + 1} does not increase")
        object.__setattr__(self, "times_ns", times)
        object.__setattr__(self, "points", points)

    @classmethod
    def hover(cls, pos_ned_m: np.ndarray, psi_rad: float) -> "ReferenceTrajectory":
        """Stand at pos_ned_m (3,) with heading psi_rad."""
        return cls(np.zeros(1, np.int64), np.r_[pos_ned_m, 0.0, 0.0, 0.0, psi_rad][None])

    @classmethod
    def hover_climb_hover(
        cls, pos_ned_m: np.ndarray, psi_rad: float, start_s: float, end_s: float, climb_mps: float
    ) -> "ReferenceTrajectory":
        """The paper's hover test: hover, climb from start_s to end_s, hover higher up."""
        low = np.asarray(pos_ned_m, float)
        high = low + np.array([0.0, 0.0, -climb_mps * (end_s - start_s)])
        times = np.round(np.array([0.0, start_s, end_s]) * 1e9).astype(np.int64)
        points = np.zeros((3, N_REFERENCE))
        points[:2, :3], points[2, :3] = low, high
        points[1, 5] = -climb_mps
        points[:, 6] = psi_rad
        return cls(times, points)


@njit
def reference_at(time_ns, times_ns, points, out):
    """Reference (7,) at time_ns after the trajectory's start; written to out.

    Position is interpolated linearly between way points, velocity and heading are those of the
    way point last passed.
    """
    i = np.searchsorted(times_ns, time_ns, side="right") - 1
    if i < 0:
        out[:] = points[0]
        out[3:6] = 0.0
        return
    out[:] = points[i]
    if i == times_ns.size - 1:
        out[3:6] = 0.0
        return
    fraction = (time_ns - times_ns[i]) / (times_ns[i + 1] - times_ns[i])
    for j in range(3):
        out[j] = points[i, j] + fraction * (points[i + 1, j] - points[i, j])
