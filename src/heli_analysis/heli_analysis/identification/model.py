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
from typing import NamedTuple

import numpy as np

from heli_analysis.identification.spectra import (
    CHANNELS,
    GUST,
    INPUTS,
    KINK,
    RATES,
    VEL,
    Array,
    ComplexArray,
    Spectra,
    U,
)
from heli_core.linear import held_and_linear, held_late, with_servos
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES, NINE
from heli_core.rows import WIND_NAMES as VELOCITY_NAMES
from heli_core.ticks import TICK_S

# -------------------------------------------------------------------------------------------------
# Places of the fast states of eq. (10), of their inputs, and of the nine states that they are.
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
FAST = slice(NINE.p, NINE.psi)
"""Where the fast states stand within the nine of eq. (10)."""
RATE_PLACES = [STATE.p, STATE.q, STATE.r]
ROTOR = slice(STATE.a_s, STATE.r)
"""a_s and b_s."""


# -------------------------------------------------------------------------------------------------
# Frequency response of the sampled rate dynamics: delay, servos, rotor and body, wind.
#
# The six fast states p, q, a_s, b_s, r, d_int of eq. (10) do not depend on phi, theta, psi, which
# follow from them by kinematics. With four servos of second order they make a linear system of 14
# states, discretised exactly: commands held over a tick after a transport delay of any
# (fractional)
# length, injected gust held over a tick, velocity over ground linear between ticks.
# -------------------------------------------------------------------------------------------------

# Rows of the response with all states: the fast ones, then servo positions, an ActuatorRow.
FAST_STATES, SERVOS = slice(0, N_FAST), slice(N_FAST, N_FAST + ACTUATOR.size)
N_INPUTS = INPUTS.stop - INPUTS.start


@dataclass(frozen=True)
class FastModel:
    """Continuous model of the fast states.

    Attributes
    ----------
    A : (6, 6) array
    B : (6, 4) array
        Inputs lat, lon, ped, col.
    E : (6, 4) array
        Relative air velocity u, v, w and |w|, m/s.
    servo_radps, servo_damping : float
        Common to the four servos.
    delay_s : float
        From the tick at which a command is sent to where it begins to act on the servo.
    """

    A: Array
    B: Array
    E: Array
    servo_radps: float
    servo_damping: float
    delay_s: float


def transfer(model: FastModel, omega_radps: Array, states: bool = False) -> ComplexArray:
    """Response (L, 3, 11) of p, q, r to the signals of `Spectra` after them (`INPUTS`).

    Parameters
    ----------
    model : FastModel
    omega_radps : (L,) array
    states : bool
        Give all fast states and servo positions, (L, 10, 11), instead.
    """
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    fast, servo = FAST_STATES, slice(N_FAST, None)
    E = np.vstack([model.E, np.zeros((2 * ACTUATOR.size, AIR.size))])
    Phi, Gust, _, Rise = held_and_linear(F, E, E[:, AIR.velocity], TICK_S)
    z = np.exp(1j * omega_radps * TICK_S)[:, None, None]
    late = held_late(F, G, TICK_S, model.delay_s)
    command = (late.newer + late.older / z) * z**-late.ticks
    # the servos move by themselves and drive the six fast states: solve one after the other
    servos = _servo_response(Phi[servo, servo], command[:, servo], z)
    inputs = np.zeros((z.size, N_FAST, N_INPUTS), dtype=np.complex128)
    air = Gust[fast, AIR.velocity]
    inputs[:, :, _after_rates(U)] = Phi[fast, servo] @ servos + command[:, fast]
    inputs[:, :, _after_rates(GUST)] = air
    inputs[:, :, _after_rates(KINK)] = Gust[fast, [AIR.kink]]
    inputs[:, :, _after_rates(VEL)] = -(air + (z - 1.0) * Rise[fast])
    left = z * np.eye(N_FAST) - Phi[fast, fast]
    if not states:
        selector = np.eye(N_FAST)[:, RATE_PLACES]
        right = np.broadcast_to(selector, (z.size, *selector.shape))
        rows = np.linalg.solve(np.swapaxes(left, 1, 2), right)
        return np.asarray(np.swapaxes(rows, 1, 2) @ inputs)
    positions = np.zeros((z.size, ACTUATOR.size, N_INPUTS), dtype=np.complex128)
    positions[:, :, _after_rates(U)] = servos[:, : ACTUATOR.size]
    return np.concatenate([np.linalg.solve(left, inputs), positions], axis=1)


def _after_rates(part: slice) -> slice:
    return slice(part.start - INPUTS.start, part.stop - INPUTS.start)


def _servo_response(Phi: Array, command: ComplexArray, z: ComplexArray) -> ComplexArray:
    """Positions and rates (L, 8, 4) of the servos per command: four times the same 2 x 2 system."""
    n = ACTUATOR.size
    a, b, c, d = Phi[0, 0], Phi[0, n], Phi[n, 0], Phi[n, n]
    z = z[:, :, 0]
    determinant = (z - a) * (z - d) - b * c
    to_position = np.diagonal(command[:, :n], axis1=1, axis2=2)
    to_rate = np.diagonal(command[:, n:], axis1=1, axis2=2)
    result = np.zeros((z.shape[0], 2 * n, n), dtype=np.complex128)
    each = np.arange(n)
    result[:, each, each] = ((z - d) * to_position + b * to_rate) / determinant
    result[:, n + each, each] = (c * to_position + (z - a) * to_rate) / determinant
    return result


# -------------------------------------------------------------------------------------------------
# Structure.
# -------------------------------------------------------------------------------------------------

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
class MatrixEntry:
    """Where a parameter stands: matrix A, B or E of the fast states, row, column."""

    matrix: str
    row: int
    column: int


def place_of(name: str) -> MatrixEntry | None:
    """Place of a parameter by its name, such as `A(p,b_s)`; None for servo, delay, flapping."""
    if name in _SCALARS:
        return None
    row, column = name[2:-1].split(",")
    return MatrixEntry(name[0], FAST_NAMES.index(row), _COLUMNS[name[0]].index(column))


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
    diagonal = np.diag(model.A)
    scalars[FLAPPING] = float(-0.5 * (diagonal[STATE.a_s] + diagonal[STATE.b_s]))
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


# -------------------------------------------------------------------------------------------------
# Measured frequency response of a rate to one input, at the input's own lines.
#
# What all other inputs do there, by a fitted model, is taken off the measured rate first, as the
# loops answer every line with all actuators.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeasuredResponse:
    """Response of a rate (rad/s) to one channel at the channel's lines.

    Attributes
    ----------
    omega_radps : (L,) array
    value : (L,) complex array
        From the tick at which a command is sent to the rate read at ticks; delay included.
    sigma : (L,) array
        Standard deviation of |value|.
    coherence : (L,) array
        Share of the periodic part in the power of one period.
    """

    omega_radps: Array
    value: ComplexArray
    sigma: Array
    coherence: Array


def measured_response(
    spectra: Spectra, model: FastModel, rate: str, channel: str
) -> MeasuredResponse:
    """Response of a rate (`RATES`) to a channel (`CHANNELS`).

    Parameters
    ----------
    spectra : Spectra
    model : FastModel
        Tells what the other inputs do.
    rate, channel : str
    """
    row, index = RATES.index(rate), CHANNELS.index(channel)
    lines = spectra.channel == index
    signal = U.start + index  # the gusts follow the actuators
    z = spectra.z[lines]
    others = transfer(model, spectra.omega_radps[lines])[:, row]
    others[:, signal - U.start] = 0.0
    left = z[:, row] - np.einsum("ls,ls->l", others, z[:, U.start :])
    drive = z[:, signal]
    noise = spectra.noise_covariance()[lines][:, row, row].real
    power = np.abs(left) ** 2
    return MeasuredResponse(
        omega_radps=spectra.omega_radps[lines],
        value=left / drive,
        sigma=np.sqrt(0.5 * noise) / np.abs(drive),
        coherence=power / (power + noise * spectra.periods),
    )
