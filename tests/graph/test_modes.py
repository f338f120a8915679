# SPDX-License-Identifier: Apache-2.0
"""Modes are life-cycle states, switched in the air: hover -> attitude held -> hover."""

import os
import subprocess
import sys

import pytest

# In a process of its own: the ROS domain is read once per process.
FLIGHT = """
import sys
from pathlib import Path
import numpy as np
from lifecycle_msgs.msg import Transition
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.graph.flight import Graph
from heli_flight.settings import resolve

settings = resolve(gps="rtk", seed=3, duration_s=600.0, mode="real time")
graph = Graph(settings, Path(sys.argv[1]))
try:
    graph.start()
    graph.bring_up()
    up = graph.supervisor

    def flown_s():
        status = up.statuses.get("plant")
        return float(status.facts.get("flown_s", 0.0)) if status else 0.0

    def fly_to(limit_s):
        assert up.wait_until(lambda: flown_s() >= limit_s, 60.0, graph.check)
        assert up.statuses["plant"].level == 0, up.statuses["plant"]

    fly_to(4.0)
    up.transition(["outer_loop"], Transition.TRANSITION_DEACTIVATE, 10.0, graph.check)
    fly_to(7.0)
    up.transition(["outer_loop"], Transition.TRANSITION_ACTIVATE, 10.0, graph.check)
    fly_to(14.0)
finally:
    graph.close()
flight = flight_from_bag(Path(sys.argv[1]) / "bag", settings)
record = getattr(flight, "record", flight)
q = record.truth_q_nb
tilt = np.degrees(np.arccos(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2)))
print("tilt", tilt.max(), "end", np.abs(record.truth_pos_ned_m[-1] - [0, 0, -10]).max())
assert tilt.max() < 30.0, "the position loop flies back banked by about 20 deg"
held = (record.time_s > 4.5) & (record.time_s < 6.5)
assert np.ptp(record.setpoint[held], axis=0).max() < 1e-9, "no setpoint while attitude is held"
assert np.abs(record.truth_pos_ned_m[-1] - [0, 0, -10]).max() < 1.0
"""


@pytest.mark.nightly
@pytest.mark.timeout(760)
def test_outer_loop_leaves_and_comes_back_in_flight(tmp_path, ros_env, living):
    """In one real-time flight of three: others may hold the processor while it flies back."""
    for name in "abc":
        folder = tmp_path / name
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", FLIGHT, str(folder)],
            env=os.environ | ros_env,
            capture_output=True,
            text=True,
            timeout=240,
        )
        assert living() == []
        if done.returncode == 0:
            return
    pytest.fail(done.stdout + done.stderr)
