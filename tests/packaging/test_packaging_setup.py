# SPDX-License-Identifier: Apache-2.0
"""scripts/setup_env.sh: what it says when it cannot work, what it leaves behind, what it redoes."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

# What run_tests.sh asks Python for with -m; the import contracts are asked for with -c.
CHECKS = ["ruff", "ruff", "mypy", "pytest"]
ROOT = Path(__file__).resolve().parents[2]
TOOLS = (
    "bash cat chmod cp cut dirname env flock grep mkdir mktemp mv readlink rm rmdir "
    "sha256sum sort tail true"
).split()
LINE_LIMIT_S = 150

# Answers like a Python that works, and writes down what it was asked to do.
RECORDING_PYTHON = """#!/usr/bin/env bash
first_line="${*%%$'\\n'*}"
echo "$first_line" >>"$CALLS"
case "$first_line" in
    "-c import sys") echo 3.11 ;;
    "-c import rclpy") exit "${RCLPY_MISSING:-0}" ;;
    "-m venv "*) mkdir -p "${!#}/bin"; cp "$0" "${!#}/bin/python" ;;
    "-m pip --version") exit "${PIP_MISSING:-0}" ;;
    "-m pip "*" --target "*" uv")
        [ -z "${UV_MISSING:-}" ] || { echo "ERROR: No matching distribution: uv"; exit 1; }
        uv=${*: -2:1}/bin/uv; mkdir -p "${uv%/uv}"; : >"$uv"; chmod +x "$uv" ;;
    "-m pip "*) exit "${PIP_FAILS:-0}" ;;
    */uv_install.py*) [ -z "${UV_FAILS:-}" ] || { echo "$UV_FAILS"; exit 1; } ;;
esac
"""


@pytest.fixture
def checkout(tmp_path):
    """A copy of what set-up reads, with an empty home and a PATH that holds no Python."""
    top = tmp_path / "checkout"
    for name in ("scripts", "requirements"):
        shutil.copytree(ROOT / name, top / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("hover_test.sh", "run_tests.sh"):
        shutil.copy2(ROOT / name, top / name)
    for manifest in (ROOT / "src").glob("*/package.xml"):
        package = top / "src" / manifest.parent.name
        package.mkdir(parents=True)
        shutil.copy2(manifest, package)
        shutil.copy2(manifest.with_name("setup.py"), package)
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    for tool in TOOLS:
        (bin_folder / tool).symlink_to(shutil.which(tool))
    return top


def add_command(checkout: Path, name: str, text: str) -> Path:
    command = checkout.parent / "bin" / name
    command.write_text(text)
    command.chmod(0o755)
    return command


def environment(checkout: Path, **extra: str) -> dict[str, str]:
    folders = {"HOME": str(checkout.parent), "TMPDIR": str(checkout.parent)}
    return {
        "PATH": str(checkout.parent / "bin"),
        "CALLS": str(checkout.parent / "calls"),
        "PIP_CONFIG_FILE": os.devnull,
        **folders,
        **extra,
    }


def start(checkout: Path, script: str = "hover_test.sh", **extra: str):
    return subprocess.run(
        [checkout / script],
        env=environment(checkout, **extra),
        capture_output=True,
        text=True,
        timeout=LINE_LIMIT_S,
        stdin=subprocess.DEVNULL,
    )


def calls(checkout: Path) -> list[str]:
    """What the recording Python was asked to do since the last look."""
    log = checkout.parent / "calls"
    lines = log.read_text().splitlines() if log.exists() else []
    log.unlink(missing_ok=True)
    return [line for line in lines if not line.startswith(("-c", "-m pip --version"))]


def kinds(asked: list[str]) -> list[str]:
    """What each call was about, in a word."""
    words = {
        "-m venv": "venv",
        "--target": "uv from pip",
        "uv_install.py": "uv",
        "-m ensurepip": "ensurepip",
        "-m pip": "pip",
        "link_ros_layout.py": "links",
        "graph.warm_up": "kernels",
        "heli_flight.start": "flight",
    }
    return [next((k for word, k in words.items() if word in line), line) for line in asked]


def assert_one_line_error(result, *words: str) -> None:
    assert result.returncode == 2, result.stderr
    told = ("Setting up ", "uv cannot do it ")
    errors = [line for line in result.stderr.splitlines() if not line.startswith(told)]
    assert len(errors) == 1, result.stderr
    assert errors[0].startswith("error: ")
    for word in words:
        assert word in errors[0]


def base_python() -> str:
    """An interpreter that is not itself an environment with ROS's start-up hook."""
    return os.path.realpath(sys.executable)


def test_no_python(checkout):
    assert_one_line_error(start(checkout), "no Python 3.11 or newer", "PYTHON=")
    assert not (checkout / ".venv").exists()


def test_python_too_old(checkout):
    add_command(checkout, "python3", "#!/usr/bin/env bash\nexit 3\n")
    assert_one_line_error(start(checkout), "no Python 3.11 or newer")


def test_chosen_python_missing_is_not_replaced(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    result = start(checkout, PYTHON="/nowhere/python3.12")
    assert_one_line_error(result, "no Python 3.11 or newer", "/nowhere/python3.12")
    assert calls(checkout) == []


def test_no_venv_module(checkout):
    blocked = checkout.parent / "blocked"
    blocked.mkdir()
    (blocked / "ensurepip.py").write_text(
        "raise ImportError('as on Debian without python3-venv')\n"
    )
    wrapper = f'#!/usr/bin/env bash\nPYTHONPATH={blocked} exec {base_python()} "$@"\n'
    python = add_command(checkout, "python3", wrapper)
    assert_one_line_error(start(checkout), "no venv module", str(python), "python3-venv")
    assert not (checkout / ".venv").exists()


def test_python_without_venv_is_passed_over(checkout):
    add_command(checkout, "python3.13", "#!/usr/bin/env bash\nexit 4\n")
    add_command(checkout, "python3.11", RECORDING_PYTHON)
    assert start(checkout).returncode == 0


def test_no_network(checkout):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # nobody listens: connections are refused
        index = f"http://127.0.0.1:{closed.getsockname()[1]}/simple"
        result = start(checkout, PYTHON=base_python(), PIP_INDEX_URL=index)
    assert_one_line_error(result, "package index cannot be reached", "no network")
    assert not (checkout / ".venv").exists()


UV_AT_WORK = """#!/usr/bin/env bash
case "$1" in pip) exec 3<>"/dev/tcp/127.0.0.1/$PORT"; read -r -u 3 ;; esac
"""


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at_work", ["pip", "uv"])
def test_interrupted_setup_leaves_nothing(checkout, signal_number, at_work):
    with socket.create_server(("127.0.0.1", 0)) as index:
        index.settimeout(LINE_LIMIT_S)
        port = str(index.getsockname()[1])
        url = f"http://127.0.0.1:{port}/simple"
        if at_work == "uv":
            add_command(checkout, "uv", UV_AT_WORK)
        setup = subprocess.Popen(
            [checkout / "hover_test.sh"],
            env=environment(checkout, PYTHON=base_python(), PIP_INDEX_URL=url, PORT=port),
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # A test run started with `&` ignores SIGINT, and so would what it starts.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        connection, _ = index.accept()  # pip or uv is at work and waits for an answer
        with connection:
            os.kill(setup.pid, signal_number)
            _, told = setup.communicate(timeout=LINE_LIMIT_S)
            connection.settimeout(LINE_LIMIT_S)
            while connection.recv(65536):  # ends when pip or uv is gone
                continue
    assert setup.returncode == 128 + signal_number
    assert told.splitlines()[1:] == ["interrupted"] * (signal_number == signal.SIGINT)
    left = {path.name for path in checkout.glob(".venv*")} | {
        path.name for path in checkout.parent.glob("heli_setup*")
    }
    assert left == {".venv.lock"}


def test_foreign_folder_is_refused_and_untouched(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    mine = checkout / ".venv" / "mine.txt"
    mine.parent.mkdir()
    mine.write_text("keep")
    assert_one_line_error(start(checkout), ".venv exists but was not made by this set-up")
    assert mine.read_text() == "keep"


def test_killed_setup_is_made_anew(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    half = checkout / ".venv"
    (half / "bin").mkdir(parents=True)
    (half / "heli_made_here").touch()  # written first; the stamp, written last, is missing
    (half / "bin" / "python").touch(mode=0o755)
    (half / "half.txt").touch()
    assert start(checkout).returncode == 0
    assert not (half / "half.txt").exists()
    assert (half / "heli_stamp").exists()


def test_two_starts_at_once_set_up_once(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    command, settings = [checkout / "hover_test.sh"], environment(checkout)
    both = [subprocess.Popen(command, env=settings, stderr=subprocess.DEVNULL) for _ in range(2)]
    assert [process.wait(LINE_LIMIT_S) for process in both] == [0, 0]
    assert sum(line.startswith("-m venv") for line in calls(checkout)) == 1


def test_failure_of_uv_and_pip_is_one_line_and_is_redone(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    result = start(checkout, UV_FAILS="no such version", PIP_FAILS="1")
    assert_one_line_error(result, "pip")
    assert "uv cannot do it (no such version)" in result.stderr
    assert not (checkout / ".venv").exists()
    calls(checkout)
    assert start(checkout).returncode == 0
    assert kinds(calls(checkout))[:3] == ["venv", "uv from pip", "uv"]


def test_without_uv_on_the_index_pip_goes_on_and_says_so(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    result = start(checkout, UV_MISSING="1")
    assert result.returncode == 0
    assert "uv cannot do it (ERROR: No matching distribution: uv); going on with pip" in (
        result.stderr
    )
    assert kinds(calls(checkout))[:4] == ["venv", "uv from pip", "pip", "links"]


def test_without_network_pip_is_not_tried_as_well(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    result = start(checkout, UV_FAILS="error sending request for url")
    assert_one_line_error(result, "package index cannot be reached", "no network")
    assert "pip" not in kinds(calls(checkout))


def test_python_without_pip_gets_uv_by_the_environments_pip(checkout):
    """As Debian's python3 is without python3-pip."""
    add_command(checkout, "python3", RECORDING_PYTHON)
    assert start(checkout, PIP_MISSING="1").returncode == 0
    assert kinds(calls(checkout))[:4] == ["venv", "ensurepip", "uv from pip", "uv"]


def test_uv_on_the_path_is_used(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    uv = add_command(checkout, "uv", "#!/usr/bin/env bash\n")
    assert start(checkout).returncode == 0
    asked = calls(checkout)
    assert kinds(asked)[:3] == ["venv", "uv", "links"]
    assert f"uv_install.py {uv} --python {checkout}/.venv/bin/python " in asked[1]


def test_uv_that_does_not_run_is_passed_over(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    add_command(checkout, "uv", "#!/usr/bin/env bash\nexit 1\n")
    assert start(checkout).returncode == 0
    assert kinds(calls(checkout))[:3] == ["venv", "uv from pip", "uv"]


def test_set_up_says_what_its_time_went_on(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    last = start(checkout).stderr.splitlines()[-1]
    parts = ", ".join(rf"{part} \d+ s" for part in ("environment", "uv", "wheels", "packages"))
    match = re.fullmatch(rf"Set up in (\d+) s: {parts}, kernels \d+ s\.", last)
    assert match, last
    assert int(match.group(1)) == sum(int(n) for n in re.findall(r"(\d+) s[,.]", last))
    assert start(checkout).stderr == ""


def test_steps_are_done_once(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    warm_up = checkout / "src/heli_flight/heli_flight/graph/warm_up.py"
    warm_up.parent.mkdir(parents=True)
    warm_up.touch()
    assert start(checkout).returncode == 0
    asked = calls(checkout)
    assert asked[0] == f"-m venv --without-pip {checkout}/.venv"
    assert asked[1].startswith("-m pip install") and "constraints.txt" in asked[1]
    assert asked[2].startswith(f"{checkout}/scripts/uv_install.py {checkout}/.venv/heli_uv/bin/uv")
    assert asked[2].endswith("requirements/ros.txt pip") and "constraints.txt" in asked[2]
    assert asked[3] == f"{checkout}/scripts/link_ros_layout.py"
    assert asked[4:] == ["-m heli_flight.graph.warm_up", "-m heli_flight.start hover_test"]
    assert start(checkout).returncode == 0
    assert calls(checkout) == ["-m heli_flight.start hover_test"]


def test_new_executable_is_linked_without_a_new_environment(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    start(checkout)
    calls(checkout)
    scripts = checkout / "src/heli_observer/scripts"
    scripts.mkdir()
    (scripts / "another").touch()
    start(checkout)
    assert kinds(calls(checkout)) == ["links", "flight"]


def test_changed_pins_make_a_new_environment(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    start(checkout)
    (checkout / ".venv" / "old.txt").touch()
    calls(checkout)
    with open(checkout / "requirements/constraints.txt", "a") as pins:
        pins.write("# changed\n")
    start(checkout)
    assert calls(checkout)[0].startswith("-m venv")
    assert not (checkout / ".venv" / "old.txt").exists()


@pytest.fixture
def two_pythons(checkout):
    """The Python that set-up finds by itself, and one that only PYTHON= can name."""
    found = add_command(checkout, "python3", RECORDING_PYTHON)
    (checkout.parent / "elsewhere").mkdir()
    return found, shutil.copy2(found, checkout.parent / "elsewhere" / "python3")


def test_environment_of_a_chosen_python_stays_without_the_choice(checkout, two_pythons):
    _, chosen = two_pythons
    start(checkout, PYTHON=str(chosen))
    calls(checkout)
    for choice in ({}, {"PYTHON": str(chosen)}, {"PYTHON": ""}):
        assert start(checkout, **choice).returncode == 0
        assert kinds(calls(checkout)) == ["flight"]


def test_another_chosen_python_makes_another_environment(checkout, two_pythons):
    found, chosen = two_pythons
    for choice in (chosen, found):
        assert start(checkout, PYTHON=str(choice)).returncode == 0
        assert kinds(calls(checkout))[0] == "venv"
        assert (checkout / ".venv/heli_python").read_text() == f"{choice}\n"


def test_changed_pins_keep_the_chosen_python(checkout, two_pythons):
    _, chosen = two_pythons
    start(checkout, PYTHON=str(chosen))
    with open(checkout / "requirements/constraints.txt", "a") as pins:
        pins.write("# changed\n")
    assert start(checkout).returncode == 0
    assert kinds(calls(checkout)).count("venv") == 2
    assert (checkout / ".venv/heli_python").read_text() == f"{chosen}\n"


def test_chosen_python_that_is_gone_is_replaced(checkout, two_pythons):
    found, chosen = two_pythons
    start(checkout, PYTHON=str(chosen))
    chosen.unlink()
    (checkout / ".venv/bin/python").unlink()
    assert start(checkout).returncode == 0
    assert (checkout / ".venv/heli_python").read_text() == f"{found}\n"


def test_environment_whose_python_vanished_is_made_anew(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    start(checkout)
    (checkout / ".venv/bin/python").unlink()
    assert start(checkout).returncode == 0
    assert (checkout / ".venv/bin/python").exists()


def test_tests_add_their_tools_once(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    start(checkout)
    calls(checkout)
    assert start(checkout, "run_tests.sh").returncode == 0
    asked = calls(checkout)
    assert "/.venv/heli_uv/bin/uv --python" in asked[0]
    assert asked[0].endswith("requirements/test.txt")
    assert [line.split()[1] for line in asked[1:]] == CHECKS
    start(checkout, "run_tests.sh")
    assert [line.split()[1] for line in calls(checkout)] == CHECKS


def test_sourced_jazzy_without_rclpy(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    result = start(checkout, ROS_DISTRO="jazzy", RCLPY_MISSING="1")
    assert_one_line_error(result, "ROS_DISTRO=jazzy", "rclpy", "setup.bash")


def test_sourced_jazzy_without_colcon(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    assert_one_line_error(start(checkout, ROS_DISTRO="jazzy"), "colcon not found")


def test_sourced_jazzy_builds_with_colcon(checkout):
    add_command(checkout, "python3", RECORDING_PYTHON)
    colcon = (
        '#!/usr/bin/env bash\necho "colcon $*" >>"$CALLS"\n'
        "mkdir -p install && echo 'export WORKSPACE=sourced' >install/local_setup.bash\n"
    )
    add_command(checkout, "colcon", colcon)
    assert start(checkout, ROS_DISTRO="jazzy").returncode == 0
    asked = calls(checkout)
    assert "--system-site-packages" in asked[0] and ".venv-ros" in asked[0]
    assert "ros.txt" not in asked[1]
    assert asked[1].startswith("-m pip install")  # uv does not see the system's packages
    assert asked[2] == "colcon build --symlink-install --base-paths src"
    assert not (checkout / ".venv").exists()
    start(checkout, ROS_DISTRO="jazzy")
    assert kinds(calls(checkout)) == ["flight"]


def test_other_ros_is_kept_out(checkout):
    shows = (
        RECORDING_PYTHON + 'env | grep -E "^(ROS_DISTRO|PYTHONPATH|_ROS_WHEELS|AMENT)" || true\n'
    )
    add_command(checkout, "python3", shows)
    foreign = {
        "ROS_DISTRO": "humble",
        "PYTHONPATH": "/opt/ros/humble/lib",
        "AMENT_PREFIX_PATH": "/opt/ros/humble",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }
    start(checkout, **foreign)
    result = start(checkout, **foreign)
    assert result.stdout.split() == [f"AMENT_PREFIX_PATH={checkout}/.venv"]
