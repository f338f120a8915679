# SPDX-License-Identifier: Apache-2.0
"""From a motion to a standstill elsewhere: jerk-limited, the fastest along each axis.

Solved by Ruckig (Berscheid, Kroeger, "Jerk-limited real-time trajectory generation with arbitrary
target states", RSS 2021); its axes arrive together.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import ruckig
from numpy.typing import NDArray

from heli_core.errors import PathCause, PathError

# -------------------------------------------------------------------------------------------------
# Transfer.
# -------------------------------------------------------------------------------------------------

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
            raise PathError(PathCause.NOT_FINITE, f"{self}: not finite")


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
            raise PathError(
                PathCause.NOT_FINITE, f"goal {np.asarray(self.goal).tolist()}: not finite"
            )
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
                PathCause.TOO_FAST,
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


# -------------------------------------------------------------------------------------------------
# How fast a path may be flown.
# -------------------------------------------------------------------------------------------------

_YAW_JERK_S = 0.5
"""How long the heading's acceleration takes to its largest."""


@dataclass(frozen=True)
class MotionLimits:
    """Largest speeds, accelerations and jerk of a path.

    Attributes
    ----------
    speed_mps : float
        Horizontal.
    climb_mps : float
        Vertical, up and down.
    acceleration_mps2, jerk_mps3 : float
        Along a leg, and across it where the aircraft comes with another velocity; the first also
        across a curve.
    yaw_rate_radps, yaw_acceleration_radps2, yaw_jerk_radps3 : float
        Of the heading.

    Raises
    ------
    PathError
        One of them is not a positive number.
    """

    speed_mps: float
    climb_mps: float
    acceleration_mps2: float
    jerk_mps3: float
    yaw_rate_radps: float
    yaw_acceleration_radps2: float
    yaw_jerk_radps3: float

    def __post_init__(self) -> None:
        for limit in fields(self):
            value = getattr(self, limit.name)
            if not (math.isfinite(value) and value > 0.0):
                raise PathError(
                    PathCause.BAD_LIMIT, f"{limit.name} is {value:g}; allowed: a positive number"
                )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], prefix: str) -> "MotionLimits":
        """From the parameters of a node, deg/s and deg/s2 among them, whose names begin so."""
        turn = math.radians(values[f"{prefix}.yaw_acceleration_degps2"])
        return cls(
            speed_mps=values[f"{prefix}.speed_mps"],
            climb_mps=values[f"{prefix}.climb_mps"],
            acceleration_mps2=values[f"{prefix}.acceleration_mps2"],
            jerk_mps3=values[f"{prefix}.jerk_mps3"],
            yaw_rate_radps=math.radians(values[f"{prefix}.yaw_rate_degps"]),
            yaw_acceleration_radps2=turn,
            yaw_jerk_radps3=turn / _YAW_JERK_S,
        )

    def speed_along(self, direction_ned: NDArray[np.float64]) -> float:
        """Largest speed, m/s, in a direction (3,), a unit vector."""
        level, upright = float(np.hypot(*direction_ned[:2])), abs(float(direction_ned[2]))
        return min(
            self.speed_mps / level if level > 0.0 else math.inf,
            self.climb_mps / upright if upright > 0.0 else math.inf,
        )
