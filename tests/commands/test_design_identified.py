# SPDX-License-Identifier: Apache-2.0
"""`heli design --identified`: from a model that was found in flight to laws."""

import json

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_flight.cli import app as cli
from heli_studies.design.identified import design_of_identified, identified_file

MODEL = config_folder("heli_flight") / "designs" / "xcell60.yaml"
"""It holds what a file of `heli identify` holds."""


def test_what_holds_no_model_is_refused_with_what_is_missing(tmp_path, capsys):
    weights = tmp_path / "weights.yaml"
    weights.write_text("/**/inner_loop:\n  ros__parameters:\n    gamma: 0.1\n")
    assert cli.main(["design", "--identified", str(weights)]) == 2
    assert "model.A is missing" in capsys.readouterr().err
    assert cli.main(["design", "--identified", str(MODEL), "--search"]) == 2
    assert "--identified" in capsys.readouterr().err


def test_a_folder_means_the_file_in_it(tmp_path):
    (tmp_path / "identified.yaml").write_bytes(MODEL.read_bytes())
    assert identified_file(tmp_path) == tmp_path / "identified.yaml"
    assert identified_file(MODEL) == MODEL


@pytest.mark.slow
def test_a_model_becomes_a_design_without_an_aircraft_file():
    made = design_of_identified(MODEL, gamma_factor=1.3)
    assert "plant" not in made.values and not made.outer
    np.testing.assert_array_equal(made.values["inner_loop"]["model.A"], made.basis.A)
    bound = made.attitude.bound
    assert bound.gamma == pytest.approx(1.3 * bound.gamma_star.value, rel=1e-3)
    assert made.reports[-1].stability < 0.0
    assert made.values["outer_loop"]["mass"] == 8.2


def test_no_proof_is_given_for_another_aircraft_than_the_one_that_is_named(tmp_path, capsys):
    linear = tmp_path / "linear.yaml"
    linear.write_text("/**/plant:\n  ros__parameters:\n    linear_model: blade360\n")
    assert cli.main(["robust", "--params", str(linear), "--json"]) == 0
    (judged,) = json.loads(capsys.readouterr().out)["rows"]
    assert judged["aircraft"] == "blade360" and not judged["certificate"]["applies"]
    assert judged["growth_per_s"] > 0.0, "with a controller of another aircraft"


@pytest.mark.parametrize("command", [["identify", "--out"], ["log", "identify", "a.csv", "--out"]])
def test_a_structure_that_is_not_known_is_refused_before_anything_is_made(
    command, tmp_path, capsys
):
    out = tmp_path / "new"
    assert cli.main([*command, str(out), "--structure", "flapping"]) == 2
    said = capsys.readouterr().err
    assert "--structure" in said and "full, quasi_static_rotor" in said
    assert not out.exists()
