# SPDX-License-Identifier: Apache-2.0
"""Goals of `heli tune` that are flown: a few flights of given seeds, judged where a descent ends.

They have no gradient. The descent goes by the linear goals; of its starts the one is taken whose
worst share is least with the flown goals among them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from heli_core.rcl_yaml import ParameterError
from heli_flight.scoring import DECIDES
from heli_flight.settings import resolve
from heli_inner_hinf.fixed_structure import KEPT
from heli_studies.campaign.run import fly_seeds

FLOWN = "flown"
"""Kind of such a goal."""
SCENARIO, GPS, AXES = "attitude_gusts", "rtk", ("roll", "pitch")
_MOST_SEEDS = 100


@dataclass(frozen=True)
class FlownGoal:
    """The larger of roll's and pitch's RMS error from truth, median over the seeds, deg.

    Attributes
    ----------
    name : str
    world : str
    seeds : tuple of int
    bound : float
    where : str
        Which aircraft.
    """

    name: str
    world: str
    seeds: tuple[int, ...]
    bound: float
    where: str


@dataclass(frozen=True)
class FlownReached:
    """What a flown goal came to; `value` is inf where a flight was lost."""

    goal: FlownGoal
    value: float

    @property
    def share(self) -> float:
        """1 at the bound, more beyond it."""
        return self.value / self.goal.bound

    @property
    def met(self) -> bool:
        """As of a linear goal."""
        return self.share <= 1.0 + KEPT


def checked_seeds(row: Mapping[str, Any], where: str) -> tuple[int, ...]:
    """Seeds of a goal's row.

    Raises
    ------
    ParameterError
    """
    seeds = row.get("seeds")
    numbers = isinstance(seeds, list) and all(type(seed) is int and seed >= 0 for seed in seeds)
    if not numbers or not seeds or len(seeds) > _MOST_SEEDS:
        raise ParameterError(
            f"{where}: seeds {seeds!r} is not allowed; allowed: a list of 1 to {_MOST_SEEDS} "
            "numbers, 0 or more"
        )
    if row.get("hard", False) is not False:
        raise ParameterError(f"{where}: hard: what is flown has no gradient and is a soft goal")
    return tuple(seeds)


def fly(
    goals: Sequence[FlownGoal],
    laws: str,
    values: Mapping[str, Mapping[str, Any]],
    tell: Callable[[str], None],
) -> tuple[FlownReached, ...]:
    """Fly every goal with a controller.

    Parameters
    ----------
    goals : sequence of FlownGoal
    laws : str
        Control preset, over which `values` are laid.
    values : mapping of node to mapping of parameter to value
    tell : callable
        Told of each goal, a few words.

    Raises
    ------
    ParameterError, SynthesisError
        The controller is refused.
    """
    found = []
    for goal in goals:
        tell(f"flies {goal.name}, {goal.where}: {len(goal.seeds)} flights")
        settings = resolve(SCENARIO, gps=GPS, laws=laws, world=goal.world, overrides=values)
        flights = fly_seeds(settings, goal.seeds)
        if any(flight.lost for flight in flights):
            found.append(FlownReached(goal, np.inf))
            continue
        rms = [
            [s.rms for s in flight.figures.of(DECIDES) if (s.metric.key, s.source) == (a, "truth")]
            for a in AXES
            for flight in flights
        ]
        by_axis = np.array(rms).reshape(len(AXES), len(flights))
        found.append(FlownReached(goal, float(np.max(np.median(by_axis, axis=1)))))
    return tuple(found)
