# SPDX-License-Identifier: Apache-2.0
"""A fix after a gap moves the navigation by metres: the reference is moved with it, and back again.

What is flown back then is a way at a limited speed, not a step of the error.
"""

import math

from heli_math.arrays import copy, is_zero, scratch
from heli_math.jit import njit
from heli_math.rows import NAV, SHAPED
from heli_outer_pd.outer_state import MEMORY

_BACK_S, _BACK_MPS, _BACK_DOWN_MPS = 2.0, 1.0, 0.3
"""Time constant, largest speed and largest vertical speed with which the reference goes back."""
_GONE_M = 1e-3


@njit
def remember_place(nav, state):
    """Where the navigation puts the aircraft at this step."""
    copy(state[MEMORY.was_pos], nav[NAV.pos][:2])
    copy(state[MEMORY.was_vel], nav[NAV.vel][:2])


@njit
def move_with(nav, k, state):
    """Move the reference by what a fix has moved the navigation.

    The estimate takes the velocity as it comes: a correction is no gust.
    """
    shift, estimate = state[MEMORY.shift], state[MEMORY.vel]
    pos, vel = state[MEMORY.was_pos], state[MEMORY.was_vel]
    for i in range(2):
        shift[i] += nav[NAV.pos][i] - pos[i] - k.dt_s * vel[i]
        estimate[i] += nav[NAV.vel][i] - vel[i]


@njit
def begin_at_height(nav, ref, state):
    """Move the reference (10,), as it comes, to the height at which the navigation is."""
    state[MEMORY.shift][2] = nav[NAV.pos][2] - ref[SHAPED.pos][2]


@njit
def move_reference(ref, k, state):
    """Move the reference (10,) by what is left, which goes back to nothing."""
    shift, rate = state[MEMORY.shift], scratch(3)
    if is_zero(shift):
        return
    level = math.hypot(shift[0], shift[1])
    rate[0] = rate[1] = min(1.0 / _BACK_S, _BACK_MPS / max(level, _GONE_M))
    rate[2] = min(1.0 / _BACK_S, _BACK_DOWN_MPS / max(abs(shift[2]), _GONE_M))
    for i in range(3):
        speed = -rate[i] * shift[i]
        shift[i] += k.dt_s * speed
        ref[SHAPED.pos][i] += shift[i]
        ref[SHAPED.vel][i] += speed
    if level + abs(shift[2]) < _GONE_M:
        for i in range(3):
            shift[i] = 0.0
