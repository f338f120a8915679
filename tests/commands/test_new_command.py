# SPDX-License-Identifier: Apache-2.0
"""`heli new aircraft`: the file that it writes, and what it refuses."""

import json

from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.cli.app import main

WORDS = ["new", "aircraft", "--mass", "5", "--rotor-diameter", "1.4"]


def test_it_writes_an_aircraft_and_ranks_its_numbers(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    assert main([*WORDS, "--rotor-rpm", "1800", "--out", str(file), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    aircraft = HelicopterParameters.from_yaml(file)
    assert (aircraft.mass_kg, aircraft.main_radius_m) == (5.0, 0.7)
    assert aircraft.main_speed_radps == 188.5
    assert content["scaled_from"] == "logo600"
    changes = [key["change"] for key in content["keys"].values()]
    assert changes == sorted(changes, reverse=True)


def test_a_file_that_is_there_is_kept(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    file.write_text("mine")
    assert main([*WORDS, "--out", str(file)]) == 2
    assert file.read_text() == "mine"
    assert str(file) in capsys.readouterr().err


def test_the_table_names_what_comes_next(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    assert main([*WORDS, "--like", "helion", "--rule", "froude", "--out", str(file)]) == 0
    assert f"heli design --aircraft {file}" in capsys.readouterr().out
