# SPDX-License-Identifier: Apache-2.0
"""What each node answers to --help, and by which names parameter files speak of it."""

from importlib import import_module
from pathlib import Path

import pytest

from heli_msgs_bridge.lifecycle_node import ManagedNode
from heli_msgs_bridge.node_process import asks_for_help, run

ROOT = Path(__file__).resolve().parents[2]
MODULES = {
    "scenario": "heli_flight.graph.scenario_node",
    "world_clock": "heli_flight.graph.world_clock_node",
    "lifecycle_manager": "heli_flight.graph.lifecycle_manager_node",
}
EXECUTABLES = sorted(
    path.name
    for path in (ROOT / "src").glob("*/scripts/*")
    if "node import main" in path.read_text()
)


def node_class(name):
    """The node class of an executable."""
    package = next((ROOT / "src").glob(f"*/scripts/{name}")).parents[1].name
    module = import_module(MODULES.get(name, f"{package}.node"))
    (cls,) = [
        thing
        for thing in vars(module).values()
        if isinstance(thing, type)
        and issubclass(thing, ManagedNode)
        and thing.__module__ == module.__name__
    ]
    return cls


def test_all_ten_are_here():
    assert len(EXECUTABLES) == 10


@pytest.mark.parametrize("name", EXECUTABLES)
class TestHelp:
    def test_names_every_parameter_with_its_packaged_value(self, name, capfd):
        cls = node_class(name)
        assert run(cls, ["--help"]) == 0
        text, errors = capfd.readouterr()
        assert errors == ""
        assert text.startswith(f"usage: ros2 run {cls.SPEC.package} {name} ")
        lines = text.splitlines()
        for row in cls.SPEC.full_table():
            assert any(line.startswith(f"  {row.name} = ") for line in lines), row.name
        assert "  autostart = true" in lines
        # Long words and arrays, as they are, may go beyond.
        assert max(map(len, lines)) < 140

    def test_another_name_and_namespace_keep_the_packaged_values(self, name):
        spec = node_class(name).SPEC
        packaged = spec.resolve()
        renamed = spec.resolve(name="/heli1/nav")
        assert list(renamed) == list(packaged)
        assert str(renamed) == str(packaged)


def test_help_after_the_ros_arguments_is_none():
    """Behind --ros-args it may be the value of another option."""
    assert asks_for_help(["--help", "--ros-args"]) and asks_for_help(["-h"])
    assert not asks_for_help(["--ros-args", "-r", "a:=b", "--help"])
    assert not asks_for_help([])


def test_files_and_rules_speak_of_a_renamed_node_by_its_new_name(tmp_path):
    spec = node_class("observer").SPEC
    file = tmp_path / "my.yaml"
    file.write_text(
        "/**/observer:\n  ros__parameters:\n    connect_timeout_s: 1.0\n"
        "/**/nav:\n  ros__parameters:\n    connect_timeout_s: 2.0\n"
    )
    assert spec.resolve([str(file)], name="/heli1/nav")["connect_timeout_s"] == 2.0
    assert spec.resolve([str(file)], name="/observer")["connect_timeout_s"] == 1.0
    rules = ["observer:peer_timeout_s:=7.0", "nav:peer_timeout_s:=8.0"]
    assert spec.resolve((), rules, "/nav")["peer_timeout_s"] == 8.0


def test_strength_of_the_users_files(tmp_path):
    """The user's file wins over the packaged one, however much more exact that one's key is."""
    file = tmp_path / "my.yaml"
    file.write_text("/**:\n  ros__parameters:\n    connect_timeout_s: 3.0\n")
    assert node_class("observer").SPEC.resolve([str(file)])["connect_timeout_s"] == 3.0
