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
from heli_identification.spectra import GUST, KINK, N_SIGNAL, VEL, ComplexArray, U
from heli_math.linear_systems import held_and_linear, held_late, with_servos
from heli_math.ticks import TICK_S

FAST = slice(2, 8)  # p q a_s b_s r d_int within eq. (10)
N_FAST, N_ACTUATOR = 6, 4
RATE_ROWS = (0, 1, 4)  # p, q, r within the fast states


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
    """Response (L, 3, N_SIGNAL - 3) of p, q, r to the signals of `Spectra` after its first three.

    Parameters
    ----------
    model : FastModel
    omega_radps : (L,) array
    states : bool
        Give all fast states and servo positions, (L, 10, N_SIGNAL - 3), instead.
    """
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    E = np.vstack([model.E, np.zeros((2 * N_ACTUATOR, model.E.shape[1]))])
    Phi, Gust, _, Rise = held_and_linear(F, E, E[:, :3], TICK_S)
    z = np.exp(1j * omega_radps * TICK_S)[:, None, None]
    late = held_late(F, G, TICK_S, model.delay_s)
    command = (late.newer + late.older / z) * z**-late.ticks
    # the servos move by themselves and drive the six fast states: solve one after the other
    servos = _servo_response(Phi[6:, 6:], command[:, 6:], z)
    inputs = np.zeros((z.size, N_FAST, N_SIGNAL - 3), dtype=np.complex128)
    inputs[:, :, _after_rates(U)] = Phi[:6, 6:] @ servos + command[:, :6]
    inputs[:, :, _after_rates(GUST)] = Gust[:6, :3]
    inputs[:, :, _after_rates(KINK)] = Gust[:6, 3:4]
    inputs[:, :, _after_rates(VEL)] = -(Gust[:6, :3] + (z - 1.0) * Rise[:6])
    fast = z * np.eye(N_FAST) - Phi[:6, :6]
    if not states:
        selector = np.zeros((N_FAST, 3))
        selector[RATE_ROWS, range(3)] = 1.0
        left = np.linalg.solve(np.swapaxes(fast, 1, 2), np.broadcast_to(selector, (z.size, 6, 3)))
        return np.asarray(np.swapaxes(left, 1, 2) @ inputs)
    positions = np.zeros((z.size, N_ACTUATOR, N_SIGNAL - 3), dtype=np.complex128)
    positions[:, :, _after_rates(U)] = servos[:, :4]
    return np.concatenate([np.linalg.solve(fast, inputs), positions], axis=1)


def _after_rates(part: slice) -> slice:
    return slice(part.start - 3, part.stop - 3)


def _servo_response(Phi: Array, command: ComplexArray, z: ComplexArray) -> ComplexArray:
    """Positions and rates (L, 8, 4) of the servos per command: four times the same 2 x 2 system."""
    a, b, c, d = Phi[0, 0], Phi[0, 4], Phi[4, 0], Phi[4, 4]
    z = z[:, :, 0]
    determinant = (z - a) * (z - d) - b * c
    to_position = np.diagonal(command[:, :4], axis1=1, axis2=2)
    to_rate = np.diagonal(command[:, 4:], axis1=1, axis2=2)
    result = np.zeros((z.shape[0], 8, 4), dtype=np.complex128)
    each = np.arange(4)
    result[:, each, each] = ((z - d) * to_position + b * to_rate) / determinant
    result[:, 4 + each, each] = (c * to_position + (z - a) * to_rate) / determinant
    return result
