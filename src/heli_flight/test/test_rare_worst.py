# SPDX-License-Identifier: Apache-2.0
"""The search for a worst case beside functions whose largest value in the box is known."""

import numpy as np
import pytest

from heli_studies.campaign.rare import at_random, by_cma

REACH, MOST = 3.0, 300
SLOPES = np.array([1.0, -2.0, 0.5, 3.0, 0.1])
PEAK, WIDTHS = np.array([1.3, -2.2, 0.4, 2.9, 0.0]), np.array([1.0, 10.0, 3.0, 30.0, 1.0])


def corner(points):
    """Largest in a corner of the box: 6.6 times 3."""
    return points @ SLOPES


def peak(points):
    """Largest inside: 0."""
    return -(((points - PEAK) ** 2) @ WIDTHS)


def waves(points):
    """Many peaks; the highest one, 0, in the middle."""
    return -(points**2 - 0.5 * np.cos(2.0 * np.pi * points) + 0.5).sum(axis=1)


@pytest.mark.parametrize(
    ("many", "dimensions", "largest", "short"),
    [(corner, 5, 6.6 * REACH, 0.5), (peak, 5, 0.0, 0.1), (waves, 2, 0.0, 0.3)],
)
def test_the_largest_value_is_found_and_random_search_beaten(many, dimensions, largest, short):
    searches = [by_cma(many, dimensions, REACH, MOST, seed) for seed in range(5)]
    rival = [at_random(many, dimensions, REACH, MOST, seed) for seed in range(5)]
    assert {search.evaluations for search in searches + rival} == {MOST}
    for ours, other in zip(searches, rival, strict=True):
        assert ours.best <= largest + 1e-12 and ours.best > other.best
    assert np.median([ours.best for ours in searches]) > largest - short


@pytest.mark.parametrize("find", [by_cma, at_random])
def test_points_stay_in_the_box_and_the_best_is_the_one_named(find):
    tried = []

    def many(points):
        assert points.shape[1] == 1 and np.abs(points).max() <= REACH
        tried.extend(points[:, 0])
        return np.cos(points[:, 0] - 0.7)

    search = find(many, 1, REACH, 60, 3)
    assert len(tried) == 60 and np.cos(tried[search.at] - 0.7) == search.best
    assert search.best > 0.999
    again = list(tried)
    tried.clear()
    find(many, 1, REACH, 60, 3)
    assert tried == again, "the same seed, the same points"


@pytest.mark.parametrize("find", [by_cma, at_random])
def test_a_lost_flight_is_the_worst_there_is(find):
    def many(points):
        return np.where(points[:, 0] > 1.0, np.inf, points[:, 1])

    search = find(many, 2, REACH, MOST, 1)
    assert search.lost and search.evaluations <= 64 and search.at < search.evaluations
