# SPDX-License-Identifier: Apache-2.0
"""A scripted hand: holds sticks, flies them to a height, keeps a velocity or an attitude commanded.

No ROS.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import STICKS
from heli_math.ticks import NS_PER_S
from heli_modes.table import Phase
from heli_outer_pd.outer_state import OuterKernel
from heli_outer_pd.pilot import Pilot
from heli_outer_pd.script import HeldAttitude, HeldSticks, Order, PilotHeight, Scripted
from heli_outer_pd.steering import StickNumbers

Array = NDArray[np.float64]

_RENEWED_NS = NS_PER_S // 5


@dataclass
class ScriptedHand:
    """What the script has a hand do.

    Attributes
    ----------
    sticks : (4,) array or None
        Held.
    height_m : float or None
        To where the pilot flies.
    cruise : (3,) array or None
        Velocity that is renewed, NED, m/s.
    attitude : HeldAttitude or None
        The same of an attitude.
    """

    sticks: Array | None = None
    height_m: float | None = None
    cruise: Array | None = None
    attitude: HeldAttitude | None = None
    numbers: StickNumbers | None = None
    _pilot: Pilot | None = None
    _standing: bool = False

    @property
    def holds_sticks(self) -> bool:
        """Whether there is a hand at the sticks."""
        return self.sticks is not None or self.height_m is not None

    def take(self, order: Scripted, numbers: StickNumbers, standing: bool) -> Order | None:
        """Take what is ordered for the hand; a command is given back."""
        self.numbers, self._standing = numbers, standing
        match order:
            case HeldSticks():
                self.sticks, self.height_m, self.attitude = order.sticks, None, None
            case PilotHeight():
                self.sticks, self.height_m, self.attitude = None, order.height_m, None
            case HeldAttitude():
                self.attitude = order
            case Order():
                self.cruise, self.attitude = order.velocity_ned_mps, None
                return order
        return None

    def begins(self) -> None:
        """The sticks are taken: a pilot begins to look."""
        self._pilot = None

    def rest(self, standing: bool) -> Array:
        """The sticks as the hand takes hold of them."""
        if self.sticks is not None:
            return self.sticks
        rest = np.zeros(STICKS.size)
        rest[STICKS.climb] = -1.0 if standing else 0.0
        return rest

    def moves(self, nav: Array, ground_down_m: float, phase: Phase, k: OuterKernel) -> Array | None:
        """The sticks (4,) now; None without a hand."""
        if self.height_m is None:
            return self.sticks
        if self._pilot is None:
            assert self.numbers is not None  # came with the order
            self._pilot = Pilot(k, self.numbers, self._standing)
        return self._pilot.fly(nav, self.height_m, ground_down_m, phase)

    def is_due(self, since_ns: int) -> bool:
        """Whether the velocity is to be renewed."""
        return self.cruise is not None and since_ns >= _RENEWED_NS
