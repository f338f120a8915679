# SPDX-License-Identifier: Apache-2.0
"""By hand: what the outer loop does while a pilot flies the actuators, and how another goes on."""

import math

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import copy, fill, is_zero, njit, scratch
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, SETPOINT
from heli_outer_pd.disturbance import (
    estimate,
    flown_acceleration,
    flyable,
    hover_share,
    trim_thrust,
)
from heli_outer_pd.state import (
    BY_HAND,
    MACHINE,
    MEMORY,
    OuterState,
    OuterStatus,
    collective_for_thrust,
)

_OK = int(OuterStatus.OK)
_BAD_NAVIGATION = int(OuterStatus.BAD_NAVIGATION)
_FADE_S = 0.5
"""Time constant with which what another has flown fades; as the attitude controller's."""

_AT_LIMIT = 1e-3
"""Nearer to a limit of the thrust, as a share of the weight, a collective is at it."""


@njit
def manual_deflections(state, manual):
    """A pilot's d_lat, d_lon, d_ped about trim into hand (3,); NaN while a controller flies."""
    if state.machine[MACHINE.guidance] >= BY_HAND:
        copy(manual, state.x[MEMORY.manual])
    else:
        fill(manual, math.nan)


def with_manual(collective: NDArray[np.float64], state: OuterState) -> NDArray[np.float64]:
    """A collective (1,), and behind it the pilot's deflections while one flies by hand: (4,)."""
    manual = np.empty(3)
    manual_deflections(state, manual)
    return collective if np.isnan(manual).any() else np.append(collective, manual)


@njit
def manual_law(nav, k, state, out):
    """One step beside a pilot: the collective is the stick's, the attitude what is measured.

    The estimate of the disturbance goes on, so that whoever takes over knows the wind. Arguments
    and outcome as of `position_law`; without navigation the sticks are flown all the same.
    """
    last = state.x[MEMORY.command]
    known = flyable(nav)
    if known:
        phi, theta, psi = euler_from_quat(nav[NAV.quat])
        estimate(nav, phi, theta, math.cos(psi), math.sin(psi), k, state, scratch(3))
        last[SETPOINT.phi], last[SETPOINT.theta], last[SETPOINT.psi] = phi, theta, psi
        # No lag between this attitude and the acceleration.
        flown_acceleration(phi, theta, k, state.x[MEMORY.lagged])
        state.x[MEMORY.engaged] = 1.0
    last[SETPOINT.col] = state.x[MEMORY.manual_col]
    for i in range(SETPOINT.size):
        out[i] = last[i]
    return _OK if known else _BAD_NAVIGATION


@njit
def collective_limits(k):
    """Collectives (2,) of the smallest and the largest thrust, in still air; ascending."""
    weight, trim = k.mass * k.g, k.trim[SETPOINT.col]
    low = collective_for_thrust(k.thrust_limits[0] * weight, 0.0, trim_thrust(k), trim, k.rotor)
    high = collective_for_thrust(k.thrust_limits[1] * weight, 0.0, trim_thrust(k), trim, k.rotor)
    return min(low, high), max(low, high)


@njit
def least_thrust(k, state):
    """Least thrust (N) that the still-air map may be asked for.

    What the air lifts besides, as edgewise flow and an upward gust do, is thrust of the rotor, too:
    both together stay above the limit. Not where it comes down for want of a position: there the
    ground is felt by what carries.
    """
    lift_mps2 = max(-state.x[MEMORY.disturbance][2], 0.0)
    if state.x[MEMORY.gone] > 0.5:
        lift_mps2 = 0.0
    return k.mass * max(k.thrust_limits[0] * k.g - lift_mps2, 0.0)


@njit
def above_floor(d_col, k):
    """The collective, but with no less blade pitch than the floor's."""
    if k.rotor.K_col < 0.0:
        return min(d_col, k.collective_floor)
    return max(d_col, k.collective_floor)


@njit
def count_at_limit(col, k, state):
    """How long a collective has stood at the limits of the thrust, into the state."""
    weight, high = k.mass * k.g, k.thrust_limits[1]
    low = least_thrust(k, state) / weight
    low = max(low, hover_share(k.collective_floor, k) * trim_thrust(k) / weight)
    share = hover_share(col, k) * trim_thrust(k) / weight
    free = low + _AT_LIMIT < share < high - _AT_LIMIT
    state.x[MEMORY.at_limit_s] = 0.0 if free else state.x[MEMORY.at_limit_s] + k.dt_s


@njit
def take_over(before, k, state, out):
    """Go on from the last command (4,) of who flew before: the difference to it fades.

    Changes `out` (4,) and what the state remembers of it; no collective passes the limits of the
    thrust that the controller alone would not have passed.
    """
    fade, last = state.x[MEMORY.fade], state.x[MEMORY.command]
    if state.x[MEMORY.takes_over] > 0.5:
        state.x[MEMORY.takes_over] = 0.0
        for i in range(SETPOINT.size):
            fade[i] = before[i] - out[i]
        fade[SETPOINT.psi] = wrap_pi(fade[SETPOINT.psi])
    if is_zero(fade):
        return
    low, high = collective_limits(k)
    low, high = min(low, out[SETPOINT.col]), max(high, out[SETPOINT.col])
    for i in range(SETPOINT.size):
        out[i] += fade[i]
    out[SETPOINT.col] = min(max(out[SETPOINT.col], low), high)
    keep = math.exp(-k.dt_s / _FADE_S)
    for i in range(SETPOINT.size):
        fade[i] *= keep
        last[i] = out[i]
