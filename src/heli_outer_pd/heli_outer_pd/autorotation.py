# SPDX-License-Identifier: Apache-2.0
"""Down without an engine: what the rotor still holds, spent on a slow touch-down.

The vertical speed follows a profile over the height above the ground: fast at first, which takes
little power, then slower at a constant deceleration, and in the last part in proportion to the
height. The blade pitch is that of the thrust map at the speed that the rotor has: as it slows down
the pitch rises, until all that turns has been spent. Horizontally and in heading the position law
flies on, its tilt held small. Whether the rotor is slow: `rotor_watch`.
"""

import math

from heli_math.jit import njit
from heli_math.rows import NAV, SETPOINT
from heli_outer_pd.disturbance import clip, trim_thrust
from heli_outer_pd.outer_state import MEMORY
from heli_outer_pd.thrust_map import RotorMap, blade_pitch

_FASTEST_MPS, _TOUCH_MPS, _SLOWS_MPS2, _LAST_S = 9.0, 0.7, 5.0, 0.6
"""Of the profile: speed at most and at the ground, m/s; deceleration; height over speed at last, s.
These and the next ones are tuned from 10 m and 20 m, worlds honest and hard, seeds 1 to 6."""
_BACK = 4.0
"""A speed that is off is brought back so, 1/s."""
_LEAST, _MOST = 0.05, 2.0
"""Thrust over weight."""
_THROUGH_MPS = 2.0
"""The map is read at no faster descent: beyond it the air through the disc is turbulent."""
_SLOWEST = 0.35
"""Nor at a rotor speed below this share: there the blades stall."""
_GEAR_M = 0.25
"""Ground that is met before the navigation is at its height."""
_TILT_RAD = math.radians(20.0)
_COLLECTIVE_LIMIT = 0.98


@njit
def wanted_sink(height_m):
    """Speed down (m/s) at a height above the ground (m), and how fast it should fall (1/s)."""
    height = max(height_m, 0.0)
    slowing = math.sqrt(_TOUCH_MPS * _TOUCH_MPS + 2.0 * _SLOWS_MPS2 * height)
    last = _TOUCH_MPS + height / _LAST_S
    if slowing <= last:
        if slowing >= _FASTEST_MPS:
            return _FASTEST_MPS, 0.0
        return slowing, _SLOWS_MPS2 / slowing if height > 0.0 else 0.0
    if last >= _FASTEST_MPS:
        return _FASTEST_MPS, 0.0
    return last, 1.0 / _LAST_S if height > 0.0 else 0.0


@njit
def autorotate(nav, k, state, out):
    """Replace the collective of a command (4,), in place, and hold its tilt small.

    Parameters
    ----------
    nav : (31,) array
        Navigation row.
    k : OuterKernel
    state : (85,) array
        Of the law, places of `MEMORY`; remembers the command and no disturbance downwards.
    out : (4,) array
        Places of `heli_math.rows.SETPOINT`.
    """
    down = nav[NAV.down_vel]
    wanted, slows = wanted_sink(state[MEMORY.ground_m] - nav[NAV.pos][2] - _GEAR_M)
    speeds_up = _BACK * (wanted - down) - slows * max(down, 0.0)
    share = min(max((k.g - speeds_up) / k.g, _LEAST), _MOST)
    r = k.rotor
    omega = r.omega * max(state[MEMORY.rotor_known], _SLOWEST)
    slow = RotorMap(r.rho, omega, r.radius, r.lift_slope, r.blades, r.chord, r.K_col)
    pitch = blade_pitch(share * k.mass * k.g, min(down, _THROUGH_MPS), slow)
    step = pitch - blade_pitch(trim_thrust(k), 0.0, r)
    out[SETPOINT.col] = clip(k.trim[SETPOINT.col] + step / r.K_col, _COLLECTIVE_LIMIT)
    last = state[MEMORY.command]
    for i in range(SETPOINT.psi):
        out[i] = k.trim[i] + clip(out[i] - k.trim[i], _TILT_RAD)
    for i in range(SETPOINT.size):
        last[i] = out[i]
    state[MEMORY.disturbance][2] = 0.0
