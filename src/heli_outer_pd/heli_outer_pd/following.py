# SPDX-License-Identifier: Apache-2.0
"""What the outer loop has while it is active. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import NAV
from heli_math.trajectory import Trajectory
from heli_outer_pd.disturbance import flyable
from heli_outer_pd.outer_state import MEMORY
from heli_outer_pd.phases import Phases


@dataclass
class Following:
    """What the outer loop has while it is active.

    Attributes
    ----------
    begun_s : float
        Wall time of the activation.
    awaits_reference : bool
        In lockstep: no step is made before a reference has come.
    held : Trajectory or None
        The position of activation, held while there is no reference.
    engaged : bool
        True once the law has followed; before that its command is the trim.
    phases : Phases
        What the flight does, from the ground to the ground.
    diverted : Trajectory or None
        The way of the last command, followed until a reference comes.
    rejoins : bool
        True until the first step after a gap.
    """

    begun_s: float
    awaits_reference: bool
    phases: Phases
    held: Trajectory | None = None
    engaged: bool = False
    diverted: Trajectory | None = None
    rejoins: bool = False

    def take(self, known: Mapping[str, Any], gap: bool) -> None:
        """Go on from the fields that a predecessor had; `gap`: time has gone by since."""
        for name, value in known.items():
            setattr(self, name, value)
        self.rejoins = gap

    def rejoin(self, nav: NDArray[np.float64], state: NDArray[np.float64]) -> None:
        """After a gap, as soon as there is navigation: estimate the velocity from that of now.

        The law's own estimate is of another moment; what it knows of the disturbance stays.
        """
        if self.rejoins and flyable(nav):
            self.rejoins = False
            state[MEMORY.vel] = nav[NAV.vel]
