# SPDX-License-Identifier: Apache-2.0
"""Commands from a browser: judged, and turned into gusts and reference trajectories. No ROS."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.faults import LONGEST_S, NONE, WIND, flow_mapping
from heli_core.rotations import wrap_pi
from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_msgs_bridge.frames import enu_to_ned, ned_to_enu

# -------------------------------------------------------------------------------------------------
# Plan.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
MODES = ("hover", "attitude")

# What is kept of the way flown so far: longer than any window over which the outer loop averages.
_PAST_NS = 5 * NS_PER_S
_TURN_STEP_NS = NS_PER_S // 10
_SHORTEST_MOVE_S = 0.1
# Time for a gust's parameters to reach the plant before the gust begins.
_GUST_LEAD_S = 0.2
_MOST_GUSTS = 32


class CommandError(ValueError):
    """A command that is refused; the message is one sentence."""


@dataclass(frozen=True)
class CommandLimits:
    """What may be commanded; parameters `command_limits.*`, SI and deg."""

    altitude_min_m: float
    altitude_max_m: float
    distance_m: float
    speed_mps: float
    climb_mps: float
    turn_dps: float
    gust_mps: float
    gust_s: float

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "CommandLimits":
        """From the parameters of the node `live_view`."""
        return cls(**{name: values[f"command_limits.{name}"] for name in cls.__annotations__})


@dataclass(frozen=True)
class Gust:
    """A 1-cosine gust: peak m/s, direction it comes from (deg clockwise from north), length s."""

    amplitude_mps: float
    from_deg: float
    duration_s: float

    def amplitude_ned_mps(self) -> list[float]:
        """Peak velocity of the air (3,), NED."""
        towards = math.radians(self.from_deg + 180.0)
        return [
            self.amplitude_mps * math.cos(towards), self.amplitude_mps * math.sin(towards), 0.0
        ]  # fmt: skip


def _number(args: Mapping[str, Any], name: str, lower: float, upper: float, unit: str) -> float:
    value = args.get(name)
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    if value is None or not known or not lower <= value <= upper:
        raise CommandError(
            f"{name}: {value!r} is not allowed; allowed: {lower:g} to {upper:g} {unit}"
        )
    return float(value)


def judge_gust(args: Mapping[str, Any], limits: CommandLimits) -> Gust:
    """The gust that a browser asks for; raises CommandError."""
    return Gust(
        _number(args, "amplitude_mps", 0.0, limits.gust_mps, "m/s"),
        _number(args, "from_deg", -360.0, 360.0, "deg"),
        _number(args, "duration_s", 0.1, limits.gust_s, "s"),
    )


def with_gust(present: Mapping[str, Any], gust: Gust, now_s: float) -> tuple[dict[str, Any], float]:
    """The plant's gust parameters with one more gust.

    Parameters
    ----------
    present : mapping
        wind.gust.start_s, .duration_s, .amplitude_mps (flat) and .frame of the plant.
    gust : Gust
    now_s : float
        Flight time.

    Returns
    -------
    dict, float
        The new values, in axes NED, without the gusts that are over; flight time of the beginning.

    Raises
    ------
    CommandError
        A gust in body axes is still to come or blowing, or there are too many.
    """
    key = "wind.gust."
    starts, durations = list(present[key + "start_s"]), list(present[key + "duration_s"])
    amplitudes = np.reshape(present[key + "amplitude_mps"], (-1, 3)).tolist()
    coming = [
        (start, duration, amplitude)
        for start, duration, amplitude in zip(starts, durations, amplitudes, strict=True)
        if start + duration > now_s and any(amplitude)
    ]
    if coming and present[key + "frame"] == "body":
        end_s = max(start + duration for start, duration, _ in coming)
        raise CommandError(f"gusts in body axes blow until {end_s:.1f} s of this flight: try then")
    if len(coming) >= _MOST_GUSTS:
        raise CommandError(f"{len(coming)} gusts are under way: wait for their end")
    start_s = round(now_s + _GUST_LEAD_S, 2)
    coming.append((start_s, gust.duration_s, gust.amplitude_ned_mps()))
    values = {
        key + "start_s": [start for start, _, _ in coming],
        key + "duration_s": [duration for _, duration, _ in coming],
        key + "amplitude_mps": [v for _, _, amplitude in coming for v in amplitude],
        key + "frame": "ned",
    }
    return values, start_s


def judge_mode(args: Mapping[str, Any]) -> str:
    """The mode that a browser asks for; raises CommandError."""
    mode = args.get("mode")
    if mode not in MODES:
        raise CommandError(f"mode: {mode!r} is not allowed; allowed: {' or '.join(MODES)}")
    return str(mode)


def judge_reference(args: Mapping[str, Any], limits: CommandLimits, home_ned_m: Array) -> Array:
    """The point that a browser asks for, as a reference row.

    Parameters
    ----------
    args : mapping
        p: east, north, up, m; yaw_deg: heading clockwise from north.
    limits : CommandLimits
    home_ned_m : (3,) array
        Where the flight began.

    Returns
    -------
    (7,) array
        Position NED m, velocity 0, heading rad.

    Raises
    ------
    CommandError
        Not three finite numbers, too low, too high, too far.
    """
    p = args.get("p")
    if not isinstance(p, list) or len(p) != 3:
        raise CommandError(f"p: {p!r} is not allowed; allowed: east, north and up in m")
    named = dict(zip(("east", "north", "altitude"), p, strict=True))
    east, north = (_number(named, axis, -1e6, 1e6, "m") for axis in ("east", "north"))
    up = _number(named, "altitude", limits.altitude_min_m, limits.altitude_max_m, "m")
    heading = math.radians(_number(args, "yaw_deg", -360.0, 360.0, "deg"))
    row = np.zeros(REFERENCE.size)
    enu_to_ned(np.array([east, north, up]), row[REFERENCE.pos])
    away = float(np.hypot(*(row[REFERENCE.pos] - home_ned_m)[:2]))
    if away > limits.distance_m:
        raise CommandError(
            f"p: {away:.0f} m from where the flight began; allowed: at most {limits.distance_m:g} m"
        )
    row[REFERENCE.psi] = wrap_pi(heading)
    return row


def move(
    before: Trajectory | None, start: Array, target: Array, now_ns: int, limits: CommandLimits
) -> tuple[Trajectory, float]:
    """A trajectory from the present reference to a point, straight, at safe speeds.

    Parameters
    ----------
    before : Trajectory or None
        What is being followed: its last seconds stay in the new trajectory, so that the outer
        loop, which averages over the past, sees no jump. None: it begins at rest.
    start, target : (7,) array
        Rows `REFERENCE`.
    now_ns : int
        Stamp of the beginning.
    limits : CommandLimits

    Returns
    -------
    Trajectory, float
        The trajectory, stamped now, and its length, s.
    """
    step = target[REFERENCE.pos] - start[REFERENCE.pos]
    turn = float(wrap_pi(target[REFERENCE.psi] - start[REFERENCE.psi]))
    length_s = max(
        float(np.hypot(step[0], step[1])) / limits.speed_mps,
        abs(float(step[2])) / limits.climb_mps,
        abs(math.degrees(turn)) / limits.turn_dps,
        _SHORTEST_MOVE_S,
    )
    length_ns = round(length_s * NS_PER_S)
    times = {0, length_ns}
    if turn:
        times |= set(range(0, length_ns, _TURN_STEP_NS))
    rows = [] if before is None else _past(before, now_ns)
    for time_ns in sorted(times):
        share = time_ns / length_ns
        row = np.zeros(REFERENCE.size)
        row[REFERENCE.pos] = start[REFERENCE.pos] + share * step
        row[REFERENCE.vel] = step / length_s if share < 1.0 else 0.0
        row[REFERENCE.psi] = wrap_pi(start[REFERENCE.psi] + share * turn)
        rows.append((time_ns, row))
    return _points(now_ns, rows), length_s


def hold(point: Array, now_ns: int) -> Trajectory:
    """Stand at a reference row (7,) from now on."""
    row = point.copy()
    row[REFERENCE.vel] = 0.0
    return _points(now_ns, [(0, row)])


def _past(before: Trajectory, now_ns: int) -> list[tuple[int, Array]]:
    """Rows of the last seconds of a trajectory, at (negative) times from now."""
    first_ns = now_ns - _PAST_NS
    rows = [(-_PAST_NS, before.at(first_ns))]
    for time_ns, point in zip(before.times_ns.tolist(), before.points, strict=True):
        at_ns = before.start_ns + time_ns - now_ns
        if -_PAST_NS < at_ns < 0:
            rows.append((at_ns, point))
    return rows


def _points(start_ns: int, rows: list[tuple[int, Array]]) -> Trajectory:
    times = np.array([time_ns for time_ns, _ in rows], dtype=np.int64)
    return Trajectory(start_ns, times, np.array([row for _, row in rows]))


def in_words(row: Array) -> str:
    """A reference row for people."""
    p = np.empty(3)
    ned_to_enu(row[REFERENCE.pos], p)
    heading = math.degrees(row[REFERENCE.psi]) % 360.0
    return f"{p[0]:.1f} m east, {p[1]:.1f} m north, {p[2]:.1f} m high, heading {heading:.0f} deg"


# -------------------------------------------------------------------------------------------------
# Faults that a browser may send: what the page offers, a command made a text. No ROS.
#
# The plant judges a fault; here is only what keeps its text a mapping of words and numbers, and
# gusts within the limits of commands.
# -------------------------------------------------------------------------------------------------

_MOST_NUMBERS = 6
_WORD = re.compile(r"[a-z][a-z0-9_]{0,30}")


def _finite(value: Any, name: str, least: float, most: float) -> float:
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not known or not least <= value <= most:
        raise CommandError(f"{name}: {value!r} is not allowed; allowed: {least:g} to {most:g}")
    return float(value)


def judge_fault(args: Mapping[str, Any], limits: CommandLimits) -> str:
    """The plant's text of the fault that a browser asks for, beginning when the plant hears of it.

    Parameters
    ----------
    args : mapping
        what, kind; value: a list of numbers, may be absent; duration_s: absent, to the end.
    limits : CommandLimits

    Raises
    ------
    CommandError
    """
    what, kind = args.get("what"), args.get("kind")
    for name, word in (("what", what), ("kind", kind)):
        if not isinstance(word, str) or not _WORD.fullmatch(word):
            raise CommandError(f"{name}: {word!r} is not allowed; allowed: a word of the table")
    numbers = args.get("value") or []
    if not isinstance(numbers, list) or len(numbers) > _MOST_NUMBERS:
        raise CommandError(f"value: allowed: a list of at most {_MOST_NUMBERS} numbers")
    values = [_finite(v, "value", -1e6, 1e6) for v in numbers]
    pairs: dict[str, str | float | list[float]] = {"what": str(what), "kind": str(kind)}
    longest_s = LONGEST_S
    if what == WIND:
        longest_s = limits.gust_s
        if math.hypot(*values) > limits.gust_mps:
            raise CommandError(
                f"value: a gust of {math.hypot(*values):.3g} m/s is not allowed; allowed: at most "
                f"{limits.gust_mps:g} m/s"
            )
    if args.get("duration_s") is not None:
        pairs["duration_s"] = _finite(args["duration_s"], "duration_s", 0.01, longest_s)
    return flow_mapping(pairs | ({"value": values} if values else {}))


def with_fault(present: Iterable[str], text: str) -> list[str]:
    """The plant's parameter with one more fault."""
    return [*(one for one in present if one != NONE), text]


def listed(facts: Mapping[str, str]) -> list[str]:
    """The faults that act or are to come, of what the plant says in /diagnostics."""
    return facts["faults"].split("; ") if facts.get("faults") else []
