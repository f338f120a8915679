# SPDX-License-Identifier: Apache-2.0
"""Whether the rotor is too slow, and whether the sensor that says so is to be believed.

Its speed as a share of the governed one. A sensor is believed after some samples at the usual
speed, and from there on as long as it goes on from sample to sample as a rotor can: what jumps,
stands still to the last bit, is zero or silent is not believed until it says the usual speed again.
So a sensor that fails says nothing of the rotor. One that drifts as slowly as a rotor might is
believed.
"""

import math

from heli_math.jit import njit
from heli_outer_pd.outer_state import AUTOROTATES, DOWN, FLIES, LEAVES, MEMORY, STEERED, TURNS

_USUAL, _SAMPLES = 0.03, 5
"""So near to the governed speed so many samples in a row are believed."""
_FALLS, _JITTER = 0.6, 0.012
"""Largest change from sample to sample: share per second, and what noise makes of it besides. With
the engine off the default aircraft loses 0.13 a second in hover."""
_SILENT_S = 0.1
_STUCK = 10
"""So many samples in a row the same to the last bit are no measurement."""
_AGAIN, _AGAIN_S, _SINKS_MPS = 0.97, 0.1, 6.0
"""At this share for so long an engine drives it; without one it stays below 0.93."""
_STILL_MPS, _STILL_S, _NEAR_M = 0.2, 0.32, 4.0
"""On the ground: it sinks no more, for so long, and is near it, as far as that is known."""


@njit
def hear_rotor(state, time_s, speed, k):
    """Take a sample of the rotor's speed, rad/s, stamped with a flight time, s.

    Parameters
    ----------
    state : (85,) array
        Of the law; changed in place.
    time_s : float
    speed : float
    k : OuterKernel
    """
    since = time_s - state[MEMORY.rotor_s]
    if since <= 0.0:
        return
    share, last = speed / k.rotor.omega, state[MEMORY.rotor]
    state[MEMORY.rotor], state[MEMORY.rotor_s] = share, time_s
    state[MEMORY.rotor_same] = state[MEMORY.rotor_same] + 1.0 if share == last else 0.0
    sound = math.isfinite(share) and since < _SILENT_S and state[MEMORY.rotor_same] < _STUCK
    sound = sound and abs(share - last) <= _FALLS * since + _JITTER
    usual = abs(share - 1.0) < _USUAL
    if not sound or (state[MEMORY.rotor_sound] < _SAMPLES and not usual):
        state[MEMORY.rotor_sound] = 0.0
    elif usual and state[MEMORY.rotor_sound] < _SAMPLES:
        state[MEMORY.rotor_sound] += 1.0
    believed = state[MEMORY.rotor_sound] >= _SAMPLES
    if believed:
        state[MEMORY.rotor_known] = share
    slow = believed and share < k.rotor_slow_share
    state[MEMORY.slow_s] = state[MEMORY.slow_s] + since if slow else 0.0
    driven = believed and share > _AGAIN
    state[MEMORY.driven_s] = state[MEMORY.driven_s] + since if driven else 0.0


@njit
def watch_rotor(down_m, down_mps, k, state):
    """Bring up to a step of the law whether it autorotates; not on the ground, nor by hand.

    Parameters
    ----------
    down_m, down_mps : float
        Of the navigation, NED.
    k : OuterKernel
    state : (85,) array
        Changed in place.
    """
    ground = state[MEMORY.ground]
    if not (ground == FLIES or ground == LEAVES or ground == STEERED):
        state[MEMORY.spin], state[MEMORY.still_s] = TURNS, 0.0
        return
    if state[MEMORY.spin] == TURNS:
        if state[MEMORY.slow_s] >= k.rotor_slow_s:
            state[MEMORY.spin], state[MEMORY.still_s] = AUTOROTATES, 0.0
        return
    if state[MEMORY.spin] == AUTOROTATES:
        if state[MEMORY.driven_s] >= _AGAIN_S and down_mps < _SINKS_MPS:
            state[MEMORY.spin], state[MEMORY.takes_over] = TURNS, 1.0
            return
        near = state[MEMORY.ground_m] - down_m < _NEAR_M
        still = near and abs(down_mps) < _STILL_MPS and state[MEMORY.rotor_known] < _AGAIN
        state[MEMORY.still_s] = state[MEMORY.still_s] + k.dt_s if still else 0.0
        if state[MEMORY.still_s] >= _STILL_S:
            state[MEMORY.spin] = DOWN
