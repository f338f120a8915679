# SPDX-License-Identifier: Apache-2.0
"""A manoeuvre in a flight against the table of its bounds."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

from heli_handling.courses import depart_abort, lateral_reposition, pirouette, slalom
from heli_handling.definitions import (
    FULL,
    Condition,
    Criterion,
    Manoeuvre,
    Scale,
    manoeuvre,
)
from heli_handling.found import Found
from heli_handling.hovering import hover, vertical
from heli_handling.tracks import Array, Track

SCHEMA = 1
"""Number of the layout of `Score.as_dict`; grows when a key changes its meaning or goes."""

_FINDERS: dict[str, Callable[[Track, Manoeuvre, Array | None, float], Found]] = {
    "hover": hover,
    "vertical": vertical,
    "pirouette": pirouette,
    "slalom": slalom,
    "lateral-reposition": lateral_reposition,
    "depart-abort": depart_abort,
}


class Level(Enum):
    """How well: in this order."""

    DESIRED = "desired"
    ADEQUATE = "adequate"
    NEITHER = "neither"


_ORDER = list(Level)


@dataclass(frozen=True)
class Result:
    """A criterion as it was flown; value None: its phase was not flown.

    Attributes
    ----------
    criterion : Criterion
    value : float or None
        Of the worst moment, SI; angles in degrees.
    at_s : float or None
        The worst moment.
    """

    criterion: Criterion
    value: float | None
    at_s: float | None

    def margin(self, bound: float) -> float | None:
        """How far inside of a bound, in its unit; negative outside."""
        if self.value is None:
            return None
        return self.value - bound if self.criterion.at_least else bound - self.value

    @property
    def level(self) -> Level | None:
        """On a bound is inside."""
        if self.value is None:
            return None
        bounds = {Level.DESIRED: self.criterion.desired, Level.ADEQUATE: self.criterion.adequate}
        for level, bound in bounds.items():
            margin = self.margin(bound)
            if margin is not None and margin >= 0.0:
                return level
        return Level.NEITHER

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        c, level = self.criterion, self.level
        return {
            "name": c.name,
            "text": c.text,
            "unit": c.quantity.value,
            "bound": "at least" if c.at_least else "at most",
            "desired": c.desired,
            "adequate": c.adequate,
            "value": self.value,
            "level": None if level is None else level.value,
            "margin_desired": self.margin(c.desired),
            "margin_adequate": self.margin(c.adequate),
            "worst_at_s": self.at_s,
        }


@dataclass(frozen=True)
class Flown:
    """A condition as it was flown; value None: it was not."""

    condition: Condition
    value: float | None

    @property
    def met(self) -> bool:
        """Whether the value is inside of the range."""
        return self.value is not None and self.condition.low <= self.value <= self.condition.high


@dataclass(frozen=True)
class Score:
    """A manoeuvre, scored.

    Attributes
    ----------
    table : Manoeuvre
        At the scale.
    scale : Scale
    found : Found
    results : tuple of Result
        In the table's order.
    conditions : tuple of Flown
    """

    table: Manoeuvre
    scale: Scale
    found: Found
    results: tuple[Result, ...]
    conditions: tuple[Flown, ...]

    @property
    def level(self) -> Level:
        """The worst of what was flown."""
        return max((r.level for r in self.results if r.level is not None), key=_ORDER.index)

    @property
    def complete(self) -> bool:
        """Whether every criterion was flown and every condition met."""
        flown = all(r.value is not None for r in self.results)
        return flown and all(c.met for c in self.conditions)

    def as_dict(self) -> dict[str, Any]:
        """For JSON; the layout is `SCHEMA`."""
        return {
            "schema": SCHEMA,
            "manoeuvre": self.table.name,
            "source": f"ADS-33E-PRF {self.table.paragraph} {self.table.title}",
            "scale": {"name": self.scale.name, "length_ratio": self.scale.ratio},
            "level": self.level.value,
            "complete": self.complete,
            "phases": [vars(phase) for phase in self.found.phases],
            "criteria": [result.as_dict() for result in self.results],
            "conditions": [
                {
                    "name": c.condition.name,
                    "text": c.condition.text,
                    "unit": c.condition.quantity.value,
                    "low": c.condition.low,
                    "high": c.condition.high,
                    "value": c.value,
                    "met": c.met,
                }
                for c in self.conditions
            ],
            "remarks": list(self.found.remarks),
        }


def score(
    track: Track,
    name: str,
    scale: Scale = FULL,
    target_ned_m: Array | None = None,
    ground_m: float = 0.0,
) -> Score:
    """Score a manoeuvre.

    Parameters
    ----------
    track : Track
    name : str
        Of `MANOEUVRES`.
    scale : Scale
        `FULL` or `froude(...)`.
    target_ned_m : (3,) array, optional
        Hover point, end of the course or centre of the circle; default: from the flight itself.
    ground_m : float
        Height of the ground in the track's frame, m.

    Raises
    ------
    HandlingError
        UNKNOWN, TOO_SHORT, NO_PHASES.
    """
    table = manoeuvre(name, scale)
    found = _FINDERS[name](track, table, target_ned_m, ground_m)
    results = []
    for criterion in table.criteria:
        value: tuple[float | None, float | None] = (None, None)
        if criterion.name in found.traces:
            value = found.traces[criterion.name].worst(criterion.at_least)
        elif criterion.name in found.numbers:
            value = found.numbers[criterion.name]
        results.append(Result(criterion, *value))
    conditions = tuple(Flown(c, found.conditions.get(c.name)) for c in table.conditions)
    return Score(table, scale, found, tuple(results), conditions)
