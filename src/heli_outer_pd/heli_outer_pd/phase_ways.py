# SPDX-License-Identifier: Apache-2.0
"""Numbers of take-off and landing, and their ways: straight up, and down until the ground ends it.

No ROS.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_guidance.flight_path import FlightPath
from heli_guidance.limits import MotionLimits
from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_outer_pd.fence import Fence
from heli_outer_pd.steering import StickNumbers

Array = NDArray[np.float64]

_BELOW_M = 10.0
"""A descent goes so far below the ground as it is remembered."""
_FAST_MPS, _SLOW_MPS = 0.7, 0.3
"""Where position or altitude are doubtful: its speed at most, as the ground may be met anywhere,
and that of its last part at least, as an error of the speed must not keep it in the air."""


@dataclass(frozen=True)
class PhaseNumbers:
    """Numbers of take-off and landing, as `parameter_table` describes them."""

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


def way_here(nav: Array, start_ns: int) -> Trajectory:
    """To stand where a navigation row is, as it points; stamped with flight time 0."""
    psi = euler_from_quat(nav[NAV.quat])[2]
    return replace(Trajectory.hover(nav[NAV.pos].copy(), psi), start_ns=start_ns)


def way_up(n: PhaseNumbers, nav: Array, now_ns: int, start_ns: int) -> Trajectory:
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


def way_down(
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
        As for `way_up`.
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
