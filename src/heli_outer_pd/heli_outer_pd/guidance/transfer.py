# SPDX-License-Identifier: Apache-2.0
"""From a motion to a standstill elsewhere: jerk-limited, the fastest along each axis.

Solved by Ruckig (Berscheid, Kroeger, "Jerk-limited real-time trajectory generation with arbitrary
target states", RSS 2021); its axes arrive together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import ruckig
from numpy.typing import NDArray

from heli_guidance.errors import Cause, PathError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Where something is and how it moves: (n,) arrays, SI."""

    pos: Array
    vel: Array
    acc: Array

    @classmethod
    def at_rest(cls, pos: Array) -> "Motion":
        """Standing still at pos (n,)."""
        return cls(np.asarray(pos, float), np.zeros(len(pos)), np.zeros(len(pos)))

    def __post_init__(self) -> None:
        if not all(np.isfinite(part).all() for part in (self.pos, self.vel, self.acc)):
            raise PathError(Cause.NOT_FINITE, f"{self}: not finite")


@dataclass(frozen=True)
class Transfer:
    """A motion from `start` to a standstill at `goal`, or wherever it is soonest, or to a velocity.

    Parameters
    ----------
    start : Motion
        Of n axes.
    goal : (n,) array or None
        None: it stops as soon as it can.
    speed, acceleration, jerk : sequences of n floats
        Largest magnitude per axis.
    cruise : (n,) array, optional
        Without a goal: the velocity that it goes on with.

    Raises
    ------
    PathError
        A number is not finite, or the start cannot be brought within the limits.
    """

    start: Motion
    goal: Array | None
    speed: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]
    cruise: Array | None = None
    _solved: ruckig.Trajectory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n, start = self.start.pos.size, self.start
        if self.goal is not None and not np.isfinite(self.goal).all():
            raise PathError(Cause.NOT_FINITE, f"goal {np.asarray(self.goal).tolist()}: not finite")
        asked = ruckig.InputParameter(n)
        asked.current_position = start.pos.tolist()
        asked.current_velocity = start.vel.tolist()
        asked.current_acceleration = start.acc.tolist()
        if self.goal is None:
            asked.control_interface = ruckig.ControlInterface.Velocity
            if self.cruise is not None:
                asked.target_velocity = np.asarray(self.cruise, float).tolist()
        else:
            asked.target_position = np.asarray(self.goal, float).tolist()
        asked.max_velocity, asked.max_acceleration = list(self.speed), list(self.acceleration)
        asked.max_jerk = list(self.jerk)
        # A straight line where the start allows one.
        asked.synchronization = ruckig.Synchronization.Phase
        solved = ruckig.Trajectory(n)
        try:
            ruckig.Ruckig(n).calculate(asked, solved)
        except ruckig.RuckigError as error:
            raise PathError(
                Cause.TOO_FAST,
                f"no motion within the limits from velocity {start.vel} m/s and acceleration "
                f"{start.acc} m/s2",
            ) from error
        object.__setattr__(self, "_solved", solved)

    @property
    def duration_s(self) -> float:
        """When the goal is reached, s."""
        return float(self._solved.duration)

    def at(self, time_s: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (n,) at a time, s; after its end as there."""
        pos, vel, acc = self._solved.at_time(min(max(time_s, 0.0), self.duration_s))
        if self.cruise is not None and time_s > self.duration_s:
            return (
                np.asarray(pos) + (time_s - self.duration_s) * self.cruise,
                self.cruise,
                0.0 * self.cruise,
            )
        return np.asarray(pos), np.asarray(vel), np.asarray(acc)
