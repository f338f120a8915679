# SPDX-License-Identifier: Apache-2.0
"""The budget of dead reckoning beside other ways to it: the filter's own, step by step, drawn."""

import numpy as np
import pytest

from evidence.experiments import dead_reckoning
from heli_flight.loop import build, fly_loop

LOST = ("{what: gps, kind: loss, start_s: 12.0}",)


@pytest.mark.parametrize("gps", ["rtk", "standalone"])
def test_the_budget_is_what_the_filter_says_without_fixes(gps):
    settings = dead_reckoning.settings(gps, 12.0, 1)
    loop = build(settings)
    fly_loop(loop, settings)
    begin = dead_reckoning.start(loop)
    settings = dead_reckoning.settings(gps, 42.5, 1, LOST)
    record = fly_loop(build(settings), settings).record
    before = record.nav_sigma_pos_m[1199, 0]
    for t in (10.0, 30.0):
        sigma_m = record.nav_sigma_pos_m[round(100 * (12.0 + t)), 0]
        budget = dead_reckoning.parts(begin, t)
        assert np.hypot(budget["all"], before) == pytest.approx(sigma_m, rel=0.06)
        assert dead_reckoning.with_drag(begin, t, np.inf, 1.0) == pytest.approx(
            budget["all"], rel=0.02
        )
        # Gusts that are nothing leave of the speed at the last fix what tilt and gyros do not tell.
        least = t / np.sqrt(np.linalg.inv(begin.cov)[0, 0])
        assert 0.99 * least < dead_reckoning.with_drag(begin, t, 0.0, 1.0) < budget["velocity"]
        assert budget["velocity"] < dead_reckoning.with_drag(begin, t, 0.8, 11.0) < budget["all"]


def test_the_worst_of_ten_is_that_of_drawn_ones():
    drawn = np.linalg.norm(np.random.default_rng(1).standard_normal((20_000, 10, 2)), axis=2)
    assert dead_reckoning.worst_of(10) == pytest.approx(drawn.max(axis=1).mean(), rel=0.01)
