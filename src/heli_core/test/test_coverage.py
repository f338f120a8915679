# SPDX-License-Identifier: Apache-2.0
"""How much of what is judged a record holds."""

import numpy as np
import pytest

from heli_core.coverage import A_FEW, Coverage, coverage_of, least, period_of

TIMES_S = np.arange(6000) / 100.0
WINDOWS_S = ((5.0, 17.5), (25.0, 60.0))


def test_a_whole_record_has_all_of_what_is_asked():
    coverage = coverage_of(TIMES_S, WINDOWS_S)
    assert coverage.is_whole and coverage.share == 1.0 and not coverage.sentence
    assert coverage.asked_s == coverage.held_s == pytest.approx(47.5)


def test_one_that_stops_lacks_the_rest_of_its_window():
    coverage = coverage_of(TIMES_S[TIMES_S < 32.0], WINDOWS_S)
    assert coverage.gap_s == pytest.approx((32.0, 60.0))
    assert coverage.share == pytest.approx(19.5 / 47.5)


def test_one_that_stops_before_a_window_has_nothing_of_it():
    coverage = coverage_of(TIMES_S[TIMES_S < 21.0], [(25.0, 60.0)])
    assert (coverage.gap_s, coverage.share) == ((25.0, 60.0), 0.0)
    assert coverage_of([], [(25.0, 60.0)]).share == 0.0


def test_one_that_begins_late_lacks_the_beginning():
    coverage = coverage_of(TIMES_S[TIMES_S >= 6.0], WINDOWS_S)
    assert coverage.gap_s == pytest.approx((5.0, 6.0))


def test_the_first_of_several_gaps_is_named_and_all_of_them_count():
    held = ~((TIMES_S > 9.995) & (TIMES_S < 11.995)) & ~((TIMES_S > 39.995) & (TIMES_S < 40.995))
    coverage = coverage_of(TIMES_S[held], WINDOWS_S)
    assert coverage.gap_s == pytest.approx((10.0, 12.0))
    assert coverage.held_s == pytest.approx(44.5)


@pytest.mark.parametrize("at", [500, 3000, 5999 - A_FEW])
def test_a_few_periods_are_no_gap_and_one_more_is(at):
    few, more = (np.delete(TIMES_S, np.arange(at, at + n)) for n in (A_FEW, A_FEW + 1))
    assert coverage_of(few, WINDOWS_S).is_whole
    assert not coverage_of(more, WINDOWS_S).is_whole


def test_where_every_sample_counts_one_that_is_missing_is_a_gap():
    coverage = coverage_of(np.delete(TIMES_S, 3000), WINDOWS_S, few=0)
    assert coverage.gap_s == pytest.approx((30.0, 30.01))
    assert coverage_of(TIMES_S, WINDOWS_S, few=0).is_whole


def test_a_gap_outside_of_what_is_asked_is_none():
    assert coverage_of(TIMES_S[(TIMES_S < 18.0) | (TIMES_S > 24.0)], WINDOWS_S).is_whole


def test_a_small_gap_is_never_called_all_of_it():
    coverage = coverage_of(np.delete(TIMES_S, np.arange(3000, 3006)), [(0.0, 60.0)])
    assert coverage.sentence.startswith("99.9 %")


def test_order_repetition_and_what_is_not_finite_change_nothing():
    shuffled = np.random.default_rng(1).permutation(np.r_[TIMES_S, TIMES_S[:100], np.nan, np.inf])
    assert coverage_of(shuffled, WINDOWS_S) == coverage_of(TIMES_S, WINDOWS_S)


def test_overlapping_stretches_are_one_and_empty_ones_none():
    assert coverage_of(TIMES_S, [(8.0, 12.0), (5.0, 10.0), (20.0, 20.0)]).spans_s == ((5.0, 12.0),)


def test_of_nothing_asked_nothing_lacks():
    assert coverage_of(TIMES_S, []) == Coverage() == least([])
    assert Coverage().is_whole and Coverage().share == 1.0


def test_the_period_of_a_slow_record_is_its_own():
    slow = TIMES_S[::10]
    assert period_of(slow) == pytest.approx(0.1)
    assert coverage_of(slow, WINDOWS_S, period_of(slow)).is_whole
    assert not coverage_of(slow, WINDOWS_S).is_whole


def test_the_smallest_share_counts():
    whole, half = coverage_of(TIMES_S, [(0.0, 60.0)]), coverage_of(TIMES_S[:3000], [(0.0, 60.0)])
    assert least([whole, half, whole]) is half
