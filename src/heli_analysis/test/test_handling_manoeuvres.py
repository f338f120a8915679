# SPDX-License-Identifier: Apache-2.0
"""Made-up flights of every manoeuvre: what was put in is what is measured, each bound flips."""

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_analysis.handling.definitions import FT
from heli_analysis.handling.scoring import HandlingLevel, score
from support.handling_flights import (
    FLIGHTS,
    STILL_MPS,
    blend,
    blend_speed,
    pirouette,
    result,
    scored,
)


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_good_flight_is_desired_and_as_defined(name):
    outcome = scored(name)
    assert outcome.level is HandlingLevel.DESIRED
    assert outcome.complete, outcome.conditions
    assert all(r.level is HandlingLevel.DESIRED for r in outcome.results)
    starts = [p.start_s for p in outcome.manoeuvre.phases]
    assert starts == sorted(starts) and all(p.end_s >= p.start_s for p in outcome.manoeuvre.phases)


@pytest.mark.parametrize(
    ("name", "criterion", "knob", "desired", "adequate", "neither"),
    [
        ("hover", "position", "drift", 0.9, 1.2, 1.9),
        ("hover", "position", "aside", -0.9, -1.2, -1.9),
        ("hover", "altitude", "up", 0.6, -0.62, 1.3),
        ("hover", "heading", "turn_deg", -4.9, 5.1, 10.1),
        ("vertical", "position", "drift", 0.9, -1.0, 1.9),
        ("vertical", "altitude", "left_m", 0.8, 0.95, None),
        ("vertical", "heading", "turn_deg", 4.9, 5.1, -10.1),
        ("pirouette", "radius", "off", 3.0, -3.1, 4.6),
        ("pirouette", "altitude", "up", 0.9, -1.0, 3.1),
        ("pirouette", "heading", "nose_deg", 9.9, -10.1, 15.1),
        ("depart-abort", "track", "off", -3.0, 3.2, 6.3),
        ("depart-abort", "height", "up", 7.2, 7.3, 14.9),
        ("depart-abort", "heading", "turn_deg", 9.9, -10.1, 15.1),
        ("lateral-reposition", "track", "off", 3.0, -3.2, 6.3),
        ("lateral-reposition", "altitude", "up", -3.0, 3.2, 4.8),
        ("lateral-reposition", "heading", "turn_deg", 9.9, -10.1, 15.1),
        ("slalom", "height", "up", 10.4, None, 10.6),
        ("slalom", "error", "aside", 30.2, None, 30.8),
        ("slalom", "clearance", "aside", 15.5, None, 15.0),
        ("slalom", "speed", "speed", 30.95, 30.8, 20.5),
    ],
)
def test_each_bound_flips_the_level(name, criterion, knob, desired, adequate, neither):
    for level, value in zip(HandlingLevel, (desired, adequate, neither), strict=True):
        if value is None:
            continue
        outcome = scored(name, **{knob: value})
        measured = result(outcome, criterion)
        assert measured.level is level, (measured.value, value)
        assert outcome.level is level
        if criterion not in ("height", "error", "clearance", "speed"):
            # The last of a descent, and the first of a course, are slower than a hover's bound.
            close = {
                "rel": 0.02,
                "abs": 0.12 if (name, criterion) == ("vertical", "altitude") else 0.0,
            }
            assert measured.value == pytest.approx(abs(value), **close)
        inside = {HandlingLevel.DESIRED: (True, True), HandlingLevel.ADEQUATE: (False, True)}
        margins = (
            measured.margin(measured.criterion.desired),
            measured.margin(measured.criterion.adequate),
        )
        assert tuple(m >= 0.0 for m in margins) == inside.get(level, (False, False))


def test_the_worst_moment_is_where_it_was_put():
    assert result(scored("hover", drift=1.2), "position").at_s == pytest.approx(28.5, abs=0.05)
    assert result(scored("vertical", turn_deg=7.0), "heading").at_s == pytest.approx(8.5, abs=0.05)


def test_time_to_hover_is_from_95_percent_to_half_a_metre_per_second():
    for braking_s, level in ((4.0, "desired"), (7.0, "adequate"), (11.0, "neither")):
        measured = result(scored("hover", braking_s=braking_s), "time")
        assert measured.value == pytest.approx(braking_s * (0.95 - STILL_MPS / 4.0), abs=0.05)
        assert measured.level.value == level


def still_at(length_m, move_s):
    """Share of a movement after which it is slower than the speed of a hover."""
    return brentq(lambda s: blend_speed(s) * length_m / move_s - STILL_MPS, 0.5, 1.0)


@pytest.mark.parametrize(
    ("name", "length_m"), [("depart-abort", 800 * FT), ("lateral-reposition", 400 * FT)]
)
@pytest.mark.parametrize("move_s", [12.7, 19.75, 26.0, 32.0])  # fmt: skip
def test_time_of_a_course(name, length_m, move_s):
    measured = result(scored(name, move_s=move_s), "time")
    late = still_at(length_m, move_s)
    assert measured.value == pytest.approx((2.0 * late - 1.0) * move_s, abs=0.06)


def test_time_of_the_vertical_manoeuvre():
    rise, move_s = 25.0 * FT, 5.0
    first = brentq(lambda s: blend(s) * rise - FT, 0.0, 0.5)
    last = still_at(rise, move_s)
    measured = result(scored("vertical"), "time")
    assert measured.value == pytest.approx(move_s * (1.0 - first + last) + 3.0, abs=0.06)
    assert result(scored("vertical", stay_s=6.0), "time").level is HandlingLevel.ADEQUATE
    assert result(scored("vertical", stay_s=11.0), "time").level is HandlingLevel.NEITHER


def test_time_around_the_circle_and_capture():
    for around_s, level in ((42.0, "desired"), (55.0, "adequate"), (70.0, "neither")):
        measured = result(scored("pirouette", around_s=around_s), "time")
        # The last 10 ft, of which the ramp of 2 s is a part, do not count.
        assert around_s - 4.0 < measured.value < around_s
        assert measured.level.value == level
    for creep_s, level in ((0.0, "desired"), (6.0, "adequate"), (11.0, "neither")):
        assert result(scored("pirouette", creep_s=creep_s), "capture").level.value == level


def test_the_circle_is_found_without_a_target():
    outcome = score(pirouette(off=2.0), "pirouette")
    centre = outcome.manoeuvre.marks_ned_m.mean(axis=0)
    assert np.hypot(*centre) < 0.5
    assert result(outcome, "radius").value == pytest.approx(2.0, abs=0.01)
