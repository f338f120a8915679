# SPDX-License-Identifier: Apache-2.0
"""One quadratic bound for a family of loops: stable however quickly one becomes another.

If x' P x shrinks at every step under each A of a family, it shrinks under every A of their convex
hull, in any order (Boyd, El Ghaoui, Feron, Balakrishnan, *Linear Matrix Inequalities in System and
Control Theory*, 1994, section 5.1).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance, solve_discrete_lyapunov

from heli_robust.errors import Cause, RobustError

Matrix = NDArray[np.float64]

_TRIALS = 8


class CommonBound(NamedTuple):
    """What all members share.

    Attributes
    ----------
    P : (n, n) array
        Positive definite.
    contraction : float
        Largest factor, below one, by which a step changes sqrt(x' P x).
    """

    P: Matrix
    contraction: float


def contraction_of(A: Matrix, P: Matrix) -> float:
    """Largest factor by which x+ = A x, (n, n), changes sqrt(x' P x), P (n, n) positive definite.

    Raises
    ------
    numpy.linalg.LinAlgError
        P is not positive definite.
    """
    L = np.linalg.cholesky(P)
    return float(np.linalg.norm(np.linalg.solve(L, A.T @ L), 2))


def common_bound(family: Sequence[Matrix]) -> CommonBound:
    """A quadratic bound that all members of a family share.

    Tried are sums of what the members' own Lyapunov equations give, each asked to decay at a rate
    between the slowest member's and none. It is found by them, and proved by `contraction_of`.

    Parameters
    ----------
    family : sequence of (n, n) arrays
        x+ = A x.

    Returns
    -------
    CommonBound

    Raises
    ------
    RobustError
        NOT_FINITE; UNSTABLE: a member is; NO_CERTIFICATE: none was found, which does not say that
        there is none.
    """
    radius = 0.0
    for place, A in enumerate(family):
        if not np.all(np.isfinite(A)):
            raise RobustError(Cause.NOT_FINITE, f"member {place} holds a value that is not finite")
        radius = max(radius, float(np.max(np.abs(np.linalg.eigvals(A)))))
        if radius >= 1.0:
            raise RobustError(
                Cause.UNSTABLE,
                f"member {place} has an eigenvalue of modulus {radius:.6g}, not below 1",
            )
    _, (scale, _) = matrix_balance(np.mean(family, axis=0), permute=False, separate=True)
    balanced = [A * scale / scale[:, None] for A in family]
    found = [_bound(balanced, radius + (1.0 - radius) * k / _TRIALS) for k in range(1, _TRIALS)]
    best = min(found, key=lambda bound: bound.contraction)
    P = best.P / np.outer(scale, scale)
    worst = max(contraction_of(A, P) for A in family)
    if worst >= 1.0:
        raise RobustError(
            Cause.NO_CERTIFICATE,
            f"no quadratic bound was found that all {len(family)} members share: with the best, "
            f"a step of one may still grow by the factor {worst:.6g}",
        )
    return CommonBound(P, worst)


def _bound(family: Sequence[Matrix], rate: float) -> CommonBound:
    """The sum of the members' solutions at a rate of decay, and what it is worth."""
    n = family[0].shape[0]
    P = sum(solve_discrete_lyapunov((A / rate).T, np.eye(n)) for A in family)
    P = 0.5 * (P + P.T) / np.linalg.norm(P, 2)
    return CommonBound(P, max(contraction_of(A, P) for A in family))
