# SPDX-License-Identifier: Apache-2.0
"""One tick, told in ns, in s and per second; times and ticks into each other."""

import numpy as np

from heli_math.ticks import TICK_NS, TICK_S, TICKS_PER_S, seconds, stamp_at, ticks_in


def test_the_three_lengths_of_a_tick_agree():
    assert TICK_S == 0.01
    assert TICK_NS * TICKS_PER_S == 10**9


def test_seconds_and_back_for_a_day():
    ticks = np.arange(0, 8_640_000, 997)
    times = seconds(ticks)
    assert [ticks_in(t) for t in times] == ticks.tolist()
    assert times[1] == 9.97 == seconds(997)


def test_the_nearest_tick_is_taken():
    assert ticks_in(0.004) == 0
    assert ticks_in(0.0149) == 1
    assert ticks_in(29.996) == 3000


def test_a_stamp_is_that_of_a_tick():
    assert stamp_at(1.0) == 10**9
    assert stamp_at(0.29) == 290_000_000
    assert stamp_at(1.0199) == 1_010_000_000
