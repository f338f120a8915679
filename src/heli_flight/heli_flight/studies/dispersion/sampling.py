# SPDX-License-Identifier: Apache-2.0
"""Which points of the unit cube a campaign flies."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from heli_parameters.parameters import ParameterError

GRID = "grid"
SAMPLINGS = ("random", "latin_hypercube", "sobol", GRID)
SEARCH = "search"
"""Points that were looked for: no sample, which nobody may take quantiles or shares of."""
# Child of the seed's sequence: far from those of wind, sensors and worlds.
_STREAM = 1 << 21
_TINY = 1e-12


def unit_points(sampling: str, count: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Points (N, d) in the unit cube.

    Parameters
    ----------
    sampling : str
        One of `SAMPLINGS` but the grid.
    count, dimensions : int
    seed : int
        Of the sampling alone; the flights have their own.

    Raises
    ------
    ParameterError
        Sobol points that are no power of two have no balance.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    if dimensions == 0:
        return np.zeros((count, 0))
    if sampling == "random":
        return rng.random((count, dimensions))
    if sampling == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=rng).random(count))
    power = count.bit_length() - 1
    if count != 1 << power:
        raise ParameterError(
            f"flights: {count}: sobol needs a power of two; allowed: {1 << power}, {2 << power}"
        )
    return np.asarray(qmc.Sobol(dimensions, seed=rng).random_base2(power))


def correlated(
    points: NDArray[np.float64], pairs: Sequence[tuple[int, int, float]]
) -> NDArray[np.float64]:
    """Points (N, d) with a Gaussian copula: each column stays uniform.

    Parameters
    ----------
    points : (N, d) array
    pairs : sequence of (int, int, float)
        Columns and the correlation of their normal scores; rank correlations are
        6/pi asin(rho/2) (Pearson 1907).

    Raises
    ------
    ParameterError
        There are no variables that correlate so.
    """
    if not pairs:
        return points
    matrix = np.eye(points.shape[1])
    for i, j, rho in pairs:
        matrix[i, j] = matrix[j, i] = rho
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        raise ParameterError(
            f"correlate: no variables correlate so (least eigenvalue {least:.3g}); allowed: a "
            "positive definite matrix"
        ) from None
    scores = stats.norm.ppf(np.clip(points, _TINY, 1.0 - _TINY))
    return np.asarray(stats.norm.cdf(scores @ factor.T))
