# SPDX-License-Identifier: Apache-2.0
"""The attitude law from the ground to the air and back, and by hand: what the loops call.

Skids hold attitude and heading against whatever the law does, so a law with memory winds up there;
cyclic that it then commands tips the aircraft over the skid that touches last (dynamic rollover:
FAA-H-8083-21B, Helicopter Flying Handbook, ch. 11). So while the collective is one of standing
(`AttitudeKernel.ground_collective`) the memory is at rest and cyclic and pedal fade to trim; with
more collective the law goes on from them as `swap_bumpless` does: its memory as at rest with what
is read and commanded, and the difference to what it would command fades.

By hand a pilot's deflections about trim are flown in its place: nothing between stick and actuator
but the yaw-rate gyro of the aircraft. The law then goes on in the same way.
"""

from heli_inner_hinf.attitude_law import attitude_law, linear_law, output_feedback
from heli_inner_hinf.law_state import (
    INTEGRAL,
    LAST_U,
    MEMORY,
    N_LAW_STATE,
    OFFSET,
    OUTPUT_FEEDBACK,
    PID,
    RELAXED,
    RUN,
    AttitudeStatus,
    all_finite,
    remember,
)
from heli_inner_hinf.output_law import N_V, read_inputs
from heli_inner_hinf.pid import pid_terms
from heli_math.arrays import scratch
from heli_math.jit import njit

_NOT_FINITE = int(AttitudeStatus.NOT_FINITE)
_ON_GROUND = int(AttitudeStatus.ON_GROUND)
_BY_HAND, _SATURATED = int(AttitudeStatus.BY_HAND), int(AttitudeStatus.SATURATED)
_AT_REST, _HANDED = 1.0, 2.0


@njit
def stands(collective, k):
    """Whether a collective (-1..1) is one of standing; k is an AttitudeKernel. NaN is not."""
    return (collective - k.ground_collective) * k.ground_side > 0.0


@njit
def _relax(x9, r3, k, state, u3):
    """One tick at rest: memory as of a law that has flown its trim, output on its way there."""
    for i in range(3):
        away = state[LAST_U + i] - k.u_trim[i]
        u3[i] = k.u_trim[i] + k.offset_decay * away
        state[LAST_U + i] = u3[i]
        state[INTEGRAL + i] = 0.0
        state[OFFSET + i] = 0.0
    for i in range(MEMORY, N_LAW_STATE):
        state[i] = 0.0
    state[RELAXED] = _AT_REST
    if not (all_finite(x9) and all_finite(r3)):
        return _NOT_FINITE
    remember(x9, r3, state)
    state[RUN] = 1.0
    return _ON_GROUND


@njit
def _take_up(x9, r3, k, state):
    """Go on from rest: the first command is that of the last tick; the memory is all zeros here."""
    remember(x9, r3, state)
    would = scratch(3)
    if k.controller == PID:
        pid_terms(x9, r3, k, scratch(3), would)
    elif k.controller == OUTPUT_FEEDBACK:
        v = scratch(N_V)
        read_inputs(x9, r3, k.x_trim, v)
        for i in range(k.rest.shape[0]):
            for j in range(N_V):
                state[MEMORY + i] += k.rest[i, j] * v[j]
            for j in range(3):
                state[MEMORY + i] += k.rest[i, N_V + j] * (state[LAST_U + j] - k.u_trim[j])
        output_feedback(v, r3, k, state, would)
    else:
        linear_law(x9, r3, k, state, would)
    for i in range(3):
        state[OFFSET + i] = state[LAST_U + i] - would[i]
    state[RELAXED] = 0.0


@njit
def law_of_tick(x9, r3, collective, k, state, u3):
    """One tick of `attitude_law`, or at rest on the ground.

    Parameters
    ----------
    x9, r3, k, state, u3
        As of `attitude_law`.
    collective : float
        As it is commanded at this tick, -1..1.

    Returns
    -------
    int
        `AttitudeStatus`. Output on the ground needs no estimate; that one is missing is said.
    """
    if stands(collective, k):
        return _relax(x9, r3, k, state, u3)
    if state[RELAXED] > 0.0 and all_finite(x9) and all_finite(r3):
        _take_up(x9, r3, k, state)
    return attitude_law(x9, r3, k, state, u3)


@njit
def _fly_by_hand(x9, r3, hand3, k, state, u3):
    """One tick of a pilot's hand; what was flown before it fades, the law's memory is at rest."""
    if state[RELAXED] != _HANDED:
        for i in range(3):
            state[OFFSET + i] = state[LAST_U + i] - k.u_trim[i] - hand3[i]
            state[INTEGRAL + i] = 0.0
        for i in range(MEMORY, N_LAW_STATE):
            state[i] = 0.0
        state[RELAXED] = _HANDED
    status = _BY_HAND
    for i in range(3):
        u = k.u_trim[i] + hand3[i] + state[OFFSET + i]
        state[OFFSET + i] *= k.offset_decay
        u3[i] = min(max(u, -k.limit), k.limit)
        if u3[i] != u:
            status = _SATURATED
        state[LAST_U + i] = u3[i]
    if all_finite(x9) and all_finite(r3):
        remember(x9, r3, state)
        state[RUN] = 1.0
    return status


@njit
def law_or_hand(x9, r3, collective, hand3, k, state, u3):
    """One tick of `law_of_tick`, or of a pilot's hand.

    Parameters
    ----------
    x9, r3, collective, k, state, u3
        As of `law_of_tick`.
    hand3 : (3,) array
        Deflections of d_lat, d_lon, d_ped about trim; NaN while the law flies.

    Returns
    -------
    int
        `AttitudeStatus`. By hand no estimate is needed.
    """
    if all_finite(hand3):
        return _fly_by_hand(x9, r3, hand3, k, state, u3)
    return law_of_tick(x9, r3, collective, k, state, u3)
