# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what is flown, from which reference, and which stretches of it are scored.

A scenario is an rcl parameter file: the rows of the `scenario` node, and what it changes in the
other nodes. So it is layered, checked and overridden like every other parameter.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from heli_flight.loop.ground_figures import Gear
from heli_flight.loop.scenario_path import CLIMB, PATH_ROWS, path_of
from heli_math.paper_metrics import in_windows
from heli_math.ticks import TICK_NS, seconds, ticks_in
from heli_math.trajectory import Trajectory
from heli_parameters.parameters import Parameter, ParameterError

NODE_NAME = "scenario"

TABLE: tuple[Parameter, ...] = (
    Parameter("kind", "string", "Which metrics are scored", choices=("hover", "attitude", "path")),
    Parameter("duration_s", "double", "Length of the flight", "s", lower=0.04, upper=86400.0),
    Parameter(
        "start_pos_ned_m", "double[]", "Where the flight starts, NED", "m", shape=(3,), upper=1e5
    ),
    Parameter(
        "heading_deg", "double", "Heading to hold, 0 is north", "deg", lower=-180.0, upper=180.0
    ),
    Parameter("climb.start_s", "double", "Start of the climb", "s", lower=0.0),
    Parameter("climb.end_s", "double", "End of the climb; as start: no climb", "s", lower=0.0),
    Parameter("climb.speed_mps", "double", "Climb speed", "m/s", lower=-3.0, upper=5.0),
    *PATH_ROWS,
    Parameter(
        "score.windows_s",
        "double[]",
        "Pairs of flight times that are scored; a negative begin counts from the end of the "
        "flight, a negative end means the end",
        "s",
        shape=(None, 2),
    ),
)


@dataclass(frozen=True)
class Scenario:
    """A flight to be flown and scored.

    Attributes
    ----------
    kind : str
        "hover", "attitude" or "path": which metrics are scored.
    n_ticks : int
        Length in ticks of 10 ms.
    reference : Trajectory
        For the outer loop, times from the start of the flight.
    windows_s : (N, 2) ndarray
        Scored stretches, s of flight time.
    gear : Gear, optional
        What a flight that begins on the ground is judged by.
    """

    kind: str
    n_ticks: int
    reference: Trajectory
    windows_s: np.ndarray
    gear: Gear | None = None

    @classmethod
    def from_parameters(cls, p: Mapping[str, Any]) -> "Scenario":
        """From checked parameters (`TABLE`); ParameterError if the path cannot be flown."""
        n_ticks = ticks_in(p["duration_s"])
        windows = np.array(p["score.windows_s"], float).reshape(-1, 2)
        end_s, begin_s = seconds(n_ticks), windows[:, 0]
        windows[windows[:, 1] < 0.0, 1] = end_s
        windows[:, 0] = np.where(begin_s < 0.0, np.maximum(0.0, end_s + begin_s), begin_s)
        start, heading = np.asarray(p["start_pos_ned_m"], float), np.radians(p["heading_deg"])
        if p["path.kind"] != CLIMB:
            reference = path_of(start, heading, p)
            _check_length(reference, n_ticks)
        elif p["climb.end_s"] > p["climb.start_s"]:
            reference = Trajectory.hover_climb_hover(
                start, heading, p["climb.start_s"], p["climb.end_s"], p["climb.speed_mps"]
            )
        else:
            reference = Trajectory.hover(start, heading)
        return cls(p["kind"], n_ticks, reference, windows)

    def scored(self, time_s: np.ndarray) -> np.ndarray:
        """Mask (N,) of the samples at time_s (N,) in a scored stretch, its end excluded."""
        return in_windows(time_s, self.windows_s)


def _check_length(reference: Trajectory, n_ticks: int) -> None:
    """Refuse a flight that ends on the way."""
    end_ticks = math.ceil(reference.times_ns[-1] / TICK_NS)
    if end_ticks > n_ticks:
        raise ParameterError(
            f"scenario: duration_s is {seconds(n_ticks):g}, but the path takes "
            f"{seconds(end_ticks):g} s; allowed: at least that, or a shorter path"
        )
