# SPDX-License-Identifier: Apache-2.0
"""Reference trajectories: way points in time, position interpolated, velocity held in between."""

from dataclasses import dataclass

import numpy as np

from heli_math.jit import njit

# Indices of a way point (7,): position NED m, velocity NED m/s, heading rad.
N_REFERENCE = 7
# Indices of a shaped reference (10,): position, velocity, acceleration NED, heading.
N_SHAPED = 10
_SHAPING_SAMPLES = 32

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


@njit
def shaped_reference_at(time_ns, window_ns, times_ns, points, out):
    """Reference (10,) averaged over the window that ends at time_ns; written to out.

    A step of the reference's velocity becomes a ramp over the window, with its acceleration, and
    the aircraft arrives where the reference stops without overshoot: the average is exact there.

    Parameters
    ----------
    time_ns, window_ns : int
        Time after the trajectory's start and length of the window; 0 for no shaping.
    times_ns, points : ndarray
        The trajectory.
    out : (10,) ndarray
        Position NED m, velocity NED m/s, acceleration NED m/s2, heading rad.
    """
    now = np.empty(N_REFERENCE)
    reference_at(time_ns, times_ns, points, now)
    out[0:6] = now[0:6]
    out[6:9] = 0.0
    out[9] = now[6]
    if window_ns <= 0:
        return
    window_s = window_ns * 1e-9
    before = np.empty(N_REFERENCE)
    reference_at(time_ns - window_ns, times_ns, points, before)
    for j in range(3):
        out[3 + j] = (now[j] - before[j]) / window_s
        out[6 + j] = (now[3 + j] - before[3 + j]) / window_s
    # Mid-point rule: exact where the reference is linear, second order over a corner.
    sample = np.empty(N_REFERENCE)
    total = np.zeros(3)
    for i in range(_SHAPING_SAMPLES):
        back_ns = window_ns * (2 * i + 1) // (2 * _SHAPING_SAMPLES)
        reference_at(time_ns - back_ns, times_ns, points, sample)
        total += sample[0:3]
    for j in range(3):
        out[j] = total[j] / _SHAPING_SAMPLES
