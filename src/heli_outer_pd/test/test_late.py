# SPDX-License-Identifier: Apache-2.0
"""Navigation that is late: its position goes on with its velocity, and in the end it is none."""

import numpy as np

from heli_core.rows import NAV
from heli_core.ticks import Rate
from heli_outer_pd.inbox import keep_newest, navigation_at, no_navigation


def row(north_m):
    nav = np.arange(float(NAV.size))
    nav[NAV.pos], nav[NAV.vel] = [north_m, 0.0, -10.0], [2.0, -1.0, 0.5]
    return nav


def nothing():
    return no_navigation(0.5, Rate())


def at(heard, tick):
    out = np.zeros(NAV.size)
    navigation_at(heard, tick, out)
    return out


def test_that_of_now_is_flown_to_the_last_bit():
    heard = nothing()
    assert np.isnan(at(heard, 0)).all()
    keep_newest(heard, 5, row(3.0))
    np.testing.assert_array_equal(at(heard, 5), row(3.0))


def test_an_old_one_goes_on_and_nothing_else_of_it_changes():
    heard = nothing()
    keep_newest(heard, 5, row(3.0))
    carried, moved = at(heard, 15), row(3.0)
    moved[NAV.pos] += 0.1 * moved[NAV.vel]
    np.testing.assert_allclose(carried, moved, rtol=0, atol=1e-15)
    assert np.isfinite(at(heard, 55)).all() and np.isnan(at(heard, 56)).all()


def test_what_comes_behind_a_newer_one_is_not_used():
    heard = nothing()
    keep_newest(heard, 5, row(3.0))
    keep_newest(heard, 4, row(9.0))
    np.testing.assert_array_equal(at(heard, 5), row(3.0))
