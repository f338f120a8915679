# SPDX-License-Identifier: Apache-2.0
"""Commands at given times of a flight: what a scenario does instead of a pilot. No ROS."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import STICKS
from heli_math.ticks import NS_PER_S
from heli_modes.table import Command
from heli_parameters.parameters import Parameter, ParameterError

Array = NDArray[np.float64]

_WIDTHS = {"sticks": STICKS.size, "attitude_deg": 3}
_COMMANDS = tuple(command for command in Command if command != Command.FOLLOW)


def _times(name: str, what: str) -> Parameter:
    return Parameter(f"commands.{name}", "double[]", f"{what}, rising; a negative one is never",
                     "s", lower=-1.0, upper=86400.0, read_only=True)  # fmt: skip


SCRIPT_ROWS: tuple[Parameter, ...] = (
    _times("at_s", "Flight times of commands"),
    Parameter("commands.what", "string[]", "What is commanded at each of them",
              choices=_COMMANDS, read_only=True),
    Parameter("commands.goto_ned_m", "double[]", "Where each goto goes, NED", "m",
              shape=(None, 3), upper=1e5, read_only=True),
    Parameter("commands.velocity_ned_mps", "double[]", "Velocity of each velocity, NED", "m/s",
              shape=(None, 3), upper=1e3, read_only=True),
    _times("sticks_at_s", "Flight times from which the sticks are held"),
    Parameter("commands.sticks", "double[]", "Roll, pitch, yaw and climb at each of them",
              shape=(None, STICKS.size), lower=-1.0, upper=1.0, read_only=True),
    _times("attitude_at_s", "Flight times from which an attitude is commanded"),
    Parameter("commands.attitude_deg", "double[]", "Roll, pitch and heading at each of them, nose "
              "up and to the right positive", "deg", shape=(None, 3), lower=-360.0, upper=360.0,
              read_only=True),
    Parameter("commands.climb_mps", "double[]", "Climb at each of them", "m/s", lower=-1e3,
              upper=1e3, read_only=True),
    _times("pilot_at_s", "Flight times from which a pilot flies the sticks"),
    Parameter("commands.pilot_height_m", "double[]", "To what height above where it stood, at each "
              "of them; 0 sets it down", "m", lower=0.0, upper=1e3, read_only=True),
)  # fmt: skip
"""Rows of the outer loop; a scenario's file sets them."""


@dataclass(frozen=True)
class Order:
    """A command of the script.

    Attributes
    ----------
    at_ns : int
        Flight time.
    command : Command
    goal_ned_m, velocity_ned_mps : (3,) array, optional
        Of a goto, of a velocity.
    """

    at_ns: int
    command: Command
    goal_ned_m: Array | None = None
    velocity_ned_mps: Array | None = None


@dataclass(frozen=True)
class HeldSticks:
    """Sticks (4,) that are held from a flight time on, ns."""

    at_ns: int
    sticks: Array


@dataclass(frozen=True)
class HeldAttitude:
    """Roll, pitch, heading (3,), rad, and a climb that are commanded from a flight time on, ns."""

    at_ns: int
    attitude_rad: Array
    climb_mps: float


@dataclass(frozen=True)
class PilotHeight:
    """A height, m, to which the scripted pilot flies from a flight time on, ns; 0: the ground."""

    at_ns: int
    height_m: float


Scripted = Order | HeldSticks | HeldAttitude | PilotHeight


def script_of(p: Mapping[str, Any]) -> Sequence[Scripted]:
    """What checked parameters (`SCRIPT_ROWS`) order, in time; hands before commands.

    Raises
    ------
    ParameterError
        Numbers of times, commands and goals do not agree, or the times do not rise.
    """
    sticks = _paired(p, "sticks_at_s", "sticks", "rows")
    heights = _paired(p, "pilot_at_s", "pilot_height_m", "heights")
    script: list[Scripted] = [HeldSticks(at_ns, np.array(row)) for at_ns, row in sticks]
    attitudes = _paired(p, "attitude_at_s", "attitude_deg", "attitudes")
    climbs = _paired(p, "attitude_at_s", "climb_mps", "climbs")
    script += [
        HeldAttitude(at_ns, np.radians(row), float(climb))
        for (at_ns, row), (_, climb) in zip(attitudes, climbs, strict=True)
    ]
    script += [PilotHeight(at_ns, float(height)) for at_ns, height in heights]
    script += _orders(p)
    return sorted(script, key=lambda order: order.at_ns)


def _paired(p: Mapping[str, Any], times: str, name: str, what: str) -> list[tuple[int, Any]]:
    """Times, ns, with their rows, without those that are never."""
    at_s, rows = np.asarray(p[f"commands.{times}"], float), p[f"commands.{name}"]
    if name in _WIDTHS:
        rows = np.reshape(rows, (-1, _WIDTHS[name]))
    if len(at_s) != len(rows):
        raise ParameterError(
            f"commands.{times} has {len(at_s)} times, commands.{name} {len(rows)} "
            f"{what}; allowed: as many"
        )
    given = at_s[at_s >= 0.0]
    if (np.diff(given) <= 0.0).any():
        raise ParameterError(f"commands.{times} is {at_s.tolist()}; allowed: rising times")
    return [(round(at * NS_PER_S), row) for at, row in zip(at_s, rows, strict=True) if at >= 0.0]


def _orders(p: Mapping[str, Any]) -> list[Order]:
    places = {
        Command.GOTO: ("goto_ned_m", "places"),
        Command.VELOCITY: ("velocity_ned_mps", "velocities"),
    }
    given = {c: np.reshape(p[f"commands.{key}"], (-1, 3)) for c, (key, _) in places.items()}
    left = {command: iter(rows) for command, rows in given.items()}
    orders = []
    for at_ns, name in _paired(p, "at_s", "what", "commands"):
        command = Command(name)
        where = next(left[command], None) if command in left else None
        if command in left and where is None:
            key, what = places[command]
            raise ParameterError(
                f"commands.what has {list(p['commands.what']).count(name)} times {name}, "
                f"commands.{key} {len(given[command])} {what}; allowed: one for each"
            )
        goal, velocity = (where, None) if command == Command.GOTO else (None, where)
        orders.append(Order(at_ns, command, goal, velocity))
    return orders
