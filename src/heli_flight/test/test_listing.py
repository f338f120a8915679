# SPDX-License-Identifier: Apache-2.0
"""`heli list`: a line for everything that is packaged; help names what there is."""

import json

import pytest
from typer.main import get_command

from heli_core.command_line import config_folder
from heli_dynamics_sim.linear_aircraft import linear_models
from heli_flight.cli import app, listing
from heli_flight.layers import scenario_names
from heli_flight.settings import resolve
from heli_flight.worlds import LAWS, WORLDS
from heli_inner_hinf.controller_state import CONTROLLERS


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("scenarios", scenario_names()),
        ("worlds", WORLDS.names()),
        ("presets", LAWS.names()),
        ("controllers", list(CONTROLLERS)),
        ("aircraft", sorted(p.stem for p in (config_folder("heli_dynamics_sim") / "aircraft")
                            .glob("*.yaml")) + linear_models()),
    ],
)  # fmt: skip
def test_everything_packaged_has_a_line(kind, names, capsys):
    assert app.main(["list", kind, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told) == names
    assert all(words and "\n" not in words for words in told.values())
    assert app.main(["list", kind]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(names) + 1


def test_an_unknown_kind_names_the_known(capsys):
    assert app.main(["list", "pilots"]) == 2
    sentence = capsys.readouterr().err
    assert all(kind in sentence for kind in listing._OPTIONS)


def test_help_names_every_preset_and_the_windows_that_are_scored():
    hover = get_command(app.app).commands["hover"]
    options = {param.opts[0]: param.help for param in hover.params}
    assert all(name in options["--control-preset"] for name in LAWS.names())
    (first, second) = resolve().scenario.windows_s
    assert f"{first[0]:g} to {first[1]:g} s and {second[0]:g} s to the end" in hover.epilog
