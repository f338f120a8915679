# SPDX-License-Identifier: Apache-2.0
"""Upstream's launch runs our launch files, where it is installed (it is no wheel)."""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    find_spec("launch") is None or find_spec("launch_ros") is None,
    reason="needs launch and launch_ros of a ROS 2 installation",
)
# What `ros2 launch PACKAGE FILE ARGUMENT...` does.
LAUNCH = """
import sys
from pathlib import Path
from ament_index_python.packages import get_package_share_directory
import launch
package, name, *arguments = sys.argv[1:]
path = Path(get_package_share_directory(package)) / "launch" / name
source = launch.launch_description_sources.AnyLaunchDescriptionSource(str(path))
pairs = [argument.split(":=", 1) for argument in arguments]
service = launch.LaunchService(argv=arguments, noninteractive=True)
service.include_launch_description(launch.LaunchDescription([
    launch.actions.IncludeLaunchDescription(source, launch_arguments=pairs),
]))
sys.exit(service.run())
"""


@pytest.fixture
def ros2_launch(ros_env, tmp_path, living):
    # The executables begin with `env python3`.
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"

    def run(*words):
        done = subprocess.run(
            [sys.executable, "-c", LAUNCH, *words], cwd=tmp_path, capture_output=True, text=True,
            env=ros_env | {"ROS_LOG_DIR": str(tmp_path / "log"), "PATH": path}, timeout=240,
        )  # fmt: skip
        assert living() == []
        return done.returncode, done.stdout + done.stderr

    return run


def test_a_flight_ends_the_launch_with_0(ros2_launch, tmp_path):
    code, printed = ros2_launch("heli_flight", "hover.launch.py", "duration:=2", "namespace:=heli1")
    assert code == 0, printed
    assert re.search(r"\bover\b.* 2 s\b", printed)
    assert list(tmp_path.glob("bags/*/metadata.yaml"))


def test_a_node_that_fails_ends_the_launch_with_1(ros2_launch, tmp_path):
    file = tmp_path / "bad.yaml"
    file.write_text("/**/inner_loop:\n  ros__parameters:\n    gamma: 0.03\n")
    code, printed = ros2_launch("heli_flight", "hover.launch.py", f"params_file:={file}")
    assert code == 1, printed
    assert re.search(r"inner_loop-.*exit code 2\b", printed)


@pytest.mark.parametrize("argument", ["seed:=x", "duration:=0", "params_file:=/nowhere.yaml"])
def test_a_bad_argument_starts_nothing(ros2_launch, argument):
    code, printed = ros2_launch("heli_flight", "hover.launch.py", argument)
    assert code == 1 and argument in printed
    assert "process started" not in printed
