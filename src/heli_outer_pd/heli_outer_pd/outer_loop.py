# SPDX-License-Identifier: Apache-2.0
"""One tick of the outer loop: what has come, where the aircraft is, where the reference begins, the
controller.

`step` is all of it, whoever fills the inbox: the node from its topics, the one-process loop from
its links. A controller in Python steps through `python_controller.OwnPositionLaw`, in the same
place. After a step of the controller `phases.Phases.after` is asked what follows from it.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from heli_core.inbox import NOTHING, has_come
from heli_core.jit import by_reference, copy, copy_part, fill, njit
from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_outer_pd.disturbance import flyable, hear_rotor
from heli_outer_pd.position_health import begin_above
from heli_outer_pd.position_law import follow
from heli_outer_pd.reference import fill_offset, move
from heli_outer_pd.state import MEMORY, OuterParams, OuterState, initial_state

INPUTS = (topics.ODOM, topics.ROTOR_SPEED)
"""What the outer loop hears, in the order of its inbox."""
_ODOM, _ROTOR_SPEED = range(len(INPUTS))
NOT_DUE = -1
"""Outcome of a tick between two steps of the controller; else it is an `OuterStatus`."""


class EngagementRow(NamedTuple):
    """Places of `OuterLoopState.engagement` (3,), integers."""

    reference: int = 0  # what becomes of it at the first step with a position: AS_GIVEN, ...
    tick: int = 1  # of that step; NOTHING before
    velocity: int = 2  # 1: after a gap, it is still to be estimated from that of the navigation
    size: int = 3


ENGAGEMENT = EngagementRow()
AS_GIVEN, MOVED, HELD = range(3)
"""The reference is flown where it says; is moved to begin where the aircraft is; its first point
becomes place and heading of the aircraft, which are held for want of a reference."""


def begins(values: Mapping[str, Any]) -> int:
    """AS_GIVEN or MOVED, by the outer loop's parameters: what becomes of a reference.

    From the ground nothing is moved: the aircraft's place says how high that is, not a reference.
    """
    moves = values["reference_anchor"] == "engagement" and not values["start.on_ground"]
    return MOVED if moves else AS_GIVEN


@by_reference
class HeardNavigation(NamedTuple):
    """The newest navigation row, changed in place; its stamp says how old it is."""

    nav: np.ndarray  # (31,)
    tick: np.ndarray  # (1,) int64, of its stamp
    timeout_ticks: int  # older it is none any more
    tick_s: float


@by_reference
class OuterLoopState(NamedTuple):
    """What the outer loop knows from one tick to the next, changed in place."""

    law: OuterState
    heard: HeardNavigation
    nav: np.ndarray  # (31,) navigation at the controller's last step
    engagement: np.ndarray  # (3,) int64, places of `ENGAGEMENT`
    offset_ned_m: np.ndarray  # (3,) by which the reference was moved, m


def no_navigation(timeout_s: float, rate: Rate) -> HeardNavigation:
    """Before the first message.

    Parameters
    ----------
    timeout_s : float
        Age of navigation that is none any more.
    rate : Rate
        Of the ticks.
    """
    oldest = max(1, rate.ticks_in(timeout_s))
    return HeardNavigation(
        np.full(NAV.size, np.nan), np.full(1, NOTHING, np.int64), oldest, rate.tick_s
    )


def initial_loop(
    k: OuterParams, timeout_s: float, rate: Rate, reference: int = AS_GIVEN
) -> OuterLoopState:
    """Before the first tick.

    Parameters
    ----------
    k : OuterParams
    timeout_s, rate
        As of `no_navigation`.
    reference : int
        What becomes of the reference where the controller engages: AS_GIVEN, MOVED or HELD.
    """
    heard, nav = no_navigation(timeout_s, rate), np.full(NAV.size, np.nan)
    engagement = np.array([reference, NOTHING, 0], np.int64)
    return OuterLoopState(initial_state(k), heard, nav, engagement, np.zeros(3))


@njit
def keep_newest(heard, stamp, nav):
    """Keep a navigation row (31,) stamped with a tick, if it is newer than the last one."""
    if stamp > heard.tick[0]:
        copy_part(heard.nav, 0, nav, 0, NAV.size)
        heard.tick[0] = stamp


@njit
def navigation_at(heard, tick, out):
    """The newest row, its position carried on by its velocity, into out (31,); NaN if too old.

    Attitude and velocity stay as they were heard. True if it is of another tick, or none.
    """
    age = tick - heard.tick[0]
    if not 0 <= age <= heard.timeout_ticks:
        fill(out, np.nan)
        return True
    copy_part(out, 0, heard.nav, 0, NAV.size)
    if age > 0:
        pos, vel = out[NAV.pos], out[NAV.vel]
        for i in range(pos.shape[0]):
            pos[i] += age * heard.tick_s * vel[i]
    return age > 0


@njit
def _listen(state, inbox, k):
    """Take what has come for a tick."""
    heard = state.heard
    if has_come(inbox, _ODOM):
        keep_newest(heard, inbox.stamps[_ODOM], inbox.rows[_ODOM])
    if has_come(inbox, _ROTOR_SPEED):
        now_s = inbox.stamps[_ROTOR_SPEED] * heard.tick_s
        hear_rotor(state.law, now_s, inbox.rows[_ROTOR_SPEED, 0], k)


@njit
def _navigate(state, tick):
    """The state estimate at a step of the controller, into `nav`; it knows if that is late."""
    is_late = navigation_at(state.heard, tick, state.nav)
    state.law.x[MEMORY.is_late] = 1.0 if is_late else 0.0


@njit
def _engage(state, tick, time_ns, times_ns, points):
    """At the first step with a position: where the reference begins, and how fast it is."""
    nav, law, engagement = state.nav, state.law, state.engagement
    engaged = engagement[ENGAGEMENT.tick] != NOTHING
    if engaged and engagement[ENGAGEMENT.velocity] == 0:
        return
    known, reference = flyable(nav), engagement[ENGAGEMENT.reference]
    if not known:
        if not engaged and reference == HELD:
            fill(nav, np.nan)  # nothing to hold yet
        return
    if engagement[ENGAGEMENT.velocity] != 0:
        # The controller's estimate is of another moment; what it knows of the disturbance stays.
        copy(law.x[MEMORY.vel], nav[NAV.vel])
        engagement[ENGAGEMENT.velocity] = 0
    if engaged:
        return
    if reference == MOVED:
        fill_offset(nav[NAV.pos], time_ns, times_ns, points, state.offset_ned_m)
        move(points, state.offset_ned_m)
        begin_above(state.offset_ned_m[2], law)
    elif reference == HELD:
        fill(points[0], 0.0)
        copy(points[0, REFERENCE.pos], nav[NAV.pos])
        points[0, REFERENCE.psi] = euler_from_quat(nav[NAV.quat])[2]
    engagement[ENGAGEMENT.tick] = tick


@njit
def step(state, inbox, tick, period_ticks, time_ns, times_ns, points, k, out):
    """One tick of the outer loop: hear; and every `period_ticks` navigate, engage, follow.

    Parameters
    ----------
    state : OuterLoopState
        In place; of a tick at which the controller steps `nav` is what it has flown by.
    inbox : Inbox
        Places of `INPUTS`.
    tick, period_ticks : int
    time_ns : int
        Time since the trajectory's own start.
    times_ns, points : ndarray
        See `heli_core.trajectory.Trajectory`; the points are changed in place at the engagement
        if the reference is MOVED or HELD.
    k : OuterParams
    out : (4,) array
        Out, where the controller steps: places of `heli_core.rows.SETPOINT`, absolute.

    Returns
    -------
    int
        NOT_DUE, or an OuterStatus as of `position_law.follow`.
    """
    _listen(state, inbox, k)
    if tick % period_ticks:
        return NOT_DUE
    _navigate(state, tick)
    _engage(state, tick, time_ns, times_ns, points)
    return follow(state.nav, time_ns, times_ns, points, k, state.law, out)
