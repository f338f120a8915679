# SPDX-License-Identifier: Apache-2.0
"""Figures of take-off and landing on records whose numbers are known by construction."""

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import quat_from_euler
from heli_dynamics_sim.config import PlantConfig
from heli_flight.fly import FinishedFlight, print_end
from heli_flight.record import FlightRecord
from heli_flight.result import Result
from heli_flight.scenario import GROUND_METRICS, Gear, ground_figures
from heli_flight.scoring import Figures
from heli_flight.settings import resolve

N = 2000
STOOD, LIFTED, DOWN = 0.24, 500, 1500


def record():
    """Stands 5 s, slides 0.1 m north meanwhile, 10 m up for 10 s, down at 0.4 m/s, slides 0.2 m."""
    time_s = np.arange(N) * 0.01
    pos, vel = np.zeros((N, 3)), np.zeros((N, 3))
    pos[:, 2] = -STOOD
    pos[:LIFTED, 0] = np.linspace(0.0, 0.1, LIFTED)
    pos[LIFTED:, 0] = 0.1
    pos[LIFTED:DOWN, 2] = -10.0 - STOOD
    vel[DOWN - 1, 2] = 0.4
    pos[DOWN:, 1] = np.linspace(0.0, 0.2, N - DOWN)
    q = np.tile(quat_from_euler(0.0, 0.0, 0.0), (N, 1))
    q[DOWN + 3] = quat_from_euler(np.radians(6.0), 0.0, 0.0)
    mode = np.full(N, "land", "U10")
    mode[:LIFTED], mode[LIFTED:700], mode[700:DOWN] = "standing", "takeoff", "hover"
    nav = pos.copy()
    nav[700:, 2] -= 0.25
    none = np.zeros((N, 3))
    mode[LIFTED - 1] = "takeoff"
    return FlightRecord(
        time_s, pos, vel, none, q, none, none, nav, vel, none, q, none, np.zeros((N, 7)), none,
        np.zeros((N, 4)), mode=mode,
    )  # fmt: skip


def gear():
    plant = resolve("takeoff_land").nodes["plant"]
    return Gear(PlantConfig.from_parameters(plant).params.aircraft.ground, 10.0)


def test_each_figure_is_what_was_built_in():
    figures = {figure.metric.key: figure for figure in ground_figures(record(), gear())}
    values = {key: figure.value for key, figure in figures.items()}
    assert values == pytest.approx(
        {
            "takeoff_skid": 0.1,
            "takeoff_height": 0.25,
            "touch_down_speed": 0.4,
            "landing_skid": 0.2,
            "touch_down_tilt": 6.0,
        }
    )
    assert all(figure.inside for figure in figures.values())


def test_a_takeoff_is_judged_by_its_own_height_where_it_had_one():
    own = np.full(N, np.nan)
    own[LIFTED:] = 9.0
    flown = replace(record(), takeoff_height_m=own)
    values = {figure.metric.key: figure.value for figure in ground_figures(flown, gear())}
    assert values["takeoff_height"] == pytest.approx(1.25)


def test_a_pilot_whose_goal_waits_leaves_no_hover_behind_the_climb():
    """The goal is taken in the very tick of the first hover, which then no record has."""
    on = record()
    on.mode[700:DOWN] = "trajectory"
    values = {figure.metric.key: figure.value for figure in ground_figures(on, gear())}
    assert values["takeoff_height"] == pytest.approx(0.25)


def test_what_did_not_happen_is_no_success():
    stays = record()
    stays = replace(stays, truth_pos_ned_m=np.tile([0.0, 0.0, -STOOD], (N, 1)))
    figures = ground_figures(stays, gear())
    assert [figure.value for figure in figures] == [None] * 5
    assert figures[0].cell == "not reached"
    result = Result(Figures(ground=figures), "", 20.0, 1.0)
    assert result.exit_code("rtk") == 1
    inside = Result(Figures(ground=ground_figures(record(), gear())), "", 20.0, 1.0)
    assert inside.exit_code("rtk") == 0


def test_what_was_missed_on_the_ground_is_named_at_the_end(capsys, tmp_path):
    """Where nothing of the paper's was outside, nothing of the paper's is said to be."""
    slid = record()
    slid = replace(slid, truth_pos_ned_m=slid.truth_pos_ned_m * [1.0, 3.0, 1.0])
    result = Result(Figures(ground=ground_figures(slid, gear())), "", 20.0, 1.0)
    page = tmp_path / "report.html"
    print_end(FinishedFlight(resolve("takeoff_land"), result, tmp_path), page, Console(width=200))
    (last,) = capsys.readouterr().out.splitlines()[2:]
    skid = next(metric for metric in GROUND_METRICS if metric.key == "landing_skid")
    outside, report = last.split("; ")
    assert outside.startswith("Outside ") and outside.endswith(f" {skid.label}")
    assert "paper" not in outside and report == f"report: {page}"


def test_a_flight_that_ends_in_the_air_has_not_landed():
    up = record()
    up = replace(up, truth_pos_ned_m=np.where(np.arange(N)[:, None] < LIFTED, up.truth_pos_ned_m,
                                              [0.0, 0.0, -10.0]))  # fmt: skip
    values = {f.metric.key: f.value for f in ground_figures(up, gear())}
    assert values["takeoff_skid"] == pytest.approx(0.1)
    assert values["touch_down_speed"] is None and values["landing_skid"] is None


@pytest.mark.parametrize(
    ("node", "change", "expected"),
    [
        ("outer_loop", {"start.on_ground": False}, "start.on_ground: True does not agree"),
        ("outer_loop", {"takeoff.idle_collective": 0.3}, "takeoff.idle_collective: 0.3"),
        ("outer_loop", {"commands.at_s": [3.0, 2.0, 1.0]}, "rising times"),
        ("outer_loop", {"commands.what": ["takeof", "goto", "land"]}, "takeoff"),
        ("outer_loop", {"commands.at_s": [3.0]}, "has 1 times, commands.what 3 commands"),
    ],
)
def test_a_scenario_that_does_not_fit_together_is_refused(node, change, expected):
    with pytest.raises(ParameterError, match=expected):
        resolve("takeoff_land", overrides={node: change})
