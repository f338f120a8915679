# SPDX-License-Identifier: Apache-2.0
"""The model of the fast states of eq. (10): its response, its parameters by name, its matrices.

Which of them are free is said by `structure`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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
from heli_analysis.identification.structure import (
    AIR,
    DAMPING,
    DELAY,
    FAST_NAMES,
    FLAPPING,
    N_FAST,
    SCALARS,
    SERVO,
    STATE,
    ModelStructure,
)
from heli_core.linear import held_and_linear, held_late, with_servos
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES, NINE
from heli_core.rows import WIND_NAMES as VELOCITY_NAMES
from heli_core.ticks import TICK_S

FAST = slice(NINE.p, NINE.psi)
"""Where the fast states stand within the nine of eq. (10)."""
RATE_PLACES = [STATE.p, STATE.q, STATE.r]


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
# Parameters by name.
# -------------------------------------------------------------------------------------------------

WIND_NAMES = (*VELOCITY_NAMES, "|w|")
_COLUMNS = {"A": FAST_NAMES, "B": ACTUATOR_NAMES, "E": WIND_NAMES}


@dataclass(frozen=True)
class MatrixEntry:
    """Where a parameter stands: matrix A, B or E of the fast states, row, column."""

    matrix: str
    row: int
    column: int


def place_of(name: str) -> MatrixEntry | None:
    """Place of a parameter by its name, such as `A(p,b_s)`; None for servo, delay, flapping."""
    if name in SCALARS:
        return None
    row, column = name[2:-1].split(",")
    return MatrixEntry(name[0], FAST_NAMES.index(row), _COLUMNS[name[0]].index(column))


def gust_parameters() -> tuple[str, ...]:
    """Names of the free parameters of the fit to injected gusts: E, and the kink of yaw."""
    return (*(f"E({r},{c})" for r in ("p", "q", "r") for c in VELOCITY_NAMES), "E(r,|w|)")


def empty_model(structure: ModelStructure) -> FastModel:
    """A model of a structure with nothing but what gives its states their scale."""
    return FastModel(*structure.empty_matrices(), 40.0, 0.7, 0.0)


def assemble(names: Sequence[str], values: Array, base: FastModel) -> FastModel:
    """Model with the named entries at `values`, the others as in `base`."""
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
