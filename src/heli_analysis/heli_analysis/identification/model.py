# SPDX-License-Identifier: Apache-2.0
"""Which entries of eq. (10) are free, how they are called, and the kinematic rows.

Fixed by kinematics and the definition of the unmeasured states: `a_s' = -q + ...`,
`b_s' = -p + ...`, `d_int' = -r + ...`. These entries of -1 give a_s, b_s and d_int their scale.
d_int is the integral of a rate error, eq. (8), so its row holds nothing else but the pedal. Cyclic
acts through the rotor only, so the rows of p, q, r have no entry for d_lat and d_lon. a_s and b_s
share one time constant, eq. (6): without that a_s could be swapped for a_s plus a multiple of q,
which no excitation of the actuators would show, and A(q,q), A(q,a_s), A(a_s,a_s) could not be told
apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heli_identification.experiment import Array
from heli_identification.places import AIR, FAST, N_FAST, STATE
from heli_identification.response import FastModel
from heli_math.rows import ACTUATOR, NINE
from heli_math.state_names import ACTUATOR_NAMES
from heli_math.state_names import WIND_NAMES as VELOCITY_NAMES

FAST_NAMES = STATE._fields
WIND_NAMES = (*VELOCITY_NAMES, "|w|")
_COLUMNS = {"A": FAST_NAMES, "B": ACTUATOR_NAMES, "E": WIND_NAMES}
SERVO, DAMPING, DELAY = "servo.frequency_radps", "servo.damping", "delay_s"
FLAPPING = "flapping.rate_1ps"  # 1/tau of eq. (6): -A(a_s,a_s) and -A(b_s,b_s)
_SCALARS = (SERVO, DAMPING, DELAY, FLAPPING)

# Without these the model is no helicopter: they are never taken for zero.
ESSENTIAL = frozenset(
    {
        "A(p,b_s)", "A(q,a_s)", "A(r,r)", "A(r,d_int)", "B(b_s,d_lat)", "B(a_s,d_lon)",
        "B(r,d_ped)", "B(d_int,d_ped)", *_SCALARS,
    }
)  # fmt: skip

# What else eq. (6) to (8), a tail rotor above the centre of gravity, a fuselage and a rotor demand.
# Left out where the data hardly show it, the effect of the aircraft's own drift through the air
# would be blamed on the small entries of p.
EXPECTED = frozenset(
    {
        "A(a_s,b_s)", "A(b_s,a_s)", "B(a_s,d_lat)", "B(b_s,d_lon)", "A(p,r)", "A(p,d_int)",
        "B(p,d_ped)", "B(r,d_col)", "E(p,v)", "E(q,w)", "E(r,v)", "E(r,w)",
    }
)  # fmt: skip


@dataclass(frozen=True)
class Place:
    """Where a parameter stands: matrix A, B or E of the fast states, row, column."""

    matrix: str
    row: int
    column: int


def place_of(name: str) -> Place | None:
    """Place of a parameter by its name, such as `A(p,b_s)`; None for servo, delay, flapping."""
    if name in _SCALARS:
        return None
    row, column = name[2:-1].split(",")
    return Place(name[0], FAST_NAMES.index(row), _COLUMNS[name[0]].index(column))


def actuator_parameters(collective: bool) -> tuple[str, ...]:
    """Names of the free parameters of the fit to actuator excitation."""
    rates, rotor = ("p", "q", "r"), ("a_s", "b_s")
    names = [f"A({row},{column})" for row in rates for column in FAST_NAMES]
    names += ["A(a_s,b_s)", "A(b_s,a_s)"]
    names += [f"B({row},{column})" for row in rotor for column in ("d_lat", "d_lon")]
    names += [f"B({row},d_ped)" for row in (*rates, "d_int")]
    if collective:
        names += [f"B({row},d_col)" for row in rates]
    names += [f"E({row},{column})" for row in rates for column in VELOCITY_NAMES]
    return (*names, *_SCALARS)


def gust_parameters() -> tuple[str, ...]:
    """Names of the free parameters of the fit to injected gusts: E, and the kink of yaw."""
    return (*(f"E({r},{c})" for r in ("p", "q", "r") for c in VELOCITY_NAMES), "E(r,|w|)")


def empty_matrices() -> tuple[Array, Array, Array]:
    """A (6, 6), B (6, 4), E (6, 4) with nothing but what gives a_s, b_s and d_int their scale."""
    A = np.zeros((N_FAST, N_FAST))
    A[STATE.a_s, STATE.q] = A[STATE.b_s, STATE.p] = A[STATE.d_int, STATE.r] = -1.0
    return A, np.zeros((N_FAST, ACTUATOR.size)), np.zeros((N_FAST, AIR.size))


def assemble(names: Sequence[str], values: Array, base: FastModel | None = None) -> FastModel:
    """Model with the named entries at `values`; other entries from `base`, or zero."""
    if base is None:
        A, B, E = empty_matrices()
        matrices = {"A": A, "B": B, "E": E}
        scalars = {SERVO: 40.0, DAMPING: 0.7, DELAY: 0.0}
    else:
        matrices = {"A": base.A.copy(), "B": base.B.copy(), "E": base.E.copy()}
        scalars = {SERVO: base.servo_radps, DAMPING: base.servo_damping, DELAY: base.delay_s}
    for name, value in zip(names, values, strict=True):
        place = place_of(name)
        if name == FLAPPING:
            for angle in (STATE.a_s, STATE.b_s):
                matrices["A"][angle, angle] = -value
        elif place is None:
            scalars[name] = float(value)
        else:
            matrices[place.matrix][place.row, place.column] = value
    return FastModel(
        matrices["A"],
        matrices["B"],
        matrices["E"],
        scalars[SERVO],
        scalars[DAMPING],
        scalars[DELAY],
    )


def values_of(names: Sequence[str], model: FastModel) -> Array:
    """The named entries of a model, the inverse of `assemble`."""
    scalars = {SERVO: model.servo_radps, DAMPING: model.servo_damping, DELAY: model.delay_s}
    own = np.diag(model.A)
    scalars[FLAPPING] = float(-0.5 * (own[STATE.a_s] + own[STATE.b_s]))
    matrices = {"A": model.A, "B": model.B, "E": model.E}
    values = []
    for name in names:
        place = place_of(name)
        values.append(
            scalars[name] if place is None else matrices[place.matrix][place.row, place.column]
        )
    return np.array(values, dtype=np.float64)


def full_matrices(model: FastModel, phi: float, theta: float) -> tuple[Array, Array, Array]:
    """A (9, 9), B (9, 3), E (9, 3) of eq. (10) with the kinematic rows at a trim attitude (rad).

    Turning rates are zero at trim, so phi' = p + (q sin phi + r cos phi) tan theta and its
    companions have derivatives with respect to p, q, r only.
    """
    A, B, E = np.zeros((9, 9)), np.zeros((9, 3)), np.zeros((9, 3))
    A[FAST, FAST] = model.A
    B[FAST] = model.B[:, ACTUATOR.attitude]
    E[FAST] = model.E[:, AIR.velocity]
    s, c = np.sin(phi), np.cos(phi)
    rates = [NINE.p, NINE.q, NINE.r]
    A[NINE.phi, rates] = 1.0, s * np.tan(theta), c * np.tan(theta)
    A[NINE.theta, rates] = 0.0, c, -s
    A[NINE.psi, rates] = 0.0, s / np.cos(theta), c / np.cos(theta)
    return A, B, E
