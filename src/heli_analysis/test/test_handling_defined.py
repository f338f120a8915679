# SPDX-License-Identifier: Apache-2.0
"""What makes a flight that manoeuvre, at which scale, and what is refused."""

import math

import numpy as np
import pytest

from heli_analysis.handling.definitions import FT, FULL_SCALE, KT, MANOEUVRES, froude, manoeuvre
from heli_analysis.handling.manoeuvres import track_of
from heli_analysis.handling.scoring import HandlingLevel, score
from heli_core.errors import HandlingCause as Cause
from heli_core.errors import HandlingError
from support.handling_flights import (
    FLIGHTS,
    STEP_S,
    TARGETS,
    blend,
    bump,
    depart_abort,
    hover,
    lateral_reposition,
    made,
    result,
    scored,
    slalom,
    vertical,
)


@pytest.mark.parametrize(
    ("name", "condition", "knobs"),
    [
        ("hover", "approach", {"speed": 5.3}),
        ("hover", "approach", {"speed": 2.9}),
        ("hover", "oblique", {"track_deg": 20.0}),
        ("vertical", "ascent", {"rise_m": 21.9 * FT}),
        ("vertical", "top", {"stay_s": 0.5}),
        ("depart-abort", "peak", {"move_s": 24.0}),
        ("lateral-reposition", "peak", {"move_s": 16.0}),
        ("slalom", "interval", {"apart": 390.0 * FT}),
    ],
)
def test_what_is_not_as_defined_is_said(name, condition, knobs):
    outcome = scored(name, **knobs)
    assert [c.condition.name for c in outcome.conditions if not c.met] == [condition]
    assert not outcome.complete


@pytest.mark.parametrize("name", ["lateral-reposition", "pirouette"])
def test_a_gust_in_the_first_hover_is_no_departure(name):
    """A second in the first hover, with 0.8 m/s: the clock does not start."""
    calm = FLIGHTS[name]()
    gusty = np.where(np.abs(calm.time_s - 2.5)[:, None] < 0.5, 0.8, calm.vel_ned_mps)
    blown = track_of(calm.time_s, calm.pos_ned_m, gusty, calm.attitude_rad)
    both = [score(flight, name, FULL_SCALE, TARGETS.get(name)) for flight in (calm, blown)]
    times = [result(outcome, "time").value for outcome in both]
    assert times[0] == times[1]


def test_an_overshoot_costs_time_and_is_no_depart_abort():
    straight = result(scored("lateral-reposition"), "time").value
    assert result(scored("lateral-reposition", beyond_m=6.0), "time").value > straight + 3.0
    target = np.array([800.0 * FT, 0.0, 0.0])
    outcome = score(depart_abort(beyond_m=8.0), "depart-abort", FULL_SCALE, target)
    assert [c.condition.name for c in outcome.conditions if not c.met] == ["overshoot"]


def test_a_hover_without_an_approach_is_scored_as_a_hold():
    still = made(40.0, lambda t: bump(t, 2.0, 36.0, 0.5), lambda t: 0 * t, lambda t: 10 + 0 * t,
                 lambda t: 0.3 + 0 * t)  # fmt: skip
    outcome = score(still, "hover")
    assert outcome.level is HandlingLevel.DESIRED and not outcome.complete
    assert result(outcome, "time").value is None
    assert [p.name for p in outcome.manoeuvre.phases] == ["hold"]
    assert outcome.manoeuvre.phases[0].end_s - outcome.manoeuvre.phases[0].start_s == pytest.approx(
        30.0
    )
    assert any("no approach" in remark for remark in outcome.manoeuvre.remarks)


class TestFroude:
    RATIO = 1.41 / 16.36

    def test_lengths_times_speeds_and_angles(self):
        full, small = manoeuvre("hover"), manoeuvre("hover", froude(1.41))
        for a, b in zip(full.criteria, small.criteria, strict=True):
            factor = {"m": self.RATIO, "s": self.RATIO**0.5, "deg": 1.0}[a.quantity.value]
            assert (b.desired, b.adequate) == pytest.approx(
                (a.desired * factor, a.adequate * factor)
            )
        assert small["approach_mps"] == pytest.approx(6.0 * KT * self.RATIO**0.5)

    @pytest.mark.parametrize("name", FLIGHTS)
    def test_a_scaled_flight_has_the_same_level_and_shares_of_the_bounds(self, name):
        """Similarity: lengths by the ratio and times by its root change nothing."""
        root = self.RATIO**0.5
        flight = FLIGHTS[name]()
        small = track_of(
            flight.time_s * root,
            flight.pos_ned_m * self.RATIO,
            flight.vel_ned_mps * root,
            flight.attitude_rad,
        )
        a, b = score(flight, name), score(small, name, froude(1.41))
        for big, little in zip(a.results, b.results, strict=True):
            assert little.level is big.level
            shares = (little.value / little.criterion.desired, big.value / big.criterion.desired)
            assert shares[0] == pytest.approx(shares[1], rel=1e-3, abs=0.02)

    def test_a_full_size_flight_is_none_at_small_scale(self):
        assert scored("hover", scale=froude(1.41), drift=0.5).level is HandlingLevel.NEITHER

    @pytest.mark.parametrize("diameter", [0.0, -1.0, 60.0, math.nan])
    def test_no_rotor(self, diameter):
        with pytest.raises(HandlingError, match="rotor diameter"):
            froude(diameter)


def test_a_slalom_beside_its_line_does_not_begin_in_the_hover():
    """10 s of hover, then 23 ft to the right of a line that it does not meet before it turns."""
    apart, speed = 500.0 * FT, 32.0

    def east(t):
        turning = 22.0 * np.sin(np.pi * speed * np.clip(t - 12.0, 0.0, None) / apart)
        return 7.0 * np.clip(t / 5.0, 0.0, 1.0) + turning

    beside = made(
        12.0 + 4.0 * apart / speed,
        lambda t: speed * np.clip(t - 10.0, 0.0, None),
        east,
        lambda t: 20.0 + 0.0 * t,
        lambda t: 0.0 * t,
    )
    outcome = score(beside, "slalom", FULL_SCALE, np.array([4.0 * apart + 2.0 * speed, 0.0, 0.0]))
    assert result(outcome, "speed").value > 0.99 * speed
    assert outcome.manoeuvre.phases[0].start_s > 11.9


@pytest.mark.parametrize("beyond_m", [4.0, 5.0])
def test_a_hover_that_creeps_back_ends_the_course_where_it_is_within_the_band(beyond_m):
    """Standing still all the while, by the definition of still: 10 ft off the end at most."""
    flight, length = lateral_reposition(beyond_m=beyond_m, back_s=40.0), 400.0 * FT
    outcome = score(flight, "lateral-reposition", FULL_SCALE, np.array([length, 0.0, 0.0]))
    shares = np.linspace(0.0, 1.0, 2000)
    came_in = 17.7 + 40.0 * np.interp(1.0 - 10.0 * FT / beyond_m, blend(shares), shares)
    assert outcome.manoeuvre.phases[-1].end_s == pytest.approx(came_in, abs=3 * STEP_S)
    with pytest.raises(HandlingError, match="down the course"):
        far = lateral_reposition(beyond_m=8.0, back_s=1e4).between(0.0, 60.0)
        score(far, "lateral-reposition", FULL_SCALE, np.array([length, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("name", "flight", "cause", "words"),
    [
        ("howver", hover, Cause.UNKNOWN, "'howver' is none of hover, vertical"),
        ("vertical", hover, Cause.NO_PHASES, "rises 0.00 m above its first hover, 7.62 m are due"),
        ("pirouette", lateral_reposition, Cause.NO_PHASES, "is not round"),
        ("depart-abort", lateral_reposition, Cause.NO_PHASES, "goes 121.8 m .* course is 243.8 m"),
        ("lateral-reposition", depart_abort, Cause.NO_PHASES, "243.6 m down the course of 121.9"),
        ("slalom", depart_abort, Cause.NO_PHASES, "0 turns to alternate sides"),
        ("slalom", hover, Cause.NO_PHASES, "0 turns"),
        ("depart-abort", vertical, Cause.NO_PHASES, "never leaves its first hover by 6.1 m"),
        ("depart-abort", slalom, Cause.NO_PHASES, "no hover to begin from"),
        ("vertical", lambda: vertical(left_m=3.0), Cause.NO_PHASES, "no hover within 1.83 m"),
        ("hover", lambda: hover().between(0.0, 20.0), Cause.TOO_SHORT, "20.0 s, the hold .* 30.0"),
    ],
)  # fmt: skip
def test_what_is_not_in_the_flight_is_refused(name, flight, cause, words):
    with pytest.raises(HandlingError, match=words) as refused:
        score(flight(), name)
    assert refused.value.cause is cause
    assert "\n" not in str(refused.value)


def test_bad_samples_are_refused():
    t, rows = np.arange(20.0), np.zeros((20, 3))
    for broken, cause in (
        (rows[:5], Cause.SHAPE),
        (rows * np.nan, Cause.NOT_FINITE),
    ):
        with pytest.raises(HandlingError) as refused:
            track_of(t, rows, broken, rows)
        assert refused.value.cause is cause
    for few in (t[:4], np.zeros(20)):
        with pytest.raises(HandlingError) as refused:
            track_of(few, rows[: few.size], rows[: few.size], rows[: few.size])
        assert refused.value.cause is Cause.TOO_SHORT
    with pytest.raises(HandlingError, match="flight is from 0.00 to 19.00 s"):
        track_of(t, rows, rows, rows).between(50.0, 60.0)


def test_the_layout_of_the_json_is_stable():
    content = scored("hover").as_dict()
    assert list(content) == [
        "schema", "manoeuvre", "source", "scale", "level", "complete", "coverage", "partial",
        "phases", "criteria", "conditions", "remarks",
    ]  # fmt: skip
    assert content["schema"] == 1
    assert content["source"] == "ADS-33E-PRF 3.11.1 Hover"
    assert content["criteria"][1] == {
        "name": "position",
        "text": "distance from the hover point, each horizontal axis",
        "unit": "m",
        "bound": "at most",
        "desired": pytest.approx(0.9144),
        "adequate": pytest.approx(1.8288),
        "value": pytest.approx(0.0884, abs=0.01),
        "level": "desired",
        "margin_desired": pytest.approx(0.826, abs=0.01),
        "margin_adequate": pytest.approx(1.74, abs=0.01),
        "worst_at_s": pytest.approx(13.5, abs=0.05),
    }
    assert list(content["conditions"][0]) == ["name", "text", "unit", "low", "high", "value", "met"]
    assert content["phases"][0].keys() == {"name", "start_s", "end_s"}


def test_every_table_has_looser_adequate_bounds_and_known_names():
    for name, table in MANOEUVRES.items():
        assert table.name == name and table.paragraph.startswith("3.11.")
        for c in table.criteria:
            assert (c.adequate <= c.desired) if c.at_least else (c.adequate >= c.desired)
