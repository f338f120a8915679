# SPDX-License-Identifier: Apache-2.0
"""Depart/abort, lateral reposition, slalom and pirouette, found in a track."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from heli_analysis.handling.definitions import Manoeuvre
from heli_core.errors import HandlingCause, HandlingError

# -------------------------------------------------------------------------------------------------
# How an aircraft moved, sample by sample.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_LEAST_SAMPLES = 10


@dataclass(frozen=True)
class MotionTrack:
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

    def between(self, start_s: float | None = None, end_s: float | None = None) -> "MotionTrack":
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
                HandlingCause.TOO_SHORT,
                f"{np.count_nonzero(inside)} samples between {low:g} and {high:g} s, at least "
                f"{_LEAST_SAMPLES} are needed; the flight is from {self.time_s[0]:.2f} to "
                f"{self.time_s[-1]:.2f} s",
            )
        return MotionTrack(
            self.time_s[inside],
            self.pos_ned_m[inside],
            self.vel_ned_mps[inside],
            self.attitude_rad[inside],
        )


def track_of(
    time_s: Array, pos_ned_m: Array, vel_ned_mps: Array, attitude_rad: Array
) -> MotionTrack:
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
                HandlingCause.SHAPE, f"{name} has shape {np.shape(values)}, expected ({n}, 3)"
            )
    times, first = np.unique(time_s, return_index=True)
    if times.size < _LEAST_SAMPLES:
        raise HandlingError(
            HandlingCause.TOO_SHORT, f"{times.size} samples, at least {_LEAST_SAMPLES} are needed"
        )
    pos, vel, attitude = (np.array(v, dtype=np.float64)[first] for v in rows.values())
    for name, column in zip(["time", *rows], [times, pos, vel, attitude], strict=True):
        if not np.isfinite(column).all():
            raise HandlingError(
                HandlingCause.NOT_FINITE, f"{name} holds a value that is not finite"
            )
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return MotionTrack(times, pos, vel, attitude)


# -------------------------------------------------------------------------------------------------
# What was found of a manoeuvre in a flight, and how its phases are found.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FlightStretch:
    """A named stretch of the flight."""

    name: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class BoundedSignal:
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
class FlownManoeuvre:
    """A manoeuvre in a flight.

    Attributes
    ----------
    phases : tuple of FlightStretch
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

    phases: tuple[FlightStretch, ...]
    traces: dict[str, BoundedSignal]
    numbers: dict[str, tuple[float, float]]
    conditions: dict[str, float]
    marks_ned_m: Array
    remarks: tuple[str, ...] = ()


def not_found(table: Manoeuvre, sentence: str) -> HandlingError:
    """The refusal of a flight in which the manoeuvre is not."""
    return HandlingError(HandlingCause.NO_PHASES, f"{table.name}: {sentence}")


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each stretch in which the mask is true."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    first, behind = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(a), int(b) - 1) for a, b in zip(first, behind, strict=True)]


def stills(
    track: MotionTrack, table: Manoeuvre, for_s: float | None = None
) -> list[tuple[int, int]]:
    """Stretches (first and last index) in which the aircraft stands still for so long."""
    for_s = table["still_for_s"] if for_s is None else for_s
    speed = np.maximum(track.ground_mps, np.abs(track.vel_ned_mps[:, 2]))
    return [
        (a, b)
        for a, b in runs(speed < table["still_mps"])
        if track.time_s[b] - track.time_s[a] >= for_s
    ]


def first_still(
    track: MotionTrack, table: Manoeuvre, after: int, for_s: float | None = None
) -> int | None:
    """First index from `after` on at which the aircraft stands still; None if it never does."""
    for_s = table["still_for_s"] if for_s is None else for_s
    for a, b in stills(track, table, for_s):
        start = max(a, after)
        if start <= b and track.time_s[b] - track.time_s[start] >= for_s:
            return start
    return None


def hovers(track: MotionTrack, table: Manoeuvre) -> list[tuple[int, int]]:
    """As `stills`, but at least one.

    Raises
    ------
    HandlingError
        NO_PHASES.
    """
    still_stretches = stills(track, table)
    if not still_stretches:
        raise not_found(
            table,
            f"no hover to begin from: the speed is never below {table['still_mps']:.2f} m/s "
            f"for {table['still_for_s']:.2f} s",
        )
    return still_stretches


def departure(track: MotionTrack, table: Manoeuvre, reach_m: float) -> int:
    """Last still index before the aircraft is farther than `reach_m` from its first hover.

    Raises
    ------
    HandlingError
        NO_PHASES: it never hovers, or never leaves.
    """
    hover_stretches = hovers(track, table)
    away = np.hypot(*offset(track, track.pos_ned_m[hover_stretches[0][0]], slice(None)).T)
    gone = np.flatnonzero(away[hover_stretches[0][0] :] > reach_m)
    if not gone.size:
        raise not_found(table, f"the aircraft never leaves its first hover by {reach_m:.1f} m")
    left = hover_stretches[0][0] + int(gone[0])
    return min(left, max(b for a, b in hover_stretches if a <= left))


def offset(track: MotionTrack, point_ned_m: Array, part: slice) -> Array:
    """Horizontal position (N, 2) relative to a point, m."""
    return np.asarray(track.pos_ned_m[part, :2] - np.asarray(point_ned_m)[:2])


def turned(horizontal_ned: Array, heading_rad: float) -> Array:
    """Horizontal vectors (N, 2) north, east as ahead and to the right of a heading."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.asarray(horizontal_ned @ np.array([[c, -s], [s, c]]))


def wrapped_deg(angle_rad: Array) -> Array:
    """Angles in degrees, within half a turn."""
    return np.asarray(np.degrees((np.asarray(angle_rad) + np.pi) % (2.0 * np.pi) - np.pi))


# -------------------------------------------------------------------------------------------------
# Courses.
# -------------------------------------------------------------------------------------------------

_ROUND = 1.5 * np.pi  # swept angle from which a return to the start is the circle's end
_CIRCLE = 64  # points of a circle that is drawn
_TURNS = 4  # of a slalom: twice to each side


def depart_abort(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Acceleration along the nose and deceleration to the end of the course."""
    return _dash(track, table, target_ned_m, ground_m, sideways=False)


def lateral_reposition(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Acceleration to the side and deceleration to the end of the course."""
    return _dash(track, table, target_ned_m, ground_m, sideways=True)


@dataclass(frozen=True)
class _Course:
    """A straight course as it was flown: first and last index, and the track in its axes."""

    begin: int
    end: int
    length_m: float
    ahead: Array
    along_m: Array
    across_m: Array


def _course(track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None) -> _Course:
    """From the end of the first hover to the first hover within the band at the course's end.

    The line runs to the target; without one towards the next hover, as long as the table says.

    Raises
    ------
    HandlingError
        NO_PHASES.
    """
    length, band = table["course_m"], table["end_m"]
    begin = departure(track, table, band)
    way = offset(track, track.pos_ned_m[begin], slice(None))
    away = np.hypot(way[:, 0], way[:, 1])
    there = np.flatnonzero(away[begin:] >= length - band)
    if not there.size:
        raise not_found(
            table,
            f"the flight goes {away[begin:].max():.1f} m from its first hover, the course is "
            f"{length:.1f} m",
        )
    stop = first_still(track, table, begin + int(there[0]))
    if stop is None:
        raise not_found(table, "no hover at the end of the course")
    towards = way[stop]
    if target_ned_m is not None:
        towards = np.asarray(target_ned_m)[:2] - track.pos_ned_m[begin, :2]
        length = float(np.hypot(*towards))
    ahead = towards / np.hypot(*towards)
    along, across = way @ ahead, way @ np.array([-ahead[1], ahead[0]])
    end = _captured(track, table, stop, np.abs(along - length) <= band)
    if end is None:
        raise not_found(
            table,
            f"the hover at the end is {along[stop]:.1f} m down the course of {length:.1f} m, "
            f"{band:.1f} m off at most are allowed",
        )
    return _Course(begin, end, length, ahead, along, across)


def _captured(
    track: MotionTrack, table: Manoeuvre, after: int, near: NDArray[np.bool_]
) -> int | None:
    """First index of a hover within the band; one that creeps into it counts from there on."""
    for a, b in stills(track, table):
        for first, _ in runs(near[a : b + 1]):
            start = max(a + first, after)
            if (
                start <= b
                and near[start]
                and (track.time_s[b] - track.time_s[start] >= table["still_for_s"])
            ):
                return start
    return None


def _dash(
    track: MotionTrack,
    table: Manoeuvre,
    target_ned_m: Array | None,
    ground_m: float,
    sideways: bool,
) -> FlownManoeuvre:
    """From hover to hover along a line, the nose along it or square to it."""
    course = _course(track, table, target_ned_m)
    part = slice(course.begin, course.end + 1)
    peak = course.begin + int(np.argmax(track.ground_mps[part]))
    off = track.attitude_rad[part, 2] - np.arctan2(course.ahead[1], course.ahead[0])
    if sideways:
        off = off - np.copysign(0.5 * np.pi, np.sin(off[0]))
    time_s = track.time_s[part]
    height = track.height_m[part, None]
    traces = {
        "track": BoundedSignal(time_s, course.across_m[part, None], ("off the course",)),
        "heading": BoundedSignal(time_s, wrapped_deg(off)[:, None], ("heading",)),
    }
    conditions = {"peak": float(track.ground_mps[peak])}
    if sideways:
        traces["altitude"] = BoundedSignal(time_s, height - height[0], ("altitude",))
    else:
        traces["height"] = BoundedSignal(time_s, height - ground_m, ("height",))
        conditions["overshoot"] = float(course.along_m[part].max() - course.length_m)
    start = track.pos_ned_m[course.begin, :2]
    return FlownManoeuvre(
        (
            FlightStretch("acceleration", float(time_s[0]), float(track.time_s[peak])),
            FlightStretch("deceleration", float(track.time_s[peak]), float(time_s[-1])),
        ),
        traces,
        {"time": (float(time_s[-1] - time_s[0]), float(time_s[-1]))},
        conditions,
        np.array([start, start + course.length_m * course.ahead]),
    )


def slalom(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Turns to alternate sides of the line from the track's first sample to its last.

    Raises
    ------
    HandlingError
        NO_PHASES with fewer than two turns to each side.
    """
    last = track.pos_ned_m[-1] if target_ned_m is None else np.asarray(target_ned_m)
    towards = last[:2] - track.pos_ned_m[0, :2]
    length = float(np.hypot(*towards))
    if length < table["gate_m"]:
        raise not_found(table, f"the flight ends {length:.1f} m from where it begins")
    ahead = towards / length
    way = offset(track, track.pos_ned_m[0], slice(None))
    along, across = way @ ahead, way @ np.array([-ahead[1], ahead[0]])
    turns = _turns(across, 0.5 * table["gate_m"])
    if len(turns) < _TURNS:
        raise not_found(
            table,
            f"{len(turns)} turns to alternate sides, more than {0.5 * table['gate_m']:.1f} m off "
            f"the line from first to last sample, {_TURNS} are due",
        )
    # From the line to the line; where it is not met there, as long as a turn takes.
    first, last_turn, half = along[turns[0]], along[turns[-1]], 0.5 * table["apart_m"]
    near = np.abs(across) <= 0.1 * table["gate_m"]
    begins = near | (along < first - half)
    ends = near | (along > last_turn + half)
    before, behind = np.flatnonzero(begins[: turns[0]]), np.flatnonzero(ends[turns[-1] :])
    begin = int(before[-1]) if before.size else 0
    end = turns[-1] + int(behind[0]) if behind.size else track.time_s.size - 1
    part = slice(begin, end + 1)
    size = np.abs(across[turns])
    small, large = int(np.argmin(size)), int(np.argmax(size))
    return FlownManoeuvre(
        tuple(
            FlightStretch(f"turn {n}", float(track.time_s[a]), float(track.time_s[b]))
            for n, (a, b) in enumerate(_between(begin, turns, end), 1)
        ),
        {
            "speed": BoundedSignal(
                track.time_s[part], track.ground_mps[part, None], ("ground speed",)
            ),
            "height": BoundedSignal(
                track.time_s[part], track.height_m[part, None] - ground_m, ("height",)
            ),
        },
        {
            "clearance": (float(size[small]), float(track.time_s[turns[small]])),
            "error": (
                max(float(size[large]) - table["gate_m"], 0.0),
                float(track.time_s[turns[large]]),
            ),
        },
        {"interval": float(np.diff(along[turns]).min())},
        np.array([track.pos_ned_m[0, :2], last[:2]]),
    )


def _turns(across: Array, least: float) -> list[int]:
    """Indices of the farthest points to alternate sides."""
    peaks, _ = find_peaks(np.abs(across), height=least, prominence=least)
    turns: list[int] = []
    for i in peaks.tolist():
        if turns and across[turns[-1]] * across[i] > 0.0:
            turns[-1] = max(turns[-1], i, key=lambda k: abs(across[k]))
        else:
            turns.append(i)
    return turns


def _between(begin: int, turns: list[int], end: int) -> list[tuple[int, int]]:
    """One stretch a turn: from half-way to the turn before to half-way to the next."""
    half = [(a + b) // 2 for a, b in zip(turns, turns[1:], strict=False)]
    return list(zip([begin, *half], [*half, end], strict=True))


def pirouette(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Once around a circle with the nose to its centre, then a hover over the start.

    Without a target the centre is that of the circle of the manoeuvre's radius that fits best.

    Raises
    ------
    HandlingError
        NO_PHASES.
    """
    radius, begin = table["radius_m"], departure(track, table, table["arrival_m"])
    start = track.pos_ned_m[begin, :2]
    if target_ned_m is None:
        centre = _centre(track, table, begin)
    else:
        centre = np.asarray(target_ned_m)[:2]
    out = offset(track, centre, slice(None))
    angle = np.unwrap(np.arctan2(out[begin:, 1], out[begin:, 0]))
    swept = np.abs(angle - angle[0])
    home = np.hypot(*offset(track, start, slice(begin, None)).T)
    back = np.flatnonzero((swept >= _ROUND) & (home <= table["arrival_m"]))
    if not back.size:
        raise not_found(
            table,
            f"the flight sweeps {np.degrees(swept.max()):.0f} deg of a circle of {radius:.1f} m "
            "and is not round",
        )
    arrival = begin + int(back[0])
    capture = first_still(track, table, arrival, table["hold_s"])
    if capture is None:
        raise not_found(table, f"no hover of {table['hold_s']:.1f} s after the return")
    held = int(np.searchsorted(track.time_s, track.time_s[capture] + table["hold_s"] - 1e-9))
    around, whole = slice(begin, arrival + 1), slice(begin, held + 1)
    bearing = np.arctan2(-out[around, 1], -out[around, 0])
    height = track.height_m[whole, None]
    turn = np.linspace(0.0, 2.0 * np.pi, _CIRCLE)
    moments = [float(track.time_s[i]) for i in (begin, arrival, capture, held)]
    return FlownManoeuvre(
        tuple(
            FlightStretch(name, a, b)
            for name, a, b in zip(("circle", "capture", "hold"), moments, moments[1:], strict=False)
        ),
        {
            "radius": BoundedSignal(
                track.time_s[around],
                np.hypot(out[around, 0], out[around, 1])[:, None] - radius,
                ("off the circle",),
            ),
            "altitude": BoundedSignal(track.time_s[whole], height - height[0], ("altitude",)),
            "heading": BoundedSignal(
                track.time_s[around],
                wrapped_deg(track.attitude_rad[around, 2] - bearing)[:, None],
                ("off the centre",),
            ),
        },
        {
            "time": (moments[1] - moments[0], moments[1]),
            "capture": (moments[2] - moments[1], moments[2]),
        },
        {},
        centre + radius * np.column_stack([np.cos(turn), np.sin(turn)]),
    )


def _centre(track: MotionTrack, table: Manoeuvre, begin: int) -> Array:
    """Centre (2,), NED, of the circle of the table's radius that fits the track to its next hover.

    The search begins where the nose points.
    """
    radius, yaw = table["radius_m"], track.attitude_rad[begin, 2]
    behind = first_still(track, table, begin + 1) or track.time_s.size - 1
    ring = track.pos_ned_m[begin : behind + 1, :2]
    nose = np.array([np.cos(yaw), np.sin(yaw)])
    fit = least_squares(
        lambda c: np.hypot(ring[:, 0] - c[0], ring[:, 1] - c[1]) - radius, ring[0] + radius * nose
    )
    return np.asarray(fit.x)


# -------------------------------------------------------------------------------------------------
# Hover and vertical manoeuvre, found in a track.
# -------------------------------------------------------------------------------------------------

_APPROACH = 0.5  # of the slowest approach: below, an aircraft is not on its way
_DECELERATING = 0.95  # of the approach's speed: below, the deceleration has begun


def hover(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Translation, deceleration, and the hold after it.

    Without a translation at more than half the approach's speed only a hold is scored: the stretch
    of its length whose largest speed is least. Heading is kept if it stays that of the translation;
    without one, and without a target, deviations are from the hold's medians.

    Raises
    ------
    HandlingError
        TOO_SHORT.
    """
    hold_s = table["hold_s"]
    if track.duration_s < hold_s:
        raise HandlingError(
            HandlingCause.TOO_SHORT,
            f"hover: the flight lasts {track.duration_s:.1f} s, the hold alone {hold_s:.1f} s",
        )
    phases, numbers, conditions, remarks = [], {}, {}, []
    approach = _approach(track, table)
    if approach is None:
        begin = _quietest(track, table)
        heading = float(np.median(track.attitude_rad[_lasting(track, begin, hold_s), 2]))
        remarks.append(
            "no approach before a hold was flown: only the quietest stretch of the hold's length "
            "is scored"
        )
    else:
        first, slowing, begin = approach
        numbers["time"] = (_span(track, slowing, begin), float(track.time_s[begin]))
        way = track.vel_ned_mps[first : slowing + 1, :2].mean(axis=0)
        heading = float(np.median(track.attitude_rad[first : slowing + 1, 2]))
        off = abs(wrapped_deg(np.arctan2(way[1], way[0]) - heading))
        conditions["approach"] = float(np.median(track.ground_mps[first : slowing + 1]))
        conditions["oblique"] = float(min(off, 180.0 - off))
        phases += [_phase(track, "translation", first, slowing)]
        phases += [_phase(track, "deceleration", slowing, begin)]
    part = _lasting(track, begin, hold_s)
    phases.append(_phase(track, "hold", begin, part.stop - 1))
    if target_ned_m is None:
        target_ned_m = np.median(track.pos_ned_m[part], axis=0)
        remarks.append(
            "no target was given: position and altitude are measured from their medians in the hold"
        )
    return FlownManoeuvre(
        tuple(phases),
        _held(track, part, target_ned_m, heading),
        numbers,
        conditions,
        np.asarray(target_ned_m)[None, :2],
        tuple(remarks),
    )


def vertical(
    track: MotionTrack, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> FlownManoeuvre:
    """Ascent, time at the top, descent to the first altitude.

    Raises
    ------
    HandlingError
        NO_PHASES.
    """
    height = track.height_m
    hovering = hovers(track, table)[0][0]
    first = float(height[hovering])
    start = np.array([*track.pos_ned_m[hovering, :2], -first])
    start = start if target_ned_m is None else np.asarray(target_ned_m)
    top, ascent = int(np.argmax(height)), table["ascent_m"]
    gained = float(height[top]) - first
    condition = table.conditions[0]
    if gained < 0.8 * ascent:
        raise not_found(
            table, f"the flight rises {gained:.2f} m above its first hover, {ascent:.2f} m are due"
        )
    below = np.flatnonzero(height[:top] <= first + table["begun_m"])
    begin = int(below[-1]) if below.size else 0
    band = table.bounds("altitude").adequate
    back = np.flatnonzero(height[top:] <= first + band)
    end = first_still(track, table, top + int(back[0])) if back.size else None
    if end is None:
        raise not_found(
            table, f"no hover within {band:.2f} m of the first altitude after the ascent"
        )
    quiet = (np.abs(track.vel_ned_mps[:, 2]) < table["still_mps"]) & (height > first + 0.5 * ascent)
    stays = [(a, b) for a, b in runs(quiet) if begin < a and b < end]
    up, leave = max(stays, key=lambda stay: stay[1] - stay[0], default=(top, top))
    settled = _lasting(track, end, table["still_for_s"])
    final = BoundedSignal(track.time_s[settled], height[settled, None] - first, ("final altitude",))
    heading = float(track.attitude_rad[begin, 2])
    traces = _held(track, slice(begin, end + 1), start, heading)
    traces["altitude"] = final
    return FlownManoeuvre(
        (
            _phase(track, "ascent", begin, up),
            _phase(track, "top", up, leave),
            _phase(track, "descent", leave, end),
        ),
        traces,
        {"time": (_span(track, begin, end), float(track.time_s[end]))},
        {condition.name: gained, "top": _span(track, up, leave)},
        start[None, :2],
    )


def _approach(track: MotionTrack, table: Manoeuvre) -> tuple[int, int, int] | None:
    """Begin of the last translation that ends in a hold, of its deceleration, and of the hold."""
    speed, last_s = track.ground_mps, track.time_s[-1] - table["hold_s"] + 1e-9
    for first, last in reversed(runs(speed >= _APPROACH * table["approach_mps"])):
        begin = first_still(track, table, last)
        if begin is None or track.time_s[begin] > last_s:
            continue
        part = speed[first : last + 1]
        cruise = float(np.median(part[part >= 0.9 * part.max()]))
        slowing = first + int(np.flatnonzero(part >= _DECELERATING * cruise)[-1])
        return first, slowing, begin
    return None


def _quietest(track: MotionTrack, table: Manoeuvre) -> int:
    """First index of the stretch of the hold's length whose largest speed is least."""
    speed = np.maximum(track.ground_mps, np.abs(track.vel_ned_mps[:, 2]))
    ends = np.searchsorted(track.time_s, track.time_s + table["hold_s"] - 1e-9)
    starts = np.flatnonzero(ends < track.time_s.size)
    # Starts a tenth of a second apart are enough, and quick.
    _, chosen = np.unique(np.floor(10.0 * track.time_s[starts]), return_index=True)
    return int(min(starts[chosen], key=lambda i: float(speed[i : ends[i] + 1].max())))


def _held(
    track: MotionTrack, part: slice, point_ned_m: Array, heading_rad: float
) -> dict[str, BoundedSignal]:
    """Deviations of position, altitude and heading over a stretch."""
    time_s = track.time_s[part]
    off = turned(offset(track, point_ned_m, part), heading_rad)
    up = track.height_m[part, None] + point_ned_m[2]
    yaw = wrapped_deg(track.attitude_rad[part, 2:] - heading_rad)
    return {
        "position": BoundedSignal(time_s, off, ("longitudinal", "lateral")),
        "altitude": BoundedSignal(time_s, up, ("altitude",)),
        "heading": BoundedSignal(time_s, yaw, ("heading",)),
    }


def _lasting(track: MotionTrack, begin: int, for_s: float) -> slice:
    """Indices from one on for so long, or to the track's end."""
    end = int(np.searchsorted(track.time_s, track.time_s[begin] + for_s - 1e-9))
    return slice(begin, min(end, track.time_s.size - 1) + 1)


def _phase(track: MotionTrack, name: str, first: int, last: int) -> FlightStretch:
    return FlightStretch(name, float(track.time_s[first]), float(track.time_s[last]))


def _span(track: MotionTrack, first: int, last: int) -> float:
    return float(track.time_s[last] - track.time_s[first])
