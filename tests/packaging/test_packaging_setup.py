# SPDX-License-Identifier: Apache-2.0
"""scripts/setup_env.sh: what it leaves behind, what it redoes, what ROS that is sourced changes."""

import os
import re
import signal
import socket
import subprocess

import pytest

# What run_tests.sh asks Python for with -m; the import contracts are asked for with -c.
CHECKS = ["ruff", "ruff", "mypy", "pytest"]


UV_AT_WORK = """#!/usr/bin/env bash
case "$1" in pip) exec 3<>"/dev/tcp/127.0.0.1/$PORT"; read -r -u 3 ;; esac
"""


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at_work", ["pip", "uv"])
def test_interrupted_setup_leaves_nothing(checkout, signal_number, at_work):
    with socket.create_server(("127.0.0.1", 0)) as index:
        index.settimeout(checkout.limit_s)
        port = str(index.getsockname()[1])
        url = f"http://127.0.0.1:{port}/simple"
        if at_work == "uv":
            checkout.add_command("uv", UV_AT_WORK)
        setup = subprocess.Popen(
            [checkout.top / "hover_test.sh"],
            env=checkout.environment(PYTHON=checkout.base_python, PIP_INDEX_URL=url, PORT=port),
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # A test run started with `&` ignores SIGINT, and so would what it starts.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        connection, _ = index.accept()  # pip or uv is at work and waits for an answer
        with connection:
            os.kill(setup.pid, signal_number)
            _, errors = setup.communicate(timeout=checkout.limit_s)
            connection.settimeout(checkout.limit_s)
            while connection.recv(65536):  # ends when pip or uv is gone
                continue
    assert setup.returncode == 128 + signal_number
    assert errors.splitlines()[1:] == ["interrupted"] * (signal_number == signal.SIGINT)
    left = {path.name for path in checkout.top.glob(".venv*")} | {
        path.name for path in checkout.top.parent.glob("heli_setup*")
    }
    assert left == {".venv.lock"}


def test_foreign_folder_is_refused_and_untouched(checkout):
    checkout.add_python()
    mine = checkout.top / ".venv" / "mine.txt"
    mine.parent.mkdir()
    mine.write_text("keep")
    checkout.one_line_error(checkout.start(), ".venv exists but was not made by this set-up")
    assert mine.read_text() == "keep"


def test_killed_setup_is_made_anew(checkout):
    checkout.add_python()
    half = checkout.top / ".venv"
    (half / "bin").mkdir(parents=True)
    (half / "heli_made_here").touch()  # written first; the stamp, written last, is missing
    (half / "bin" / "python").touch(mode=0o755)
    (half / "half.txt").touch()
    assert checkout.start().returncode == 0
    assert not (half / "half.txt").exists()
    assert (half / "heli_stamp").exists()


def test_two_starts_at_once_set_up_once(checkout):
    checkout.add_python()
    command, settings = [checkout.top / "hover_test.sh"], checkout.environment()
    both = [subprocess.Popen(command, env=settings, stderr=subprocess.DEVNULL) for _ in range(2)]
    assert [process.wait(checkout.limit_s) for process in both] == [0, 0]
    assert sum(line.startswith("-m venv") for line in checkout.calls()) == 1


def test_set_up_says_what_its_time_went_on(checkout):
    checkout.add_python()
    last = checkout.start().stderr.splitlines()[-1]
    parts = ", ".join(rf"{part} \d+ s" for part in ("environment", "uv", "wheels", "packages"))
    match = re.fullmatch(rf"Set up in (\d+) s: {parts}, kernels \d+ s\.", last)
    assert match, last
    assert int(match.group(1)) == sum(int(n) for n in re.findall(r"(\d+) s[,.]", last))
    assert checkout.start().stderr == ""


@pytest.mark.parametrize("script", ["hover_test.sh", "linked", "relative"])
def test_a_start_with_nothing_to_set_up_starts_no_other_process(checkout, script):
    """A signal while a pipe is forked makes bash lose the child or run its trap twice."""
    python = checkout.add_python()
    assert checkout.start().returncode == 0
    linked = script == "linked"
    needed = {"bash", "env", python.name, *["readlink"][:linked]}
    for tool in python.parent.iterdir():
        if tool.name not in needed:
            tool.unlink()
    if linked:
        (checkout.top / script).symlink_to("hover_test.sh")
    name = script if linked else "hover_test.sh"
    command = ["bash", name] if script == "relative" else [checkout.top / name]
    result = subprocess.run(
        command, cwd=checkout.top, env=checkout.environment(), capture_output=True, text=True
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert checkout.calls()[-1] == "-m heli_flight.start hover_test"


def test_steps_are_done_once(checkout):
    checkout.add_python()
    warm_up = checkout.top / "src/heli_flight/heli_flight/graph/warm_up.py"
    warm_up.parent.mkdir(parents=True)
    warm_up.touch()
    assert checkout.start().returncode == 0
    asked = checkout.calls()
    assert asked[0] == f"-m venv --without-pip {checkout.top}/.venv"
    hashed = f"--no-deps --require-hashes -r {checkout.top}/requirements/hashes"
    assert asked[1].startswith("-m pip install") and f"{hashed}/uv.txt" in asked[1]
    assert asked[2].startswith(
        f"{checkout.top}/scripts/uv_install.py {checkout.top}/.venv/heli_uv/bin/uv"
    )
    assert asked[2].endswith(f"{hashed}/flight.txt")
    assert asked[3] == f"{checkout.top}/scripts/link_ros_layout.py"
    assert asked[4:] == ["-m heli_flight.graph.warm_up", "-m heli_flight.start hover_test"]
    assert checkout.start().returncode == 0
    assert checkout.calls() == ["-m heli_flight.start hover_test"]


def test_new_executable_is_linked_without_a_new_environment(checkout):
    checkout.add_python()
    checkout.start()
    checkout.calls()
    scripts = checkout.top / "src/heli_observer/scripts"
    scripts.mkdir()
    (scripts / "another").touch()
    checkout.start()
    assert checkout.kinds_of_calls() == ["links", "flight"]


def test_changed_pins_make_a_new_environment(checkout):
    checkout.add_python()
    checkout.start()
    (checkout.top / ".venv" / "old.txt").touch()
    checkout.calls()
    with open(checkout.top / "requirements/constraints.txt", "a") as pins:
        pins.write("# changed\n")
    checkout.start()
    assert checkout.calls()[0].startswith("-m venv")
    assert not (checkout.top / ".venv" / "old.txt").exists()


def test_tests_add_their_tools_once(checkout):
    checkout.add_python()
    checkout.start()
    checkout.calls()
    assert checkout.start("run_tests.sh").returncode == 0
    asked = checkout.calls()
    assert "/.venv/heli_uv/bin/uv --python" in asked[0]
    hashed = f"--no-deps --require-hashes -r {checkout.top}/requirements/hashes"
    assert asked[0].endswith(f"{hashed}/test.txt")
    assert [line.split()[1] for line in asked[1:]] == CHECKS
    checkout.start("run_tests.sh")
    assert [line.split()[1] for line in checkout.calls()] == CHECKS


def test_sourced_jazzy_without_rclpy(checkout):
    checkout.add_python()
    result = checkout.start(ROS_DISTRO="jazzy", RCLPY_MISSING="1")
    checkout.one_line_error(result, "ROS_DISTRO=jazzy", "rclpy", "setup.bash")


def test_sourced_jazzy_without_colcon(checkout):
    checkout.add_python()
    checkout.one_line_error(checkout.start(ROS_DISTRO="jazzy"), "colcon not found")


def test_sourced_jazzy_builds_with_colcon(checkout):
    checkout.add_python()
    colcon = (
        '#!/usr/bin/env bash\necho "colcon $*" >>"$CALLS"\n'
        "mkdir -p install && echo 'export WORKSPACE=sourced' >install/local_setup.bash\n"
    )
    checkout.add_command("colcon", colcon)
    assert checkout.start(ROS_DISTRO="jazzy").returncode == 0
    asked = checkout.calls()
    assert "--system-site-packages" in asked[0] and ".venv-ros" in asked[0]
    assert "ros.txt" not in asked[1]
    assert asked[1].startswith("-m pip install")  # uv does not see the system's packages
    command = "colcon build --symlink-install --base-paths src"
    assert asked[2] == f"{command} --packages-ignore heli_interfaces"
    assert not (checkout.top / ".venv").exists()
    checkout.start(ROS_DISTRO="jazzy")
    assert checkout.kinds_of_calls() == ["flight"]
    # Interfaces are built as soon as there are generators and a compiler.
    prefix = checkout.top.parent / "ros"
    (prefix / "share/rosidl_default_generators").mkdir(parents=True)
    environment = {"ROS_DISTRO": "jazzy", "AMENT_PREFIX_PATH": f"/nowhere:{prefix}"}
    checkout.start(**environment)
    assert checkout.kinds_of_calls() == ["flight"]
    checkout.add_command("c++", "#!/usr/bin/env bash\n")
    checkout.start(**environment)
    assert checkout.calls()[0] == command
    checkout.start("run_tests.sh", **environment)
    assert "ros_test.txt" not in checkout.calls()[0]


def test_other_ros_is_kept_out(checkout):
    checkout.add_python('env | grep -E "^(ROS_DISTRO|PYTHONPATH|_ROS_WHEELS|AMENT)" || true\n')
    foreign = {
        "ROS_DISTRO": "humble",
        "PYTHONPATH": "/opt/ros/humble/lib",
        "AMENT_PREFIX_PATH": "/opt/ros/humble",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }
    checkout.start(**foreign)
    result = checkout.start(**foreign)
    assert result.stdout.split() == [f"AMENT_PREFIX_PATH={checkout.top}/.venv"]
