# SPDX-License-Identifier: Apache-2.0
"""Where the aircraft itself may be, by measured navigation, and the way back from beyond. No ROS.

`reference_limits` says what may be asked for. The fence acts where the aircraft has left all the
same: in a gust, by its sticks, on a reference that moved with it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import REFERENCE
from heli_math.trajectory import Trajectory
from heli_outer_pd.goto import Goto
from heli_outer_pd.reference_limits import ReferenceRefused

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fence:
    """Radius from home, ceiling above the ground, and how far inside it hovers then; m."""

    radius_m: float
    ceiling_m: float
    margin_m: float

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "Fence":
        """From the parameters of the outer loop."""
        return cls(**{name: values[f"fence.{name}"] for name in cls.__annotations__})

    def beyond_m(self, pos_ned_m: Array, home_ned_m: Array, ground_down_m: float) -> float:
        """How far a position (3,) is outside, m; 0 inside, and where it is not known.

        Parameters
        ----------
        pos_ned_m, home_ned_m : (3,) arrays
            NED, m.
        ground_down_m : float
            Where the ground is, as far as it is known, NED.
        """
        away = float(np.hypot(*(pos_ned_m - home_ned_m)[:2])) - self.radius_m
        above = ground_down_m - float(pos_ned_m[2]) - self.ceiling_m
        out = max(away, above)
        return out if out > 0.0 else 0.0

    def inside(self, pos_ned_m: Array, home_ned_m: Array, ground_down_m: float) -> Array:
        """The nearest place (3,) that is `margin_m` inside; arguments as for `beyond_m`."""
        goal, off = np.array(pos_ned_m, float), (pos_ned_m - home_ned_m)[:2]
        away, most = float(np.hypot(*off)), max(self.radius_m - self.margin_m, 0.0)
        if away > most:
            goal[:2] = home_ned_m[:2] + off * (most / away)
        goal[2] = max(goal[2], ground_down_m - max(self.ceiling_m - self.margin_m, 0.0))
        return goal

    def halt(
        self,
        goto: Goto,
        before: Trajectory,
        now_ns: int,
        home_ned_m: Array,
        ground_down_m: float,
    ) -> Trajectory:
        """The way to a standstill; where that would be outside, on to the nearest place inside.

        Parameters
        ----------
        goto : Goto
            How it is flown.
        before : Trajectory
            What is followed, or how the aircraft moves.
        now_ns : int
            Stamp of the law's last step.
        home_ned_m, ground_down_m
            As for `beyond_m`.
        """
        way = goto.halt(before, now_ns)
        end, psi = way.points[-1, REFERENCE.pos], float(way.points[-1, REFERENCE.psi])
        if self.beyond_m(end, home_ned_m, ground_down_m) <= 0.0:
            return way
        try:
            return goto.plan(before, now_ns, self.inside(end, home_ned_m, ground_down_m), psi)
        except ReferenceRefused:
            return way


def left(mode: str, beyond_m: float) -> str:
    """That the fence has ended a mode, in a sentence."""
    return f"{mode}: the aircraft is {beyond_m:.1f} m outside the fence; it comes back to hover"


def outside(beyond_m: float, said: str) -> str:
    """`said`; outside the fence how far, in a sentence."""
    if beyond_m <= 0.0:
        return said
    return f"{beyond_m:.1f} m outside the fence: coming back, no command leads outward"
