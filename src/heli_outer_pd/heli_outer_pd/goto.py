# SPDX-License-Identifier: Apache-2.0
"""Goto and hold: from the present reference to a goal or a halt, without a jump. No ROS.

The law averages the reference over a window about now, so that what it has made of it so far hangs
on the next half window, too. The old way is kept for so long.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_guidance.diversion import Cruise, Goal, divert
from heli_guidance.errors import PathError
from heli_guidance.limits import MotionLimits
from heli_guidance.turning import turn_duration_s, turned
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_outer_pd.reference import foreseen_ns
from heli_outer_pd.reference_limits import ReferenceLimits, ReferenceRefused

POSE, TOWARDS, FIXED, WIND = "pose", "towards", "fixed", "wind"
HEADINGS = (POSE, TOWARDS, FIXED, WIND)
_PAST_NS = 5 * NS_PER_S
"""What is kept of the way flown so far, for who hears of a goto late."""
_RECENT_NS = NS_PER_S
"""The same of a way that is replaced many times a second."""


@dataclass(frozen=True)
class Goto:
    """How a goto is flown.

    Attributes
    ----------
    limits : MotionLimits
    heading : str
        POSE: turn on the way to the heading that is asked for; TOWARDS: nose to the goal on the
        way, then so; FIXED: as it is; WIND: so, and into the wind while it hovers.
    shaping_ns : int
        Window over which the law averages the reference.
    """

    limits: MotionLimits
    heading: str
    shaping_ns: int

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "Goto":
        """From the parameters of the outer loop."""
        limits = MotionLimits.from_parameters(values, "goto")
        return cls(limits, values["goto.heading"], round(values["reference_shaping_s"] * NS_PER_S))

    def plan(
        self, before: Trajectory, now_ns: int, pos_ned_m: NDArray[np.float64], psi_rad: float
    ) -> Trajectory:
        """The way to a goal from where the reference is going now.

        Parameters
        ----------
        before : Trajectory
            What is followed.
        now_ns : int
            Stamp of the law's last step at the earliest.
        pos_ned_m : (3,) array
        psi_rad : float

        Returns
        -------
        Trajectory
            As `before` for as long as the law has looked ahead.

        Raises
        ------
        ReferenceRefused
            No way within the limits, or too long a one.
        """
        psi = None if self.heading in (FIXED, WIND) else psi_rad
        return self._divert(before, now_ns, Goal(pos_ned_m, psi, facing=self.heading == TOWARDS))

    def halt(self, before: Trajectory, now_ns: int) -> Trajectory:
        """The way to a standstill, as soon as the limits allow; arguments as for `plan`."""
        return self._divert(before, now_ns, None)

    def cruise(
        self,
        before: Trajectory,
        now_ns: int,
        vel_ned_mps: NDArray[np.float64],
        psi_rate_radps: float,
        duration_s: float,
        fence: ReferenceLimits,
        home_ned_m: NDArray[np.float64],
    ) -> Trajectory:
        """The way at a velocity and a rate of turn for so long, then to a halt, inside the fence.

        What is more than the limits is cut to them, its direction kept. Other arguments as for
        `judged`. It is fenced in with its halt; where it is outside already, it may come back.
        """
        vel = np.array(vel_ned_mps, float)
        if not (np.isfinite(vel).all() and np.isfinite(psi_rate_radps)):
            raise ReferenceRefused(f"velocity {vel} m/s, turn {psi_rate_radps} rad/s: not finite")
        most = self.limits
        level = float(np.hypot(*vel[:2]))
        if level > most.speed_mps:
            vel[:2] *= most.speed_mps / level
        vel[2] = min(max(vel[2], -most.climb_mps), most.climb_mps)
        rate = min(max(psi_rate_radps, -most.yaw_rate_radps), most.yaw_rate_radps)
        way = self._divert(before, now_ns, Cruise(vel, rate, duration_s), _RECENT_NS)
        ahead = way.points[way.start_ns + way.times_ns > now_ns, REFERENCE.pos]
        out_m = fence.beyond_m(ahead, home_ned_m)
        farthest = int(np.argmax(out_m))
        if out_m[farthest] > max(float(out_m[0]), 0.0):
            fence.judge_place("the way at this velocity", ahead[farthest], home_ned_m)
        return way

    def turn(self, before: Trajectory, now_ns: int, angle_rad: float) -> tuple[Trajectory, int]:
        """`before` with the nose turned, to the right, and the stamp at which that is flown, ns."""
        leave_ns = now_ns + foreseen_ns(self.shaping_ns)
        lasts_ns = round(turn_duration_s(angle_rad, self.limits) * NS_PER_S)
        try:
            way = turned(before, leave_ns, max(_PAST_NS, self.shaping_ns), angle_rad, self.limits)
        except PathError as error:
            raise ReferenceRefused(str(error)) from error
        return way, leave_ns + lasts_ns

    def _divert(
        self,
        before: Trajectory,
        now_ns: int,
        goal: Goal | Cruise | None,
        past_ns: int = _PAST_NS,
    ) -> Trajectory:
        leave_ns = now_ns + foreseen_ns(self.shaping_ns)
        try:
            return divert(before, leave_ns, max(past_ns, 3 * self.shaping_ns), goal, self.limits)
        except PathError as error:
            raise ReferenceRefused(str(error)) from error

    def judged(
        self,
        before: Trajectory,
        now_ns: int,
        pos_ned_m: NDArray[np.float64],
        psi_rad: float,
        fence: ReferenceLimits,
        home_ned_m: NDArray[np.float64],
    ) -> Trajectory:
        """`plan`, if goal and way are inside the limits of references; else ReferenceRefused."""
        fence.judge_place("the goal", pos_ned_m, home_ned_m)
        way = self.plan(before, now_ns, pos_ned_m, psi_rad)
        for place in way.points[way.start_ns + way.times_ns > now_ns, REFERENCE.pos]:
            fence.judge_place("the way to the goal", place, home_ned_m)
        return way
