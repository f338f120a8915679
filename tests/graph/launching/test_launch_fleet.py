# SPDX-License-Identifier: Apache-2.0
"""`fleet:=fleet.yaml`: aircraft of different types and places in one launch; bad ones named."""

import re

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.command_line import config_folder
from heli_core.parameters import ParameterError, load, with_common
from heli_core.rows import PLANT
from heli_dynamics_sim.parameters import TABLE
from heli_flight.fleet import read_fleet, types
from heli_flight.loop import simulate
from heli_flight.scenario import TABLE as SCENARIO_TABLE
from heli_flight.settings import resolve, seed_of
from heli_msgs_bridge import topics
from support.launched import flown

HOVER = ("heli_flight", "hover.launch.py")
FLEET = """
fleet:
  - namespace: red
    pos_ned_m: [0.0, -5.0, -10.0]
  - namespace: blue
    type: xcell60
    pos_ned_m: [3.0, 5.0, -12.0]
    heading_deg: 90.0
    params_file: blue.yaml
    seed: 7
"""
BLUE = "/**/plant:\n  ros__parameters:\n    sensors.gps.white_m: 0.25\n"


@pytest.fixture
def fleet(tmp_path):
    """Write a fleet file and the parameters of one of its aircraft; its path."""
    (tmp_path / "blue.yaml").write_text(BLUE)

    def write(text=FLEET):
        (tmp_path / "fleet.yaml").write_text(text)
        return tmp_path / "fleet.yaml"

    return write


def values(node, folder):
    """Parameters of a plant, or a scenario, that launch starts."""
    package, table = {
        "plant": ("heli_dynamics_sim", with_common(TABLE)),
        "scenario": ("heli_flight", with_common(SCENARIO_TABLE)),
    }[node.name]
    common = config_folder("heli_core") / "common.yaml"
    packaged = config_folder(package) / f"{node.name}.yaml"
    return load(table, [common, packaged, *node.files(folder)], node.full_name)


def test_each_has_its_type_its_place_and_its_parameters(launch, fleet, tmp_path):
    started = launch(*HOVER, f"fleet:={fleet()}", "seed:=3", "bag:=bags")
    assert started[0].full_name == "/world_clock"
    told = "".join(path.read_text() for path in started[0].files(tmp_path))
    assert "- red\n" in told and "- blue\n" in told
    assert {node.namespace for node in started[1:]} == {"red", "blue"}
    names = {node.full_name: node for node in started}
    red, blue = (values(names[f"/{name}/plant"], tmp_path) for name in ("red", "blue"))
    assert (red["aircraft_file"], blue["aircraft_file"]) == ("helion.yaml", "xcell60.yaml")
    for values_of, place, heading in ((red, [0, -5, -10], 0), (blue, [3, 5, -12], 90)):
        assert list(values_of["initial.pos_ned_m"]) == place
        assert values_of["initial.psi_deg"] == heading and values_of["clock"] == "world"
    assert (red["seed"], blue["seed"]) == (seed_of(3, 0), 7)
    assert blue["sensors.gps.white_m"] == 0.25 != red["sensors.gps.white_m"]
    for name, place in (("red", [0, -5, -10]), ("blue", [3, 5, -12])):
        scenario = values(names[f"/{name}/scenario"], tmp_path)
        assert list(scenario["start_pos_ned_m"]) == place


def test_what_is_not_said_is_as_for_all(launch, fleet, tmp_path):
    """The launch's own parameter file is under that of the aircraft, and over its type."""
    file = tmp_path / "all.yaml"
    file.write_text("/**/plant:\n  ros__parameters:\n    sensors.gps.white_m: 0.15\n")
    words = (f"fleet:={fleet()}", f"params_file:={file}")
    names = {node.full_name: node for node in launch(*HOVER, *words)}
    speeds = [
        values(names[f"/{n}/plant"], tmp_path)["sensors.gps.white_m"] for n in ("red", "blue")
    ]
    assert speeds == [0.15, 0.25]


def test_every_type_is_there(launch, fleet):
    assert {"helion", "xcell60", "logo600"} <= set(types())
    for kind in types():
        (only,) = read_fleet(fleet(f"fleet: [{{namespace: a, type: {kind}}}]"))
        assert only.design is None or only.design.is_file()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "fleet.yaml: fleet: "),
        ("fleet: 3", "fleet.yaml: fleet: "),
        ("fleet: []", "fleet.yaml: fleet: 0 aircraft"),
        ("aircraft: []", "fleet.yaml: fleet: "),
        ("fleet: [red]", "aircraft 1: namespace: "),
        ("fleet: [{type: helion}]", "aircraft 1: namespace: is missing"),
        ("fleet: [{namespace: 3}]", "aircraft 1: namespace: 3"),
        ("fleet: [{namespace: a b}]", "aircraft 1: namespace: 'a b' is no ROS name"),
        ("fleet: [{namespace: a}, {namespace: /a/}]", "aircraft 2: namespace: a is there twice"),
        ("fleet: [{namespace: a, typ: helion}]", "aircraft 1: typ: .*did you mean 'type'"),
        ("fleet: [{namespace: a, type: xcel60}]", "aircraft 1: type: .*did you mean xcell60"),
        ("fleet: [{namespace: a, pos_ned_m: [1.0]}]", "aircraft 1: pos_ned_m: "),
        ("fleet: [{namespace: a, pos_ned_m: [1.0, .nan, 2.0]}]", "aircraft 1: pos_ned_m: "),
        ("fleet: [{namespace: a, heading_deg: north}]", "aircraft 1: heading_deg: "),
        ("fleet: [{namespace: a, seed: -1}]", "aircraft 1: seed: -1"),
        ("fleet: [{namespace: a, params_file: none.yaml}]", "aircraft 1: params_file: .*none.yaml"),
        ("fleet: [&a {namespace: a}, *a]", "fleet.yaml:1: YAML aliases"),
        ("fleet: [", "fleet.yaml:2: not valid YAML"),
    ],
)
def test_a_bad_file_is_named_with_its_key(launch, fleet, text, named):
    with pytest.raises(ParameterError, match=named) as caught:
        launch(*HOVER, f"fleet:={fleet(text)}")
    assert str(caught.value).count("\n") == 0 and "fleet.yaml" in str(caught.value)


def test_a_file_that_is_not_there_is_named(launch):
    with pytest.raises(ParameterError, match=re.escape("/nowhere.yaml")):
        launch(*HOVER, "fleet:=/nowhere.yaml")


@pytest.mark.parametrize("other", ["aircraft:=2", "live:=true", "respawn:=true"])
def test_what_does_not_go_starts_nothing(launch, fleet, other):
    with pytest.raises(ValueError, match=other.split(":=")[0]):
        launch(*HOVER, f"fleet:={fleet()}", other)


@pytest.mark.slow
def test_two_types_fly_side_by_side(launch, fleet, tmp_path, ros_env, living):
    """Each begins at its place, and flies what it would fly alone."""
    bags = tmp_path / "bags"
    started = launch(*HOVER, f"fleet:={fleet()}", "duration:=3", f"bag:={bags}", "world:=paper")
    codes, printed = flown(started, tmp_path, ros_env, "/world_clock")
    assert living() == []
    assert codes == {0} and "going on" not in printed, printed
    design = config_folder("heli_flight") / "designs/xcell60.yaml"
    alone = {
        "red": ([0.0, -5.0, -10.0], 0.0, seed_of(1, 0), []),
        "blue": ([3.0, 5.0, -12.0], 90.0, 7, [design, tmp_path / "blue.yaml"]),
    }
    for name, (place, heading, seed, files) in alone.items():
        truth = read_bag(bags / name).streams[topics.TRUTH_ODOM].rows
        assert truth[0, PLANT.pos].tolist() == place
        where = {"scenario": {"start_pos_ned_m": place, "heading_deg": heading}}
        settings = resolve(
            "hover", seed=seed, duration_s=3.0, world="paper", params=files, overrides=where
        )
        assert np.abs(truth[:, PLANT.pos] - simulate(settings).record.truth_pos_ned_m).max() < 1e-6
