# SPDX-License-Identifier: Apache-2.0
"""Several aircraft in one ROS domain: what the launch file starts, and two of them in flight."""

import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.loop import simulate
from heli_flight.settings import resolve, seed_of
from heli_flight.worlds import HOVER_TEST_WORLD
from heli_msgs_bridge import topics
from support.launched import flown

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
        nodes = {node.name: node for node in started if node.namespace == space}
        plant = "".join(path.read_text() for path in nodes["plant"].files(tmp_path))
        assert f"seed: {seed_of(7, i)}\n" in plant and "clock: world\n" in plant
        recorder = "".join(path.read_text() for path in nodes["recorder"].files(tmp_path))
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


def assert_flown_as_if_alone(bags, seeds):
    """Ground truth of each is that of one process, and has every tick."""
    tracks = []
    for bag, seed in zip(bags, seeds, strict=True):
        truth = read_bag(bag).streams[topics.TRUTH_ODOM]
        expected = NS_PER_S + TICK_NS * np.arange(LENGTH_S * NS_PER_S // TICK_NS)
        assert np.array_equal(truth.stamp_ns, expected)
        alone = simulate(
            resolve("hover", seed=seed, duration_s=float(LENGTH_S), world=HOVER_TEST_WORLD)
        )
        tracks.append(truth.rows[:, PLANT.pos])
        assert np.abs(tracks[-1] - alone.record.truth_pos_ned_m).max() < 1e-6
    assert np.abs(tracks[0] - tracks[1]).max() > 1e-3


@pytest.mark.slow
def test_two_fly_side_by_side_by_one_clock(launch, tmp_path, ros_env, living):
    """Each flies the flight of its seed, as if alone; the clock goes tick by tick to the end."""
    bags = tmp_path / "bags"
    arguments = ["aircraft:=2", f"duration:={LENGTH_S}", f"bag:={bags}", "seed:=3"]
    codes, printed = flown(launch(*HOVER, *arguments), tmp_path, ros_env, "/world_clock")
    assert living() == []
    assert codes == {0} and "going on" not in printed, printed
    assert_flown_as_if_alone([bags / "heli1", bags / "heli2"], [seed_of(3, 0), seed_of(3, 1)])


@pytest.mark.slow
def test_two_launches_by_hand_in_one_domain(launch, tmp_path, ros_env, living):
    """Under two namespaces, by one clock that is started for itself."""
    started, names = [], ("red", "blue")
    for seed, name in enumerate(names, 1):
        options = [f"namespace:={name}", "clock:=world", f"seed:={seed}", f"bag:={tmp_path / name}"]
        started += launch(*HOVER, f"duration:={LENGTH_S}", *options)
    clock = [sys.executable, "-m", "heli_flight.graph.world_clock_node", "--ros-args"]
    with subprocess.Popen([*clock, "-p", "aircraft:=[red, blue]"], env=ros_env) as world:
        codes, printed = flown(started, tmp_path, ros_env, "/red/plant", "/blue/plant")
        assert world.wait(timeout=120) == 0
    assert living() == []
    assert codes == {0} and "going on" not in printed, printed
    assert_flown_as_if_alone([tmp_path / name for name in names], [1, 2])
