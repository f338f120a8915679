# SPDX-License-Identifier: Apache-2.0
"""A keyboard takes off, clients fly by attitude and by velocities, and land: with `heli joy`."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from heli_core.rotations import euler_angles
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_MODE

HELI = [sys.executable, "-m", "heli_flight.cli.app"]
# On loaded cores a pilot is seconds late, at ten times the wall clock's pace: time enough is given.
FLIGHT = [
    *HELI, "hover", "--scenario", "by_hand", "--world", "paper", "--gps", "rtk", "--seed", "5",
    "--duration", "200", "--no-report",
]  # fmt: skip
LOW = """/**/outer_loop:
  ros__parameters:
    takeoff: {height_m: 6.0}
    land: {slow_below_m: 1.5}
"""
ATTEMPTS = 3
"""A pilot that the machine stops for 0.15 s misses the two seconds of flight of one lean."""
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def wait_for_mode(env, until, goes_on):
    """Until a mode of the outer loop satisfies `until`, which is asked of each; or all is over."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(env["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("watcher", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    ended = []

    def look(message):
        for status in message.status:
            mode = {pair.key: pair.value for pair in status.values}.get(FACT_MODE)
            if status.name == "outer_loop" and mode is not None and until(mode):
                ended.append(mode)

    kind = topics.message_class(topics.BY_NAME[topics.DIAGNOSTICS].type)
    node.create_subscription(kind, topics.DIAGNOSTICS, look, topics.qos(topics.DIAGNOSTICS))
    while not ended and goes_on():
        executor.spin_once(1.0)
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def fly_by_hand(ros_env, folder):
    """A flight with its three pilots; its record, once it is known that all did their part."""
    typist, terminal = pty.openpty()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "env": ros_env}
    keys = subprocess.Popen([*HELI, "joy", "--keyboard"], stdin=terminal, **pipes)
    # It says which keys there are as soon as it sends.
    assert "climb" in keys.stdout.readline()
    leans = [sys.executable, str(EXAMPLES / "attitude.py"), "6", "2", "0.5"]
    moves = [sys.executable, str(EXAMPLES / "velocity.py"), "6", "4", "1.5"]
    clients = [subprocess.Popen(leans, **pipes)]
    low = folder.with_suffix(".yaml")
    low.write_text(LOW)
    flight = subprocess.Popen([*FLIGHT, "--params", str(low), "--out", str(folder)], **pipes)

    def goes_on():
        return all(process.poll() is None for process in (flight, keys, *clients))

    def take_off(mode):
        if mode == "standing":
            os.write(typist, b"t")
        return mode != "standing"

    try:
        wait_for_mode(ros_env, take_off, goes_on)
        os.write(typist, b"q")
        held, _ = clients[0].communicate(timeout=200)
        clients.append(subprocess.Popen(moves, **pipes))
        printed, _ = clients[1].communicate(timeout=200)
        flown, _ = flight.communicate(timeout=200)
        keys.communicate(timeout=120)
    finally:
        for process in (flight, keys, *clients):
            process.kill()
        os.close(typist)
        os.close(terminal)
    assert [process.returncode for process in (*clients, keys)] == [0, 0, 0], held + printed
    assert held.startswith("hold: to ")
    assert printed.startswith("land: comes to rest")
    # Steered at once after the climb, its height is not judged, and so the flight is not inside.
    assert flight.returncode in (0, 1), flown
    settings = resolve("by_hand", gps="rtk", seed=5, duration_s=200.0)
    return flight_from_bag(folder / "bag", settings).record


def leans_of(record):
    """Range of roll, deg, and fastest climb, m/s, while the attitude was commanded."""
    leant = np.flatnonzero(record.mode == "attitude")
    roll = np.degrees(euler_angles(record.truth_q_nb[leant])[:, 0])
    return roll.max() - roll.min(), -record.truth_vel_ned_mps[leant, 2].min()


@pytest.mark.slow
def test_a_keyboard_takes_off_and_clients_fly_by_attitude_and_velocities(ros_env, tmp_path):
    for attempt in range(ATTEMPTS):
        folder = tmp_path / f"f{attempt}"
        record = fly_by_hand(ros_env, folder)
        ground = json.loads((folder / "result.json").read_text())["ground"]
        inside = {figure["key"]: figure["inside"] for figure in ground}
        del inside["takeoff_height"]
        assert len(inside) == 4 and all(inside.values()), inside
        begun = np.flatnonzero(np.r_[True, record.mode[1:] != record.mode[:-1]])
        modes = record.mode[begun].tolist()
        assert [modes[0], modes[1], *modes[-2:]] == ["standing", "takeoff", "land", "standing"]
        assert modes.index("attitude") < modes.index("velocity")
        rolled_deg, climbed_mps = leans_of(record)
        if rolled_deg > 9.0:
            break
    assert rolled_deg > 9.0, "6 deg to either side"
    assert climbed_mps > 0.4
    north, east, _ = record.truth_pos_ned_m[-1]
    assert np.hypot(east - 6.0, north - 4.0) < 2.0
