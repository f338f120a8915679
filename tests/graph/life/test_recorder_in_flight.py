# SPDX-License-Identifier: Apache-2.0
"""The recorder's whole life while a flight goes on: it answers, and every bag opens."""

import os
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics

FLYING = ("scenario", "outer_loop", "inner_loop", "observer", "plant")
CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = 1, 2, 3, 4


@pytest.fixture
def recorder(own_domain, tmp_path):
    """A recorder's process, which waits to be told what to do."""
    env = dict(os.environ, ROS_DOMAIN_ID=str(own_domain))
    command = [sys.executable, "-m", "heli_bags.node", "--ros-args", "-p", "autostart:=false"]
    command += ["-p", f"bag:={tmp_path}/bag", "-p", "peers:=[plant]"]
    process = subprocess.Popen(
        command, env=env | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    yield process
    process.kill()
    process.communicate()


@pytest.mark.slow
def test_paused_cleaned_up_and_ended_in_flight(crew, recorder, tmp_path):
    """The flight does not cease for it; what was sent before a deactivation is in the bag."""
    ours = crew(*FLYING, lockstep=False, duration_s=600.0, peer_timeout_s=30.0)
    ours.bring_up()
    plant = ours.nodes["plant"]
    for bag in ("bag", "bag_2"):
        for number in (CONFIGURE, ACTIVATE):
            assert ours.change("recorder", number)
        for _ in range(2):
            ours.fly(30)
            before = plant.tick
            assert ours.change("recorder", DEACTIVATE)
            assert ours.change("recorder", ACTIVATE)
        assert ours.change("recorder", DEACTIVATE)
        assert ours.change("recorder", CLEANUP)
        imu = read_bag(tmp_path / bag).streams[topics.IMU]
        ticks = (imu.stamp_ns - plant.start_ns) // TICK_NS
        assert ticks[-1] >= before
        np.testing.assert_array_equal(np.diff(ticks), 1)
    for number in (CONFIGURE, ACTIVATE):
        assert ours.change("recorder", number)
    ours.fly(20)
    assert ours.change("recorder", 7), "told to shut down, it answers and ends"
    out, _ = recorder.communicate(timeout=120)
    assert recorder.returncode == 0, out
    assert "gaps" not in out and "failed" not in out, out
    assert len(read_bag(tmp_path / "bag_3").streams[topics.IMU].stamp_ns) >= 20
