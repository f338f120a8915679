# SPDX-License-Identifier: Apache-2.0
"""Nodes started one by one, as `ros2 run` does: they configure and activate themselves and fly."""

import subprocess
import sys

from heli_flight.loop.layers import NODES
from heli_parameters.locate import executable


def test_nodes_started_alone_find_each_other_and_fly(tmp_path, ros_env, living):
    """A namespace moves the whole graph; the plant ends by itself when the flight is over."""
    arguments = ["--ros-args", "-r", "__ns:=/heli1"]
    others = [("heli_flight", "scenario")]
    others += [(n.package, n.executable) for n in NODES if n.name != "plant"]
    started = []
    for package, name in others:
        with open(tmp_path / f"{name}.log", "wb") as log:
            command = [sys.executable, str(executable(package, name)), *arguments]
            started.append(
                subprocess.Popen(command, env=ros_env, stdout=log, stderr=subprocess.STDOUT)
            )
    plant = subprocess.run(
        [sys.executable, str(executable("heli_dynamics_sim", "plant")), *arguments,
         "-p", "duration_s:=3.0"],
        env=ros_env, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    for process in started:
        process.terminate()
    codes = [process.wait(timeout=60.0) for process in started]
    logs = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    assert plant.returncode == 0, plant.stdout + plant.stderr + logs
    assert "flight over after 3 s" in plant.stdout + plant.stderr
    assert "no message" not in plant.stdout + plant.stderr
    assert "position is held" in (tmp_path / "outer_loop.log").read_text()
    assert codes == [0] * len(codes), logs
    assert living() == []
