# SPDX-License-Identifier: Apache-2.0
"""The paper's tests, flown with seeds 1..20: inside the paper's figures on every one.

With a standalone receiver the paper's own yardstick counts, the on-board navigation record; with
rtk the ground truth.
"""

import functools
import io
import re

import numpy as np
import pytest
from rich.console import Console

from heli_core.rcl_yaml import ParameterError
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.campaign.run import fly_seeds, parse_seeds, seeds_table, worst_of_seeds

SEEDS = range(1, 21)


@functools.cache
def flights(scenario, gps):
    """Each of them flown once, for all that is asked of them."""
    return fly_seeds(resolve(scenario, gps=gps), SEEDS)


@pytest.mark.parametrize("scenario", ["hover", "attitude"])
@pytest.mark.parametrize(("gps", "source"), [("standalone", "navigation"), ("rtk", "truth")])
def test_every_seed_is_inside_the_papers_figures(scenario, gps, source):
    flown = flights(scenario, gps)
    assert [f.lost for f in flown] == [""] * len(SEEDS)
    outside = [
        f"seed {f.seed}: {s.metric.label} {s.max:.3f} {s.metric.unit}, paper {s.metric.paper}"
        for f in flown
        for s in f.figures.windows
        if s.source == source and not s.inside
    ]
    assert not outside, "\n".join(outside)


def test_over_the_whole_flight_the_climb_is_inside_too():
    """Against its reference, which can be flown: a fifth over the paper's 0.18 m/s at the worst,
    on one seed of 20; 1.25 m/s against a step."""
    speeds = []
    for f in flights("hover", "rtk"):
        figures = {s.metric.key: s for s in f.figures.whole if s.source == "truth"}
        assert all(figures[key].inside for key in figures.keys() - {"v_z"})
        speeds.append(figures["v_z"].max)
    assert np.median(speeds) < 0.15 and max(speeds) < 0.22
    assert sum(speed > 0.18 for speed in speeds) <= 1


@pytest.mark.parametrize("gps", ["standalone", "rtk"])
def test_the_climb_does_not_begin_before_its_command(gps):
    """At 1.1 m/s before 18 s, were it averaged about now; a gust or two is 0.2 m/s."""
    record = simulate(resolve("hover", gps=gps, duration_s=20.0)).record
    before = (record.time_s >= 17.4) & (record.time_s <= 18.0)
    assert np.abs(record.truth_vel_ned_mps[before, 2]).max() < 0.2
    assert record.truth_vel_ned_mps[-1, 2] < -2.0


def test_over_the_whole_flight_the_attitude_test_starts_banked():
    """What the README says: outside in roll by about 5 deg, at the start and by the start alone."""
    for f in flights("attitude", "rtk"):
        roll = next(s for s in f.figures.whole if (s.metric.key, s.source) == ("roll", "truth"))
        assert roll.max == pytest.approx(5.0, abs=0.7) and not roll.inside
        assert all(s.inside for s in f.figures.windows)


def test_pure_pd_drifts_off_in_steady_wind():
    """Without compensation it is the paper's law, which stands off to leeward."""
    calm = {"plant": {"wind.turbulence": False}}
    outer = {"wind_compensation": False, "K_P": [0.4, 0.5, 6.0], "K_D": [1.1, 1.8, 7.0]}
    pd = {**calm, "outer_loop": outer}
    with_pd = simulate(resolve(gps="rtk", seed=3, overrides=pd)).record.truth_pos_ned_m[1700]
    default = simulate(resolve(gps="rtk", seed=3, overrides=calm)).record.truth_pos_ned_m[1700]
    leeward = np.array([-1.0, -1.0]) / np.sqrt(2.0)
    assert with_pd[:2] @ leeward > 0.5
    assert abs(default[:2] @ leeward) < 0.1


def test_same_seed_same_flight_other_seed_other_flight():
    first, again, other = (simulate(resolve(seed=s, duration_s=5.0)).record for s in (4, 4, 5))
    np.testing.assert_array_equal(first.truth_pos_ned_m, again.truth_pos_ned_m)
    assert np.abs(first.truth_pos_ned_m - other.truth_pos_ned_m).max() > 1e-3


def test_seeds_as_users_write_them():
    assert parse_seeds("3..5") == [3, 4, 5]
    assert parse_seeds("7") == [7]
    assert parse_seeds("1,9") == [1, 9]
    for text in ("", "x", "5..3", "-1"):
        with pytest.raises(ParameterError, match="--seeds"):
            parse_seeds(text)


def test_table_shows_the_worst_seed():
    flown = fly_seeds(resolve(duration_s=8.0), [1, 2])
    value = worst_of_seeds(flown)["v_y", "truth"].max
    assert value == max(s.max for f in flown for s in f.figures.windows if s.metric.key == "v_y"
                        and s.source == "truth")  # fmt: skip
    out = Console(file=io.StringIO(), width=200)
    out.print(seeds_table({"standalone": flown}, "hover", out))
    text = out.file.getvalue()
    largest = worst_of_seeds(flown)["v_y", "navigation"].max
    row = rf"\| lateral speed +\| +0.3 m/s +\| +{largest:.2f} \|"
    assert re.search(row, text)
