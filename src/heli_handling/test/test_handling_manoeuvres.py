# SPDX-License-Identifier: Apache-2.0
"""Made-up flights of every manoeuvre: what was put in is what is measured, each bound flips."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_handling.definitions import FT, FULL, KT, MANOEUVRES, froude, manoeuvre
from heli_handling.errors import Cause, HandlingError
from heli_handling.scoring import Level, score
from heli_handling.tracks import track_of

STEP_S = 0.02
STILL_MPS = 0.5


def blend(share):
    """From 0 to 1 with the least jerk."""
    t = np.clip(share, 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2)


def blend_speed(share):
    return 30.0 * share**2 * (1.0 - share) ** 2


def made(duration_s, north, east, height, yaw):
    """A track of four functions of time."""
    t = np.arange(0.0, duration_s, STEP_S)
    columns = [np.broadcast_to(f(t), t.shape) for f in (north, east, lambda t: -height(t))]
    pos = np.column_stack(columns)
    attitude = np.column_stack([0.0 * t, 0.0 * t, np.broadcast_to(yaw(t), t.shape)])
    return track_of(t, pos, np.gradient(pos, STEP_S, axis=0), attitude)


def bump(t, start_s, length_s, size):
    """From 0 to size and back, slowly."""
    share = np.clip((t - start_s) / length_s, 0.0, 1.0)
    return size * np.sin(np.pi * share) ** 2


def hover(drift=0.0, aside=0.0, up=0.0, turn_deg=0.0, braking_s=4.0, speed=4.0, track_deg=45.0):
    """10 s towards the origin, a constant deceleration, then 35 s over it."""

    def left_m(t):
        run, brake = np.clip(t, 0.0, 10.0), np.clip(t - 10.0, 0.0, braking_s)
        total = speed * (10.0 + 0.5 * braking_s)
        return total - speed * (run + brake - 0.5 * brake**2 / braking_s)

    begin, angle = 12.0 + braking_s, math.radians(track_deg)
    return made(
        45.0 + braking_s,
        lambda t: -left_m(t) * math.cos(angle) + bump(t, begin, 25.0, drift),
        lambda t: -left_m(t) * math.sin(angle) + bump(t, begin, 25.0, aside),
        lambda t: 5.0 + bump(t, begin, 25.0, up),
        lambda t: np.radians(bump(t, begin, 25.0, turn_deg)),
    )


def vertical(drift=0.0, left_m=0.0, turn_deg=0.0, move_s=5.0, rise_m=25.0 * FT, stay_s=3.0):
    """5 s of hover, up, at the top, down, 5 s of hover."""
    down = 5.0 + move_s + stay_s

    def height(t):
        up = rise_m * blend((t - 5.0) / move_s)
        return 4.6 + up - (rise_m - left_m) * blend((t - down) / move_s)

    return made(
        down + move_s + 5.0,
        lambda t: bump(t, 6.0, move_s, drift),
        lambda t: 0.0 * t,
        height,
        lambda t: np.radians(bump(t, 6.0, move_s, turn_deg)),
    )


def pirouette(around_s=42.0, off=0.0, up=0.0, nose_deg=0.0, creep_s=0.0):
    """Once around the origin, at constant speed but for the ends; then, maybe, creeping."""
    radius = 100.0 * FT

    def swept(t):
        ramp = 2.0
        u = np.clip(t - 5.0, 0.0, around_s)
        v = np.where(u < ramp, 0.5 * u**2 / ramp, u - 0.5 * ramp)
        late = np.clip(u - (around_s - ramp), 0.0, ramp)
        return 2.0 * np.pi * (v - 0.5 * late**2 / ramp) / (around_s - ramp)

    def distance(t):
        late = np.clip((t - 5.0 - around_s) / max(creep_s, 1e-9), 0.0, 1.0)
        return radius + off * np.sin(swept(t)) ** 2 + creep_s * late

    return made(
        around_s + creep_s + 20.0,
        lambda t: distance(t) * np.cos(swept(t)),
        lambda t: distance(t) * np.sin(swept(t)),
        lambda t: 3.0 + up * np.sin(0.5 * swept(t)) ** 2,
        lambda t: swept(t) + np.pi + np.radians(nose_deg) * np.sin(swept(t)) ** 2,
    )


def dash(length_m, yaw, move_s, off=0.0, up=0.0, turn_deg=0.0, beyond_m=0.0, height=8.0):
    """From hover to hover, north; maybe beyond the end and back."""

    def north(t):
        there = (length_m + beyond_m) * blend((t - 5.0) / move_s)
        return there - beyond_m * blend((t - 5.0 - move_s) / 8.0)

    return made(
        move_s + 20.0,
        north,
        lambda t: bump(t, 5.0, move_s, off),
        lambda t: height + bump(t, 5.0, move_s, up),
        lambda t: yaw + np.radians(bump(t, 5.0, move_s, turn_deg)),
    )


def depart_abort(move_s=19.75, **more):
    return dash(800.0 * FT, 0.0, move_s, **more)


def lateral_reposition(move_s=12.7, **more):
    return dash(400.0 * FT, -0.5 * math.pi, move_s, **more)


def slalom(speed=32.0, aside=22.0, height=20.0, up=0.0, apart=500.0 * FT):
    """Two turns to each side of a line to the north."""
    length = 4.0 * apart
    return made(
        length / speed + STEP_S,
        lambda t: speed * t,
        lambda t: aside * np.sin(np.pi * speed * t / apart),
        lambda t: height + bump(t, 1.0, 4.0, up),
        lambda t: 0.0 * t,
    )


FLIGHTS = {
    "hover": hover,
    "vertical": vertical,
    "pirouette": pirouette,
    "slalom": slalom,
    "lateral-reposition": lateral_reposition,
    "depart-abort": depart_abort,
}
TARGETS = {"hover": np.zeros(3) - [0, 0, 5.0], "pirouette": np.zeros(3)}


def scored(name, scale=FULL, **knobs):
    return score(FLIGHTS[name](**knobs), name, scale, TARGETS.get(name))


def result(found, criterion):
    return next(r for r in found.results if r.criterion.name == criterion)


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_good_flight_is_desired_and_as_defined(name):
    found = scored(name)
    assert found.level is Level.DESIRED
    assert found.complete, found.conditions
    assert all(r.level is Level.DESIRED for r in found.results)
    starts = [p.start_s for p in found.found.phases]
    assert starts == sorted(starts) and all(p.end_s >= p.start_s for p in found.found.phases)


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
    for level, value in zip(Level, (desired, adequate, neither), strict=True):
        if value is None:
            continue
        found = scored(name, **{knob: value})
        own = result(found, criterion)
        assert own.level is level, (own.value, value)
        assert found.level is level
        if criterion not in ("height", "error", "clearance", "speed"):
            # The last of a descent, and the first of a course, are slower than a hover's bound.
            close = {
                "rel": 0.02,
                "abs": 0.12 if (name, criterion) == ("vertical", "altitude") else 0.0,
            }
            assert own.value == pytest.approx(abs(value), **close)
        inside = {Level.DESIRED: (True, True), Level.ADEQUATE: (False, True)}
        margins = (own.margin(own.criterion.desired), own.margin(own.criterion.adequate))
        assert tuple(m >= 0.0 for m in margins) == inside.get(level, (False, False))


def test_the_worst_moment_is_where_it_was_put():
    assert result(scored("hover", drift=1.2), "position").at_s == pytest.approx(28.5, abs=0.05)
    assert result(scored("vertical", turn_deg=7.0), "heading").at_s == pytest.approx(8.5, abs=0.05)


def test_time_to_hover_is_from_95_percent_to_half_a_metre_per_second():
    for braking_s, level in ((4.0, "desired"), (7.0, "adequate"), (11.0, "neither")):
        own = result(scored("hover", braking_s=braking_s), "time")
        assert own.value == pytest.approx(braking_s * (0.95 - STILL_MPS / 4.0), abs=0.05)
        assert own.level.value == level


def still_at(length_m, move_s):
    """Share of a movement after which it is slower than the speed of a hover."""
    return brentq(lambda s: blend_speed(s) * length_m / move_s - STILL_MPS, 0.5, 1.0)


@pytest.mark.parametrize(
    ("name", "length_m"), [("depart-abort", 800 * FT), ("lateral-reposition", 400 * FT)]
)
@pytest.mark.parametrize("move_s", [12.7, 19.75, 26.0, 32.0])  # fmt: skip
def test_time_of_a_course(name, length_m, move_s):
    own = result(scored(name, move_s=move_s), "time")
    late = still_at(length_m, move_s)
    assert own.value == pytest.approx((2.0 * late - 1.0) * move_s, abs=0.06)


def test_time_of_the_vertical_manoeuvre():
    rise, move_s = 25.0 * FT, 5.0
    first = brentq(lambda s: blend(s) * rise - FT, 0.0, 0.5)
    last = still_at(rise, move_s)
    own = result(scored("vertical"), "time")
    assert own.value == pytest.approx(move_s * (1.0 - first + last) + 3.0, abs=0.06)
    assert result(scored("vertical", stay_s=6.0), "time").level is Level.ADEQUATE
    assert result(scored("vertical", stay_s=11.0), "time").level is Level.NEITHER


def test_time_around_the_circle_and_capture():
    for around_s, level in ((42.0, "desired"), (55.0, "adequate"), (70.0, "neither")):
        own = result(scored("pirouette", around_s=around_s), "time")
        # The last 10 ft, of which the ramp of 2 s is a part, do not count.
        assert around_s - 4.0 < own.value < around_s
        assert own.level.value == level
    for creep_s, level in ((0.0, "desired"), (6.0, "adequate"), (11.0, "neither")):
        assert result(scored("pirouette", creep_s=creep_s), "capture").level.value == level


def test_the_circle_is_found_without_a_target():
    found = score(pirouette(off=2.0), "pirouette")
    centre = found.found.marks_ned_m.mean(axis=0)
    assert np.hypot(*centre) < 0.5
    assert result(found, "radius").value == pytest.approx(2.0, abs=0.01)


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
    found = scored(name, **knobs)
    assert [c.condition.name for c in found.conditions if not c.met] == [condition]
    assert not found.complete


@pytest.mark.parametrize("name", ["lateral-reposition", "pirouette"])
def test_a_gust_in_the_first_hover_is_no_departure(name):
    """A second in the first hover, with 0.8 m/s: the clock does not start."""
    calm = FLIGHTS[name]()
    gusty = np.where(np.abs(calm.time_s - 2.5)[:, None] < 0.5, 0.8, calm.vel_ned_mps)
    blown = track_of(calm.time_s, calm.pos_ned_m, gusty, calm.attitude_rad)
    both = [score(flight, name, FULL, TARGETS.get(name)) for flight in (calm, blown)]
    times = [result(found, "time").value for found in both]
    assert times[0] == times[1]


def test_an_overshoot_costs_time_and_is_no_depart_abort():
    straight = result(scored("lateral-reposition"), "time").value
    assert result(scored("lateral-reposition", beyond_m=6.0), "time").value > straight + 3.0
    target = np.array([800.0 * FT, 0.0, 0.0])
    found = score(depart_abort(beyond_m=8.0), "depart-abort", FULL, target)
    assert [c.condition.name for c in found.conditions if not c.met] == ["overshoot"]


def test_a_hover_without_an_approach_is_scored_as_a_hold():
    still = made(40.0, lambda t: bump(t, 2.0, 36.0, 0.5), lambda t: 0 * t, lambda t: 10 + 0 * t,
                 lambda t: 0.3 + 0 * t)  # fmt: skip
    found = score(still, "hover")
    assert found.level is Level.DESIRED and not found.complete
    assert result(found, "time").value is None
    assert [p.name for p in found.found.phases] == ["hold"]
    assert found.found.phases[0].end_s - found.found.phases[0].start_s == pytest.approx(30.0)
    assert any("no approach" in remark for remark in found.found.remarks)


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
        assert scored("hover", scale=froude(1.41), drift=0.5).level is Level.NEITHER

    @pytest.mark.parametrize("diameter", [0.0, -1.0, 60.0, math.nan])
    def test_no_rotor(self, diameter):
        with pytest.raises(HandlingError, match="rotor diameter"):
            froude(diameter)


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
    for broken, cause in ((rows[:5], Cause.SHAPE), (rows * np.nan, Cause.NOT_FINITE)):
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
        "schema", "manoeuvre", "source", "scale", "level", "complete", "phases", "criteria",
        "conditions", "remarks",
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
