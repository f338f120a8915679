# SPDX-License-Identifier: Apache-2.0
"""Linear systems x' = A x + B u as plain arrays: exact sampling, servos, delay, eq. (19).

What flies and what is searched over is worked out with these. For analysis there is python-control
(`heli_core.linear` makes its systems of the same arrays), which also checks them in the tests.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.rows import INPUT_NAMES, STATE_NAMES, WIND_NAMES

if TYPE_CHECKING:
    import control

# -------------------------------------------------------------------------------------------------
# Linear systems.
# -------------------------------------------------------------------------------------------------

Matrix = NDArray[np.float64]
_SHORTEST_S = 1e-9  # a part of a tick that is shorter than this is rounding


class Delayed(NamedTuple):
    """x(n+1) = Phi x(n) + newer u(n - ticks) + older u(n - ticks - 1)."""

    Phi: Matrix
    ticks: int
    newer: Matrix
    older: Matrix


class ReducedOrderMatrices(NamedTuple):
    """z' = A z + B y + H u, x_u = z + K y: the matrices A', B', H' of eq. (19)."""

    A: Matrix
    B: Matrix
    H: Matrix


def held(A: Matrix, B: Matrix, dt_s: float) -> tuple[Matrix, Matrix]:
    """Phi, Gamma of x(n+1) = Phi x + Gamma u over dt_s with u held; exact."""
    from scipy.linalg import expm

    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    both = expm(block * dt_s)
    return both[:n, :n], both[:n, n:]


def held_and_linear(
    A: Matrix, B_held: Matrix, B_linear: Matrix, dt_s: float
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Phi, Gu, G0, G1 of x(n+1) = Phi x + Gu u + G0 y(n) + G1 y(n+1); exact.

    Over dt_s the input u of `B_held` is held and the input y of `B_linear` is linear.
    """
    from scipy.linalg import expm

    n, m, k = A.shape[0], B_held.shape[1], B_linear.shape[1]
    block = np.zeros((n + m + 2 * k, n + m + 2 * k))
    block[:n] = np.hstack([A, B_held, B_linear, np.zeros((n, k))])
    block[n + m : n + m + k, n + m + k :] = np.eye(k) / dt_s
    e = expm(block * dt_s)[:n]
    slope = e[:, n + m + k :]
    return e[:, :n], e[:, n : n + m], e[:, n + m : n + m + k] - slope, slope


def held_late(A: Matrix, B: Matrix, dt_s: float, delay_s: float) -> Delayed:
    """Sampled system whose input u(n), held over dt_s, acts delay_s late; exact.

    Where the delay is not a whole number of steps, two inputs act during each.
    """
    ticks = int(delay_s / dt_s + _SHORTEST_S / dt_s)
    part_s = delay_s - ticks * dt_s
    if part_s <= _SHORTEST_S:
        Phi, Gamma = held(A, B, dt_s)
        return Delayed(Phi, ticks, Gamma, np.zeros_like(B))
    rest, newer = held(A, B, dt_s - part_s)
    first, older = held(A, B, part_s)
    return Delayed(rest @ first, ticks, newer, rest @ older)


def with_delay_line(late: Delayed) -> tuple[Matrix, Matrix]:
    """A (n + m k, n + m k), B (n + m k, m) of a late system with its past inputs as states.

    States: x(n), then u(n-1) ... u(n-k), as far back as the delay needs.
    """
    n, m = late.newer.shape
    depth = late.ticks + (1 if np.any(late.older) else 0)
    A, B = np.zeros((n + m * depth, n + m * depth)), np.zeros((n + m * depth, m))
    A[:n, :n] = late.Phi
    for lag, gain in ((late.ticks, late.newer), (late.ticks + 1, late.older)):
        if lag == 0:
            B[:n] = gain
        elif lag <= depth:
            A[:n, n + m * (lag - 1) : n + m * lag] = gain
    if depth:
        B[n : n + m] = np.eye(m)
        A[n + m :, n : n + m * (depth - 1)] = np.eye(m * (depth - 1))
    return A, B


def stationary(A: Matrix, Q: Matrix) -> Matrix:
    """X = A X A' + Q of a stable A, by doubling."""
    X = Q
    for _ in range(64):
        step = A @ X @ A.T
        X, A = X + step, A @ A
        if np.max(np.abs(step)) <= 1e-14 * np.max(np.abs(X)):
            break
    return X


def with_servos(
    A: Matrix, B: Matrix, natural_radps: float, damping: float
) -> tuple[Matrix, Matrix]:
    """A (n + 2m, n + 2m), B (n + 2m, m) of x' = A x + B s behind like servos of second order.

    The servos' positions s (m,) follow the new inputs; states: x, positions, rates.
    """
    n, m = B.shape
    eye, w2 = np.eye(m), natural_radps**2
    F, G = np.zeros((n + 2 * m, n + 2 * m)), np.zeros((n + 2 * m, m))
    F[:n, :n], F[:n, n : n + m] = A, B
    F[n : n + m, n + m :] = eye
    F[n + m :, n : n + m] = -w2 * eye
    F[n + m :, n + m :] = -2.0 * damping * natural_radps * eye
    G[n + m :] = w2 * eye
    return F, G


def reduced_order_observer(
    A: Matrix, B: Matrix, K: Matrix, measured: tuple[int, ...], unmeasured: tuple[int, ...]
) -> ReducedOrderMatrices:
    """The reduced-order observer of eq. (19).

    Its error obeys e' = A' e exactly, whatever y and u do.

    Parameters
    ----------
    A, B : (n, n), (n, n_u) arrays
    K : (unmeasured, measured) array
        Gain.
    measured, unmeasured : tuple of int
        Places in x of y and of what is estimated.
    """
    m, u = list(measured), list(unmeasured)
    A_prime = A[np.ix_(u, u)] - K @ A[np.ix_(m, u)]
    return ReducedOrderMatrices(
        A=A_prime,
        B=A[np.ix_(u, m)] - K @ A[np.ix_(m, m)] + A_prime @ K,
        H=B[u] - K @ B[m],
    )


def diagonal_observer_gain(
    A: Matrix, poles: tuple[float, ...], measured: tuple[int, ...], unmeasured: tuple[int, ...]
) -> Matrix:
    """Gain K (unmeasured, measured) for which A' of eq. (19) is diag(poles), of least norm.

    Exact where what is estimated acts on y with full column rank.
    """
    m, u = list(measured), list(unmeasured)
    return np.asarray((A[np.ix_(u, u)] - np.diag(poles)) @ np.linalg.pinv(A[np.ix_(m, u)]))


# -------------------------------------------------------------------------------------------------
# The linear helicopter of eq. (9) and (10) as a system of python-control with named signals.
#
# For analysis: python-control takes seconds to import, so whatever flies does not import this
# module.
# -------------------------------------------------------------------------------------------------

WIND = tuple(f"wind_{name}" for name in WIND_NAMES)
"""Velocity of the air in body axes as inputs, m/s (`u`, `v`, `w` of E)."""


def hover_system(
    A: NDArray[np.float64], B: NDArray[np.float64], E: NDArray[np.float64], name: str
) -> control.StateSpace:
    """x' = A x + B u + E w, deviations from trim, all states as outputs.

    Parameters
    ----------
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        SI and rad; states `STATE_NAMES`.
    name : str
        Of the system.

    Returns
    -------
    control.StateSpace
        Inputs d_lat d_lon d_ped, then `WIND`.
    """
    import control

    return control.ss(
        A,
        np.hstack([B, E]),
        np.eye(len(STATE_NAMES)),
        np.zeros((len(STATE_NAMES), len(INPUT_NAMES) + len(WIND))),
        name=name,
        states=list(STATE_NAMES),
        inputs=[*INPUT_NAMES, *WIND],
        outputs=list(STATE_NAMES),
    )
