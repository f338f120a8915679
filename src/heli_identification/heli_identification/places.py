# SPDX-License-Identifier: Apache-2.0
"""Places of the fast states of eq. (10), of their inputs, and of the nine states that they are.

p, q, a_s, b_s, r, d_int do not depend on phi, theta, psi, which follow from them by kinematics.
Inputs of B are `heli_math.rows.ACTUATOR`.
"""

from typing import NamedTuple

from heli_math.rows import NINE


class FastStates(NamedTuple):
    """Rows of A, B, E of the fast states (6,)."""

    p: int = 0
    q: int = 1
    a_s: int = 2
    b_s: int = 3
    r: int = 4
    d_int: int = 5


class AirInputs(NamedTuple):
    """Columns of E of the fast states (4,): air velocity relative to the aircraft, m/s."""

    u: int = 0
    v: int = 1
    w: int = 2
    velocity: slice = slice(0, 3)  # these three, as in eq. (10)
    kink: int = 3  # |w|
    size: int = 4


STATE = FastStates()
AIR = AirInputs()
N_FAST = len(STATE)
FAST = slice(NINE.p, NINE.psi)
"""Where the fast states stand within the nine of eq. (10)."""
RATES = [STATE.p, STATE.q, STATE.r]
ROTOR = slice(STATE.a_s, STATE.r)
"""a_s and b_s."""
