# SPDX-License-Identifier: Apache-2.0
"""Several aircraft in one ROS domain: what the launch file starts, and two of them in flight."""

import contextlib
import subprocess

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.settings import resolve
from heli_flight.loop.several import seed_of
from heli_math.rows import PLANT
from heli_math.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics

HOVER = ("heli_flight", "hover.launch.py")
LENGTH_S = 3


def test_each_has_its_nodes_its_seed_and_its_bag(launch, tmp_path):
    started = launch(*HOVER, "aircraft:=3", "seed:=7", "bag:=my_bags", "namespace:=field")
    assert started[0].full_name == "/world_clock"
    spaces = [f"field/heli{i}" for i in (1, 2, 3)]
    assert {node.namespace for node in started[1:]} == set(spaces)
    assert len(started) == 1 + 3 * 6
    text = "".join(path.read_text() for path in started[0].files(tmp_path))
    assert all(space in text for space in spaces)
    for i, space in enumerate(spaces):
        own = {node.name: node for node in started if node.namespace == space}
        plant = "".join(path.read_text() for path in own["plant"].files(tmp_path))
        assert f"seed: {seed_of(7, i)}\n" in plant and "clock: world\n" in plant
        recorder = "".join(path.read_text() for path in own["recorder"].files(tmp_path))
        assert f"bag: my_bags/heli{i + 1}\n" in recorder


def test_the_last_flight_ends_the_launch(launch):
    for node in launch(*HOVER, "aircraft:=2"):
        assert node.ended(0) == (None if node.name == "plant" else 0)
        assert node.ended(1) == 1


@pytest.mark.parametrize("arguments", [["aircraft:=0"], ["aircraft:=two"], ["aircraft:=99"],
                                       ["aircraft:=2", "live:=true"]])  # fmt: skip
def test_what_does_not_go_starts_nothing(launch, arguments):
    with pytest.raises(ValueError, match="aircraft:="):
        launch(*HOVER, *arguments)


def test_two_fly_side_by_side_by_one_clock(launch, tmp_path, ros_env, living):
    """Each flies the flight of its seed, as if alone; the clock goes tick by tick to the end."""
    bags = tmp_path / "bags"
    arguments = ["aircraft:=2", f"duration:={LENGTH_S}", f"bag:={bags}", "seed:=3"]
    started = launch(*HOVER, *arguments)
    with contextlib.ExitStack() as ending:
        processes = {}
        for node in started:
            label = node.full_name.replace("/", "_")
            folder = tmp_path / label
            folder.mkdir()
            log = ending.enter_context(open(tmp_path / f"{label}.log", "wb"))
            processes[node.full_name] = subprocess.Popen(
                node.command(folder), env=ros_env, stdout=log, stderr=subprocess.STDOUT
            )
            ending.callback(processes[node.full_name].terminate)
        code = processes["/world_clock"].wait(timeout=240)
    assert living() == []
    said = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    assert code == 0, said
    assert "going on" not in said
    tracks = []
    for i in (1, 2):
        bag = read_bag(bags / f"heli{i}")
        truth = bag.streams[topics.TRUTH_ODOM]
        expected = NS_PER_S + TICK_NS * np.arange(LENGTH_S * NS_PER_S // TICK_NS)
        assert np.array_equal(truth.stamp_ns, expected)
        alone = simulate(resolve("hover", seed=seed_of(3, i - 1), duration_s=float(LENGTH_S)))
        tracks.append(truth.rows[:, PLANT.pos])
        assert np.abs(tracks[-1] - alone.record.truth_pos_ned_m).max() < 1e-6
    assert np.abs(tracks[0] - tracks[1]).max() > 1e-3
