# SPDX-License-Identifier: Apache-2.0
"""`lifecycle_manager:=true`: nobody starts itself, and a flight comes up, also after a death."""

import contextlib
import os
import signal
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S
from heli_flight.graph.manager import TABLE
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_flight.worlds import HOVER_TEST_WORLD
from heli_msgs_bridge import topics
from heli_msgs_bridge.handover import FOLDER, HandoverFile
from support.launched import flown

HOVER = ("heli_flight", "hover.launch.py")
MANAGED = "lifecycle_manager:=true"
MODULES = {"lifecycle_manager": "heli_flight.graph.manager", "scenario": "heli_flight.scenario"}


def values(node, folder):
    """Parameters that a started node ends up with."""
    table = import_module(MODULES.get(node.name, f"{node.package}.parameters")).TABLE
    common = config_folder("heli_core") / "common.yaml"
    packaged = config_folder(node.package) / f"{node.name}.yaml"
    return load(with_common(table), [common, packaged, *node.files(folder)], node.full_name)


@pytest.mark.parametrize("space", ["", "heli1"])
def test_all_are_led_and_the_plant_comes_last(launch, tmp_path, space):
    words = (MANAGED, "live:=true", "actions:=true", f"namespace:={space}")
    started = {node.name: node for node in launch(*HOVER, *words)}
    manager = values(started.pop("lifecycle_manager"), tmp_path)
    assert set(manager["node_names"]) == set(started) and manager["node_names"][-1] == "plant"
    assert manager["autostart"]
    for node in started.values():
        assert values(node, tmp_path)["autostart"] is False


def test_without_it_all_start_themselves(launch, tmp_path):
    started = {node.name: node for node in launch(*HOVER)}
    assert "lifecycle_manager" not in started
    assert all(values(node, tmp_path)["autostart"] for node in started.values())


def test_who_is_not_started_is_not_waited_for(launch, tmp_path):
    started = {node.name: node for node in launch(*HOVER, MANAGED, "record:=false")}
    names = values(started["lifecycle_manager"], tmp_path)["node_names"]
    assert "recorder" not in names and "live_view" not in names


def test_a_users_file_speaks_to_the_manager(launch, tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("/**/lifecycle_manager:\n  ros__parameters:\n    bond_timeout: 8.0\n")
    started = {node.name: node for node in launch(*HOVER, MANAGED, f"params_file:={file}")}
    assert values(started["lifecycle_manager"], tmp_path)["bond_timeout"] == 8.0
    assert {row.name for row in TABLE} >= {"node_names", "bond_timeout"}


def test_composed_nodes_are_led_each(launch, tmp_path):
    started = {node.executable: node for node in launch(*HOVER, MANAGED, "composed:=true")}
    text = "".join(path.read_text() for path in started["composed"].files(tmp_path))
    assert text.count("autostart: false") == 4


@pytest.mark.slow
def test_a_led_flight_is_the_flight(launch, tmp_path, ros_env, living):
    bag = tmp_path / "bag"
    started = launch(*HOVER, MANAGED, "duration:=2", f"bag:={bag}", "seed:=3")
    codes, printed = flown(started, tmp_path, ros_env, "/plant")
    assert living() == []
    assert codes == {0}, printed
    truth = read_bag(bag).streams[topics.TRUTH_ODOM]
    assert truth.stamp_ns[0] == NS_PER_S and len(truth.stamp_ns) == 200
    alone = simulate(resolve("hover", seed=3, duration_s=2.0, world=HOVER_TEST_WORLD))
    assert np.abs(truth.rows[:, PLANT.pos] - alone.record.truth_pos_ned_m).max() < 1e-6


@pytest.mark.slow
def test_a_killed_node_is_brought_up_by_the_manager(launch, tmp_path, ros_env, living):
    """The manager is told of the death by launch, and the flight goes on to its end."""
    bag, patient = tmp_path / "bag", tmp_path / "patient.yaml"
    # On loaded cores a Python that loads the kernels takes longer than the ten seconds.
    patient.write_text(
        "/**/lifecycle_manager:\n  ros__parameters:\n    bond_respawn_max_duration: 120.0\n"
    )
    words = (MANAGED, "respawn:=true", "duration:=20", f"bag:={bag}", "seed:=3")
    words += (f"params_file:={patient}",)
    started = {node.name: node for node in launch(*HOVER, *words)}
    with contextlib.ExitStack() as ending:

        def start(node):
            log = ending.enter_context(open(tmp_path / f"{node.name}.log", "ab"))
            process = subprocess.Popen(
                node.command(tmp_path), env=ros_env | node.env, stdout=log, stderr=log
            )
            ending.callback(process.terminate)
            return process

        processes = {name: start(node) for name, node in started.items()}
        memory = HandoverFile(Path(started["observer"].env[FOLDER]) / "observer.memory")
        while (kept := memory.load()) is None or kept.tick < 300:
            with pytest.raises(subprocess.TimeoutExpired):
                processes["plant"].wait(0.02)
        os.kill(processes["observer"].pid, signal.SIGKILL)
        processes["observer"].wait()
        assert started["observer"].ended(-9) is None
        start(started["observer"])
        assert processes["plant"].wait(240.0) == 0
    assert living() == []
    said = (tmp_path / "lifecycle_manager.log").read_text()
    assert "observer is lost: it has died" in said and "observer is back" in said
    truth = read_bag(bag).streams[topics.TRUTH_ODOM]
    assert len(np.unique(truth.stamp_ns)) == 2000
