# SPDX-License-Identifier: Apache-2.0
"""Goto and hold: from the present reference to a goal or a halt, without a jump. No ROS.

The controller averages the reference over a window about now, so that what it has made of it so far
hangs on the next half window, too. The old way is kept for so long.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import PathError
from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.guidance.paths import (
    Cruise,
    DiversionGoal,
    FlightPath,
    divert,
    turn_duration_s,
    turned,
)
from heli_outer_pd.guidance.transfer import MotionLimits
from heli_outer_pd.manual import StickNumbers
from heli_outer_pd.modes import RefusalCause
from heli_outer_pd.reference import (
    ReferenceLimits,
    ReferenceRefused,
    foreseen_ns,
)
from heli_outer_pd.state import OuterParams

# -------------------------------------------------------------------------------------------------
# Goto.
# -------------------------------------------------------------------------------------------------

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
        Window over which the controller averages the reference.
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
            Stamp of the controller's last step at the earliest.
        pos_ned_m : (3,) array
        psi_rad : float

        Returns
        -------
        Trajectory
            As `before` for as long as the controller has looked ahead.

        Raises
        ------
        ReferenceRefused
            No way within the limits, or too long a one.
        """
        psi = None if self.heading in (FIXED, WIND) else psi_rad
        return self._divert(
            before, now_ns, DiversionGoal(pos_ned_m, psi, facing=self.heading == TOWARDS)
        )

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
            raise ReferenceRefused(
                RefusalCause.NOT_NUMBERS,
                f"velocity {vel} m/s, turn {psi_rate_radps} rad/s: not finite",
            )
        most = self.limits
        level = float(np.hypot(*vel[:2]))
        if level > most.speed_mps:
            vel[:2] *= most.speed_mps / level
        vel[2] = min(max(vel[2], -most.climb_mps), most.climb_mps)
        rate = min(max(psi_rate_radps, -most.yaw_rate_radps), most.yaw_rate_radps)
        trajectory = self._divert(before, now_ns, Cruise(vel, rate, duration_s), _RECENT_NS)
        ahead = trajectory.points[trajectory.start_ns + trajectory.times_ns > now_ns, REFERENCE.pos]
        out_m = fence.fence_distance_m(ahead, home_ned_m)
        farthest = int(np.argmax(out_m))
        if out_m[farthest] > max(float(out_m[0]), 0.0):
            fence.judge_place("the way at this velocity", ahead[farthest], home_ned_m)
        return trajectory

    def turn(self, before: Trajectory, now_ns: int, angle_rad: float) -> tuple[Trajectory, int]:
        """`before` with the nose turned, to the right, and the stamp at which that is flown, ns."""
        leave_ns = now_ns + foreseen_ns(self.shaping_ns)
        lasts_ns = round(turn_duration_s(angle_rad, self.limits) * NS_PER_S)
        try:
            trajectory = turned(
                before, leave_ns, max(_PAST_NS, self.shaping_ns), angle_rad, self.limits
            )
        except PathError as error:
            raise ReferenceRefused(error.cause, str(error)) from error
        return trajectory, leave_ns + lasts_ns

    def _divert(
        self,
        before: Trajectory,
        now_ns: int,
        goal: DiversionGoal | Cruise | None,
        past_ns: int = _PAST_NS,
    ) -> Trajectory:
        leave_ns = now_ns + foreseen_ns(self.shaping_ns)
        try:
            return divert(before, leave_ns, max(past_ns, 3 * self.shaping_ns), goal, self.limits)
        except PathError as error:
            raise ReferenceRefused(error.cause, str(error)) from error

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
        trajectory = self.plan(before, now_ns, pos_ned_m, psi_rad)
        for place in trajectory.points[
            trajectory.start_ns + trajectory.times_ns > now_ns, REFERENCE.pos
        ]:
            fence.judge_place("the way to the goal", place, home_ned_m)
        return trajectory


# -------------------------------------------------------------------------------------------------
# Where the aircraft itself may be, by measured navigation, and the way back from beyond. No ROS.
#
# `reference_limits` says what may be asked for. The fence acts where the aircraft has left all the
# same: in a gust, by its sticks, on a reference that moved with it.
# -------------------------------------------------------------------------------------------------

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

    def fence_distance_m(self, pos_ned_m: Array, home_ned_m: Array, ground_down_m: float) -> float:
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
        """The nearest place (3,) that is `margin_m` inside; arguments as for `fence_distance_m`."""
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
            Stamp of the controller's last step.
        home_ned_m, ground_down_m
            As for `fence_distance_m`.
        """
        trajectory = goto.halt(before, now_ns)
        end, psi = trajectory.points[-1, REFERENCE.pos], float(trajectory.points[-1, REFERENCE.psi])
        if self.fence_distance_m(end, home_ned_m, ground_down_m) <= 0.0:
            return trajectory
        try:
            return goto.plan(before, now_ns, self.inside(end, home_ned_m, ground_down_m), psi)
        except ReferenceRefused:
            return trajectory


def left(mode: str, beyond_m: float) -> str:
    """That the fence has ended a mode, in a sentence."""
    return f"{mode}: the aircraft is {beyond_m:.1f} m outside the fence; it comes back to hover"


def outside(beyond_m: float, otherwise: str) -> str:
    """`otherwise`; outside the fence how far, in a sentence."""
    if beyond_m <= 0.0:
        return otherwise
    return f"{beyond_m:.1f} m outside the fence: coming back, no command leads outward"


# -------------------------------------------------------------------------------------------------
# Numbers of take-off and landing, and their trajectories: straight up, and down to the ground.
#
# No ROS.
# -------------------------------------------------------------------------------------------------

_BELOW_M = 10.0
"""A descent goes so far below the ground as it is remembered."""
_PIECE_NS = NS_PER_S // 10
"""A descent whose speed changes is made of pieces so long."""
_FAST_MPS, _SLOW_MPS = 0.7, 0.3
"""Where position or altitude are doubtful: its speed at most, as the ground may be met anywhere,
and that of its last part at least, as an error of the speed must not keep it in the air."""


@dataclass(frozen=True)
class PhaseNumbers:
    """Numbers of take-off and landing, as `parameters.TABLE` describes them."""

    on_ground: bool
    height_m: float
    idle_collective: float
    spool_up_ns: int
    up_ramp_s: float
    lean_max_rad: float
    tip_rad: float
    slow_below_m: float
    down_ramp_s: float
    clear_m: float
    land_heading: str
    climb: MotionLimits
    descent: MotionLimits
    touch_down: MotionLimits
    sticks: StickNumbers
    fence: Fence

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "PhaseNumbers":
        """From the parameters of the outer loop."""
        limits = MotionLimits.from_parameters(values, "goto")
        return cls(
            on_ground=values["start.on_ground"],
            height_m=values["takeoff.height_m"],
            idle_collective=values["takeoff.idle_collective"],
            spool_up_ns=round(values["takeoff.spool_up_s"] * NS_PER_S),
            up_ramp_s=values["takeoff.ramp_s"],
            lean_max_rad=math.radians(values["takeoff.lean_max_deg"]),
            tip_rad=math.radians(values["takeoff.tip_deg"]),
            slow_below_m=values["land.slow_below_m"],
            down_ramp_s=values["land.ramp_s"],
            clear_m=values["land.clear_m"],
            land_heading=values["land.heading"],
            climb=replace(limits, climb_mps=values["takeoff.climb_mps"]),
            descent=replace(limits, climb_mps=values["land.descent_mps"]),
            touch_down=replace(limits, climb_mps=values["land.touch_down_mps"]),
            sticks=StickNumbers.from_parameters(values),
            fence=Fence.from_parameters(values),
        )


HEIGHT_M = (1.0, 100.0)
"""Least and greatest height of the hover after a take-off, above where it stood."""


def judge_height(height_m: float) -> None:
    """ReferenceRefused unless a take-off may climb to this height, m, above where it stands."""
    least, most = HEIGHT_M
    if not least <= height_m <= most:
        raise ReferenceRefused(
            RefusalCause.ALTITUDE,
            f"a climb to {height_m:g} m above the ground; allowed: {least:g} to {most:g} m",
        )


def trajectory_here(nav: Array, start_ns: int) -> Trajectory:
    """To stand where a navigation row is, as it points; stamped with flight time 0."""
    psi = euler_from_quat(nav[NAV.quat])[2]
    return replace(Trajectory.hover(nav[NAV.pos].copy(), psi), start_ns=start_ns)


def trajectory_up(n: PhaseNumbers, nav: Array, now_ns: int, start_ns: int) -> Trajectory:
    """From where it is, with the heading that it has, up to the hover; from now on.

    Parameters
    ----------
    n : PhaseNumbers
    nav : array
        Navigation row.
    now_ns, start_ns : int
        Stamps of its beginning and of flight time 0.
    """
    psi = euler_from_quat(nav[NAV.quat])[2]
    return _legs(nav[NAV.pos].copy(), psi, [(n.climb, -n.height_m)], now_ns, start_ns)


def trajectory_down(
    n: PhaseNumbers,
    hover: Trajectory,
    ground_down_m: float,
    now_ns: int,
    start_ns: int,
    doubtful: bool = False,
) -> Trajectory:
    """From where a trajectory ends down, fast and then slow, through the ground.

    Parameters
    ----------
    n, now_ns, start_ns
        As for `trajectory_up`.
    hover : Trajectory
    ground_down_m : float
        Where the ground is, as far as it is known, NED.
    doubtful : bool, optional
        Whether it lands for want of a position or of a vertical speed.
    """
    fast, slow = n.descent, n.touch_down
    if doubtful:
        fast = replace(fast, climb_mps=min(fast.climb_mps, _FAST_MPS))
        slow = replace(slow, climb_mps=max(slow.climb_mps, _SLOW_MPS))
    pos, psi = hover.points[-1, REFERENCE.pos].copy(), float(hover.points[-1, REFERENCE.psi])
    fast_m = max(ground_down_m - n.slow_below_m - pos[2], 0.0)
    slow_m = max(ground_down_m - pos[2] - fast_m, 0.0) + _BELOW_M
    return _legs(pos, psi, [(fast, fast_m), (slow, slow_m)], now_ns, start_ns)


def trajectory_quickly_down(
    n: PhaseNumbers,
    hover: Trajectory,
    ground_down_m: float,
    k: OuterParams,
    now_ns: int,
    start_ns: int,
    known: bool,
) -> Trajectory:
    """From where a trajectory ends down by dead reckoning: the nearer the ground the slower.

    Parameters
    ----------
    n, hover, ground_down_m, now_ns, start_ns
        As for `trajectory_down`.
    k : OuterParams
        Its speeds.
    known : bool
        Whether the height of the ground is: else it may be met anywhere.
    """
    (fast, touch, feel), least_s = k.quick_mps.tolist(), _PIECE_NS / NS_PER_S
    if not known:
        fast = touch = feel
    point, speed, times, points = hover.points[-1].copy(), 0.0, [now_ns - start_ns], []
    last_m = max(fast - touch, 0.0) * k.flare_s
    while (height := ground_down_m - float(point[REFERENCE.pos][2])) > 0.0:
        speed = min(speed + n.descent.acceleration_mps2 * least_s, touch + height / k.flare_s, fast)
        lasts_s = max((height - last_m) / speed, least_s) if speed == fast else least_s
        point[REFERENCE.vel] = 0.0, 0.0, speed
        points.append(point.copy())
        times.append(times[-1] + round(lasts_s * NS_PER_S))
        point[REFERENCE.pos] += lasts_s * point[REFERENCE.vel]
    # On through where the ground should be.
    point[REFERENCE.vel] = 0.0, 0.0, touch
    points.append(point.copy())
    times.append(times[-1] + round(_BELOW_M / touch * NS_PER_S))
    point[REFERENCE.pos] += _BELOW_M / touch * point[REFERENCE.vel]
    point[REFERENCE.vel] = 0.0
    points.append(point)
    return Trajectory(start_ns, np.array(times), np.array(points))


def _legs(
    pos: Array,
    psi: float,
    legs: Sequence[tuple[MotionLimits, float]],
    now_ns: int,
    start_ns: int,
) -> Trajectory:
    """Legs straight down by so much each, m, one after the other from now on."""
    times: list[NDArray[np.int64]] = []
    points: list[Array] = []
    begins_ns = now_ns - start_ns
    for limits, down_m in legs:
        if down_m == 0.0:
            continue
        leg = FlightPath(pos, psi, limits).go_to(pos + np.array([0.0, 0.0, down_m]))
        flown = leg.trajectory()
        if times:
            # The end of a leg is the beginning of the next, which has the velocity there.
            times[-1], points[-1] = times[-1][:-1], points[-1][:-1]
        times.append(begins_ns + flown.times_ns)
        points.append(flown.points)
        pos, begins_ns = leg.pos_ned_m, begins_ns + int(flown.times_ns[-1])
    return Trajectory(start_ns, np.concatenate(times), np.concatenate(points))
