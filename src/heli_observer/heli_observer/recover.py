# SPDX-License-Identifier: Apache-2.0
"""A filter whose state is none any more begins again in flight, from what it knew before.

No sensor can make a state that is not finite: each is judged before it is fused. What can is an
error of ours or of the machine; then the filter would say nothing ever again. It keeps what it knew
at each of the last fixes, and all that it took since (`relearn`): from the newest knowledge that is
sound it takes the same samples and fixes again, and is where it would have been.
"""

import math

from heli_math.jit import njit
from heli_observer import layout as L
from heli_observer.doubt import believe
from heli_observer.relearn import FIXES, TICKS, take_again_from

QUAT_NORM_OFF = 0.1
"""A unit quaternion is so near to 1."""
VEL_MPS = 150.0
"""No helicopter is faster."""
CORRELATION2 = 1.05
"""Of two errors, squared: beyond 1 there is no covariance; rounding may be so far."""
_TINY = 1e-24


@njit
def is_state(x, P):
    """Whether nominal state and covariance can be those of an aircraft: finite, not absurd."""
    for i in range(L.N_NOMINAL):
        if not math.isfinite(x[i]):
            return False
    norm2 = 0.0
    for i in range(4):
        norm2 += x[L.X_QUAT + i] ** 2
    if not abs(norm2 - 1.0) <= QUAT_NORM_OFF:
        return False
    for i in range(3):
        if not abs(x[L.X_VEL + i]) <= VEL_MPS:
            return False
    for i in range(L.N_ERROR):
        if not (math.isfinite(P[i, i]) and P[i, i] >= 0.0):
            return False
        for j in range(i):
            if not P[i, j] * P[i, j] <= CORRELATION2 * P[i, i] * P[j, j] + _TINY:
                return False
    return True


@njit
def is_rotor(rotor):
    """Whether the states of the reduced-order observer are finite."""
    for i in range(L.N_ROTOR_W):
        if not math.isfinite(rotor[i]):
            return False
    return True


@njit
def recover(state, horizon, k):
    """Go on from the newest knowledge that is sound; nominal and P in place.

    Parameters
    ----------
    state : ObserverState
    horizon : int
        Tick that the filter is at.
    k : EkfKernel

    Returns
    -------
    bool
        False where there is none: then it has to be aligned anew.
    """
    window = state.window
    before = horizon + 1
    for _ in range(FIXES):
        best = -1
        for slot in range(FIXES):
            tick = window.tick[slot]
            if tick == L.NO_TICK or tick >= before or horizon - tick >= TICKS:
                continue
            if best < 0 or tick > window.tick[best]:
                best = slot
        if best < 0:
            return False
        before = window.tick[best]
        if is_state(window.nominal[best], window.P[best]):
            take_again_from(state, best, horizon, k)
            if is_state(state.nominal, state.P):
                believe(state)
                state.count[L.C_RECOVERED] += 1
                return True
    return False
