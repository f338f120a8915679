# SPDX-License-Identifier: Apache-2.0
"""The commands of a pilot, flown; a mode of a script, to its end, and one that falls silent."""

import math
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy

from heli_actions import Pilot

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/foreign_mode.py"
FLIGHT = [
    sys.executable, "-m", "heli_flight.cli.app", "hover", "--scenario", "by_hand", "--world",
    "paper", "--gps", "rtk", "--seed", "5", "--no-report", "--duration", "3000",
    "--realtime",
]  # fmt: skip
LIMIT_S = 280.0


@pytest.fixture
def watcher(ros_env, tmp_path):
    """A flight that waits on the ground, and a pilot that looks on."""
    flight = subprocess.Popen(
        [*FLIGHT, "--out", str(tmp_path / "f")], env=ros_env, stdout=subprocess.DEVNULL
    )
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(ros_env["ROS_DOMAIN_ID"]))
    try:
        with Pilot(context=context, actions=False, wait_s=LIMIT_S) as pilot:
            yield pilot
    finally:
        context.try_shutdown()
        flight.send_signal(signal.SIGINT)
        flight.communicate(timeout=LIMIT_S)


# By the wall clock: on cores that are late by more than the vertical loop bears, the collective
# comes to its limit and the mode is left, as it should be.
@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_a_circle_is_flown_and_a_process_that_dies_is_followed_by_a_hover(ros_env, watcher):
    command = [sys.executable, str(EXAMPLE), "6", "2"]
    done = subprocess.run(command, env=ros_env, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1:] == ["circle: done", "land: done, mode standing"]
    client = subprocess.Popen(command, env=ros_env, stdout=subprocess.DEVNULL)
    try:
        while watcher.status.mode != "velocity":
            assert client.poll() is None
    finally:
        client.kill()
        client.wait()
    while (mode := watcher.status.mode) != "hover":
        assert mode == "velocity"
    assert not watcher.status.landed
    watcher.land()
    assert watcher.status.landed


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_commands_fly_from_the_ground_to_the_ground(ros_env, watcher):
    place = ["28.17005414", "112.93009164", "62"]  # 9 m east, 6 m north, 12 m up
    for words, said in (
        (["takeoff", "6"], "takeoff: done, mode hover"),
        (["goto", "--gps", *place, "--heading", "90"], "goto: there, "),
        (["mode", "hover"], "hold: to "),
        (["land"], "land: done, mode standing"),
    ):
        command = [sys.executable, "-m", "heli_flight.cli.app", *words]
        done = subprocess.run(command, env=ros_env, capture_output=True, text=True, timeout=LIMIT_S)
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(said)
    east, north, _ = watcher.pos_enu_m
    assert math.hypot(east - 9.0, north - 6.0) < 1.0
