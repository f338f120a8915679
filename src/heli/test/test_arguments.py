# SPDX-License-Identifier: Apache-2.0
"""What a script is told names its arguments; numbers that are none are refused in a sentence."""

import numpy as np
import pytest

import heli
from heli.arguments import number, whole


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"seed": "a"}, "seed"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"seed": True}, "seed"),
        ({"duration_s": "long"}, "duration_s"),
        ({"duration_s": float("nan")}, "duration_s"),
        ({"gps": "glonass"}, "gps"),
        ({"world": "mars"}, "world"),
        ({"laws": "none"}, "laws"),
        ({"scenario": "loop"}, "scenario"),
        ({"controller": "lead"}, "controller"),
    ],
)
def test_a_refusal_names_the_argument(options, name):
    scenario = options.pop("scenario", None)
    with pytest.raises(heli.ParameterError) as caught:
        heli.fly(scenario, quiet=True, **options)
    assert str(caught.value).startswith(name) and "--" not in str(caught.value)


def test_seeds_of_a_campaign_are_whole_numbers():
    for seeds in (["a"], [1.5], 3.5, [-1]):
        with pytest.raises(heli.ParameterError, match="seeds"):
            heli.campaign(seeds=seeds, quiet=True)


def test_numbers_of_numpy_are_numbers():
    assert whole("seed", np.int64(3)) == 3 and number("duration_s", np.float32(0.5)) == 0.5
    assert whole("seed", None) is None is number("duration_s", None)


def test_more_thrust_is_less_collective_and_a_climb_needs_more():
    hover = heli.trim()
    at_hover = heli.collective_for_thrust(9.75 * 9.781)
    assert hover.d_col == hover.u[3]
    assert at_hover == pytest.approx(hover.d_col, abs=0.02)
    assert heli.collective_for_thrust(110.0) < at_hover < heli.collective_for_thrust(80.0)
    assert heli.collective_for_thrust(9.75 * 9.781, climb_mps=2.0) < at_hover
    with pytest.raises(heli.ParameterError, match="thrust_n"):
        heli.collective_for_thrust(-1.0)


def test_a_linear_model_prints_as_python_control_does():
    model = heli.linearize()
    assert str(model.system) in repr(model)


def test_the_version_is_that_of_the_command(capsys):
    from heli_flight.cli import app

    assert app.main(["--version"]) == 0
    assert capsys.readouterr().out == f"heli {heli.__version__}\n"


@pytest.fixture
def told(monkeypatch):
    """What calls that may take long say, whatever they take."""
    from contextlib import contextmanager

    import heli.flight
    import heli.flying

    said = []

    @contextmanager
    def at_once(what, quiet=False):
        yield lambda step: said.append((what, step))

    for module in (heli.flight, heli.flying):
        monkeypatch.setattr(module, "told_when_long", at_once)
    return said


def test_reading_and_reporting_say_what_they_are_at(told, tmp_path):
    flight = heli.fly(duration_s=2.0, quiet=True)
    flight.report(flight.save(tmp_path / "flight"))
    heli.load(tmp_path / "flight")
    assert [what for what, _ in told] == ["flight.report", "heli.load"]


def test_an_environment_says_that_it_compiles(monkeypatch):
    pytest.importorskip("gymnasium")
    from heli import environments

    asked = []
    monkeypatch.setattr(
        environments, "tell_if_it_compiles", lambda say, kernel: asked.append(kernel)
    )
    environments.Fleet("hover", 1)
    assert asked == [environments.step_batch]
