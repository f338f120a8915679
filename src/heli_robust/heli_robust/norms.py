# SPDX-License-Identifier: Apache-2.0
"""H-infinity norm of a stable discrete-time system, with its angle on the unit circle."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from heli_robust.errors import Cause, RobustError

Matrix = NDArray[np.float64]

REL_TOL = 1e-10
_NEAR_CIRCLE = 1e-5
"""Eigenvalues this near the circle are tried as crossings: a false one costs a trial only."""


def root(square: Matrix) -> Matrix:
    """F (n, n) with F F' the positive part of a symmetric matrix (n, n)."""
    values, vectors = np.linalg.eigh(square)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def discrete_norm(A: Matrix, B: Matrix, C: Matrix, D: Matrix) -> tuple[float, float]:
    """max over the unit circle of the largest singular value of D + C (z I - A)^-1 B.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, n_u), (n_y, n), (n_y, n_u) arrays

    Returns
    -------
    norm, angle : float
        Relative accuracy 1e-10 (Bruinsma, Steinbuch 1990, on the circle); angle of z, rad.

    Raises
    ------
    RobustError
        NOT_FINITE or UNSTABLE.
    """
    for name, given in zip("ABCD", (A, B, C, D), strict=True):
        if not np.all(np.isfinite(given)):
            raise RobustError(Cause.NOT_FINITE, f"{name} holds a value that is not finite")
    poles = np.linalg.eigvals(A)
    radius = float(np.max(np.abs(poles), initial=0.0))
    if radius >= 1.0:
        raise RobustError(Cause.UNSTABLE, f"a pole has the modulus {radius:.6g}, not below 1")

    def gain(angle: float) -> float:
        inside = np.exp(1j * angle) * np.eye(A.shape[0]) - A
        return float(np.linalg.norm(D + C @ np.linalg.solve(inside, B), 2))

    best, where = max((gain(t), t) for t in np.concatenate([[0.0, np.pi], np.angle(poles)]))
    for _ in range(60):
        if best == 0.0:
            break
        level = best * (1.0 + REL_TOL)
        crossing = np.unique(np.append(_crossings(A, B, C, D, level), 0.0))
        trial = np.append(crossing, 0.5 * (crossing[1:] + crossing[:-1]))
        found, at = max((gain(t), t) for t in trial)
        if found <= level:
            break
        best, where = found, at
    return best, abs(float(where))


def _crossings(A: Matrix, B: Matrix, C: Matrix, D: Matrix, level: float) -> Matrix:
    """Angles in [0, pi] where a singular value equals `level`.

    G~ G u = level^2 u as a generalised eigenproblem in (x, costate, u), nothing inverted.
    """
    n, m = B.shape
    left, right = np.zeros((2 * n + m, 2 * n + m)), np.zeros((2 * n + m, 2 * n + m))
    left[:n, :n], left[:n, 2 * n :] = A, B
    left[n : 2 * n, n : 2 * n] = np.eye(n)
    left[2 * n :] = np.hstack([-D.T @ C / level, -B.T, level * np.eye(m) - D.T @ D / level])
    right[:n, :n] = np.eye(n)
    right[n : 2 * n] = np.hstack([C.T @ C / level, A.T, C.T @ D / level])
    values = eigvals(left, right)
    values = values[np.isfinite(values)]
    return np.abs(np.angle(values[np.abs(np.abs(values) - 1.0) < _NEAR_CIRCLE]))
