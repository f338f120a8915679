# SPDX-License-Identifier: Apache-2.0
"""Scores of made-up flights whose errors are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_core.metrics import GOAL, NONE, OWN, bounded, heading_frame
from heli_core.parameters import load
from heli_core.rotations import quat_from_euler
from heli_flight.layers import PAPERS_AIRCRAFT
from heli_flight.record import FlightRecord
from heli_flight.result import EXIT_INSIDE, EXIT_OUTSIDE, Result, Verdict
from heli_flight.scenario import TABLE, Scenario
from heli_flight.scoring import (
    DECIDES,
    TRUTH_LESS_DRIFT,
    WHOLE,
    WINDOWS,
    counted,
    decides,
    score,
    sources_of,
)
from heli_flight.settings import resolve
from support.record_bag import rows_of


def scenario(name="hover", **changes):
    folder = config_folder("heli_flight")
    layers = [folder / "scenario.yaml", folder / "scenarios" / f"{name}.yaml"]
    return Scenario.from_parameters(dict(load(TABLE, layers, "scenario")) | changes)


def record(n=6000, psi=0.0, **changes):
    z3, q = np.zeros((n, 3)), np.tile(quat_from_euler(0.0, 0.0, psi), (n, 1))
    reference = np.zeros((n, 7))
    reference[:, 6] = psi
    arrays = dict(
        time_s=np.arange(n) / 100.0,
        truth_pos_ned_m=z3, truth_vel_ned_mps=z3, truth_rate_body_radps=z3, truth_q_nb=q,
        truth_rotor=z3, wind_ned_mps=z3, nav_pos_ned_m=z3, nav_vel_ned_mps=z3,
        nav_rate_body_radps=z3, nav_q_nb=q, nav_rotor=z3, reference=reference, setpoint=z3,
        u=np.zeros((n, 4)),
    )  # fmt: skip
    return FlightRecord(**(arrays | changes))


def by_key(figures, stretch=WINDOWS):
    return {(s.metric.key, s.source): s for s in figures.of(stretch)}


def test_errors_are_measured_in_the_heading_frame():
    """Nose east: an error to the north is to the left, an error to the east is ahead."""
    pos = np.tile([0.3, -0.2, 0.1], (6000, 1))
    vel = np.tile([0.04, 0.05, -0.06], (6000, 1))
    scores = by_key(
        score(record(psi=math.pi / 2, nav_pos_ned_m=pos, nav_vel_ned_mps=vel), scenario())
    )
    expected = {"lateral": 0.3, "longitudinal": 0.2, "altitude": 0.1,
                "v_y": 0.04, "v_x": 0.05, "v_z": 0.06}  # fmt: skip
    for key, value in expected.items():
        assert scores[key, "navigation"].max == pytest.approx(value)
        assert scores[key, "navigation"].rms == pytest.approx(value)
        assert scores[key, "truth"].max == 0.0


@pytest.mark.parametrize(
    ("time_s", "counted"),
    [(4.99, False), (5.0, True), (17.99, True), (18.0, False), (24.99, False), (25.0, True),
     (59.99, True)],
)  # fmt: skip
def test_only_the_hover_phases_count(time_s, counted):
    pos = np.zeros((6000, 3))
    pos[round(time_s * 100), 1] = 2.0
    scores = by_key(score(record(truth_pos_ned_m=pos), scenario()))
    assert (scores["lateral", "truth"].max == 2.0) is counted
    assert scores["lateral", "truth"].inside is not counted


def test_the_climb_is_one_that_can_be_flown_and_nothing_of_it_is_before_its_command():
    """Still until 18 s, at 20 m at 23.5 s: 2.5 m/s in 1 s at 2.5 m/s2, and 0.5 s for 5 m/s3."""
    trajectory = scenario().reference
    t = np.arange(0.0, 30.0, 0.04)
    rows = np.array([trajectory.at(round(s * 1e9)) for s in t])
    height, climb = -rows[:, 2], -rows[:, 5]
    np.testing.assert_array_equal(height[t <= 18.0], 10.0)
    assert height[t > 18.03][0] > 10.0
    np.testing.assert_allclose(height[t >= 23.5], 20.0, atol=1e-9)
    assert height[t < 23.4][-1] < 20.0 and np.all(np.diff(height) >= -1e-9)
    assert climb.max() == pytest.approx(2.5, abs=1e-6)
    acceleration = np.diff(climb) / 0.04
    assert np.abs(acceleration).max() < 2.5 + 1e-6
    assert np.abs(np.diff(acceleration) / 0.04).max() < 5.0 + 1e-3
    # Speed times the time between the two commands, whichever way.
    down = scenario(**{"climb.speed_mps": -1.0}).reference
    assert down.points[-1, 2] == pytest.approx(-6.0)
    assert len(scenario(**{"climb.speed_mps": 0.0}).reference.points) == 1


def test_attitude_errors_in_degrees():
    q = np.tile(quat_from_euler(math.radians(2.0), math.radians(-1.0), 3.0), (6000, 1))
    scores = by_key(score(record(truth_q_nb=q), scenario("attitude")))
    assert scores["roll", "truth"].max == pytest.approx(2.0)
    assert scores["pitch", "truth"].max == pytest.approx(1.0)
    assert not scores["roll", "truth"].inside
    assert scores["pitch", "truth"].inside


def test_a_flight_that_is_ordered_to_end_before_the_windows_is_not_scored():
    figures = score(record(n=400), scenario(duration_s=4.0))
    assert figures.windows == [] and len(figures.whole) == 12
    result = Result(figures, "", 4.0, 1.0)
    assert result.verdict("standalone") is Verdict.NOT_SCORED
    assert result.exit_code("standalone") == EXIT_INSIDE


def of(flight, gps="standalone", lost="", **order):
    return Result(score(flight, scenario(**order)), lost, 60.0, 1.0)


@pytest.mark.parametrize(
    ("end_s", "gap_s", "share"),
    [(4.0, (4.0, 60.0), 0.0), (21.0, (21.0, 60.0), 13.0 / 48.0), (59.5, (59.5, 60.0), 47.5 / 48.0)],
)
def test_a_record_that_ends_early_is_partial(end_s, gap_s, share):
    """A disk that is full at 21 s says nothing of 25 to 60 s."""
    flight = record(n=round(100 * end_s))
    result = of(flight)
    assert result.verdict("standalone") is Verdict.PARTIAL
    assert result.exit_code("standalone") == EXIT_OUTSIDE
    assert result.coverage("standalone", WHOLE).gap_s == pytest.approx(gap_s)
    assert result.coverage("standalone", WINDOWS).share == pytest.approx(share)
    assert result.coverage("standalone").sentence in result.partial("standalone")


@pytest.mark.parametrize("begin", [0, 1500, 2000, 4000, 5900])
def test_a_gap_anywhere_is_partial_also_of_one_record_alone(begin):
    rows = np.delete(np.arange(6000), np.arange(begin, begin + 50))
    of_both = rows_of(record(), rows)
    pos = np.zeros((6000, 3))
    # Before 5 s navigation may not have begun.
    pos[begin or 500 : (begin or 500) + 50] = np.nan
    for flight, gps, verdict in (
        (of_both, "standalone", Verdict.PARTIAL),
        (record(nav_pos_ned_m=pos), "standalone", Verdict.PARTIAL),
        (record(truth_pos_ned_m=pos), "rtk", Verdict.PARTIAL),
        (record(truth_pos_ned_m=pos), "standalone", Verdict.INSIDE),
    ):
        assert of(flight).verdict(gps) is verdict


def test_without_what_decides_nothing_is_inside():
    """A bag without the navigation record was called inside by the paper's figures."""
    unknown = np.full((6000, 3), np.nan)
    for name, gps in (("nav_pos_ned_m", "standalone"), ("truth_pos_ned_m", "rtk")):
        result = of(record(**{name: unknown}))
        assert result.verdict(gps) is Verdict.PARTIAL and result.coverage(gps).share == 0.0
    assert of(record(truth_pos_ned_m=unknown)).verdict("standalone") is Verdict.INSIDE


def test_figures_are_of_what_is_there_and_outside_stays_outside():
    pos = np.zeros((6000, 3))
    pos[4000:4100], pos[3000, 1] = np.nan, 2.0
    result = of(record(nav_pos_ned_m=pos))
    assert by_key(result.figures)["lateral", "navigation"].max == 2.0
    assert [s.name for s in result.judged("standalone")] == ["lateral (navigation)"]
    assert result.verdict("standalone") is Verdict.PARTIAL


def test_of_a_lost_helicopter_nothing_is_missing_behind_its_loss():
    result = of(record(n=3000), lost="hit the ground")
    assert result.verdict("standalone") is Verdict.LOST and not result.partial("standalone")
    assert not result.coverage("standalone").is_whole


def test_exit_codes_follow_the_record_that_the_paper_used():
    pos = np.tile([0.0, 2.0, 0.0], (6000, 1))
    truth_only = Result(score(record(truth_pos_ned_m=pos), scenario()), "", 60.0, 1.0)
    assert truth_only.exit_code("standalone") == EXIT_INSIDE
    assert truth_only.exit_code("rtk") == EXIT_OUTSIDE
    navigation = Result(score(record(nav_pos_ned_m=pos), scenario()), "", 60.0, 1.0)
    assert navigation.exit_code("standalone") == EXIT_OUTSIDE
    lost = Result(score(record(), scenario()), "hit the ground", 60.0, 1.0)
    assert lost.exit_code("standalone") == EXIT_OUTSIDE


def test_errors_turn_with_the_heading():
    """Forward, right, down: north and east seen with the nose north, east, south, north-east."""
    vectors = np.tile([1.0, 2.0, 3.0], (4, 1))
    errors = heading_frame(vectors, np.radians([0.0, 90.0, 180.0, 45.0]))
    half = np.sqrt(0.5)
    expected = [[1, 2, 3], [2, -1, 3], [-1, -2, 3], [3 * half, half, 3]]
    assert errors == pytest.approx(np.array(expected), abs=1e-12)


@pytest.mark.parametrize("time_s", [0.0, 4.99, 5.0, 18.0, 20.0, 24.99, 59.99])
def test_the_whole_flight_counts_from_engagement_to_the_end(time_s):
    """The start, the climb and what follows it, too."""
    pos = np.zeros((6000, 3))
    pos[round(time_s * 100), 1] = 2.0
    scores = by_key(score(record(nav_pos_ned_m=pos), scenario()), WHOLE)
    assert scores["lateral", "navigation"].max == 2.0
    assert scores["lateral", "navigation"].rms == pytest.approx(2.0 / np.sqrt(6000))
    assert scores["lateral", "truth"].max == 0.0


def test_the_climb_is_measured_against_the_reference_as_commanded():
    """An aircraft that stands while the reference climbs is off by all of it, speed and height."""
    trajectory = scenario().reference
    reference = np.array([trajectory.at(tick * 10_000_000) for tick in range(6000)])
    pos = np.tile([0.0, 0.0, -10.0], (6000, 1))
    scores = by_key(score(record(nav_pos_ned_m=pos, reference=reference), scenario()), WHOLE)
    assert scores["v_z", "navigation"].max == pytest.approx(2.5)
    assert scores["altitude", "navigation"].max == pytest.approx(10.0)


def test_engagement_is_the_first_sample_with_navigation():
    pos = np.zeros((6000, 3))
    pos[:30] = np.nan
    pos[30, 1] = 0.7
    flight = record(nav_pos_ned_m=pos)
    assert by_key(score(flight, scenario()), WHOLE)["lateral", "navigation"].max == 0.7
    mask = counted(flight, scenario(), WHOLE)
    assert not mask[:30].any() and mask[30:].all()
    # Where navigation was not recorded at all, the rest still counts.
    assert counted(record(nav_pos_ned_m=np.full((6000, 3), np.nan)), scenario(), WHOLE).all()


def test_a_gap_in_what_was_recorded_is_no_pass():
    pos = np.zeros((6000, 3))
    pos[1000] = np.nan
    figures = score(record(nav_pos_ned_m=pos), scenario())
    assert Result(figures, "", 60.0, 1.0).exit_code("standalone") == EXIT_OUTSIDE
    assert not by_key(figures)["lateral", "navigation"].inside


def test_truth_without_the_drift_at_engagement_shows_the_control():
    """The record is 1.5 m off from the start and drifts on by 0.2 m; the control keeps it at 0."""
    drift = np.tile([1.5, -0.9, 0.6], (6000, 1))
    drift[3000:, 1] -= 0.2
    scores = by_key(score(record(truth_pos_ned_m=-drift), scenario()))
    assert scores["lateral", "truth"].max == pytest.approx(1.1)
    assert scores["longitudinal", "truth"].max == pytest.approx(1.5)
    assert scores["lateral", TRUTH_LESS_DRIFT].max == pytest.approx(0.2)
    assert scores["longitudinal", TRUTH_LESS_DRIFT].max == pytest.approx(0.0, abs=1e-12)
    assert {key for key, source in scores if source == TRUTH_LESS_DRIFT} == {
        "altitude", "lateral", "longitudinal",
    }  # fmt: skip
    assert TRUTH_LESS_DRIFT in sources_of("standalone")
    assert TRUTH_LESS_DRIFT not in sources_of("rtk")
    # It is for reading: no verdict hangs on it.
    assert not decides(TRUTH_LESS_DRIFT, "standalone")


def test_one_line_chooses_what_decides_the_exit_code():
    """An error in the climb alone: outside over the whole flight, inside in the windows."""
    pos = np.zeros((6000, 3))
    pos[2000, 1] = 2.0
    result = Result(score(record(nav_pos_ned_m=pos), scenario()), "", 60.0, 1.0)
    assert [s.name for s in result.judged("standalone", WHOLE)] == ["lateral (navigation)"]
    assert result.judged("standalone", WINDOWS) == []
    assert DECIDES == WINDOWS
    assert result.judged("standalone") == result.judged("standalone", DECIDES)
    assert result.exit_code("standalone") == EXIT_INSIDE


@pytest.mark.parametrize(("duration_s", "begin_s"), [(100.0, 99.0), (200.0, 199.0), (0.5, 0.0)])
def test_a_window_that_begins_before_the_end_moves_with_it(duration_s, begin_s):
    """Nobody knows where a pilot goes: of by_hand the last second is judged, however long."""
    folder = config_folder("heli_flight")
    layers = [folder / "scenario.yaml", folder / "scenarios" / "by_hand.yaml"]
    values = dict(load(TABLE, layers, "scenario")) | {"duration_s": duration_s}
    windows_s = Scenario.from_parameters(values).windows_s
    np.testing.assert_allclose(windows_s, [[begin_s, duration_s]])


def test_what_a_pilot_commands_in_a_test_is_not_scored():
    """Up to then the flight is judged; a failsafe that leads away is not a pilot."""
    away = np.zeros((6000, 3))
    away[2800:, 0] = 5.0
    commanded = np.arange(6000) >= 2800
    mine = Result(score(record(nav_pos_ned_m=away, commanded=commanded), scenario()), "", 60.0, 1.0)
    assert mine.figures.until_s == 28.0
    assert mine.verdict("standalone") is Verdict.INSIDE
    assert mine.coverage("standalone").spans_s == ((5.0, 18.0), (25.0, 28.0))
    fell = np.full(6000, "NONE", "U14")
    fell[2790:] = "LAND"
    lost = score(record(nav_pos_ned_m=away, commanded=commanded, failsafe=fell), scenario())
    assert lost.until_s is None
    assert Result(lost, "", 60.0, 1.0).verdict("standalone") is Verdict.OUTSIDE
    early = score(record(nav_pos_ned_m=away, commanded=np.ones(6000, bool)), scenario())
    assert Result(early, "", 60.0, 1.0).verdict("standalone") is Verdict.NOT_SCORED


@pytest.mark.parametrize(
    ("options", "sources"),
    [
        ({}, {"Fig. 5", "Fig. 6", "Fig. 7", "Fig. 8", "Fig. 9"}),
        ({"scenario_name": "attitude"}, {"Fig. 4"}),
        ({"scenario_name": "attitude_gusts"}, {NONE}),
        ({"scenario_name": "waypoints"}, {GOAL}),
        ({"overrides": {"plant": {"aircraft_file": "xcell60.yaml"}}}, {NONE}),
        ({"overrides": {"scenario": {"climb.end_s": 20.0}}}, {NONE}),
        ({"overrides": {"scenario": {"duration_s": 30.0}}, "world": "hard"},
         {"Fig. 5", "Fig. 6", "Fig. 7", "Fig. 8", "Fig. 9"}),
        ({"scenario_name": "waypoints", "overrides": {"scenario": {
            "score.bounds.position_m": 2.0, "score.bounds.heading_deg": 9.0}}}, {OWN}),
    ],
)  # fmt: skip
def test_the_papers_figures_bound_its_own_tests_alone(options, sources):
    metrics = resolve(**options).scenario.metrics
    assert {metric.source for metric in metrics} == sources
    assert all(metric.bounded == (metric.source != NONE) for metric in metrics)


def test_the_papers_aircraft_is_the_packaged_one():
    assert resolve().nodes["plant"]["aircraft_file"] == PAPERS_AIRCRAFT


def test_without_a_bound_json_has_none():
    metrics = bounded("hover", {"altitude_m": 0.5}, False)
    flight = score(record(), replace(scenario(), metrics=metrics))
    rows = {row["key"]: row for row in (s.as_dict() for s in flight.windows)}
    assert (rows["altitude"]["paper"], rows["altitude"]["inside"]) == (0.5, True)
    assert (rows["v_x"]["paper"], rows["v_x"]["inside"]) == (None, None)
