# SPDX-License-Identifier: Apache-2.0
"""The largest value of a function inside a box, by CMA-ES, beside random search.

CMA-ES: Hansen, "The CMA evolution strategy: a tutorial" (2016, arXiv:1604.00772), by the package
`cma`. A first part of the points is a Latin hypercube; the search begins at its best point, and
where it has converged again from the next best one with twice the population.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

Array = NDArray[np.float64]
Many = Callable[[Array], Array]
"""From points (n, d) to values (n,); +inf is beyond everything."""

_STREAM_CMA, _STREAM_RANDOM = (1 << 22) + 1, (1 << 22) + 2
LEAST = 10
"""Evaluations: with fewer there is nothing to search with."""
_FIRST = 0.2
_STEP = 0.4
_BATCH = 64
# Two dimensions at least: the package knows no single one. The further one does nothing.
_LEAST_DIMENSIONS = 2


@dataclass
class Search:
    """What a search has found so far.

    Attributes
    ----------
    best : float
        Largest value; NaN before the first.
    at : int
        Which evaluation it was, counted from 0.
    evaluations : int
    """

    best: float = math.nan
    at: int = -1
    evaluations: int = 0

    @property
    def lost(self) -> bool:
        """A value beyond everything was found: there is no larger one."""
        return self.best == math.inf

    def take(self, values: Array) -> None:
        """Count what was evaluated."""
        place = int(values.argmax())
        if not self.best >= values[place]:
            self.best, self.at = float(values[place]), self.evaluations + place
        self.evaluations += len(values)


def by_cma(
    many: Many, dimensions: int, reach: float, most: int, seed: int, search: Search | None = None
) -> Search:
    """Search for the largest value in the box [-reach, reach]^d.

    Parameters
    ----------
    many : callable
        Is given a generation at once.
    dimensions : int
    reach : float
    most : int
        Evaluations; fewer if one is beyond everything.
    seed : int
    search : Search, optional
        Is filled on the way.
    """
    import cma

    rng = _rng(seed, _STREAM_CMA)
    found = Search() if search is None else search

    def evaluate(points: Array) -> Array:
        points = points[: most - found.evaluations, :dimensions]
        values = np.asarray(many(points), dtype=float)
        found.take(values)
        return values

    first = max(2, round(_FIRST * most))
    starts = (2.0 * qmc.LatinHypercube(dimensions, seed=rng).random(first) - 1.0) * reach
    values = evaluate(starts)
    starts = starts[np.argsort(-values, kind="stable")]
    size = max(_LEAST_DIMENSIONS, dimensions)
    population, runs = 4 + int(3.0 * math.log(size)), 0
    while found.evaluations < most and not found.lost:
        begin = np.zeros(size)
        begin[:dimensions] = starts[runs % first]
        options = {
            "bounds": [-reach, reach], "popsize": population << runs, "verbose": -9,
            "randn": lambda *shape: rng.standard_normal(shape), "seed": math.nan,
            "tolfun": 1e-9, "tolfunhist": 1e-9,
        }  # fmt: skip
        strategy = cma.CMAEvolutionStrategy(begin, _STEP * reach, options)
        while found.evaluations < most and not strategy.stop():
            asked = np.array(strategy.ask())
            values = evaluate(asked)
            if found.lost or len(values) < len(asked):
                return found
            strategy.tell(list(asked), list(-values))
        runs += 1
    return found


def at_random(
    many: Many, dimensions: int, reach: float, most: int, seed: int, search: Search | None = None
) -> Search:
    """The same by points drawn uniformly in the box, until `most` or one beyond everything."""
    rng = _rng(seed, _STREAM_RANDOM)
    found = Search() if search is None else search
    while found.evaluations < most and not found.lost:
        count = min(_BATCH, most - found.evaluations)
        points = rng.uniform(-reach, reach, (count, dimensions))
        found.take(np.asarray(many(points), dtype=float))
    return found


def _rng(seed: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
