# SPDX-License-Identifier: Apache-2.0
"""Nodes started one by one by `heli run`: they configure and activate themselves and fly."""

import re
import subprocess
import sys

import pytest

from heli_flight.flight_file import write_parameters
from heli_flight.settings import NODES, resolve
from heli_outer_pd.state import OuterStatus

RUN = [sys.executable, "-m", "heli_flight.cli.app", "run"]


@pytest.mark.parametrize(
    "navigation", [pytest.param("observer", marks=pytest.mark.slow), "navigator"]
)
def test_nodes_started_alone_find_each_other_and_fly(tmp_path, ros_env, living, navigation):
    """A namespace moves the whole graph; the plant ends by itself when the flight is over.

    They are given a flight's params.yaml: each takes its section, and passes the others over. One
    may have another name, by which the file speaks of it then.
    """
    params = tmp_path / "params.yaml"
    write_parameters(resolve(duration_s=3.0), params)
    text = params.read_text()
    assert text.count("/observer:\n") == 1
    params.write_text(text.replace("/observer:\n", f"/{navigation}:\n"))
    arguments = ["--ros-args", "-r", "__ns:=/heli1", "--params-file", str(params)]
    arguments += ["-r", f"observer:__node:={navigation}"]
    others = [("heli_flight", "scenario")]
    others += [(n.package, n.executable) for n in NODES if n.name != "plant"]
    started = []
    for package, name in others:
        with open(tmp_path / f"{name}.log", "wb") as log:
            command = [*RUN, package, name, *arguments]
            started.append(
                subprocess.Popen(command, env=ros_env, stdout=log, stderr=subprocess.STDOUT)
            )
    plant = subprocess.run(
        [*RUN, "heli_dynamics_sim", "plant", *arguments],
        env=ros_env, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    for process in started:
        process.terminate()
    codes = [process.wait(timeout=120) for process in started]
    logs = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    assert plant.returncode == 0, plant.stdout + plant.stderr + logs
    assert re.search(r"\bover\b.* 3 s\b", plant.stdout + plant.stderr)
    assert "no message" not in plant.stdout + plant.stderr
    assert OuterStatus.OK.sentence in (tmp_path / "outer_loop.log").read_text()
    assert f"[heli1.{navigation}]" in (tmp_path / "observer.log").read_text()
    assert codes == [0] * len(codes), logs
    assert living() == []
