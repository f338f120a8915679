# SPDX-License-Identifier: Apache-2.0
"""Navigation of now, from what was heard last: its stamp says how old it is."""

from typing import NamedTuple

import numpy as np

from heli_math.arrays import copy, fill
from heli_math.jit import njit
from heli_math.rows import NAV

_NEVER = -(2**62)


class Heard(NamedTuple):
    """The newest navigation row, changed in place."""

    nav: np.ndarray  # (31,)
    tick: np.ndarray  # (1,) int64, of its stamp


def nothing_heard() -> Heard:
    """Before the first message."""
    return Heard(np.full(NAV.size, np.nan), np.full(1, _NEVER, np.int64))


@njit
def hear(heard, stamp, nav):
    """Keep a navigation row (31,) stamped with a tick, if it is newer than the last one."""
    if stamp > heard.tick[0]:
        copy(heard.nav, nav)
        heard.tick[0] = stamp


@njit
def navigation_at(heard, tick, timeout_ticks, tick_s, out):
    """The newest row, its position carried on by its velocity, into out (31,); NaN if too old.

    Attitude and velocity stay as they were heard.
    """
    age = tick - heard.tick[0]
    if not 0 <= age <= timeout_ticks:
        fill(out, np.nan)
        return
    copy(out, heard.nav)
    if age > 0:
        pos, vel = out[NAV.pos], out[NAV.vel]
        for i in range(pos.shape[0]):
            pos[i] += age * tick_s * vel[i]
