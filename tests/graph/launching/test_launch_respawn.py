# SPDX-License-Identifier: Apache-2.0
"""`respawn:=true`: who is started again, how often, and a flight in which a node is killed."""

import contextlib
import os
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.rows import PLANT
from heli_flight.graph.respawn import AGAIN, MOST
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_flight.worlds import HOVER_TEST_WORLD
from heli_msgs_bridge import topics
from heli_msgs_bridge.handover import FOLDER, HandoverFile, Restarts

HOVER = ("heli_flight", "hover.launch.py")
LENGTH_S, KILLED_AT = 20.0, 300
LIMIT_S = 240.0


def test_who_is_started_again_and_all_know_it(launch):
    started = {node.name: node for node in launch(*HOVER, "respawn:=true", "live:=true")}
    assert {name for name, node in started.items() if node.respawn} == set(AGAIN)
    # Else launch would start one that has just ended before it hears that all is to end.
    assert all(started[name].respawn_delay > 0.0 for name in AGAIN)
    (folder,) = {node.env[FOLDER] for node in started.values()}
    assert Path(folder).is_dir()
    for node in launch(*HOVER):
        assert not node.respawn and not node.env


def test_a_death_is_told_and_one_too_many_ends_the_launch(launch, monkeypatch):
    started = {node.name: node for node in launch(*HOVER, "respawn:=true")}
    monkeypatch.setenv(FOLDER, started["plant"].env[FOLDER])
    restarts = Restarts()
    assert not restarts.news()
    for times in range(1, MOST):
        assert started["observer"].ended(-9) is None
        assert restarts.news() == {"observer": times} and not restarts.news()
    assert started["inner_loop"].ended(1) is None
    assert restarts.news() == {"observer": MOST - 1, "inner_loop": 1}
    assert started["observer"].ended(-9) == 1
    assert not restarts.news()


@pytest.mark.parametrize(("name", "code"), [("observer", 2), ("plant", -9), ("recorder", -9)])
def test_what_cannot_start_and_who_cannot_be_gone_on_with_end_the_launch(launch, name, code):
    started = {node.name: node for node in launch(*HOVER, "respawn:=true")}
    assert started[name].ended(code) == 1
    assert started["observer"].ended(0) == 0
    assert started["observer"].ended(-9, shutting_down=True) is None


@pytest.mark.parametrize("other", ["composed:=true", "aircraft:=2"])
def test_what_does_not_go_starts_nothing(launch, other):
    with pytest.raises(ValueError, match=f"respawn:=true.*{other}"):
        launch(*HOVER, "respawn:=true", other)


@pytest.mark.slow
@pytest.mark.parametrize("killed", AGAIN)
def test_a_killed_node_comes_back_and_the_flight_is_the_same(
    launch, tmp_path, ros_env, living, killed
):
    """In lockstep number for number, and nobody is called a stranger."""
    bag, patient = tmp_path / "bag", tmp_path / "patient.yaml"
    # However loaded the machine is, the plant waits for the node.
    waits = f"{{ros__parameters: {{peer_timeout_s: {LIMIT_S}}}}}\n"
    patient.write_text("".join(f"{name}: {waits}" for name in ("plant", *AGAIN)))
    words = (f"bag:={bag}", f"duration:={LENGTH_S}", "seed:=3", "respawn:=true")
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
        memory = HandoverFile(Path(started[killed].env[FOLDER]) / f"{killed}.memory")
        while (kept := memory.load()) is None or kept.tick < KILLED_AT:
            with pytest.raises(subprocess.TimeoutExpired):
                processes["plant"].wait(0.02)
        os.kill(processes[killed].pid, signal.SIGKILL)
        processes[killed].wait()
        assert started[killed].ended(-9) is None
        start(started[killed])
        assert processes["plant"].wait(LIMIT_S) == 0
        status = processes["recorder"].poll()
    assert status is None and living() == []
    logs = [path.read_text() for path in sorted(tmp_path.glob("*.log"))]
    flown = read_bag(bag)
    truth = flown.streams[topics.TRUTH_ODOM]
    stamps, first = np.unique(truth.stamp_ns, return_index=True)
    assert len(stamps) == round(LENGTH_S * 100)
    alone = simulate(resolve("hover", seed=3, duration_s=LENGTH_S, world=HOVER_TEST_WORLD))
    flown_m = truth.rows[first][:, PLANT.pos]
    off_m = np.abs(flown_m - alone.record.truth_pos_ned_m).max(axis=1)
    assert off_m.max() < 1e-6, (kept.tick, int(np.argmax(off_m > 1e-6)), logs)
    assert not any("somebody else" in remark.message for remark in flown.remarks)
