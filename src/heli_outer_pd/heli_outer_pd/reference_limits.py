# SPDX-License-Identifier: Apache-2.0
"""What a reference may ask for, whoever sends it. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory

_AHEAD_S = 60.0
"""A trajectory may be sent before it begins, but not stamped by another clock."""


class ReferenceRefused(ValueError):
    """A reference that is not followed; the message is one sentence."""


@dataclass(frozen=True)
class ReferenceLimits:
    """Lowest and highest altitude above the origin, largest horizontal distance from home; m."""

    altitude_min_m: float
    altitude_max_m: float
    distance_m: float

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ReferenceLimits":
        """From the parameters of the outer loop; ReferenceRefused if they leave no altitude.

        What lies beyond the fence is not asked for, either.
        """
        low, high, far = (values[f"reference_limits.{name}"] for name in cls.__annotations__)
        made = cls(low, min(high, values["fence.ceiling_m"]), min(far, values["fence.radius_m"]))
        if made.altitude_min_m >= made.altitude_max_m:
            raise ReferenceRefused(
                f"reference_limits: altitude_min_m {made.altitude_min_m:g} is not below "
                f"altitude_max_m {made.altitude_max_m:g}"
            )
        return made

    def judge(self, way: Trajectory, home_ned_m: NDArray[np.float64], now_ns: int) -> None:
        """Refuse a trajectory that leaves the limits; what lies between its points is inside, too.

        Parameters
        ----------
        way : Trajectory
        home_ned_m : (3,) array
            Where the flight began.
        now_ns : int
            Stamp of now.

        Raises
        ------
        ReferenceRefused
            Names the point that is too low, too high or too far, or when it would begin.
        """
        ahead_s = (way.start_ns - now_ns) / NS_PER_S
        if way.start_ns < 0 or ahead_s > _AHEAD_S:
            raise ReferenceRefused(
                f"stamped {way.start_ns / NS_PER_S:.2f} s; now is {now_ns / NS_PER_S:.2f} s, "
                f"allowed: at most {_AHEAD_S:g} s later"
            )
        for number, point in enumerate(way.points[:, REFERENCE.pos]):
            self.judge_place(f"point {number}", point, home_ned_m)

    def beyond_m(
        self, pos_ned_m: NDArray[np.float64], home_ned_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How far positions (N, 3) are outside (N,), m; negative inside."""
        up = -pos_ned_m[:, 2]
        away = np.hypot(*(pos_ned_m - home_ned_m)[:, :2].T)
        return np.max(
            [self.altitude_min_m - up, up - self.altitude_max_m, away - self.distance_m], axis=0
        )

    def judge_place(
        self, name: str, pos_ned_m: NDArray[np.float64], home_ned_m: NDArray[np.float64]
    ) -> None:
        """Refuse a position (3,), by this name, that is too low, too high or too far from home."""
        up = -float(pos_ned_m[2])
        away = float(np.hypot(*(pos_ned_m - home_ned_m)[:2]))
        if not self.altitude_min_m <= up <= self.altitude_max_m:
            raise ReferenceRefused(
                f"{name} is {up:.1f} m high; allowed: {self.altitude_min_m:g} to "
                f"{self.altitude_max_m:g} m"
            )
        if not away <= self.distance_m:
            raise ReferenceRefused(
                f"{name} is {away:.0f} m from where the flight began; allowed: at most "
                f"{self.distance_m:g} m"
            )
