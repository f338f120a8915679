# SPDX-License-Identifier: Apache-2.0
"""`heli compare controller`: laws in Python beside the packaged ones, on the same seeds."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from heli_flight.cli.app import main
from heli_flight.fly import FlightOrder
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.campaign.run import FlownSeed
from heli_studies.compare_own import rivals

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
LAW = """
class {name}:
    def reset(self, x, r, u):
        self.u = u

    def step(self, x, r, t):
        {code}
"""
ARGUMENTS = ("--scenario", "attitude", "--duration", "8", "--seeds", "1..2", "--json")


@pytest.fixture
def law(tmp_path):
    def written(code, name="Mine"):
        file = tmp_path / "own.py"
        file.write_text(LAW.format(name=name, code=code))
        return f"{file}:{name}"

    return written


def compared(capsys, *words):
    assert main(["compare", "controller", *words, *ARGUMENTS]) == 0
    return json.loads(capsys.readouterr().out)["laws"]


def test_every_law_flies_every_seed(capsys, law):
    laws = compared(capsys, law("return self.u"), "pid", "--workers", "0")
    assert list(laws) == ["packaged", "own:Mine", "pid"]
    assert [[f["seed"] for f in flights] for flights in laws.values()] == [[1, 2]] * 3
    settings = resolve("attitude", duration_s=8.0, seed=2, laws="pid")
    flown = FlownSeed.of(2, simulate(settings), settings)
    truth = {s.metric.key: s.max for s in flown.figures.of("windows") if s.source == "truth"}
    assert laws["pid"][1]["largest"] == pytest.approx(truth, rel=1e-12)
    errors = [[f["largest"]["roll"] for f in flights] for flights in laws.values() if flights]
    assert np.ptp(np.array(errors), axis=0).min() > 0.0


@pytest.mark.slow
def test_workers_fly_the_same(capsys, law):
    own = law("return self.u")
    here = compared(capsys, own, "--workers", "0")
    assert compared(capsys, own, "--workers", "2") == here


def test_a_law_that_fails_is_a_lost_flight(capsys, law):
    laws = compared(capsys, law("return 1 / 0"), "--workers", "0")
    assert "ZeroDivisionError" in laws["own:Mine"][0]["lost"] and not laws["packaged"][0]["lost"]


def test_a_position_controller_flies_the_hover_by_default():
    order = partial(FlightOrder, duration_s=1.0)
    for name, scenario in (
        ("mpc_position.py:MpcPosition", "hover"),
        ("my_law.py:MyLaw", "attitude"),
    ):
        flown = rivals((str(EXAMPLES / name),), None, order)
        assert [rival.settings.scenario_name for rival in flown] == [scenario] * 2


@pytest.mark.parametrize(
    ("words", "named"),
    [(["packaged"], "packaged"), (["none.py:Law"], "none.py"), (["fancy"], "fancy")],
)
def test_what_is_no_law_is_named(capsys, words, named):
    assert main(["compare", "controller", *words, *ARGUMENTS]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and named in error
