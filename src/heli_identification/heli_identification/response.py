# SPDX-License-Identifier: Apache-2.0
"""Frequency response of the sampled rate dynamics: delay, servos, rotor and body, wind.

The six fast states p, q, a_s, b_s, r, d_int of eq. (10) do not depend on phi, theta, psi, which
follow from them by kinematics. With four servos of second order they make a linear system of 14
states, discretised exactly: commands held over a tick after a transport delay of any (fractional)
length, injected gust held over a tick, velocity over ground linear between ticks.
"""

from dataclasses import dataclass

import numpy as np

from heli_identification.experiment import Array
from heli_identification.places import AIR, N_FAST, RATES
from heli_identification.spectra import GUST, INPUTS, KINK, VEL, ComplexArray, U
from heli_math.linear_systems import held_and_linear, held_late, with_servos
from heli_math.rows import ACTUATOR
from heli_math.ticks import TICK_S

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
        selector = np.eye(N_FAST)[:, RATES]
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
