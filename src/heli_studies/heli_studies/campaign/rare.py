# SPDX-License-Identifier: Apache-2.0
"""Small probabilities by subset simulation, in standard normal space.

Levels: Au and Beck, "Estimation of small failure probabilities in high dimensions by subset
simulation", Probabilistic Engineering Mechanics 16 (2001) 263-277. Chains: conditional sampling
with an adapted step, Papaioannou, Betz, Zwirglmaier and Straub, "MCMC algorithms for subset
simulation", Probabilistic Engineering Mechanics 41 (2015) 89-103. How far the estimate is
off, by which of the first points the last ones descend from: Lee and Whiteley, "Variance estimation
in the particle filter", Biometrika 105 (2018) 609-625; Au and Beck's own formula leaves out what
chains from one ancestor have in common, and is told beside it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
Many = Callable[[Array], Array]
"""From points (n, d), standard normal, to values (n,); +inf is beyond everything."""

SHARE = 0.1
"""Of a level's points those that the next one begins with."""
LENGTH = round(1.0 / SHARE)
"""Points of a chain; those of a level are a multiple of it."""
_STREAM = 1 << 22
_STEP, _ACCEPTANCE = 0.6, 0.44
_REDRAWN = 0.2
_DEEPEST = 1e-9
_QUANTILE = float(stats.norm.ppf(0.975))


class Ended(StrEnum):
    """Why no further level was begun."""

    REACHED = "the bound is reached"
    BUDGET = "the flights are spent"
    DEEPEST = "rarer than can be told"
    PLATEAU = "a tenth of all points or more has one and the same value"


@dataclass(frozen=True)
class Level:
    """Points drawn given that they are beyond the threshold of the level before.

    Attributes
    ----------
    threshold : float
        Next threshold, or the bound.
    share : float
        Of these points that are beyond it.
    share_cov : float
        Coefficient of variation of the share, with the correlation within the chains.
    accepted : float
        Share of moves that stayed beyond the threshold of the level before; NaN of the first level.
    flights : int
        So far, those of earlier levels among them.
    probability : float
        To be beyond `threshold`: the product of the shares so far.
    cov : float
        Coefficient of variation of `probability`, from lines of descent.
    au_beck : float
        The same by Au and Beck's formula: smaller where chains do not forget where they began.
    """

    threshold: float
    share: float
    share_cov: float
    accepted: float
    flights: int
    probability: float
    cov: float
    au_beck: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of `probability`, taken as lognormal."""
        if not math.isfinite(self.cov):
            return 0.0, 1.0
        width = _QUANTILE * math.sqrt(math.log1p(self.cov**2))
        return self.probability * math.exp(-width), min(1.0, self.probability * math.exp(width))


@dataclass(frozen=True)
class Estimate:
    """What subset simulation has found.

    Attributes
    ----------
    levels : tuple of Level
        The last one's probability is the answer if `ended` is REACHED; otherwise the bound is at
        least as rare as the last threshold.
    ended : Ended
    """

    levels: tuple[Level, ...]
    ended: Ended


def subset_simulation(
    many: Many,
    dimensions: int,
    bound: float,
    per_level: int,
    most: int,
    seed: int,
    redrawn: int = 0,
    told: Callable[[Level], None] | None = None,
) -> Estimate:
    """Probability that a function of independent standard normal variables is above a bound.

    Parameters
    ----------
    many : callable
        Is given a level's points at once, later a step of all its chains.
    dimensions : int
    bound : float
    per_level : int
        Points of a level, a multiple of `LENGTH`, at least twice that.
    most : int
        No level is begun that would need more points than this in all.
    seed : int
    redrawn : int
        So many variables, the last ones, have no neighbourhood, such as the seed of noise: a step
        keeps them or draws them anew, which leaves the normal distribution as it is, too.
    told : callable, optional
        Is given each level once it is done.

    Returns
    -------
    Estimate

    Raises
    ------
    ValueError
        The points of a level cannot be cut into chains, or there is no level at all.
    """
    if per_level % LENGTH or per_level < 2 * LENGTH or most < per_level:
        raise ValueError(f"{per_level} points of a level, {most} at most")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    points = rng.standard_normal((per_level, dimensions))
    values, accepted = _evaluated(many, points), math.nan
    flown, step = per_level, _STEP
    levels: list[Level] = []
    chains = per_level // LENGTH
    ancestors = np.arange(per_level)
    while True:
        level, beyond = _judged(values, ancestors, bound, levels, accepted, flown)
        stuck = bool(levels) and level.threshold <= levels[-1].threshold
        levels.append(level)
        if told is not None:
            told(level)
        if level.threshold == bound:
            return Estimate(tuple(levels), Ended.REACHED)
        if stuck or level.share == 1.0:
            return Estimate(tuple(levels), Ended.PLATEAU)
        if level.probability * SHARE < _DEEPEST:
            return Estimate(tuple(levels), Ended.DEEPEST)
        if flown + per_level - chains > most:
            return Estimate(tuple(levels), Ended.BUDGET)
        begin = rng.permutation(np.flatnonzero(beyond))[:chains]
        points, values, accepted, step = _chains(
            many, points[begin], values[begin], level.threshold, step, redrawn, rng
        )
        ancestors = np.tile(ancestors[begin], LENGTH)
        flown += per_level - chains


def _evaluated(many: Many, points: Array) -> Array:
    """Values; what is not a number is beyond everything."""
    values = np.asarray(many(points), dtype=float)
    return np.where(np.isnan(values), np.inf, values)


def _judged(
    values: Array,
    ancestors: NDArray[np.int64],
    bound: float,
    before: list[Level],
    accepted: float,
    flown: int,
) -> tuple[Level, NDArray[np.bool_]]:
    """A level, the points of a step of all chains one after the other; who is beyond."""
    chains = round(values.size * SHARE)
    falling = np.sort(values)[::-1]
    threshold = _between(falling[chains - 1], falling[chains])
    last = threshold >= bound
    threshold = bound if last else threshold
    beyond = values > threshold if last else values >= threshold
    share, share_cov = float(beyond.mean()), _share_cov(beyond, LENGTH if before else 1)
    probability = share * (before[-1].probability if before else 1.0)
    au_beck = math.hypot(share_cov, before[-1].au_beck if before else 0.0)
    cov = _descent_cov(ancestors[beyond], values.size)
    return Level(threshold, share, share_cov, accepted, flown, probability, cov, au_beck), beyond


def _between(larger: float, smaller: float) -> float:
    """Middle of two values; with an infinite one the infinite, as it is in nobody's middle."""
    return float(0.5 * (larger + smaller)) if math.isfinite(larger) else float(larger)


def _descent_cov(ancestors: NDArray[np.int64], count: int) -> float:
    """Coefficient of variation from who of so many first points the points beyond descend from."""
    if not ancestors.size:
        return math.inf
    shares = np.bincount(ancestors) / ancestors.size
    return math.sqrt(max(float((shares * shares).sum()) - 1.0 / count, 0.0))


def _share_cov(beyond: NDArray[np.bool_], length: int) -> float:
    """Coefficient of variation of a share over chains (Au and Beck 2001, eq. 28 and 29)."""
    share, count = float(beyond.mean()), beyond.size
    if share in (0.0, 1.0):
        return math.inf if share == 0.0 else 0.0
    chains = beyond.reshape(length, -1).astype(float)
    gamma = 0.0
    for lag in range(1, length):
        covariance = float((chains[:-lag] * chains[lag:]).mean()) - share**2
        gamma += 2.0 * (1.0 - lag / length) * covariance / (share * (1.0 - share))
    return math.sqrt(max((1.0 - share) / (share * count) * (1.0 + gamma), 0.0))


def _chains(
    many: Many,
    points: Array,
    values: Array,
    threshold: float,
    step: float,
    redrawn: int,
    rng: np.random.Generator,
) -> tuple[Array, Array, float, float]:
    """Chains from points beyond a threshold: all points and values, accepted share, new step.

    A candidate rho u + sqrt(1 - rho^2) w is normal if u is; it is taken if it is beyond, too. All
    chains go together; the step follows what was accepted of all of them (2015, section 5).
    """
    smooth = points.shape[1] - redrawn
    all_points, all_values, accepted = [points], [values], []
    for k in range(1, LENGTH):
        drawn = rng.standard_normal(points.shape)
        candidates = math.sqrt(1.0 - step**2) * points + step * drawn
        anew = rng.random((len(points), redrawn)) < _REDRAWN
        candidates[:, smooth:] = np.where(anew, drawn[:, smooth:], points[:, smooth:])
        found = _evaluated(many, candidates)
        taken = found >= threshold
        points = np.where(taken[:, None], candidates, points)
        values = np.where(taken, found, values)
        all_points.append(points)
        all_values.append(values)
        accepted.append(float(taken.mean()))
        step = min(1.0, step * math.exp((accepted[-1] - _ACCEPTANCE) / math.sqrt(k)))
    return np.concatenate(all_points), np.concatenate(all_values), float(np.mean(accepted)), step
