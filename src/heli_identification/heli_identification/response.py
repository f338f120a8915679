# SPDX-License-Identifier: Apache-2.0
"""Frequency response of the sampled rate dynamics: delay, servos, rotor and body, wind.

The six fast states p, q, a_s, b_s, r, d_int of eq. (10) do not depend on phi, theta, psi, which
follow from them by kinematics. With four servos of second order they make a linear system of 14
states, discretised exactly: commands held over a tick after a transport delay of any (fractional)
length, injected gust held over a tick, velocity over ground linear between ticks.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from heli_identification.experiment import Array
from heli_identification.spectra import GUST, KINK, N_SIGNAL, VEL, ComplexArray, U
from heli_observer.layout import TICK_S

FAST = slice(2, 8)  # p q a_s b_s r d_int within eq. (10)
N_FAST, N_ACTUATOR, N_WIND, N_FULL = 6, 4, 4, 14
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


def _continuous(model: FastModel) -> tuple[Array, Array]:
    """F (14, 14) and inputs G (14, 8): four commands, four wind inputs."""
    F = np.zeros((N_FULL, N_FULL))
    F[:N_FAST, :N_FAST] = model.A
    F[:N_FAST, 6:10] = model.B
    F[6:10, 10:14] = np.eye(4)
    F[10:14, 6:10] = -(model.servo_radps**2) * np.eye(4)
    F[10:14, 10:14] = -2.0 * model.servo_damping * model.servo_radps * np.eye(4)
    G = np.zeros((N_FULL, N_ACTUATOR + N_WIND))
    G[10:14, :4] = model.servo_radps**2 * np.eye(4)
    G[:N_FAST, 4:] = model.E
    return F, G


def _held(F: Array, G: Array, time_s: float) -> tuple[Array, Array, Array]:
    """Phi, Gamma (input held) and Gamma_1 (input rising from 0 to 1) over time_s."""
    n, m = G.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n] = F * time_s
    block[:n, n : n + m] = G * time_s
    block[n : n + m, n + m :] = np.eye(m)
    e = expm(block)[:n]
    return e[:, :n], e[:, n : n + m], e[:, n + m :]


def transfer(model: FastModel, omega_radps: Array, states: bool = False) -> ComplexArray:
    """Response (L, 3, N_SIGNAL - 3) of p, q, r to the signals of `Spectra` after its first three.

    Parameters
    ----------
    model : FastModel
    omega_radps : (L,) array
    states : bool
        Give all fast states and servo positions, (L, 10, N_SIGNAL - 3), instead.
    """
    F, G = _continuous(model)
    Phi, Gamma, Rise = _held(F, G, TICK_S)
    z = np.exp(1j * omega_radps * TICK_S)[:, None, None]
    ticks = int(np.floor(model.delay_s / TICK_S + 1e-9))
    rest_s = max(model.delay_s - ticks * TICK_S, 0.0)
    command = np.broadcast_to(Gamma[:, :4], (z.size, N_FULL, 4)).astype(np.complex128)
    if rest_s > 1e-9:
        part = _held(F, G[:, :4], TICK_S - rest_s)
        command = part[1] + (part[0] @ _held(F, G[:, :4], rest_s)[1]) / z
    command = command * z**-ticks
    # the servos move by themselves and drive the six fast states: solve one after the other
    servos = _servo_response(Phi[6:, 6:], command[:, 6:], z)
    inputs = np.zeros((z.size, N_FAST, N_SIGNAL - 3), dtype=np.complex128)
    inputs[:, :, _after_rates(U)] = Phi[:6, 6:] @ servos + command[:, :6]
    inputs[:, :, _after_rates(GUST)] = Gamma[:6, 4:7]
    inputs[:, :, _after_rates(KINK)] = Gamma[:6, 7:8]
    inputs[:, :, _after_rates(VEL)] = -(Gamma[:6, 4:7] + (z - 1.0) * Rise[:6, 4:7])
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
