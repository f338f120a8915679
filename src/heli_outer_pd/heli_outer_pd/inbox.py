# SPDX-License-Identifier: Apache-2.0
"""What the outer loop has heard: the newest navigation, carried on while it is late; the rotor."""

from typing import NamedTuple

import numpy as np

from heli_core.inbox import NOTHING, has_come
from heli_core.jit import by_reference, copy_part, fill, njit
from heli_core.rows import NAV
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_outer_pd.disturbance import hear_rotor
from heli_outer_pd.state import MEMORY

INPUTS = (topics.ODOM, topics.ROTOR_SPEED)
"""What the outer loop hears, in the order of its inbox."""
_ODOM, _ROTOR_SPEED = range(len(INPUTS))


@by_reference
class HeardNavigation(NamedTuple):
    """The newest navigation row, changed in place; its stamp says how old it is."""

    nav: np.ndarray  # (31,)
    tick: np.ndarray  # (1,) int64, of its stamp
    timeout_ticks: int  # older it is none any more
    tick_s: float


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
def listen(state, heard, inbox, tick, k):
    """Take what has come for a tick.

    Parameters
    ----------
    state : OuterState
        In place.
    heard : HeardNavigation
        In place.
    inbox : Inbox
        Places of `INPUTS`.
    tick : int
    k : OuterParams
    """
    if has_come(inbox, _ODOM):
        keep_newest(heard, inbox.stamps[_ODOM], inbox.rows[_ODOM])
    if has_come(inbox, _ROTOR_SPEED):
        now_s = inbox.stamps[_ROTOR_SPEED] * heard.tick_s
        hear_rotor(state, now_s, inbox.rows[_ROTOR_SPEED, 0], k)


@njit
def navigate(state, heard, tick, nav):
    """Navigation of a tick at which the law steps, into nav (31,); the law knows if it is late."""
    is_late = navigation_at(heard, tick, nav)
    state.x[MEMORY.is_late] = 1.0 if is_late else 0.0
