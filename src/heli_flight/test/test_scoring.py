# SPDX-License-Identifier: Apache-2.0
"""Scores of made-up flights whose errors are known."""

import math

import numpy as np
import pytest

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import EXIT_INSIDE, EXIT_OUTSIDE, Result
from heli_flight.loop.scenario import TABLE, Scenario
from heli_flight.loop.scoring import score
from heli_math.paper_metrics import heading_frame
from heli_math.rotations import quat_from_euler
from heli_parameters.locate import config_folder
from heli_parameters.parameters import load


def scenario(name="hover"):
    path = config_folder("heli_flight") / "scenarios" / f"{name}.yaml"
    return Scenario.from_parameters(load(TABLE, [path], "scenario"))


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


def by_key(scores):
    return {(s.metric.key, s.source): s for s in scores}


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


def test_climb_is_measured_about_the_reference():
    way = scenario().reference
    assert way.points[1, 5] == -2.5
    np.testing.assert_allclose(way.points[:, 2], [-10, -10, -20])


def test_attitude_errors_in_degrees():
    q = np.tile(quat_from_euler(math.radians(2.0), math.radians(-1.0), 3.0), (6000, 1))
    scores = by_key(score(record(truth_q_nb=q), scenario("attitude")))
    assert scores["roll", "truth"].max == pytest.approx(2.0)
    assert scores["pitch", "truth"].max == pytest.approx(1.0)
    assert not scores["roll", "truth"].inside
    assert scores["pitch", "truth"].inside


def test_a_flight_that_ends_early_is_not_scored():
    assert score(record(n=400), scenario()) == []


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
    found = heading_frame(vectors, np.radians([0.0, 90.0, 180.0, 45.0]))
    half = np.sqrt(0.5)
    expected = [[1, 2, 3], [2, -1, 3], [-1, -2, 3], [3 * half, half, 3]]
    assert found == pytest.approx(np.array(expected), abs=1e-12)
