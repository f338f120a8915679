# SPDX-License-Identifier: Apache-2.0
"""Where no ROS is installed all but the graph works: the wheel brings none (scripts/release.py)."""

import os
import subprocess
import sys

import pytest

_PACKAGES = (
    "rclpy rpyutils ament_index_python action_msgs builtin_interfaces diagnostic_msgs "
    "geometry_msgs lifecycle_msgs nav_msgs rcl_interfaces rosgraph_msgs sensor_msgs std_msgs "
    "std_srvs tf2_msgs trajectory_msgs visualization_msgs"
)
_WITHOUT = f"""
import sys
sys.modules.update(dict.fromkeys({_PACKAGES!r}.split()))
"""
FLY = """
from heli_flight.cli import app
sys.exit(app.main(sys.argv[1:]))
"""
FACE = """
import heli
flight = heli.fly(seed=3, gps="rtk", duration_s=1.0, quiet=True)
assert not flight.lost and heli.__version__
print(heli.load(flight.save(sys.argv[1])).verdict)
"""


def run(code, *words):
    command = [sys.executable, "-c", _WITHOUT + code, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=dict(os.environ))


def test_a_script_flies(tmp_path):
    done = run(FACE, tmp_path / "flight")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ["hover", "--one-process", "--duration", "1"],
        ["list", "scenarios"],
        ["--version"],
        ["campaign", "--help"],
        ["design", "--help"],
    ],
)
def test_a_command_works(words, tmp_path):
    out = ["--out", tmp_path / "flight"] if words[0] == "hover" else []
    done = run(FLY, *words, *out)
    assert done.returncode == 0, done.stderr
    if out:
        assert run(FLY, "report", tmp_path / "flight").returncode == 0


@pytest.mark.parametrize("words", [["hover", "--duration", "1"], ["topics"], ["land"]])
def test_what_needs_the_graph_says_so_in_a_line(words):
    done = run(FLY, *words)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert "heli-hover[ros]" in line
