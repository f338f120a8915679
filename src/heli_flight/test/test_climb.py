# SPDX-License-Identifier: Apache-2.0
"""Figures of a climb: of made-up heights whose answers are known, and of today's flights."""

import numpy as np
import pytest

from heli_core.metrics import climb_figures, commanded_climb
from heli_flight.loop import simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve
from support.step_climb import step_climb

TIME_S = np.arange(6000) / 100.0


def commanded(speed_mps=2.5, end_s=22.0):
    way = step_climb(np.array([0.0, 0.0, -10.0]), 0.0, 18.0, end_s, speed_mps)
    return np.array([way.at(tick * 10_000_000) for tick in range(6000)])


def values(height_m, reference, time_s=TIME_S):
    return [f.value for f in climb_figures(time_s, height_m, reference, "truth")]


def delayed(reference, ticks):
    height = -reference[:, 2]
    return np.r_[np.full(ticks, height[0]), height[:-ticks]]


def test_the_climb_is_found_in_the_reference():
    climb = commanded_climb(commanded())
    assert (climb.start, climb.arrival) == (1800, 2200)
    assert (climb.old_m, climb.new_m) == pytest.approx((10.0, 20.0))
    assert climb.duration_s(TIME_S) == pytest.approx(4.0)


def test_an_aircraft_that_follows_late():
    """Its lag is 0.7 s; it comes within 0.4 m that long after the reference has passed 19.6 m."""
    overshoot, time_s, lag_s = values(delayed(commanded(), 70), commanded())
    assert overshoot == 0.0
    assert time_s == pytest.approx(3.84 + 0.7)
    assert lag_s == pytest.approx(0.7)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_overshoot_is_beyond_the_new_height_upwards_and_downwards(way):
    reference = commanded(2.0 * way)
    height = delayed(reference, 50)
    height[2400] += 0.3 * way
    # Too late to be of the climb; and before it, the other way, is not it either.
    height[3300] += 0.9 * way
    height[1000] += 20.0 * way
    assert values(height, reference)[0] == pytest.approx(0.3)


def test_a_height_that_is_not_reached_is_said():
    """It stops 0.5 m short of the new height; or it does not climb at all."""
    figures = values(np.minimum(delayed(commanded(), 50), 19.5), commanded())
    assert figures[:2] == [0.0, None] and figures[2] == pytest.approx(0.5)
    assert values(np.full(6000, 10.0), commanded()) == [0.0, None, None]


@pytest.mark.parametrize(
    ("rows", "speed"), [(slice(0, 2100), 2.5), (slice(0, 1500), 2.5), (slice(None), 0.0)]
)
def test_without_a_whole_climb_there_are_no_figures(rows, speed):
    reference = commanded(speed)[rows]
    assert commanded_climb(reference) is None
    assert values(-reference[:, 2], reference, TIME_S[rows]) == []


def test_without_heights_there_are_no_figures():
    assert values(np.full(6000, np.nan), commanded()) == []


@pytest.mark.parametrize("gps", ["standalone", "rtk"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_flown_climb_stays_what_it_is(gps, seed):
    """Half a climb within 0.15 s, overshoot less than 0.15 m with RTK; within 0.4 m of the new
    height when the reference is, 4.6 s after the command, give or take 0.4 s."""
    settings = resolve(gps=gps, seed=seed, duration_s=33.0)
    climb = score(simulate(settings).record, settings.scenario).climb
    figures = {f.metric.key: f.value for f in climb if f.source == "navigation"}
    assert set(figures) == {"climb_overshoot", "climb_time", "climb_lag"}
    assert figures["climb_overshoot"] < {"rtk": 0.15, "standalone": 0.40}[gps]
    assert figures["climb_time"] == pytest.approx(4.6, abs=0.4)
    assert abs(figures["climb_lag"]) < 0.15
