# SPDX-License-Identifier: Apache-2.0
"""The mission of docs/howto/waypoints.md flies from its file, as the page says."""

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

import heli

TEXT = (Path(__file__).resolve().parents[2] / "docs/howto/waypoints.md").read_text("utf-8")
MISSION = textwrap.dedent(re.search(r"(?s)<<'YAML'\n(.*?)\n    YAML", TEXT)[1])
CODE = re.search(r"(?s)```py\n(.*?)```", TEXT)[1]


@pytest.fixture
def file(tmp_path):
    """The page's parameter file."""
    path = tmp_path / "mission.yaml"
    path.write_text(MISSION, encoding="utf-8")
    return path


def points_ned_m():
    """The points that the file names, (N, 3)."""
    listed = re.search(r"waypoints_ned_m: \[(.*?)\]", MISSION, re.DOTALL)[1]
    return np.reshape([float(word) for word in listed.split(",")], (-1, 3))


def test_the_file_is_flown_and_the_table_flies_the_same(file, tmp_path, monkeypatch):
    flight = heli.fly("waypoints", gps="rtk", params=str(file), quiet=True)
    reference = flight.reference.pos_ned_m
    stops = [np.abs(reference - point).max(axis=1).argmin() for point in points_ned_m()]
    assert len(stops) == 4 and (np.diff(stops) > 200).all() and flight.time_s[stops[-1]] < 58.0
    off_m = np.linalg.norm(flight.truth.pos_ned_m - reference, axis=1)
    assert not flight.lost and off_m[flight.time_s > 5.0].max() < 0.5
    # Two seconds at each point: it stands still there.
    still = np.abs(flight.reference.vel_ned_mps).max(axis=1)
    assert all(still[stop + 20 : stop + 180].max() < 0.05 for stop in stops)

    np.savetxt(tmp_path / "mission.csv", points_ned_m(), delimiter=",")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(CODE, names)
    assert not names["flight"].lost and names["away_m"].min() < 0.3


def test_a_point_of_two_numbers_is_refused_in_a_sentence(file):
    file.write_text(MISSION.replace("12.0,  0.0, -12.0", "12.0,  0.0"), encoding="utf-8")
    with pytest.raises(heli.ParameterError, match="waypoints_ned_m") as caught:
        heli.fly("waypoints", params=str(file), quiet=True)
    assert "\n" not in str(caught.value) and "multiple of 3" in str(caught.value)
