# SPDX-License-Identifier: Apache-2.0
"""How fast a path may be flown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_guidance.errors import Cause, PathError

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
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise PathError(
                    Cause.BAD_LIMIT, f"{field.name} is {value:g}; allowed: a positive number"
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
