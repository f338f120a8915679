# SPDX-License-Identifier: Apache-2.0
"""The attitude controller from the ground to the air and back, and by hand: what the loops call.

Skids hold attitude and heading against whatever the controller does, so a controller with memory
winds up there; cyclic that it then commands tips the aircraft over the skid that touches last
(dynamic rollover: FAA-H-8083-21B, Helicopter Flying Handbook, ch. 11). So while the collective is
one of standing (`AttitudeParams.ground_collective`) the memory is at rest and cyclic and pedal fade
to trim; with more collective the controller goes on from them as `swap_bumpless` does: its memory
as at rest with what is read and commanded, and the difference to what it would command fades.

By hand a pilot's deflections about trim are flown in its place: nothing between stick and actuator
but the yaw-rate gyro of the aircraft. The controller then goes on in the same way.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import njit, scratch
from heli_core.python_controller import INNER, LawError, PythonLaw, find
from heli_inner_hinf.controller_state import (
    INTEGRAL,
    LAST_R,
    LAST_U,
    LAST_X,
    MEMORY,
    N_LAW_STATE,
    N_V,
    OFFSET,
    OUTPUT_FEEDBACK,
    PID,
    RELAXED,
    RUN,
    AttitudeParams,
    AttitudeStatus,
    all_finite,
    read_inputs,
    save_state,
)
from heli_inner_hinf.controllers import attitude_law, linear_law, output_feedback, pid_terms

# -------------------------------------------------------------------------------------------------
# Ground controller.
# -------------------------------------------------------------------------------------------------

_NOT_FINITE = int(AttitudeStatus.NOT_FINITE)
_ON_GROUND = int(AttitudeStatus.ON_GROUND)
_BY_HAND, _SATURATED = int(AttitudeStatus.BY_HAND), int(AttitudeStatus.SATURATED)
_AT_REST, _HANDED = 1.0, 2.0


@njit
def stands(collective, k):
    """Whether a collective (-1..1) is one of standing; k is an AttitudeParams. NaN is not."""
    return (collective - k.ground_collective) * k.ground_side > 0.0


@njit
def _relax(x9, r3, k, state, u3):
    """One tick at rest: memory of a controller that has flown its trim, output on its way there."""
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
    save_state(x9, r3, state)
    state[RUN] = 1.0
    return _ON_GROUND


@njit
def _take_up(x9, r3, k, state):
    """Go on from rest: the first command is that of the last tick; the memory is all zeros here."""
    save_state(x9, r3, state)
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
def _fly_by_hand(x9, r3, manual3, k, state, u3):
    """One tick of a pilot's hand; the command before it fades, the controller's memory rests."""
    if state[RELAXED] != _HANDED:
        for i in range(3):
            state[OFFSET + i] = state[LAST_U + i] - k.u_trim[i] - manual3[i]
            state[INTEGRAL + i] = 0.0
        for i in range(MEMORY, N_LAW_STATE):
            state[i] = 0.0
        state[RELAXED] = _HANDED
    status = _BY_HAND
    for i in range(3):
        u = k.u_trim[i] + manual3[i] + state[OFFSET + i]
        state[OFFSET + i] *= k.offset_decay
        u3[i] = min(max(u, -k.limit), k.limit)
        if u3[i] != u:
            status = _SATURATED
        state[LAST_U + i] = u3[i]
    if all_finite(x9) and all_finite(r3):
        save_state(x9, r3, state)
        state[RUN] = 1.0
    return status


@njit
def stand_by(x9, r3, u3, state):
    """One tick with actuators u3 (3,), absolute, commanded by others: the controller follows on.

    Parameters
    ----------
    x9, r3, state
        As of `attitude_law`.
    """
    for i in range(MEMORY, N_LAW_STATE):
        state[i] = 0.0
    for i in range(3):
        state[OFFSET + i], state[INTEGRAL + i] = 0.0, 0.0
        state[LAST_U + i] = u3[i]
    state[RELAXED] = _HANDED
    if all_finite(x9) and all_finite(r3):
        save_state(x9, r3, state)
        state[RUN] = 1.0


@njit
def law_or_manual(x9, r3, collective, manual3, k, state, u3):
    """One tick of `law_of_tick`, or of a pilot's hand.

    Parameters
    ----------
    x9, r3, collective, k, state, u3
        As of `law_of_tick`.
    hand3 : (3,) array
        Deflections of d_lat, d_lon, d_ped about trim; NaN while the controller flies.

    Returns
    -------
    int
        `AttitudeStatus`. By hand no estimate is needed.
    """
    if all_finite(manual3):
        return _fly_by_hand(x9, r3, manual3, k, state, u3)
    return law_of_tick(x9, r3, collective, k, state, u3)


# -------------------------------------------------------------------------------------------------
# A controller given in Python, flown in place of the attitude controller.
#
# It reads x (9,), the states of eq. (10) (places `NINE`, rad and rad/s, absolute), and r (3,), the
# commanded phi, theta, psi (places `SETPOINT`, rad, absolute), and gives d_lat, d_lon, d_ped,
# absolute, in (-1, 1), every tick. What is around a controller stays: on the ground the actuators
# rest in trim, a pilot's hand goes before it, its actuators are cut at `actuator_limit`, and where
# it begins in flight the difference to what was flown fades.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


class OwnAttitudeLaw:
    """What calls the controller once a tick.

    Parameters
    ----------
    law : PythonLaw or None
        Of the inner loop; None: the packaged controller flies.
    """

    def __init__(self, law: PythonLaw | None) -> None:
        self.law = law
        self._begins, self._from_trim = True, True

    @property
    def failure(self) -> str:
        """What the controller has done wrong in flight, and what is flown; empty for nothing."""
        if self.law is None or not self.law.failure:
            return ""
        return f"{self.law.failure}; the last good command is held"

    def begin(self, in_flight: bool = False) -> None:
        """Another flight, or one that is taken over from what is flown."""
        self._begins, self._from_trim = True, not in_flight

    def step(
        self,
        tick: int,
        time_s: float,
        x9: Array,
        r3: Array,
        collective: float,
        manual3: Array,
        k: AttitudeParams,
        state: Array,
        u3: Array,
        packaged: Callable[..., int],
    ) -> int:
        """One tick; arguments and outcome as of `law_or_hand`, which is `packaged`.

        Where the controller has failed the last command is repeated: NOT_FINITE, and `law.failure`.
        """
        if self.law is None:
            return packaged(x9, r3, collective, manual3, k, state, u3)
        stands = (collective - k.ground_collective) * k.ground_side > 0.0
        if stands or np.isfinite(manual3).all():
            self.begin(in_flight=True)
            return packaged(x9, r3, collective, manual3, k, state, u3)
        last = state[LAST_U : LAST_U + 3]
        u3[:] = last
        if not (np.isfinite(x9).all() and np.isfinite(r3).all()):
            return AttitudeStatus.NOT_FINITE
        if self._begins:
            self.law.reset(x9, r3, last, tick, time_s)
        made = self.law.step(x9, r3, tick, time_s)
        if made is None:
            return AttitudeStatus.NOT_FINITE
        offset = state[OFFSET : OFFSET + 3]
        if self._begins:
            offset[:] = 0.0 if self._from_trim else last - made
            self._begins, state[RELAXED] = False, 0.0
        made += offset
        offset *= k.offset_decay
        u3[:] = np.clip(made, -k.limit, k.limit)
        last[:] = u3
        state[LAST_X : LAST_X + 9], state[LAST_R : LAST_R + 3], state[RUN] = x9, r3, 1.0
        return AttitudeStatus.OK if np.array_equal(u3, made) else AttitudeStatus.SATURATED


def own_law(source: str) -> OwnAttitudeLaw:
    """The controller of the parameter `own_law`; empty: the packaged one.

    Raises
    ------
    LawError
    """
    if not source:
        return OwnAttitudeLaw(None)
    law = find(source)
    if law.loop != INNER:
        raise LawError(f"controller {law.name}: is of the {law.loop} loop; here: the {INNER} loop")
    return OwnAttitudeLaw(law)
