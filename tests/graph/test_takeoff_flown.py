# SPDX-License-Identifier: Apache-2.0
"""From the ground to the ground through the graph: as in one process, told and written as flown."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--scenario", "takeoff_land"]
SECONDS = 66.0
"""It stands again with its rotor still a few seconds before."""
# On loaded cores a pilot is seconds late, at ten times the wall clock's pace: time enough is given.
BY_HAND = [
    *HOVER[:-1], "by_hand", "--world", "paper", "--gps", "rtk", "--seed", "5", "--no-report",
    "--duration", "200",
]  # fmt: skip
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def _in_order(modes):
    return modes[np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])].tolist()


def test_the_graph_flies_from_the_ground_to_the_ground_as_one_process_does(ros_env, tmp_path):
    folder = tmp_path / "f"
    done = subprocess.run(
        [
            *HOVER,
            "--gps",
            "rtk",
            "--seed",
            "5",
            "--duration",
            str(SECONDS),
            "--no-report",
            "--out",
            str(folder),
        ],
        env=ros_env,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    settings = resolve("takeoff_land", gps="rtk", seed=5, duration_s=SECONDS)
    flown = flight_from_bag(folder / "bag", settings).record
    alone = simulate(settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    assert _in_order(flown.mode) == _in_order(alone.mode)
    # Ways count from when they were flown, not from when a recorder on loaded cores heard of them.
    away = np.linalg.norm((flown.reference - alone.reference)[:, :3], axis=1) > 1e-6
    assert not away.any()
    result = json.loads((folder / "result.json").read_text())
    assert [figure["inside"] for figure in result["ground"]] == [True] * 5
    assert all(figure["label"] in done.stdout for figure in result["ground"])


TEN_LINES = [[str(EXAMPLES / "ten_lines.py")]]
CLIENT = [[str(EXAMPLES / "takeoff_goto_land.py"), "9", "6", "12"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("programs", "said"),
    [
        (TEN_LINES, ["takeoff", "land"]),
        (CLIENT, ["takeoff", "goto", "land"]),
    ],
    ids=["ten_lines", "client"],
)
def test_a_pilot_takes_off_goes_there_and_lands(ros_env, tmp_path, programs, said):
    """Beside an aircraft that waits on the ground."""
    folder = tmp_path / "f"
    flight = subprocess.Popen(
        [*BY_HAND, "--out", str(folder)],
        env=ros_env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    told = ""
    try:
        for words in programs:
            pilot = subprocess.run(
                [sys.executable, *words], env=ros_env, capture_output=True, text=True, timeout=200
            )
            assert pilot.returncode == 0, pilot.stdout + pilot.stderr
            told += pilot.stdout
        printed, _ = flight.communicate(timeout=200)
    finally:
        flight.kill()
    assert [line.split(":")[0] for line in told.splitlines()] == said
    assert flight.returncode == 0, printed
    settings = resolve("by_hand", gps="rtk", seed=5, duration_s=200.0)
    record = flight_from_bag(folder / "bag", settings).record
    modes = _in_order(record.mode)
    assert [modes[0], modes[1], modes[-2], modes[-1]] == ["standing", "takeoff", "land", "standing"]
    assert "trajectory" in modes
    north, east, _ = record.truth_pos_ned_m[-1]
    assert np.hypot(east - 9.0, north - 6.0) < 0.5
    result = json.loads((folder / "result.json").read_text())
    assert [figure["inside"] for figure in result["ground"]] == [True] * 5
