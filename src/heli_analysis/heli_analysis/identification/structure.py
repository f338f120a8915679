# SPDX-License-Identifier: Apache-2.0
"""Structures of the hover model: with or without flapping states, with or without a yaw gyro.

Eq. (10) has a rotor with states a_s and b_s and a yaw gyro with the state d_int. A rotor that is
much faster than the body follows at once: what remains are the derivatives of p, q, r by rates,
air velocity and controls, a quasi-static model (Tischler and Remple, Aircraft and Rotorcraft System
Identification, 2nd ed., AIAA 2012, ch. 15; Mettler, Identification Modeling and Characteristics of
Miniature Rotorcraft, 2003, ch. 4). The rotor's lag is then in the delay and the servos. States that
a structure has not stay in their places, driven by nothing and felt by nothing, and fade within
`FADES_S`, so all that takes the nine states of eq. (10) takes each structure.

Fixed by kinematics and the definition of the unmeasured states: `a_s' = -q + ...`,
`b_s' = -p + ...`, `d_int' = -r + ...`. These entries of -1 give a_s, b_s and d_int their scale.
d_int is the integral of a rate error, eq. (8), so its row holds nothing else but the pedal. With
flapping states, cyclic acts through the rotor only, so the rows of p, q, r have no entry for d_lat
and d_lon. a_s and b_s share one time constant, eq. (6): without that a_s could be swapped for a_s
plus a multiple of q, which no excitation of the actuators would show, and A(q,q), A(q,a_s),
A(a_s,a_s) could not be told apart.
"""

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from heli_analysis.identification.spectra import Array
from heli_core.rows import ACTUATOR
from heli_core.rows import WIND_NAMES as VELOCITY_NAMES

# -------------------------------------------------------------------------------------------------
# Places of the fast states of eq. (10) and of their inputs.
#
# p, q, a_s, b_s, r, d_int do not depend on phi, theta, psi, which follow from them by kinematics.
# Inputs of B are `heli_core.rows.ACTUATOR`.
# -------------------------------------------------------------------------------------------------


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
FAST_NAMES = STATE._fields
RATE_NAMES = ("p", "q", "r")
ROTOR = slice(STATE.a_s, STATE.r)
"""a_s and b_s."""

SERVO, DAMPING, DELAY = "servo.frequency_radps", "servo.damping", "delay_s"
FLAPPING = "flapping.rate_1ps"  # 1/tau of eq. (6): -A(a_s,a_s) and -A(b_s,b_s)
SCALARS = (SERVO, DAMPING, DELAY, FLAPPING)
_ACTUATION = (SERVO, DAMPING, DELAY)

FADES_S = 0.01
"""Time constant of a state that the structure has not."""


class Rotor(enum.StrEnum):
    """How the rotor's disc follows."""

    FULL = "full"  # with the flapping states a_s, b_s
    QUASI_STATIC = "quasi_static_rotor"  # at once


# -------------------------------------------------------------------------------------------------
# Parameters.
# -------------------------------------------------------------------------------------------------

# Without these the model is no helicopter: they are never taken for zero.
_ESSENTIAL = {
    Rotor.FULL: (
        "A(p,b_s)", "A(q,a_s)", "A(r,r)", "B(b_s,d_lat)", "B(a_s,d_lon)", "B(r,d_ped)",
        *_ACTUATION, FLAPPING,
    ),
    Rotor.QUASI_STATIC: (
        "A(p,p)", "A(q,q)", "A(r,r)", "B(p,d_lat)", "B(q,d_lon)", "B(r,d_ped)", *_ACTUATION,
    ),
}  # fmt: skip
_ESSENTIAL_OF_GYRO = ("A(r,d_int)", "B(d_int,d_ped)")

# What else eq. (6) to (8), a tail rotor above the centre of gravity, a fuselage and a rotor demand.
# Left out where the data hardly show it, the effect of the aircraft's own drift through the air
# would be blamed on the small entries of p.
_EXPECTED_OF_BODY = ("A(p,r)", "B(p,d_ped)", "B(r,d_col)", "E(p,v)", "E(q,w)", "E(r,v)", "E(r,w)")
_EXPECTED = {
    Rotor.FULL: ("A(a_s,b_s)", "A(b_s,a_s)", "B(a_s,d_lat)", "B(b_s,d_lon)", *_EXPECTED_OF_BODY),
    Rotor.QUASI_STATIC: (
        "A(p,q)", "A(q,p)", "B(p,d_lon)", "B(q,d_lat)", "E(q,u)", *_EXPECTED_OF_BODY
    ),
}  # fmt: skip
_EXPECTED_OF_GYRO = ("A(p,d_int)",)


@dataclass(frozen=True)
class ModelStructure:
    """Which states a model has.

    Attributes
    ----------
    rotor : Rotor
    yaw_gyro : bool
        Whether a yaw gyro with the integrator d_int works between d_ped and the tail.
    """

    rotor: Rotor = Rotor.FULL
    yaw_gyro: bool = True

    @property
    def absent(self) -> tuple[int, ...]:
        """Places of the fast states that it has not."""
        rotor = (STATE.a_s, STATE.b_s) if self.rotor is Rotor.QUASI_STATIC else ()
        return (*rotor, *(() if self.yaw_gyro else (STATE.d_int,)))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the fast states that it has."""
        return tuple(name for i, name in enumerate(FAST_NAMES) if i not in self.absent)

    @property
    def essential(self) -> frozenset[str]:
        """Parameters that are never taken for zero."""
        return frozenset(_ESSENTIAL[self.rotor] + (_ESSENTIAL_OF_GYRO if self.yaw_gyro else ()))

    @property
    def kept(self) -> frozenset[str]:
        """Parameters with which a fit begins, and which stay: essential, and what physics asks."""
        expected = _EXPECTED[self.rotor] + (_EXPECTED_OF_GYRO if self.yaw_gyro else ())
        return self.essential | frozenset(expected)

    def actuator_parameters(self, collective: bool) -> tuple[str, ...]:
        """Names of the free parameters of the fit to actuator excitation."""
        names = [f"A({row},{column})" for row in RATE_NAMES for column in self.states]
        if self.rotor is Rotor.FULL:
            names += ["A(a_s,b_s)", "A(b_s,a_s)"]
        tilted = ("a_s", "b_s") if self.rotor is Rotor.FULL else RATE_NAMES
        names += [f"B({row},{column})" for row in tilted for column in ("d_lat", "d_lon")]
        driven = (*RATE_NAMES, "d_int") if self.yaw_gyro else RATE_NAMES
        names += [f"B({row},d_ped)" for row in driven]
        if collective:
            names += [f"B({row},d_col)" for row in RATE_NAMES]
        names += [f"E({row},{column})" for row in RATE_NAMES for column in VELOCITY_NAMES]
        return (*names, *(SCALARS if self.rotor is Rotor.FULL else _ACTUATION))

    def empty_matrices(self) -> tuple[Array, Array, Array]:
        """A (6, 6), B (6, 4), E (6, 4) with nothing but what gives a_s, b_s, d_int their scale."""
        A = np.zeros((N_FAST, N_FAST))
        A[STATE.a_s, STATE.q] = A[STATE.b_s, STATE.p] = A[STATE.d_int, STATE.r] = -1.0
        for i in self.absent:
            A[i] = 0.0
            A[i, i] = -1.0 / FADES_S
        return A, np.zeros((N_FAST, ACTUATOR.size)), np.zeros((N_FAST, AIR.size))


FULL = ModelStructure()
"""Eq. (10) as it is."""


def at_once(A: Array, B: Array, E: Array) -> tuple[Array, Array, Array]:
    """A (6, 6), B (6, m), E (6, k) of the fast states with a rotor that follows at once.

    a_s and b_s at their equilibrium (residualisation): x' = (A_11 - A_12 A_22^-1 A_21) x + ...

    Raises
    ------
    numpy.linalg.LinAlgError
        The rotor has no equilibrium.
    """
    absent = ModelStructure(Rotor.QUASI_STATIC).absent
    left = [i for i in range(N_FAST) if i not in absent]
    follows = A[np.ix_(left, absent)] @ np.linalg.inv(A[np.ix_(absent, absent)])
    found = []
    for matrix in (A, B, E):
        made = np.zeros_like(matrix)
        made[left] = matrix[left] - follows @ matrix[list(absent)]
        found.append(made)
    found[0][:, absent] = 0.0
    for i in absent:
        found[0][i, i] = -1.0 / FADES_S
    return found[0], found[1], found[2]
