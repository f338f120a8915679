# SPDX-License-Identifier: Apache-2.0
"""How an aircraft moved, sample by sample."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_handling.errors import Cause, HandlingError

Array = NDArray[np.float64]

_LEAST_SAMPLES = 10


@dataclass(frozen=True)
class Track:
    """Motion of an aircraft, at samples that need not be equally far apart.

    Attributes
    ----------
    time_s : (N,) array
        Increasing.
    pos_ned_m, vel_ned_mps : (N, 3) array
        Position and velocity over ground; north, east, down.
    attitude_rad : (N, 3) array
        Roll, pitch, yaw (3-2-1 Euler angles); the yaw angle without jumps.
    """

    time_s: Array
    pos_ned_m: Array
    vel_ned_mps: Array
    attitude_rad: Array

    @property
    def ground_mps(self) -> Array:
        """Speed over ground (N,)."""
        return np.asarray(np.hypot(self.vel_ned_mps[:, 0], self.vel_ned_mps[:, 1]))

    @property
    def height_m(self) -> Array:
        """Height above the frame's origin (N,)."""
        return -self.pos_ned_m[:, 2]

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    def between(self, start_s: float | None = None, end_s: float | None = None) -> "Track":
        """The samples of a stretch, its limits included.

        Raises
        ------
        HandlingError
            TOO_SHORT if fewer than ten are left.
        """
        low = -np.inf if start_s is None else start_s
        high = np.inf if end_s is None else end_s
        inside = (self.time_s >= low) & (self.time_s <= high)
        if np.count_nonzero(inside) < _LEAST_SAMPLES:
            raise HandlingError(
                Cause.TOO_SHORT,
                f"{np.count_nonzero(inside)} samples between {low:g} and {high:g} s, at least "
                f"{_LEAST_SAMPLES} are needed; the flight is from {self.time_s[0]:.2f} to "
                f"{self.time_s[-1]:.2f} s",
            )
        return Track(
            self.time_s[inside],
            self.pos_ned_m[inside],
            self.vel_ned_mps[inside],
            self.attitude_rad[inside],
        )


def track_of(time_s: Array, pos_ned_m: Array, vel_ned_mps: Array, attitude_rad: Array) -> Track:
    """A Track of samples in any order: sorted, repeated times left out, the yaw angle unwrapped.

    Raises
    ------
    HandlingError
        SHAPE, NOT_FINITE, or TOO_SHORT below ten samples.
    """
    time_s = np.asarray(time_s, dtype=np.float64)
    n = time_s.size
    rows = {"position": pos_ned_m, "velocity": vel_ned_mps, "attitude": attitude_rad}
    for name, values in rows.items():
        if np.shape(values) != (n, 3):
            raise HandlingError(
                Cause.SHAPE, f"{name} has shape {np.shape(values)}, expected ({n}, 3)"
            )
    times, first = np.unique(time_s, return_index=True)
    if times.size < _LEAST_SAMPLES:
        raise HandlingError(
            Cause.TOO_SHORT, f"{times.size} samples, at least {_LEAST_SAMPLES} are needed"
        )
    pos, vel, attitude = (np.array(v, dtype=np.float64)[first] for v in rows.values())
    for name, column in zip(["time", *rows], [times, pos, vel, attitude], strict=True):
        if not np.isfinite(column).all():
            raise HandlingError(Cause.NOT_FINITE, f"{name} holds a value that is not finite")
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return Track(times, pos, vel, attitude)
