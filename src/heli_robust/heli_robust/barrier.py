# SPDX-License-Identifier: Apache-2.0
"""A linear matrix inequality of small Hermitian matrices in many unknowns, by a barrier method.

maximise t subject to sum x_i T_i - t I >= 0, sum x_i E_i >= 0, trace of the latter fixed: Newton's
method along the central path (Boyd, Vandenberghe, *Convex Optimization*, 2004, ch. 11). An
iteration costs k^2 n^2 for k unknowns and matrices of size n, where a general solver, which has the
entries of the matrices for unknowns, pays n^6. No answer is trusted: `Scalings.slack` is worked out
anew from x.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_FASTER = 8.0  # tau grows by this factor
_FIRST_GAP, _LAST_GAP = 1.0, 1e-10
_SHARE = 0.05  # a gap of this share of t is near enough where t > 0
_PLENTY = 2.0  # real blocks alone may leave t without a bound
_CENTRED, _MOST_STEPS = 0.3, 200


def largest_slack(
    T: NDArray[np.complex128], E: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], float]:
    """The unknowns x (k,) with which t is largest, or near it once its sign is sure, and t.

    Parameters
    ----------
    T : (k, n, n) array
        Hermitian.
    E : (k_d, m, m) array
        Hermitian, of the first k_d unknowns; some real combination of them is the identity. The
        trace of sum x_i E_i is that of the identity.
    """
    k, n, m = len(T), T.shape[1], E.shape[1]
    flat = E.reshape(len(E), -1)
    flat = np.hstack([flat.real, flat.imag])
    one = np.append(np.eye(m).ravel(), np.zeros(m * m))
    x = np.zeros(k + 1)
    x[: len(E)] = np.linalg.lstsq(flat.T, one, rcond=None)[0]
    x[k] = float(np.linalg.eigvalsh(np.tensordot(x[:k], T, 1))[0]) - 1.0
    terms = np.concatenate([T, -np.eye(n)[None]])
    trace = np.zeros(k + 1)
    trace[: len(E)] = np.trace(E, axis1=1, axis2=2).real
    tau, steps = (n + m) / _FIRST_GAP, 0
    roots = _roots(x, terms, E)
    while steps < _MOST_STEPS and roots is not None:
        steps += 1
        step, decrement = _newton(terms, E, roots, trace, tau)
        along, value = 1.0, _value(x, roots, tau)
        while True:
            trial = x + along * step
            found = _roots(trial, terms, E)
            if found is not None and _value(trial, found, tau) <= value:
                break
            along *= 0.5
            if along < 1e-6:
                return x[:k], float(x[k])
        x, roots = trial, found
        if x[k] > _PLENTY:
            break
        if decrement < _CENTRED:
            gap = (n + m) / tau
            if gap < _LAST_GAP or x[k] + gap < 0.0 or gap < _SHARE * x[k]:
                break
            tau *= _FASTER
    return x[:k], float(x[k])


_Roots = tuple[NDArray[Any], NDArray[Any]]


def _roots(x: NDArray[np.float64], terms: NDArray[Any], E: NDArray[Any]) -> _Roots | None:
    """Cholesky factors of both matrices; None where one is not positive definite."""
    try:
        slack = np.linalg.cholesky(np.tensordot(x, terms, 1))
        return slack, np.linalg.cholesky(np.tensordot(x[: len(E)], E, 1))
    except np.linalg.LinAlgError:
        return None


def _value(x: NDArray[np.float64], roots: _Roots, tau: float) -> float:
    """The barrier function -tau t - log det - log det."""
    slack, positive = (float(np.sum(np.log(np.diag(root).real))) for root in roots)
    return -tau * float(x[-1]) - 2.0 * (slack + positive)


def _newton(
    terms: NDArray[Any], E: NDArray[Any], roots: _Roots, trace: NDArray[np.float64], tau: float
) -> tuple[NDArray[np.float64], float]:
    """Newton's step that keeps the trace, and its decrement."""
    H = np.zeros((len(terms), len(terms)))
    g = np.zeros(len(terms))
    g[-1] = -tau
    for matrices, root in zip((terms, E), roots, strict=True):
        inverse = np.linalg.inv(root)
        seen = inverse @ matrices @ inverse.conj().T
        rows = seen.reshape(len(seen), -1)
        rows = np.hstack([rows.real, rows.imag])
        H[: len(rows), : len(rows)] += rows @ rows.T
        g[: len(rows)] -= np.trace(seen, axis1=1, axis2=2).real
    H[np.diag_indices_from(H)] *= 1.0 + 1e-14
    solved = np.linalg.solve(H, np.column_stack([-g, trace]))
    step = solved[:, 0] - solved[:, 1] * (trace @ solved[:, 0]) / (trace @ solved[:, 1])
    return step, max(-float(g @ step), 0.0) ** 0.5
