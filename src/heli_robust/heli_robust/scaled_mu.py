# SPDX-License-Identifier: Apache-2.0
"""Upper bound of mu for complex numbers and one full block, with its scalings, at many M at once.

min over D of the largest singular value of D M D^-1: Osborne's balancing, then steps down the
gradient in log D, in which the problem is convex. Whatever D comes out, the bound holds.
"""

import numpy as np
from numpy.typing import NDArray

_BALANCING = 40
_DESCENT = 149
_TINY = 1e-300


def scaled_mu(
    M: NDArray[np.complex128], scalars: int, descent: int = _DESCENT
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Upper bound (m,) of mu and the scalings (m, scalars) of the numbers, that of the rest 1.

    Parameters
    ----------
    M : (m, n_z, n_w) array
        The first `scalars` places of z and of w belong to the numbers, the others to a full block.
    scalars : int
    descent : int
        Steps after the balancing.
    """
    log_d = _balanced(np.abs(M) ** 2, scalars)
    best, found = np.full(len(M), np.inf), log_d.copy()
    for step in range(descent + 1):
        d = np.exp(log_d)
        scaled = M.copy()
        scaled[:, :scalars] *= d[:, :, None]
        scaled[:, :, :scalars] /= d[:, None, :]
        left, sizes, right = np.linalg.svd(scaled)
        better = sizes[:, 0] < best
        best = np.where(better, sizes[:, 0], best)
        found[better] = log_d[better]
        slope = np.abs(left[:, :scalars, 0]) ** 2 - np.abs(right[:, 0, :scalars]) ** 2
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        log_d = log_d - slope / np.maximum(size, 1.0 / 3.0) * (0.5 / (1.0 + 0.15 * step))
    return best, np.exp(found)


def _balanced(size: NDArray[np.float64], scalars: int) -> NDArray[np.float64]:
    """log D (m, scalars) for which what goes into each number's row equals what goes out."""
    k = scalars
    grouped = np.zeros((len(size), k + 1, k + 1))
    grouped[:, :k, :k] = size[:, :k, :k]
    grouped[:, :k, k] = size[:, :k, k:].sum(axis=2)
    grouped[:, k, :k] = size[:, k:, :k].sum(axis=1)
    grouped[:, range(k), range(k)] = 0.0
    log_d = np.zeros((len(size), k + 1))
    for _ in range(_BALANCING):
        for i in range(k):
            out = (grouped[:, i] * np.exp(-2.0 * log_d)).sum(axis=1) + _TINY
            into = (grouped[:, :, i] * np.exp(2.0 * log_d)).sum(axis=1) + _TINY
            log_d[:, i] = 0.25 * np.log(into / out)
    return log_d[:, :k]
