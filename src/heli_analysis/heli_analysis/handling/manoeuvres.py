# SPDX-License-Identifier: Apache-2.0
"""Depart/abort, lateral reposition, slalom and pirouette, found in a track."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import find_peaks

from heli_handling.definitions import Manoeuvre
from heli_handling.found import (
    Found,
    Phase,
    Trace,
    departure,
    first_still,
    not_found,
    offset,
    runs,
    stills,
    wrapped_deg,
)
from heli_handling.tracks import Array, Track

_ROUND = 1.5 * np.pi  # swept angle from which a return to the start is the circle's end
_CIRCLE = 64  # points of a circle that is drawn
_TURNS = 4  # of a slalom: twice to each side


def depart_abort(
    track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> Found:
    """Acceleration along the nose and deceleration to the end of the course."""
    return _dash(track, table, target_ned_m, ground_m, sideways=False)


def lateral_reposition(
    track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float
) -> Found:
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


def _course(track: Track, table: Manoeuvre, target_ned_m: Array | None) -> _Course:
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


def _captured(track: Track, table: Manoeuvre, after: int, near: NDArray[np.bool_]) -> int | None:
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
    track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float, sideways: bool
) -> Found:
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
        "track": Trace(time_s, course.across_m[part, None], ("off the course",)),
        "heading": Trace(time_s, wrapped_deg(off)[:, None], ("heading",)),
    }
    conditions = {"peak": float(track.ground_mps[peak])}
    if sideways:
        traces["altitude"] = Trace(time_s, height - height[0], ("altitude",))
    else:
        traces["height"] = Trace(time_s, height - ground_m, ("height",))
        conditions["overshoot"] = float(course.along_m[part].max() - course.length_m)
    start = track.pos_ned_m[course.begin, :2]
    return Found(
        (
            Phase("acceleration", float(time_s[0]), float(track.time_s[peak])),
            Phase("deceleration", float(track.time_s[peak]), float(time_s[-1])),
        ),
        traces,
        {"time": (float(time_s[-1] - time_s[0]), float(time_s[-1]))},
        conditions,
        np.array([start, start + course.length_m * course.ahead]),
    )


def slalom(track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float) -> Found:
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
    return Found(
        tuple(
            Phase(f"turn {n}", float(track.time_s[a]), float(track.time_s[b]))
            for n, (a, b) in enumerate(_between(begin, turns, end), 1)
        ),
        {
            "speed": Trace(track.time_s[part], track.ground_mps[part, None], ("ground speed",)),
            "height": Trace(track.time_s[part], track.height_m[part, None] - ground_m, ("height",)),
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
    found, _ = find_peaks(np.abs(across), height=least, prominence=least)
    turns: list[int] = []
    for i in found.tolist():
        if turns and across[turns[-1]] * across[i] > 0.0:
            turns[-1] = max(turns[-1], i, key=lambda k: abs(across[k]))
        else:
            turns.append(i)
    return turns


def _between(begin: int, turns: list[int], end: int) -> list[tuple[int, int]]:
    """One stretch a turn: from half-way to the turn before to half-way to the next."""
    half = [(a + b) // 2 for a, b in zip(turns, turns[1:], strict=False)]
    return list(zip([begin, *half], [*half, end], strict=True))


def pirouette(track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float) -> Found:
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
    return Found(
        tuple(
            Phase(name, a, b)
            for name, a, b in zip(("circle", "capture", "hold"), moments, moments[1:], strict=False)
        ),
        {
            "radius": Trace(
                track.time_s[around],
                np.hypot(out[around, 0], out[around, 1])[:, None] - radius,
                ("off the circle",),
            ),
            "altitude": Trace(track.time_s[whole], height - height[0], ("altitude",)),
            "heading": Trace(
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


def _centre(track: Track, table: Manoeuvre, begin: int) -> Array:
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
