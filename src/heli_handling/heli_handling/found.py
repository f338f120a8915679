# SPDX-License-Identifier: Apache-2.0
"""What was found of a manoeuvre in a flight, and how its phases are found."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_handling.definitions import Manoeuvre
from heli_handling.errors import Cause, HandlingError
from heli_handling.tracks import Array, Track


@dataclass(frozen=True)
class Phase:
    """A named stretch of the flight."""

    name: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Trace:
    """A bounded signal over the stretch in which it is bounded.

    Attributes
    ----------
    time_s : (N,) array
    values : (N, K) array
        Deviations, SI; angles in degrees.
    labels : tuple of str
        Of the K columns.
    """

    time_s: Array
    values: Array
    labels: tuple[str, ...]

    def worst(self, at_least: bool) -> tuple[float, float]:
        """Largest magnitude (smallest value, for a bound from below) and when, s."""
        size = self.values.min(axis=1) if at_least else np.abs(self.values).max(axis=1)
        at = int(np.argmin(size) if at_least else np.argmax(size))
        return float(size[at]), float(self.time_s[at])


@dataclass(frozen=True)
class Found:
    """A manoeuvre in a flight.

    Attributes
    ----------
    phases : tuple of Phase
    traces : dict
        Criterion to its Trace.
    numbers : dict
        Criterion to (value, when it was so, s), for those that are one number.
    conditions : dict
        Condition to its value.
    marks_ned_m : (M, 2) array
        Line on the ground that was to be flown over, or the one point.
    remarks : tuple of str
    """

    phases: tuple[Phase, ...]
    traces: dict[str, Trace]
    numbers: dict[str, tuple[float, float]]
    conditions: dict[str, float]
    marks_ned_m: Array
    remarks: tuple[str, ...] = ()


def not_found(table: Manoeuvre, sentence: str) -> HandlingError:
    """The refusal of a flight in which the manoeuvre is not."""
    return HandlingError(Cause.NO_PHASES, f"{table.name}: {sentence}")


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each stretch in which the mask is true."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    first, behind = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b) - 1) for a, b in zip(first, behind, strict=True)]


def stills(track: Track, table: Manoeuvre, for_s: float | None = None) -> list[tuple[int, int]]:
    """Stretches (first and last index) in which the aircraft stands still for so long."""
    for_s = table["still_for_s"] if for_s is None else for_s
    speed = np.maximum(track.ground_mps, np.abs(track.vel_ned_mps[:, 2]))
    return [
        (a, b)
        for a, b in runs(speed < table["still_mps"])
        if track.time_s[b] - track.time_s[a] >= for_s
    ]


def first_still(
    track: Track, table: Manoeuvre, after: int, for_s: float | None = None
) -> int | None:
    """First index from `after` on at which the aircraft stands still; None if it never does."""
    for_s = table["still_for_s"] if for_s is None else for_s
    for a, b in stills(track, table, for_s):
        start = max(a, after)
        if start <= b and track.time_s[b] - track.time_s[start] >= for_s:
            return start
    return None


def hovers(track: Track, table: Manoeuvre) -> list[tuple[int, int]]:
    """As `stills`, but at least one.

    Raises
    ------
    HandlingError
        NO_PHASES.
    """
    found = stills(track, table)
    if not found:
        raise not_found(
            table,
            f"no hover to begin from: the speed is never below {table['still_mps']:.2f} m/s "
            f"for {table['still_for_s']:.2f} s",
        )
    return found


def departure(track: Track, table: Manoeuvre, reach_m: float) -> int:
    """Last still index before the aircraft is farther than `reach_m` from its first hover.

    Raises
    ------
    HandlingError
        NO_PHASES: it never hovers, or never leaves.
    """
    found = hovers(track, table)
    away = np.hypot(*offset(track, track.pos_ned_m[found[0][0]], slice(None)).T)
    gone = np.flatnonzero(away[found[0][0] :] > reach_m)
    if not gone.size:
        raise not_found(table, f"the aircraft never leaves its first hover by {reach_m:.1f} m")
    left = found[0][0] + int(gone[0])
    return min(left, max(b for a, b in found if a <= left))


def offset(track: Track, point_ned_m: Array, part: slice) -> Array:
    """Horizontal position (N, 2) relative to a point, m."""
    return np.asarray(track.pos_ned_m[part, :2] - np.asarray(point_ned_m)[:2])


def turned(horizontal_ned: Array, heading_rad: float) -> Array:
    """Horizontal vectors (N, 2) north, east as ahead and to the right of a heading."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.asarray(horizontal_ned @ np.array([[c, -s], [s, c]]))


def wrapped_deg(angle_rad: Array) -> Array:
    """Angles in degrees, within half a turn."""
    return np.asarray(np.degrees((np.asarray(angle_rad) + np.pi) % (2.0 * np.pi) - np.pi))
