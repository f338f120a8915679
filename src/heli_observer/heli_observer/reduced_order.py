# SPDX-License-Identifier: Apache-2.0
"""Reduced-order observer of a_s, b_s, d_int: eq. (19) of the paper.

With the nine states of eq. (10) split into measured m = (phi theta p q r psi) and unmeasured
u = (a_s b_s d_int):  x_u_hat = z + K y,  z' = A' z + B' y + H' u  with
  A' = A_uu - K A_mu,  B' = A_um - K A_mm + A' K,  H' = B_u - K B_m,
all in deviations from trim. The error obeys e' = A' e exactly, whatever y and u do.

Discretisation over one tick is exact (matrix exponential) for commands held constant over the tick,
which is how they act, and outputs that vary linearly between two ticks: both y(n-1) and y(n) are
known when z is brought to n, so there is no delay. The optional second-order servo model is part of
the same exponential.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import copy_part, njit, scratch
from heli_core.linear import held_and_linear, reduced_order_observer, with_servos
from heli_core.rows import MEASURED, UNMEASURED
from heli_core.ticks import TICK_S
from heli_observer.layout import N_INPUT, N_UNMEASURED, OUTPUT, ROTOR_W, ReducedOrderParams

_N_ROTOR_W = ROTOR_W.size  # a length of what lies on the stack

Matrix = NDArray[np.float64]


class ReducedOrderError(ValueError):
    """A reduced-order observer that cannot be built; the message says why."""


@dataclass(frozen=True)
class ReducedOrderModel:
    """Continuous matrices of eq. (19).

    Attributes
    ----------
    A_prime : ndarray (3, 3)
    B_prime : ndarray (3, 6)
    H_prime : ndarray (3, 3)
    K : ndarray (3, 6)
    """

    A_prime: Matrix
    B_prime: Matrix
    H_prime: Matrix
    K: Matrix


def _finite(name: str, value: Matrix, shape: tuple[int, ...]) -> Matrix:
    array = np.asarray(value, dtype=np.float64)
    if array.size != int(np.prod(shape)):
        raise ReducedOrderError(f"{name} has {array.size} entries, {shape} is needed")
    if not np.all(np.isfinite(array)):
        raise ReducedOrderError(f"{name} has an entry that is not finite")
    return np.ascontiguousarray(array.reshape(shape))


def reduced_order_model(A: Matrix, B: Matrix, K: Matrix) -> ReducedOrderModel:
    """Matrices of eq. (19).

    Parameters
    ----------
    A : ndarray (9, 9)
    B : ndarray (9, 3)
        Hover model of eq. (10), continuous, SI and rad.
    K : ndarray (3, 6)
        Observer gain: rows a_s, b_s, d_int; columns phi theta p q r psi.

    Raises
    ------
    ReducedOrderError
        Wrong size, an entry that is not finite, or an A' that is not stable.
    """
    A, B = _finite("model.A", A, (9, 9)), _finite("model.B", B, (9, 3))
    K = _finite("K", K, (N_UNMEASURED, OUTPUT.size))
    observer = reduced_order_observer(A, B, K, MEASURED, UNMEASURED)
    poles = np.linalg.eigvals(observer.A)
    if not np.all(poles.real < 0.0):
        raise ReducedOrderError(
            f"K makes the reduced-order observer unstable: poles {np.round(poles, 4).tolist()}"
        )
    return ReducedOrderModel(observer.A, observer.B, observer.H, K)


def continuous_system(
    model: ReducedOrderModel, servo_frequency_radps: float, servo_damping: float
) -> tuple[Matrix, Matrix, Matrix]:
    """The observer with its servo model: w' = F w + G_u u + G_y y, w = [z, servo pos, servo rate].

    servo_frequency_radps = 0 leaves the servos out: then u drives z directly.
    """
    z = slice(0, N_UNMEASURED)
    F = np.zeros((ROTOR_W.size, ROTOR_W.size))
    G_u = np.zeros((ROTOR_W.size, N_INPUT))
    G_y = np.zeros((ROTOR_W.size, OUTPUT.size))
    G_y[z] = model.B_prime
    if servo_frequency_radps == 0.0:
        F[z, z], G_u[z] = model.A_prime, model.H_prime
        return F, G_u, G_y
    F, G_u = with_servos(model.A_prime, model.H_prime, servo_frequency_radps, servo_damping)
    return F, G_u, G_y


def reduced_order_params(
    model: ReducedOrderModel,
    x_trim: Matrix,
    u_trim: Matrix,
    u_delay_ticks: int,
    servo_frequency_radps: float,
    servo_damping: float,
    tick_s: float = TICK_S,
) -> ReducedOrderParams:
    """Constants of the compiled observer; x_trim (9,) and u_trim (4,) are absolute."""
    x_trim = _finite("trim.x", x_trim, (9,))
    u_trim = _finite("trim.u", u_trim, (4,))
    system = continuous_system(model, servo_frequency_radps, servo_damping)
    Phi, Gu, G0, G1 = (np.ascontiguousarray(m) for m in held_and_linear(*system, tick_s))
    return ReducedOrderParams(
        Phi=Phi,
        Gu=Gu,
        G0=G0,
        G1=G1,
        K=model.K,
        y_trim=x_trim[list(MEASURED)],
        x_u_trim=x_trim[list(UNMEASURED)],
        u_trim=u_trim,
        u_delay_ticks=int(u_delay_ticks),
        with_servo=int(servo_frequency_radps > 0.0),
    )


@njit
def rotor_start(w, y, u, k):
    """Start w (9,) so that a_s, b_s, d_int are at trim and the servos stand where they are told.

    y (6,) are deviations from trim; u (4,) is the command flown so far; k: ReducedOrderParams.
    """
    for i in range(N_UNMEASURED):
        w[i] = 0.0
        for j in range(OUTPUT.size):
            w[i] -= k.K[i, j] * y[j]
        w[ROTOR_W.servo + i] = (u[i] - k.u_trim[i]) * k.with_servo
        w[ROTOR_W.servo_rate + i] = 0.0


@njit
def rotor_step(w, y0, y1, u, k):
    """Bring w (9,) over one tick, in place.

    y0, y1 (6,) are the outputs at its beginning and end (deviations from trim, psi unwrapped);
    u (4,) is the command that acts on the aircraft during it; k is the ReducedOrderParams.
    """
    new = scratch(_N_ROTOR_W)
    for i in range(ROTOR_W.size):
        new[i] = 0.0
        for j in range(ROTOR_W.size):
            new[i] += k.Phi[i, j] * w[j]
        for j in range(OUTPUT.size):
            new[i] += k.G0[i, j] * y0[j] + k.G1[i, j] * y1[j]
        for j in range(N_INPUT):
            new[i] += k.Gu[i, j] * (u[j] - k.u_trim[j])
    copy_part(w, 0, new, 0, ROTOR_W.size)


@njit
def rotor_output(w, y, k, out):
    """a_s, b_s (rad), d_int into out (3,), absolute: z + K y + trim."""
    for i in range(N_UNMEASURED):
        out[i] = k.x_u_trim[i] + w[i]
        for j in range(OUTPUT.size):
            out[i] += k.K[i, j] * y[j]
