# SPDX-License-Identifier: Apache-2.0
"""The experiment on another's helicopter, where its plant is not installed; how lost flights count.

What it flies: tests/verification/test_flown_ah1s.py.
"""

from evidence.experiments import ah1s
from evidence.registry import PRODUCERS


def test_without_the_plant_it_is_refused_by_name(monkeypatch, capsys):
    monkeypatch.setattr(ah1s, "find_spec", lambda name: None)
    assert ah1s.main() == 2
    said = capsys.readouterr()
    assert "jsbsim" in said.err and ah1s.LIST in said.err and said.out == ""
    assert PRODUCERS["ah1s"].needs == "jsbsim"


def facts(lost, horizontal_m):
    numbers = dict.fromkeys(("down_m", "heading_deg", "tilt_deg", "at_limit"), 0.5)
    return {"lost": lost, "horizontal_m": horizontal_m, "rotor_share": [0.9, 1.1], **numbers}


def test_a_lost_flight_counts_and_is_in_no_median():
    flights = [facts("", 1.0), facts("", 3.0), facts("It hit the ground.", 90.0)]
    row = ah1s._summary(flights, 2.0)
    assert (row["flown"], row["lost"], row["within_2_m"]) == (3, 1, 1)
    assert row["median"]["horizontal_m"] == 2.0 and row["worst"]["horizontal_m"] == 3.0
    lost = ah1s._summary(flights[2:], 2.0)
    assert lost == {"flown": 1, "lost": 1} and ah1s._distances(lost, False) == ["–"] * 4
