# SPDX-License-Identifier: Apache-2.0
"""Subset simulation beside probabilities that are known: by formula, or by quadrature."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from heli_studies.campaign.rare import Ended, _descent_cov, _share_cov, subset_simulation

PER_LEVEL, MOST = 1000, 20_000


def linear(points):
    """Normal with variance 1, whatever the dimension."""
    return points.sum(axis=1) / math.sqrt(points.shape[1])


def series(points):
    """Two ways to fail."""
    return np.maximum(points[:, 0], points[:, 1])


def curved(points):
    return points[:, 0] + 0.2 * points[:, 1] ** 2


def curved_probability(bound):
    def density(v):
        return stats.norm.pdf(v) * stats.norm.sf(bound - 0.2 * v**2)

    return 2.0 * integrate.quad(density, 0.0, 12.0, epsabs=0.0, epsrel=1e-9)[0]


def noisy(points):
    """The last variable has no neighbourhood, as a seed: another normal number for each value."""
    mixed = np.modf(stats.norm.cdf(points[:, -1]) * 1e5)[0]
    return (points[:, 0] + stats.norm.ppf(np.clip(mixed, 1e-12, 1.0 - 1e-12))) / math.sqrt(2.0)


CASES = {
    "beta 3": (linear, 2, 3.0, stats.norm.sf(3.0), 0),
    "1e-6": (linear, 6, 4.75, stats.norm.sf(4.75), 0),
    "1e-6, 100 variables": (linear, 100, 4.75, stats.norm.sf(4.75), 0),
    "two ways": (series, 6, 4.0, 1.0 - stats.norm.cdf(4.0) ** 2, 0),
    "curved": (curved, 5, 4.5, curved_probability(4.5), 0),
    "a seed": (noisy, 3, 3.5, stats.norm.sf(3.5), 1),
}


def estimates(case, runs, per_level=PER_LEVEL):
    many, dimensions, bound, _, redrawn = CASES[case]
    levels = []
    for seed in range(runs):
        estimate = subset_simulation(
            many, dimensions, bound, per_level, MOST, seed, redrawn=redrawn
        )
        assert estimate.ended is Ended.REACHED
        levels.append(estimate.levels[-1])
    return levels


@pytest.mark.parametrize("case", CASES)
def test_the_mean_over_runs_is_the_probability_and_their_spread_is_as_told(case):
    runs, truth = 60, CASES[case][3]
    levels = estimates(case, runs)
    cov = math.sqrt(np.mean([level.cov**2 for level in levels]))
    shares = np.array([level.probability for level in levels]) / truth
    spread = shares.std(ddof=1)
    # The thresholds are quantiles of the same points, so that there is a bias of order 1/N.
    assert abs(shares.mean() - 1.0) < 3.5 * spread / math.sqrt(runs) + 0.03
    assert 0.75 < spread / cov < 1.35, (spread, cov)
    inside = [level.interval[0] <= truth <= level.interval[1] for level in levels]
    assert np.mean(inside) > 0.8


def test_one_in_a_million_is_known_to_a_third_within_the_flights_of_the_issue():
    """The command's own choice of 2500 a level."""
    levels = estimates("1e-6", 12, 2500)
    truth = CASES["1e-6"][3]
    assert max(level.flights for level in levels) <= 20_000
    assert np.mean([level.cov for level in levels]) < 0.3
    assert np.std([level.probability for level in levels], ddof=1) / truth < 0.45


def test_a_first_level_is_plain_sampling():
    estimate = subset_simulation(linear, 3, 0.0, PER_LEVEL, MOST, 1)
    (level,) = estimate.levels
    drawn = np.random.default_rng(np.random.SeedSequence(1, spawn_key=(1 << 22,)))
    share = np.mean(linear(drawn.standard_normal((PER_LEVEL, 3))) > 0.0)
    assert level.probability == share
    assert level.cov == pytest.approx(math.sqrt((1.0 - share) / (share * PER_LEVEL)))
    assert level.flights == PER_LEVEL


def test_au_and_becks_formula_on_chains_written_by_hand():
    """Two chains of ten, one all beyond, one not at all: ten times the same is one."""
    beyond = np.tile([True, False], 10)
    assert _share_cov(beyond, 10) == pytest.approx(math.sqrt(0.5 / 0.5 / 20 * (1.0 + 9.0)))
    assert _share_cov(beyond, 1) == pytest.approx(math.sqrt(1.0 / 20))


def test_points_of_one_ancestor_count_once():
    assert _descent_cov(np.array([3, 3, 3, 3]), 100) == pytest.approx(math.sqrt(1.0 - 0.01))
    assert _descent_cov(np.array([1, 2, 3, 4]), 100) == pytest.approx(math.sqrt(0.25 - 0.01))
    assert _descent_cov(np.array([], int), 100) == math.inf


def test_what_is_lost_or_not_a_number_is_beyond():
    def many(points):
        values = np.where(points[:, 0] > 3.2, np.inf, np.minimum(points[:, 0], 2.9))
        return np.where(points[:, 1] > 3.4, np.nan, values)

    truth = 1.0 - stats.norm.cdf(3.2) * stats.norm.cdf(3.4)
    runs = [subset_simulation(many, 2, 3.0, 2000, MOST, seed) for seed in range(20)]
    assert {estimate.ended for estimate in runs} == {Ended.REACHED}
    mean = np.mean([estimate.levels[-1].probability for estimate in runs])
    assert mean == pytest.approx(truth, rel=0.2)


def test_without_flights_left_what_stands_is_told():
    levels = []
    estimate = subset_simulation(
        linear, 4, 6.0, PER_LEVEL, PER_LEVEL + 2 * 900, 1, report_level=levels.append
    )
    assert estimate.ended is Ended.BUDGET and list(estimate.levels) == levels
    assert [level.flights for level in levels] == [1000, 1900, 2800]
    last = levels[-1]
    low, high = last.interval
    assert last.threshold < 6.0 and low < stats.norm.sf(last.threshold) < high
    assert last.probability == pytest.approx(1e-3, rel=0.05), "a rejected move counts twice"


def test_where_nothing_gets_worse_there_is_no_further_level():
    def capped(points):
        return np.minimum(points[:, 0], 1.0)

    estimate = subset_simulation(capped, 2, 2.0, PER_LEVEL, MOST, 1)
    assert estimate.ended is Ended.PLATEAU
    assert estimate.levels[-1].probability == pytest.approx(stats.norm.sf(1.0), rel=0.2)
    far = subset_simulation(linear, 2, 50.0, 100, 10**6, 1)
    assert far.ended is Ended.DEEPEST and far.levels[-1].probability < 1e-7


def test_a_seed_gives_the_same_and_another_one_something_else():
    def run(seed):
        return subset_simulation(linear, 3, 3.5, 200, MOST, seed).levels[-1].probability

    assert run(5) == run(5) != run(6)


@pytest.mark.parametrize(("per_level", "most"), [(105, 1000), (10, 1000), (100, 99)])
def test_levels_that_cannot_be_are_refused(per_level, most):
    with pytest.raises(ValueError, match=str(per_level)):
        subset_simulation(linear, 2, 3.0, per_level, most, 1)
