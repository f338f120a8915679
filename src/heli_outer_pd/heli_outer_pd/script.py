# SPDX-License-Identifier: Apache-2.0
"""Commands at given times of a flight: what a scenario does instead of a pilot. No ROS."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.ticks import NS_PER_S
from heli_modes.table import Command
from heli_parameters.parameters import Parameter, ParameterError

SCRIPT_ROWS: tuple[Parameter, ...] = (
    Parameter("commands.at_s", "double[]", "Flight times of commands, rising; a negative one is "
              "never", "s", lower=-1.0, upper=86400.0, read_only=True),
    Parameter("commands.what", "string[]", "What is commanded at each of them",
              choices=(Command.TAKEOFF, Command.LAND, Command.HOLD, Command.GOTO), read_only=True),
    Parameter("commands.goto_ned_m", "double[]", "Where each goto goes, NED", "m",
              shape=(None, 3), upper=1e5, read_only=True),
)  # fmt: skip
"""Rows of the outer loop; a scenario's file sets them."""


@dataclass(frozen=True)
class Order:
    """A command of the script: when, ns of flight time, what, and where if it is a goto."""

    at_ns: int
    command: Command
    goal_ned_m: NDArray[np.float64] | None = None


def script_of(p: Mapping[str, Any]) -> Sequence[Order]:
    """The orders of checked parameters (`SCRIPT_ROWS`), in time.

    Raises
    ------
    ParameterError
        Numbers of times, commands and goals do not agree, or the times do not rise.
    """
    times, what = np.asarray(p["commands.at_s"], float), p["commands.what"]
    if len(times) != len(what):
        raise ParameterError(
            f"commands.at_s has {len(times)} times, commands.what {len(what)} commands; "
            "allowed: as many"
        )
    given = times[times >= 0.0]
    if (np.diff(given) <= 0.0).any():
        raise ParameterError(f"commands.at_s is {times.tolist()}; allowed: rising times")
    goals = iter(np.reshape(p["commands.goto_ned_m"], (-1, 3)))
    orders = []
    for at_s, name in zip(times, what, strict=True):
        if at_s < 0.0:
            continue
        command, goal = Command(name), None
        if command == Command.GOTO:
            goal = next(goals, None)
            if goal is None:
                raise ParameterError(
                    f"commands.what has {list(what).count(name)} times goto, "
                    f"commands.goto_ned_m {len(p['commands.goto_ned_m'])} places; "
                    "allowed: one for each"
                )
        orders.append(Order(round(at_s * NS_PER_S), command, goal))
    return orders
