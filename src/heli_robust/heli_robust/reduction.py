# SPDX-License-Identifier: Apache-2.0
"""Balanced truncation of a stable sampled system (Moore, *IEEE Trans. Autom. Control* 26, 1981)."""

import numpy as np
from scipy.linalg import solve_discrete_lyapunov, svd

from heli_math.central_controller import System
from heli_robust.errors import Cause, RobustError
from heli_robust.norms import Matrix, root


def balancing(system: System) -> tuple[Matrix, Matrix, Matrix]:
    """Hankel singular values (n,), falling, and W, V with W V = I that balance the system.

    The system of order k is W[:k] A V[:, :k], W[:k] B, C V[:, :k], D; its error is at most twice
    the sum of the Hankel singular values that are left out.

    Raises
    ------
    RobustError
        UNSTABLE.
    """
    A, B, C, _ = system
    radius = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
    if radius >= 1.0:
        raise RobustError(Cause.UNSTABLE, f"a pole has the modulus {radius:.6g}, not below 1")
    reach = _half(solve_discrete_lyapunov(A, B @ B.T))
    seen = _half(solve_discrete_lyapunov(A.T, C.T @ C))
    left, hankel, right = svd(seen.T @ reach)
    part = np.sqrt(np.maximum(hankel, hankel[0] * np.finfo(float).eps))
    return hankel, (left / part).T @ seen.T, reach @ right.T / part


def truncated(system: System, W: Matrix, V: Matrix, order: int) -> System:
    """The system of an order, with W and V of `balancing`."""
    left, right = W[:order], V[:, :order]
    return System(left @ system.A @ right, left @ system.B, system.C @ right, system.D)


def _half(gramian: Matrix) -> Matrix:
    return root(0.5 * (gramian + gramian.T))
