# SPDX-License-Identifier: Apache-2.0
"""What the controller follows: the reference, begun where the aircraft is and averaged so that its
velocity has no jumps.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import CausedError
from heli_core.jit import copy, fill, njit, scratch
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, REFERENCE, SHAPED
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory, reference_at
from heli_outer_pd.disturbance import flown_acceleration_ned, flyable, hover_share
from heli_outer_pd.guidance.paths import STEP_S
from heli_outer_pd.manual_controller import collective_limits, manual_deflections
from heli_outer_pd.modes import RefusalCause
from heli_outer_pd.state import MEMORY, OuterParams, OuterState

# -------------------------------------------------------------------------------------------------
# Reference.
# -------------------------------------------------------------------------------------------------

_SHAPING_SAMPLES = 32
_STEP_NS = round(STEP_S * NS_PER_S)
_N_REFERENCE = REFERENCE.size
_TURN_NS = 120_000_000  # three points of a path
_CATCH_UP = 10  # one second of a trajectory's late start is caught up in so many


@njit
def fill_offset(pos_ned_m, time_ns, times_ns, points, offset):
    """Offset (3,), NED, m, from the trajectory at time_ns to a position (3,), into offset."""
    now = scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, now)
    for j in range(3):
        offset[j] = pos_ned_m[j] - now[j]


@njit
def move(points, offset_ned_m):
    """Move the positions of way points (N, 7), in place, by an offset (3,), NED, m."""
    for i in range(points.shape[0]):
        for j in range(3):
            points[i, j] += offset_ned_m[j]


def moved(trajectory: Trajectory, offset_ned_m: NDArray[np.float64]) -> Trajectory:
    """The trajectory with all positions moved by an offset (3,), NED, m; headings stay."""
    points = trajectory.points.copy()
    move(points, np.asarray(offset_ned_m, float))
    return replace(trajectory, points=points)


@njit
def turn_rate_at(time_ns, times_ns, points):
    """Rate of the reference's heading just ahead of time_ns, rad/s; 0 about a step.

    The smaller of the rates over the next two stretches, 0 if they differ in sign (minmod): a
    heading that turns is in both, a step in one at most.
    """
    here, near, far = scratch(_N_REFERENCE), scratch(_N_REFERENCE), scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, here)
    reference_at(time_ns + _TURN_NS, times_ns, points, near)
    reference_at(time_ns + 2 * _TURN_NS, times_ns, points, far)
    psi = REFERENCE.psi
    first, second = wrap_pi(near[psi] - here[psi]), wrap_pi(far[psi] - near[psi])
    if first * second <= 0.0:
        return 0.0
    least = first if abs(first) < abs(second) else second
    return least / (_TURN_NS * 1e-9)


def unforeseen_window_ns(values: Mapping[str, Any]) -> int:
    """Window over which the controller averages a reference of others, ns, from its parameters.

    Of one that is not known ahead (`reference_preview`) it is one step of the controller, which its
    acceleration is the difference over, but no less than a path's points are apart: between them
    its speed is constant, and a difference over less is 0 or a pulse. Half of it lies ahead of now.
    What the loop plans itself is known from the command on.
    """
    window_ns = round(values["reference_shaping_s"] * NS_PER_S)
    step_ns = max(values["period_ticks"] * TICK_NS, _STEP_NS)
    return window_ns if values["reference_preview"] else min(window_ns, step_ns)


@njit
def window_of(k, state):
    """Window, ns, over which the reference that is followed is averaged."""
    return k.unforeseen_ns if state.x[MEMORY.unforeseen] > 0.5 else k.shaping_ns


def foreseen_ns(window_ns: int) -> int:
    """From so much after now on `shaped_reference_at` does not look at the trajectory, ns."""
    return max(window_ns // 2 + _STEP_NS // 2, 2 * _TURN_NS) + 1


@njit
def _velocity_about(time_ns, times_ns, points, out):
    """Mean velocity (3,), NED, m/s, over a stretch between a path's points, about a time.

    A path's own is constant from point to point: of a faster controller it would be a staircase.
    """
    ahead, behind = scratch(_N_REFERENCE), scratch(_N_REFERENCE)
    reference_at(time_ns + _STEP_NS // 2, times_ns, points, ahead)
    reference_at(time_ns - _STEP_NS // 2, times_ns, points, behind)
    for j in range(3):
        out[j] = (ahead[j] - behind[j]) / (_STEP_NS * 1e-9)


@njit
def shaped_reference_at(time_ns, window_ns, heading_lead_s, times_ns, points, out):
    """Reference (10,) averaged over the window about time_ns; written to out.

    A step of the reference's velocity becomes a ramp, half of it before the step, with its
    acceleration; where the reference stands or moves steadily, the average is exact. A trajectory
    may begin with a step that nobody knew of, so its first average ends at its start: half a
    window late, which is caught up a tenth faster than commanded.

    Parameters
    ----------
    time_ns, window_ns : int
        Time after the trajectory's start and length of the window; 0 for no shaping.
    heading_lead_s : float
        The heading is led by so much times its rate.
    times_ns, points : ndarray
        The trajectory.
    out : (10,) ndarray
        Position NED m, velocity NED m/s, acceleration NED m/s2, heading rad.
    """
    now = scratch(_N_REFERENCE)
    reference_at(time_ns, times_ns, points, now)
    pos, vel, acc = out[SHAPED.pos], out[SHAPED.vel], out[SHAPED.acc]
    copy(pos, now[REFERENCE.pos])
    copy(vel, now[REFERENCE.vel])
    fill(acc, 0.0)
    out[SHAPED.psi] = now[REFERENCE.psi] + heading_lead_s * turn_rate_at(time_ns, times_ns, points)
    if window_ns <= 0:
        return
    window_s = window_ns * 1e-9
    late_ns = max(window_ns // 2 - max(time_ns, 0) // _CATCH_UP, 0)
    pace = 1.0 + 1.0 / _CATCH_UP if late_ns > 0 and time_ns > 0 else 1.0
    end_ns = time_ns + window_ns // 2 - late_ns
    end, begin = scratch(_N_REFERENCE), scratch(_N_REFERENCE)
    vel_end, vel_begin = scratch(3), scratch(3)
    reference_at(end_ns, times_ns, points, end)
    reference_at(end_ns - window_ns, times_ns, points, begin)
    _velocity_about(end_ns, times_ns, points, vel_end)
    _velocity_about(end_ns - window_ns, times_ns, points, vel_begin)
    pos_end, pos_begin = end[REFERENCE.pos], begin[REFERENCE.pos]
    for j in range(3):
        vel[j] = pace * (pos_end[j] - pos_begin[j]) / window_s
        acc[j] = pace * pace * (vel_end[j] - vel_begin[j]) / window_s
    # Mid-point rule: exact where the reference is linear, second order over a corner.
    sample, total = scratch(_N_REFERENCE), scratch(3)
    fill(total, 0.0)
    for i in range(_SHAPING_SAMPLES):
        back_ns = window_ns * (2 * i + 1) // (2 * _SHAPING_SAMPLES)
        reference_at(end_ns - back_ns, times_ns, points, sample)
        for j in range(3):
            total[j] += sample[j]
    for j in range(3):
        pos[j] = total[j] / _SHAPING_SAMPLES


# -------------------------------------------------------------------------------------------------
# A reference that begins where the aircraft is and moves as it does. No ROS.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

GLIMPSE_NS = NS_PER_S
"""How far ahead a pilot's way is told."""


@dataclass
class MotionState:
    """How something moves: rows position, velocity, acceleration (3, 3), NED; heading (3,), rad."""

    ned: Array
    psi: Array


def flown_now(nav: Array, k: OuterParams, state: OuterState) -> MotionState:
    """How the aircraft moves by its navigation and the controller's own estimate of the forces."""
    acc = np.empty(3)
    flown_acceleration_ned(nav, k, state, acc)
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    rate = (nav[NAV.q] * np.sin(phi) + nav[NAV.r] * np.cos(phi)) / np.cos(theta)
    return MotionState(np.array([nav[NAV.pos], nav[NAV.vel], acc]), np.array([psi, rate, 0.0]))


def reference_state(trajectory: Trajectory, now_ns: int, window_ns: int) -> MotionState:
    """How the reference moves, as the controller follows it, averaged over its window."""
    shaped, row = np.empty(SHAPED.size), np.empty(REFERENCE.size)
    asked = now_ns - trajectory.start_ns, trajectory.times_ns, trajectory.points
    shaped_reference_at(asked[0], window_ns, 0.0, *asked[1:], shaped)
    reference_at(*asked, row)
    ned = np.array([shaped[SHAPED.pos], shaped[SHAPED.vel], shaped[SHAPED.acc]])
    return MotionState(ned, np.array([row[REFERENCE.psi], turn_rate_at(*asked), 0.0]))


def warm_up(k: OuterParams, state: OuterState) -> None:
    """Load the compiled parts of a change of modes before a flight needs them."""
    nav = np.zeros(NAV.size)
    nav[NAV.quat] = 1.0, 0.0, 0.0, 0.0
    flown_now(nav, k, state)
    reference_state(Trajectory.hover(np.zeros(3), 0.0), 0, window_of(k, state))
    manual_deflections(state, np.empty(3))
    collective_limits(k)
    hover_share(0.0, k)
    flyable(nav)


def anchored(flown: MotionState, now_ns: int, start_ns: int, k: OuterParams) -> Trajectory:
    """A reference that moves so about now, within the controller's window, to be diverted.

    Parameters
    ----------
    flown : MotionState
    now_ns, start_ns : int
        Stamps of now and of flight time 0.
    """
    window_s = k.shaping_ns / NS_PER_S
    behind = -(-k.shaping_ns // _STEP_NS) + 1
    ahead = foreseen_ns(k.shaping_ns) // _STEP_NS + 3
    steps = np.arange(-behind, ahead + 1)
    t = (steps * STEP_S)[:, None]
    pos, vel, acc = flown.ned
    points = np.zeros((steps.size, REFERENCE.size))
    # An average over the window is that much ahead of a parabola.
    points[:, REFERENCE.pos] = pos - acc * window_s**2 / 24.0 + vel * t + 0.5 * acc * t * t
    points[:, REFERENCE.vel] = vel + acc * (t + 0.5 * STEP_S)
    psi, rate, _ = flown.psi
    points[:, REFERENCE.psi] = [wrap_pi(psi + rate * float(at)) for at in t[:, 0]]
    return Trajectory(start_ns, now_ns - start_ns + steps * _STEP_NS, points)


def preview(flown: MotionState, now_ns: int, start_ns: int) -> Trajectory:
    """Where a pilot seems to go: straight on for a second. Nothing follows it."""
    pos, vel, _ = flown.ned
    psi = flown.psi[0]
    points = np.array([np.r_[pos, vel, psi], np.r_[pos + vel, np.zeros(3), psi]])
    points[1, REFERENCE.pos] = pos + vel * GLIMPSE_NS / NS_PER_S
    return Trajectory(start_ns, now_ns - start_ns + np.array([0, GLIMPSE_NS]), points)


# -------------------------------------------------------------------------------------------------
# What a reference may ask for, whoever sends it. No ROS.
# -------------------------------------------------------------------------------------------------

_AHEAD_S = 60.0
"""A trajectory may be sent before it begins, but not stamped by another clock."""


class ReferenceRefused(CausedError):
    """A reference that is not followed; `cause` is a `RefusalCause`, or the `PathCause` of it."""


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
                RefusalCause.NO_ALTITUDE_LEFT,
                f"reference_limits: altitude_min_m {made.altitude_min_m:g} is not below "
                f"altitude_max_m {made.altitude_max_m:g}",
            )
        return made

    def judge(self, trajectory: Trajectory, home_ned_m: NDArray[np.float64], now_ns: int) -> None:
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
        ahead_s = (trajectory.start_ns - now_ns) / NS_PER_S
        if trajectory.start_ns < 0 or ahead_s > _AHEAD_S:
            raise ReferenceRefused(
                RefusalCause.STAMP,
                f"stamped {trajectory.start_ns / NS_PER_S:.2f} s; now is {now_ns / NS_PER_S:.2f} "
                f"s, allowed: at most {_AHEAD_S:g} s later",
            )
        for number, point in enumerate(trajectory.points[:, REFERENCE.pos]):
            self.judge_place(f"point {number}", point, home_ned_m)

    def fence_distance_m(
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
                RefusalCause.ALTITUDE,
                f"{name} is {up:.1f} m high; allowed: {self.altitude_min_m:g} to "
                f"{self.altitude_max_m:g} m",
            )
        if not away <= self.distance_m:
            raise ReferenceRefused(
                RefusalCause.DISTANCE,
                f"{name} is {away:.0f} m from where the flight began; allowed: at most "
                f"{self.distance_m:g} m",
            )
