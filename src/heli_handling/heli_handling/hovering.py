# SPDX-License-Identifier: Apache-2.0
"""Hover and vertical manoeuvre, found in a track."""

import numpy as np

from heli_handling.definitions import Manoeuvre
from heli_handling.errors import Cause, HandlingError
from heli_handling.found import (
    Found,
    Phase,
    Trace,
    first_still,
    hovers,
    not_found,
    offset,
    runs,
    turned,
    wrapped_deg,
)
from heli_handling.tracks import Array, Track

_APPROACH = 0.5  # of the slowest approach: below, an aircraft is not on its way
_DECELERATING = 0.95  # of the approach's speed: below, the deceleration has begun


def hover(track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float) -> Found:
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
            Cause.TOO_SHORT,
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
    return Found(
        tuple(phases),
        _held(track, part, target_ned_m, heading),
        numbers,
        conditions,
        np.asarray(target_ned_m)[None, :2],
        tuple(remarks),
    )


def vertical(track: Track, table: Manoeuvre, target_ned_m: Array | None, ground_m: float) -> Found:
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
    final = Trace(track.time_s[settled], height[settled, None] - first, ("final altitude",))
    heading = float(track.attitude_rad[begin, 2])
    traces = _held(track, slice(begin, end + 1), start, heading)
    traces["altitude"] = final
    return Found(
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


def _approach(track: Track, table: Manoeuvre) -> tuple[int, int, int] | None:
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


def _quietest(track: Track, table: Manoeuvre) -> int:
    """First index of the stretch of the hold's length whose largest speed is least."""
    speed = np.maximum(track.ground_mps, np.abs(track.vel_ned_mps[:, 2]))
    ends = np.searchsorted(track.time_s, track.time_s + table["hold_s"] - 1e-9)
    starts = np.flatnonzero(ends < track.time_s.size)
    # Starts a tenth of a second apart are enough, and quick.
    _, chosen = np.unique(np.floor(10.0 * track.time_s[starts]), return_index=True)
    return int(min(starts[chosen], key=lambda i: float(speed[i : ends[i] + 1].max())))


def _held(track: Track, part: slice, point_ned_m: Array, heading_rad: float) -> dict[str, Trace]:
    """Deviations of position, altitude and heading over a stretch."""
    time_s = track.time_s[part]
    off = turned(offset(track, point_ned_m, part), heading_rad)
    up = track.height_m[part, None] + point_ned_m[2]
    yaw = wrapped_deg(track.attitude_rad[part, 2:] - heading_rad)
    return {
        "position": Trace(time_s, off, ("longitudinal", "lateral")),
        "altitude": Trace(time_s, up, ("altitude",)),
        "heading": Trace(time_s, yaw, ("heading",)),
    }


def _lasting(track: Track, begin: int, for_s: float) -> slice:
    """Indices from one on for so long, or to the track's end."""
    end = int(np.searchsorted(track.time_s, track.time_s[begin] + for_s - 1e-9))
    return slice(begin, min(end, track.time_s.size - 1) + 1)


def _phase(track: Track, name: str, first: int, last: int) -> Phase:
    return Phase(name, float(track.time_s[first]), float(track.time_s[last]))


def _span(track: Track, first: int, last: int) -> float:
    return float(track.time_s[last] - track.time_s[first])
