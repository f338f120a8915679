# SPDX-License-Identifier: Apache-2.0
"""Altitude without a sensor that knows it: down by thrust alone.

Without fixes and barometer the vertical velocity is the integral of an accelerometer, and its error
grows without bound. What does not drift is the rotor: at a thrust that carries the weight it climbs
or sinks at the speed at which its map gives that thrust, and its own damping holds this. So the
collective is that of the descent that is wanted, with the disturbance as it was at rest; of the
navigation's velocity what is fast is fed back, what is slow is its error.

That the ground carries it shows in the same way: thrust is taken away for a moment now and then,
and in the air that speeds up the descent at once, which the accelerometer sees.
"""

import math

from heli_math.jit import njit
from heli_math.rows import NAV, SHAPED
from heli_outer_pd.disturbance import clip
from heli_outer_pd.outer_state import KNOWN, LEAVES, MEMORY, RISES, SEES, SINKS

_AGAIN, _LANDING = 0.8, 0.5
"""Known again with so much of the limit; in a landing the limit is so much of it."""
_LASTS_S = 1.0
"""Not known for so long: an IMU that stops for a moment leaves a doubt that the next fixes take."""
_MEAN_S = 10.0
"""The disturbance is averaged over so long."""
_FAST_S, _DAMPING = 2.0, 1.5
"""What is faster than the first, s, is fed back by the second, 1/s. A velocity whose error grows by
a m/s2 costs a times both over the rotor's own damping."""
_HEAVE, _BY_THRUST_MPS = 0.7, 0.5
"""The rotor's own damping, 1/s; what thrust alone leaves of the speed, sigma: translational lift,
a rotor weaker than its map."""
_CHANGE_MPS2 = 0.5
"""So fast the descent's speed is changed."""
_LATE_M, _HASTE = 2.0, 0.2
"""Where it should be so far below the ground it sinks too slowly: faster by so much, 1/s, of it."""
_EVERY_S, _EASE_MPS3, _MOST_MPS2, _FALLS_MPS = 3.0, 3.0, 4.5, 0.35
"""So often thrust is taken away, more and more, to the most, until it has sped up by the last."""


@njit
def sigma_of_climb(nav):
    """Standard deviation of the vertical velocity, m/s; 0 where none is said."""
    most = 0.0
    for sigma in nav[NAV.sigma_vel][2:]:
        if sigma > most:
            most = sigma
    return most


@njit
def look_down(nav, k, state):
    """Bring up to a navigation row whether the vertical velocity is known."""
    blind = state[MEMORY.sinks] == SINKS
    limit = k.blind_sigma_down * (_LANDING if state[MEMORY.lands] > 0.5 else 1.0)
    doubtful = sigma_of_climb(nav) > limit * (_AGAIN if blind else 1.0)
    state[MEMORY.doubt_s] = state[MEMORY.doubt_s] + k.dt_s if doubtful else 0.0
    if doubtful and (blind or state[MEMORY.doubt_s] > _LASTS_S):
        if not blind:
            state[MEMORY.takes_over] = 1.0
            state[MEMORY.sink_mps], state[MEMORY.slow_mps] = nav[NAV.down_vel], 0.0
            state[MEMORY.probe_s] = state[MEMORY.eased_mps2] = 0.0
            state[MEMORY.sunk_m] = nav[NAV.pos][2]
        state[MEMORY.sinks] = SINKS
    elif blind and not doubtful:
        state[MEMORY.takes_over] = 1.0
        state[MEMORY.sinks] = RISES


@njit
def remember_thrust(k, state):
    """Average what thrust is missing in the air while position and speed are known."""
    if state[MEMORY.ground] == LEAVES or state[MEMORY.sight] != KNOWN:
        return
    if state[MEMORY.sinks] == SEES and state[MEMORY.engaged] > 0.5:
        error = state[MEMORY.disturbance][2] - state[MEMORY.rest_down]
        state[MEMORY.rest_down] += k.dt_s / _MEAN_S * error


@njit
def _ease(v_down, k, state):
    """Thrust that is taken away to feel for the ground, m/s2."""
    state[MEMORY.probe_s] += k.dt_s
    eased = state[MEMORY.eased_mps2]
    if eased == 0.0:
        if state[MEMORY.probe_s] < _EVERY_S:
            return 0.0
        state[MEMORY.probe_mps] = v_down
    elif v_down - state[MEMORY.probe_mps] > _FALLS_MPS:
        state[MEMORY.probe_s] = state[MEMORY.eased_mps2] = 0.0
        return 0.0
    state[MEMORY.eased_mps2] = min(eased + _EASE_MPS3 * k.dt_s, _MOST_MPS2)
    return state[MEMORY.eased_mps2]


@njit
def sink(nav, ref, k, state, d_h):
    """Fly on, or down in a landing, by thrust: changes reference (10,) and disturbance d_h (3,)."""
    v_down, wanted, eased = nav[NAV.down_vel], 0.0, 0.0
    if state[MEMORY.lands] > 0.5 and ref[SHAPED.down_vel] > 0.0:
        late_m = max(state[MEMORY.sunk_m] - state[MEMORY.ground_m] - _LATE_M, 0.0)
        wanted = k.blind_descent_mps + _HASTE * late_m
        eased = _ease(v_down, k, state)
    state[MEMORY.sink_mps] += clip(wanted - state[MEMORY.sink_mps], _CHANGE_MPS2 * k.dt_s)
    state[MEMORY.sunk_m] += k.dt_s * min(state[MEMORY.sink_mps], k.blind_descent_mps)
    fast = v_down - state[MEMORY.sink_mps] - state[MEMORY.slow_mps]
    state[MEMORY.slow_mps] += (1.0 - math.exp(-k.dt_s / _FAST_S)) * fast
    ref[SHAPED.pos][2] = nav[NAV.pos][2]
    ref[SHAPED.down_vel], ref[SHAPED.acc][2] = state[MEMORY.sink_mps], 0.0
    state[MEMORY.vel][2], state[MEMORY.disturbance][2] = v_down, state[MEMORY.rest_down]
    # Of two witnesses of the speed the surer one has more weight.
    doubt = sigma_of_climb(nav) / _BY_THRUST_MPS
    steady = min(_HEAVE / (doubt * doubt), k.K_D[2])
    over = v_down - state[MEMORY.sink_mps]
    back = steady * over + max(_DAMPING - steady, 0.0) * fast
    if eased > 0.0:
        back = steady * (state[MEMORY.probe_mps] - state[MEMORY.sink_mps])
    # The law itself feeds back K_D times all of the difference.
    d_h[2] = state[MEMORY.rest_down] - k.K_D[2] * over + back - eased
