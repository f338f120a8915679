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

import difflib
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy import stats
from scipy.stats import qmc

from heli_core.metrics import POSITIONS, PaperMetric
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import seconds
from heli_flight.scoring import TRUTH_LESS_DRIFT, sources_of
from heli_flight.settings import Settings
from heli_flight.terminal import table
from heli_studies.campaign.spec import (
    CAUSE,
    EACH,
    FIGURE,
    NUMBER,
    SEARCH,
    FlightEnding,
    Spec,
    check_ends,
    correlated,
)
from heli_studies.campaign.workers import Fly, Rows, fly_here, tasks

# -------------------------------------------------------------------------------------------------
# Subset.
# -------------------------------------------------------------------------------------------------

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
class SubsetLevel:
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
class ProbabilityEstimate:
    """What subset simulation has found.

    Attributes
    ----------
    levels : tuple of SubsetLevel
        The last one's probability is the answer if `ended` is REACHED; otherwise the bound is at
        least as rare as the last threshold.
    ended : Ended
    """

    levels: tuple[SubsetLevel, ...]
    ended: Ended


def subset_simulation(
    many: Many,
    dimensions: int,
    bound: float,
    per_level: int,
    most: int,
    seed: int,
    redrawn: int = 0,
    report_level: Callable[[SubsetLevel], None] | None = None,
) -> ProbabilityEstimate:
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
    report_level : callable, optional
        Is given each level once it is done.

    Returns
    -------
    ProbabilityEstimate

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
    levels: list[SubsetLevel] = []
    chains = per_level // LENGTH
    ancestors = np.arange(per_level)
    while True:
        level, beyond = _judged(values, ancestors, bound, levels, accepted, flown)
        stuck = bool(levels) and level.threshold <= levels[-1].threshold
        levels.append(level)
        if report_level is not None:
            report_level(level)
        if level.threshold == bound:
            return ProbabilityEstimate(tuple(levels), Ended.REACHED)
        if stuck or level.share == 1.0:
            return ProbabilityEstimate(tuple(levels), Ended.PLATEAU)
        if level.probability * SHARE < _DEEPEST:
            return ProbabilityEstimate(tuple(levels), Ended.DEEPEST)
        if flown + per_level - chains > most:
            return ProbabilityEstimate(tuple(levels), Ended.BUDGET)
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
    before: list[SubsetLevel],
    accepted: float,
    flown: int,
) -> tuple[SubsetLevel, NDArray[np.bool_]]:
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
    return SubsetLevel(
        threshold, share, share_cov, accepted, flown, probability, cov, au_beck
    ), beyond


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
        candidate_values = _evaluated(many, candidates)
        taken = candidate_values >= threshold
        points = np.where(taken[:, None], candidates, points)
        values = np.where(taken, candidate_values, values)
        all_points.append(points)
        all_values.append(values)
        accepted.append(float(taken.mean()))
        step = min(1.0, step * math.exp((accepted[-1] - _ACCEPTANCE) / math.sqrt(k)))
    return np.concatenate(all_points), np.concatenate(all_values), float(np.mean(accepted)), step


# -------------------------------------------------------------------------------------------------
# Flights at chosen points of a campaign's dispersions, instead of those that it samples.
# -------------------------------------------------------------------------------------------------

LAST_SEED = 2**31 - 1
REACH = 6.0
"""As far out as rare failures are looked for, sigma."""


@dataclass(frozen=True)
class Points(Spec):
    """A spec whose flights are at points of standard normal space; how it samples counts no more.

    Attributes
    ----------
    parent : Spec
    scores : (N, d) array
        Independent standard normal scores of the dispersed parameters, in the order of the spec:
        their shares are the distributions' quantiles, after the spec's correlation. One more
        column is the score of the seed of wind and sensors, uniform from 1 to `LAST_SEED`; without
        it all flights have `one_seed` of the parent.
    """

    parent: Spec = field(default_factory=Spec)
    scores: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, parent: Spec, scores: Array | None = None) -> "Points":
        """Those of a spec; without scores there is no flight."""
        if scores is None:
            scores = np.zeros((0, len(parent.names)))
        parent_fields = {f.name: getattr(parent, f.name) for f in fields(Spec)}
        return cls(
            **{**parent_fields, "flights": len(scores), "sampling": SEARCH},
            parent=parent,
            scores=scores,
        )

    @cached_property
    def identity(self) -> str:
        """Another than the parent's, so that its campaign does not go on with these rows."""
        return hashlib.sha256(f"points of {self.parent.identity}".encode()).hexdigest()

    @cached_property
    def inputs(self) -> list[list[Any]]:
        """Per flight the values of the dispersed parameters, in the order of `names`."""
        shares = stats.norm.cdf(self.scores[:, : len(self.names)])
        at = {name: i for i, name in enumerate(self.names)}
        shares = correlated(shares, [(at[a], at[b], rho) for a, b, rho in self.correlate])
        columns = [d.values(shares[:, i]) for i, d in enumerate(self.disperse.values())]
        return [list(row) for row in zip(*columns, strict=True)] or [[] for _ in self.scores]

    def flight_seed(self, number: int) -> int:
        """Seed of wind and sensors of a flight, counted from 0."""
        if self.scores.shape[1] == len(self.names):
            return one_seed(self.parent)
        share = float(stats.norm.cdf(self.scores[number, -1]))
        return 1 + min(int(share * LAST_SEED), LAST_SEED - 1)

    @cached_property
    def base(self) -> Settings:
        """The flight without dispersions."""
        return self.parent.base


def one_seed(spec: Spec) -> int:
    """Seed of wind and sensors where all flights have the same: the spec's, else 1."""
    return 1 if spec.flight_seeds == EACH else int(spec.flight_seeds)


def seed_is_random(spec: Spec) -> bool:
    """Whether wind and noise are among what is random."""
    return spec.flight_seeds == EACH


def check_reach(spec: Spec, reach: float = REACH) -> None:
    """Let each parameter be checked by its row as far out as a search goes.

    Raises
    ------
    ParameterError
        Nothing is dispersed, or a distribution goes where the parameter may not.
    """
    if not spec.names:
        raise ParameterError("disperse: nothing; allowed: at least one parameter")
    ends = np.array([[-reach], [reach]]) * np.ones(len(spec.names))
    try:
        check_ends(replace(Points.of(spec, ends), correlate=()), spec.base)
    except ParameterError as error:
        raise ParameterError(
            f"{error} ({reach:g} sigma out; such a flight would be no failure of the aircraft; "
            "allowed: a uniform or truncated distribution)"
        ) from None


# -------------------------------------------------------------------------------------------------
# A metric of a flight as a function of the dispersions' normal scores; every row is kept.
# -------------------------------------------------------------------------------------------------

_TASKS = 8


@dataclass(frozen=True)
class MetricBound:
    """A metric and its bound.

    Attributes
    ----------
    name : str
        As rows name it: altitude (truth).
    metric : PaperMetric
    bound : float
        In the metric's unit: the paper's figure, or another one.
    """

    name: str
    metric: PaperMetric
    bound: float


def asked_of(spec: Spec, name: str, beyond: float | None = None) -> MetricBound:
    """Find a metric of the spec's flights by its name.

    Raises
    ------
    ParameterError
        There is none of this name, or nothing is scored in so short a flight.
    """
    known = {
        f"{metric.key} ({source})": metric
        for source in sources_of(spec.base.gps)
        for metric in spec.base.scenario.metrics
        if source != TRUTH_LESS_DRIFT or metric.key in POSITIONS
    }
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ParameterError(f"--of {name!r}: unknown{hint}; allowed: {', '.join(known)}")
    end_s = seconds(spec.base.scenario.n_ticks)
    windows = spec.base.scenario.windows_s
    if not any(first < min(last, end_s) for first, last in windows):
        raise ParameterError(f"duration_s: {end_s:g}: ends before anything is scored")
    bound = known[name].paper if beyond is None else beyond
    if not math.isfinite(bound) or bound <= 0.0:
        raise ParameterError(f"--beyond: {bound}; allowed: a number above 0")
    return MetricBound(name, known[name], bound)


@dataclass
class Flights:
    """Called with scores (n, d) it flies there and gives the metric (n,), +inf if it did not fly.

    A flight that throws, is lost or refused is so beyond every bound; its row says the cause.

    Attributes
    ----------
    spec : Spec
    asked : MetricBound
    keep : callable
        Is given the rows of a task as they come.
    fly : callable
        From a spec and tasks to rows, in any order.
    report_count : callable
        Is given the number of flights so far.
    marks : dict
        Further columns of the rows to come.
    """

    spec: Spec
    asked: MetricBound
    keep: Callable[[Rows], None]
    fly: Fly = fly_here
    report_count: Callable[[int], None] = lambda flown: None
    marks: dict[str, Any] = field(default_factory=dict)
    scores: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    causes: dict[str, int] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Flights of whole calls so far."""
        return sum(map(len, self.scores))

    def __call__(self, scores: Array) -> Array:
        """Fly; the numbers of flights go on where the last call ended."""
        first, values = self.count, np.full(len(scores), np.inf)
        chunk = min(self.spec.chunk, max(1, len(scores) // _TASKS))
        batch = replace(Points.of(self.spec, scores), chunk=chunk)
        flown = 0
        for rows in self.fly(batch, tasks(batch, set())):
            for row in rows:
                values[row[NUMBER]] = self._value(row)
                self.causes[row[CAUSE]] = self.causes.get(row[CAUSE], 0) + 1
            self.keep([{**row, NUMBER: first + row[NUMBER], **self.marks} for row in rows])
            flown += len(rows)
            self.report_count(first + flown)
        self.scores.append(scores)
        self.values.append(values)
        return values

    def _value(self, row: dict[str, Any]) -> float:
        value = row.get(f"{FIGURE}{self.asked.name}", math.inf)
        flown = row[CAUSE] == FlightEnding.FLOWN and not math.isnan(value)
        return float(value) if flown else math.inf

    def all(self) -> tuple[Points, Array]:
        """All flights so far, to be flown again by number, and their values (N,)."""
        if not self.scores:
            return Points.of(self.spec), np.zeros(0)
        return Points.of(self.spec, np.concatenate(self.scores)), np.concatenate(self.values)


# -------------------------------------------------------------------------------------------------
# The largest value of a function inside a box, by CMA-ES, beside random search.
#
# CMA-ES: Hansen, "The CMA evolution strategy: a tutorial" (2016, arXiv:1604.00772), by the package
# `cma`. A first part of the points is a Latin hypercube; the search begins at its best point, and
# where it has converged again from the next best one with twice the population.
# -------------------------------------------------------------------------------------------------

"""From points (n, d) to values (n,); +inf is beyond everything."""

_STREAM_CMA, _STREAM_RANDOM = (1 << 22) + 1, (1 << 22) + 2
LEAST = 10
"""Evaluations: with fewer there is nothing to search with."""
_FIRST = 0.2
_WORST_STEP = 0.4
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
    progress = Search() if search is None else search

    def evaluate(points: Array) -> Array:
        points = points[: most - progress.evaluations, :dimensions]
        values = np.asarray(many(points), dtype=float)
        progress.take(values)
        return values

    first = max(2, round(_FIRST * most))
    starts = (2.0 * qmc.LatinHypercube(dimensions, seed=rng).random(first) - 1.0) * reach
    values = evaluate(starts)
    starts = starts[np.argsort(-values, kind="stable")]
    size = max(_LEAST_DIMENSIONS, dimensions)
    population, runs = 4 + int(3.0 * math.log(size)), 0
    while progress.evaluations < most and not progress.lost:
        begin = np.zeros(size)
        begin[:dimensions] = starts[runs % first]
        options = {
            "bounds": [-reach, reach], "popsize": population << runs, "verbose": -9,
            "randn": lambda *shape: rng.standard_normal(shape), "seed": math.nan,
            "tolfun": 1e-9, "tolfunhist": 1e-9,
        }  # fmt: skip
        strategy = cma.CMAEvolutionStrategy(begin, _WORST_STEP * reach, options)
        while progress.evaluations < most and not strategy.stop():
            asked = np.array(strategy.ask())
            values = evaluate(asked)
            if progress.lost or len(values) < len(asked):
                return progress
            strategy.tell(list(asked), list(-values))
        runs += 1
    return progress


def at_random(
    many: Many, dimensions: int, reach: float, most: int, seed: int, search: Search | None = None
) -> Search:
    """The same by points drawn uniformly in the box, until `most` or one beyond everything."""
    rng = _rng(seed, _STREAM_RANDOM)
    progress = Search() if search is None else search
    while progress.evaluations < most and not progress.lost:
        count = min(_BATCH, most - progress.evaluations)
        points = rng.uniform(-reach, reach, (count, dimensions))
        progress.take(np.asarray(many(points), dtype=float))
    return progress


def _rng(seed: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))


# -------------------------------------------------------------------------------------------------
# What rare failures and worst cases are told as: for people, and as JSON.
# -------------------------------------------------------------------------------------------------

MOST_AGAIN = 5


def largest(flights: Flights) -> list[int]:
    """Numbers of the flights with the largest values, at most `MOST_AGAIN`; lost ones first."""
    _, values = flights.all()
    return [int(n) for n in np.argsort(-values, kind="stable")[:MOST_AGAIN]]


def likeliest(flights: Flights) -> int | None:
    """Of the flights beyond the bound the one whose parameters are the likeliest."""
    points, values = flights.all()
    beyond = np.flatnonzero(values > flights.asked.bound)
    if not beyond.size:
        return None
    scores = points.scores[beyond, : len(points.names)]
    return int(beyond[(scores * scores).sum(axis=1).argmin()])


def noise(flights: Flights, drawn: bool) -> str:
    """What becomes of wind and sensor noise, in words."""
    if drawn:
        return "wind and sensors: a seed of its own per flight, drawn like the dispersions"
    which_seed = "the spec's" if not seed_is_random(flights.spec) else "the spec has one for each"
    return f"wind and sensors: seed {one_seed(flights.spec)} in every flight ({which_seed})"


def _common(flights: Flights) -> dict[str, Any]:
    asked = flights.asked
    return {
        "spec": flights.spec.identity,
        "dispersed": list(flights.spec.names),
        "metric": asked.name,
        "unit": asked.metric.unit,
        "bound": asked.bound,
        "paper": asked.metric.paper,
        "flights": flights.count,
        "causes": dict(flights.causes),
        "again": largest(flights),
    }


def rare_dict(
    flights: Flights, levels: Sequence[SubsetLevel], ended: Ended | None, seed: int
) -> dict[str, Any]:
    """Of subset simulation, for result.json; `ended` is None if it was interrupted."""
    near = likeliest(flights)
    common = _common(flights)
    again = common["again"] if near is None else [near, *common["again"]]
    reached, last = ended is Ended.REACHED, levels[-1] if levels else None
    answer = {
        "probability": last.probability if reached and last else None,
        "cov": last.cov if reached and last else None,
        "interval": list(last.interval) if reached and last else None,
        "not_above": list(last.interval)[1] if last else None,
    }
    return {
        **common,
        "again": list(dict.fromkeys(again)),
        "seed": seed,
        "seed_drawn": seed_is_random(flights.spec),
        "ended": ended.value if ended else "interrupted",
        **answer,
        "likeliest": near,
        "levels": [
            {
                "threshold": level.threshold, "share": level.share, "accepted": level.accepted,
                "flights": level.flights, "probability": level.probability, "cov": level.cov,
                "cov_au_beck": level.au_beck,
            }
            for level in levels
        ],
    }  # fmt: skip


def rare_answer(flights: Flights, levels: Sequence[SubsetLevel], ended: Ended | None) -> str:
    """The probability, or what stands of it, in one line."""
    asked = flights.asked
    if not levels:
        return "no level is done"
    last = levels[-1]
    low, high = last.interval
    figures = (
        f"{last.probability:.3g} (coefficient of variation {last.cov:.2f}, 95 %: "
        f"{low:.2g} to {high:.2g})"
    )
    if ended is Ended.REACHED:
        return f"P({asked.name} > {asked.bound:g} {asked.metric.unit}) = {figures}"
    return (
        f"{ended.value if ended else 'interrupted'}: P({asked.name} > {last.threshold:.4g} "
        f"{asked.metric.unit}) = {figures}; to be beyond {asked.bound:g} is rarer"
    )


def print_rare(
    out: Console, flights: Flights, levels: Sequence[SubsetLevel], ended: Ended | None
) -> None:
    """The levels, the probability and what it is of."""
    unit = flights.asked.metric.unit
    rows = table(f"subset simulation, {flights.asked.name}", out)
    for name in ("level", f"beyond, {unit}", "probability", "cov", "moves accepted", "flights"):
        rows.add_column(name, justify="right")
    for number, level in enumerate(levels):
        accepted = f"{level.accepted:.0%}" if math.isfinite(level.accepted) else "-"
        rows.add_row(
            f"{number}", f"{level.threshold:.4g}", f"{level.probability:.3g}",
            f"{level.cov:.2f}", accepted, f"{level.flights}",
        )  # fmt: skip
    out.print(rows)
    lines = [rare_answer(flights, levels, ended), _flown(flights)]
    lines.append(noise(flights, seed_is_random(flights.spec)))
    near = likeliest(flights)
    if near is not None:
        points, _ = flights.all()
        values = zip(points.names, points.inputs[near], strict=True)
        inputs_text = ", ".join(f"{name} {_cell(value)}" for name, value in values)
        lines.append(f"likeliest flight beyond: {near}: {inputs_text}")
    _print(out, lines)


def worst_dict(
    flights: Flights, searches: Sequence[tuple[str, Search]], reach: float, seed: int
) -> dict[str, Any]:
    """Of a search for the worst case, for result.json."""
    points, _ = flights.all()
    by_method: dict[str, Any] = {}
    first = 0
    for name, search in searches:
        number = first + search.at if search.at >= 0 else None
        by_method[name] = {
            "value": search.best, "lost": search.lost, "flights": search.evaluations,
            "after": search.at + 1, "flight": number,
            "inputs": {} if number is None
            else dict(zip(points.names, points.inputs[number], strict=True)),
        }  # fmt: skip
        first += search.evaluations
    best = [search.best for _, search in searches if search.at >= 0]
    more = best[0] - best[1] if len(best) == 2 and all(map(math.isfinite, best)) else None
    return {
        **_common(flights),
        "seed": seed,
        "flight_seed": one_seed(flights.spec),
        "sigma": reach,
        "searches": by_method,
        "larger_by": more,
    }


def print_worst(
    out: Console, flights: Flights, searches: Sequence[tuple[str, Search]], reach: float
) -> None:
    """The worst case that each search has found, and by how much one beats the other."""
    asked, unit = flights.asked, flights.asked.metric.unit
    points, _ = flights.all()
    rows = table(f"worst case, {asked.name}, {reach:g} sigma", out)
    rows.add_column("")
    for name, _ in searches:
        rows.add_column(name, justify="right")
    begins = np.cumsum([0, *(search.evaluations for _, search in searches)])
    at = [begin + s.at for begin, (_, s) in zip(begins, searches, strict=False) if s.at >= 0]
    rows.add_row("largest", *(_value(s, unit) for _, s in searches))
    rows.add_row("found by flight", *(f"{s.at + 1} of {s.evaluations}" for _, s in searches))
    for i, name in enumerate(points.names):
        rows.add_row(name, *(_cell(points.inputs[number][i]) for number in at))
    out.print(rows)
    lines = [_flown(flights), noise(flights, False)]
    best = [search for _, search in searches if search.at >= 0]
    if len(best) == 2:
        lines.insert(0, _beaten(best[0], best[1], unit))
    _print(out, lines)


def _beaten(ours: Search, other: Search, unit: str) -> str:
    if ours.lost and other.lost:
        return f"both lose the aircraft: by flight {ours.at + 1} and by flight {other.at + 1}"
    if ours.lost or other.lost:
        who = "CMA-ES" if ours.lost else "random search"
        return f"{who} alone finds a flight that is lost"
    more = ours.best - other.best
    share = more / other.best if other.best > 0.0 else math.inf
    word = "beats" if more > 0.0 else "does not beat"
    return f"CMA-ES {word} random search of the same flights: {more:+.3g} {unit} ({share:+.0%})"


def _value(search: Search, unit: str) -> str:
    return "not flown to the end" if search.lost else f"{search.best:.4g} {unit}"


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _flown(flights: Flights) -> str:
    causes = ", ".join(f"{count} {cause}" for cause, count in flights.causes.items())
    return f"{flights.count} flights: {causes}; not flown to the end counts as beyond the bound"


def print_folder(out: Console, folder: Path, again: Sequence[Path]) -> None:
    """How to fly what was found again, and where everything is."""
    lines = [f"again: heli hover --params {path}" for path in again]
    _print(out, [*lines, f"rows: {folder}/rows/*.parquet, result: {folder}/result.json"])


def _print(out: Console, lines: Sequence[str]) -> None:
    for line in lines:
        out.print(line, soft_wrap=True, markup=False)
