# SPDX-License-Identifier: Apache-2.0
"""One tick, told in ns, in s and per second; times and ticks into each other."""

import numpy as np
import pytest

from heli_core.ticks import (
    RATES_HZ,
    TICK_NS,
    TICK_S,
    TICKS_PER_S,
    Rate,
    seconds,
    stamp_at,
    ticks_in,
)


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


def test_a_rate_divides_ten_milliseconds_and_schedules_keep_their_times():
    assert (Rate().tick_ns, Rate().tick_s, Rate().hz) == (TICK_NS, TICK_S, TICKS_PER_S)
    for hz in RATES_HZ:
        rate = Rate.of_hz(hz)
        assert rate.hz * rate.tick_ns == 10**9
        assert rate.tick_s == rate.tick_ns / 1e9
        assert rate.of(20) * rate.tick_ns == 200_000_000
        assert rate.ticks_in(0.2) == rate.of(20)
        assert rate.seconds(rate.of(997)) == 9.97


@pytest.mark.parametrize("hz", [0, 50, 150, 300, 401, -100])
def test_another_rate_is_refused(hz):
    with pytest.raises(ValueError, match=f"{hz} .*: 100, 200, 400"):
        Rate.of_hz(hz)


@pytest.mark.parametrize(
    ("hz", "fold"), [(1, 1), (100, 1), (101, 2), (400, 4), (1150, 12), (1200, 12), (1201, 13)]
)
def test_a_plant_of_others_steps_in_whole_parts_of_10_ms_as_often_as_asked(hz, fold):
    rate = Rate.at_least(hz)
    assert rate == Rate(fold) and rate.hz >= hz
    assert [rate.time_ns(n * fold) for n in (1, 97)] == [10_000_000, 970_000_000]
    assert rate.time_ns(1) == pytest.approx(1e9 * rate.tick_s, abs=1.0)
