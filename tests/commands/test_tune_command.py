# SPDX-License-Identifier: Apache-2.0
"""`heli tune`: what it writes flies, its goals are checked, the packaged law is what it finds."""

import json

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_flight.cli import app as cli
from heli_flight.settings import resolve
from heli_inner_hinf.attitude_goals import pid_structure
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.fixed_structure import TuningProblem
from heli_studies.tune import PACKAGED, TuneOrder, aircraft_of, goals_of, read_goals

GOALS = """
goals:
  - {name: gusts, kind: hinf, from: [wind], to: [attitude], bound: 0.1}
  - {name: margin, kind: disk_margin, at: input, bound: 0.4, hard: true}
  - {name: decay, kind: decay, bound: 0.3, hard: true}
"""


@pytest.fixture
def goals(tmp_path):
    file = tmp_path / "goals.yaml"
    file.write_text(GOALS)
    return file


@pytest.mark.parametrize("structure", ["pid", pytest.param("output:1", marks=pytest.mark.slow)])
def test_what_is_written_flies_and_is_not_worse(structure, goals, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["tune", "--structure", structure, "--goals", str(goals), "--iterations", "3",
             "--out", str(out), "--world", "paper"]  # fmt: skip
    assert cli.main(words) in (0, 1)
    said = capsys.readouterr()
    assert said.err.startswith("tune: ")
    assert "gusts" in said.out and "tuned.yaml" in said.out
    found = json.loads((out / "tuned.json").read_text())
    first = found["goals"][0]
    assert first["value"] <= first["before"]
    inner = resolve(params=[out / "tuned.yaml"]).nodes["inner_loop"]
    flown = AttitudeConfig.from_parameters(inner)
    assert flown.controller == ("pid" if structure == "pid" else "matrices")
    assert set(found["parameters"]) == {"inner_loop"}


def test_goals_hold_for_every_aircraft_in_every_world():
    order = TuneOrder(aircraft=("helion.yaml", "xcell60.yaml"))
    aircraft = aircraft_of(order)
    assert len({one.name for one in aircraft}) == 4
    assert len(goals_of(read_goals(order), aircraft)) == 4 * 5


def test_the_packaged_law_keeps_the_hard_goals_and_betters_the_shipped_one():
    order = TuneOrder()
    problem = TuningProblem(pid_structure(), goals_of(read_goals(order), aircraft_of(order)))
    soft = {}
    for name, files in (("shipped", []), ("tuned", [config_folder("heli_flight") / PACKAGED])):
        inner = resolve(params=files, laws="pid").nodes["inner_loop"]
        gains = np.concatenate([np.asarray(inner[f"pid.K_{k}"], float) for k in "PID"])
        reached = problem.reached(problem.scaled_start(gains))
        soft[name] = max(one.share for one in reached if not one.goal.hard)
        if name == "tuned":
            # the scalings are those of one frequency: a margin may look 2 % smaller than it is
            assert all(one.share <= 1.05 for one in reached if one.goal.hard)
    assert soft["tuned"] < 0.97 * soft["shipped"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_packaged_law_is_what_the_tuner_finds(capsys):
    assert cli.main(["tune", "--check"]) == 0
    assert PACKAGED in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--structure", "pi"], "output:N"),
        (["--structure", "output:99"], "output:N"),
        (["--goal", "nothing=3"], "nothing"),
        (["--goal", "cost"], "NAME=BOUND"),
        (["--goal", "cost=-1"], "cost"),
        (["--aircraft", "airship"], "airship"),
        (["--world", "mars"], "mars"),
        (["--goals", "absent.yaml"], "absent.yaml"),
    ],
)
def test_bad_input_is_one_sentence(words, named, capsys):
    assert cli.main(["tune", *words]) == 2
    said = capsys.readouterr().err.splitlines()
    assert named in said[-1]
    assert not any("Traceback" in line for line in said)


@pytest.mark.parametrize(
    "row",
    [
        "{name: x, kind: h3, bound: 1}",
        "{name: x, kind: h2, from: [wind], to: [moon], bound: 1}",
        "{name: x, kind: h2, from: [surroundings], to: [u], bound: 1}",
        "{name: x, kind: disk_margin, at: middle, bound: 1}",
        "{name: x, kind: decay, bound: .nan}",
        "{name: x, kind: decay, bound: 0}",
        "{name: x, kind: decay, bound: true}",
        "{name: x, kind: decay, bound: 1, hard: maybe}",
        "{name: x, kind: decay, bound: 1, further_ticks: 99}",
        "{name: x, kind: damping, bound: 1}",
        "{name: x, kind: decay, bound: 1, hard: true}",
        "{name: x, kind: decay, bond: 1}",
        "{kind: decay, bound: 1}",
        "x",
        "{name: [x], kind: decay, bound: 1}",
        "{name: x, kind: [decay], bound: 1}",
        "{name: x, kind: h2, from: [[1]], to: [u], bound: 1}",
    ],
)
def test_a_bad_goal_is_named(row, tmp_path, capsys):
    file = tmp_path / "goals.yaml"
    file.write_text(f"goals:\n  - {row}\n")
    assert cli.main(["tune", "--goals", str(file)]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "goal" in said


def test_a_folder_that_exists_is_refused(tmp_path, capsys):
    assert cli.main(["tune", "--out", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err
