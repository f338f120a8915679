# SPDX-License-Identifier: Apache-2.0
"""Bad input: one line that names it, exit code 2, nothing half-started, no process left behind."""

import errno
import os
import signal
import subprocess
import sys

import pytest

from heli_bags.reader import read_bag

REALTIME = [sys.executable, "-m", "heli_flight.cli.hover_test", "--realtime", "--duration", "30"]


def section(node, text):
    return f"/**/{node}:\n  ros__parameters:\n    {text}\n"


def test_a_gamma_that_only_the_node_finds_infeasible(hover_test, tmp_path):
    """The nodes are up already; a command of its own ends them, and says what the node said."""
    path = tmp_path / "bad.yaml"
    path.write_text(section("inner_loop", "output: {gamma: 0.5}"))
    done = hover_test("--out", tmp_path / "flight", "--params", path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    for word in ("output.gamma", "0.5", "3.75"):
        assert word in done.stderr
    assert not (tmp_path / "flight").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (section("inner_loop", "gama: 0.07"), ["gama", "gamma"]),
        (section("inner_loop", "D11: [1.0, 2.0]"), ["D11", "9"]),
        (section("inner_loop", "gamma: 1"), ["gamma", "1.0"]),
        (section("inner_loop", "gamma: .nan"), ["gamma", "finite"]),
        (section("outer_loop", "K_P: [0.1, 0.2, .inf]"), ["K_P", "finite"]),
        (section("outer_loop", "period_ticks: 3"), ["period_ticks", "3", "4"]),
        (section("outer_loop", "period_ticks: 5"), ["outer_loop: period_ticks: 5", "inner_loop"]),
        (section("plant", "wind.towards_deg: north"), ["wind.towards_deg", "north"]),
        (section("planet", "seed: 1"), ["planet", "plant"]),
        ("plant: [", ["not valid YAML"]),
    ],
    ids=["misspelt", "length", "integer", "nan", "inf", "rates", "disagree", "type", "node",
         "malformed"],
)  # fmt: skip
def test_parameter_files(refused, tmp_path, content, words):
    path = tmp_path / "bad.yaml"
    path.write_text(content)
    sentence = refused("--out", tmp_path / "flight", "--params", path, "--duration", 1)
    for word in words:
        assert word in sentence
    assert not (tmp_path / "flight").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--scenario", "moon"], ["moon", "attitude", "hover"]),
        (["--gps", "galileo"], ["galileo", "standalone", "rtk"]),
        (["--params", "/nonexistent.yaml"], ["/nonexistent.yaml"]),
        (["--duration", "-1"], ["--duration", "-1"]),
        (["--duration", "nan"], ["--duration", "finite"]),
        (["--seed", "-3"], ["--seed", "-3"]),
    ],
)
def test_options(refused, tmp_path, arguments, words):
    sentence = refused("--out", tmp_path / "flight", *arguments)
    for word in words:
        assert word in sentence


def test_folder_that_exists_and_folder_that_cannot_be_written(refused, tmp_path):
    assert f"--out {tmp_path}: exists" in refused("--out", tmp_path)
    (tmp_path / "file").write_text("")
    unwritable = tmp_path / "file" / "flight"
    sentence = refused("--out", unwritable)
    assert f"--out {unwritable}: " in sentence and os.strerror(errno.ENOTDIR) in sentence


def test_missing_executable_is_named(tmp_path, ros_env):
    """Looked for as ros2 run does, in a prefix that lacks the observer."""
    code = (
        "import heli_flight.graph.flight as g, sys\n"
        "from heli_flight.cli.hover_test import main\n"
        "from heli_core import command_line\n"
        "def without(package, name):\n"
        "    name = 'gone' if name == 'observer' else name\n"
        "    return command_line.executable(package, name)\n"
        "g.executable = without\n"
        f"sys.exit(main(['--out', {str(tmp_path / 'f')!r}]))\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=ros_env, capture_output=True, text=True)
    assert done.returncode == 2
    assert "lib/heli_observer/gone" in done.stderr
    assert not (tmp_path / "f").exists()


@pytest.mark.parametrize(
    "env", [{"RMW_IMPLEMENTATION": "rmw_does_not_exist_cpp"}, {"ROS_DOMAIN_ID": "9999"}]
)
def test_dds_that_cannot_start(hover_test, tmp_path, env):
    done = hover_test("--out", tmp_path / "f", env=env)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    ((key, value),) = env.items()
    assert f"{key}={value}" in done.stderr
    assert not (tmp_path / "f").exists()


def test_node_that_dies_at_start_is_named(hover_test, tmp_path, ros_env):
    aircraft = tmp_path / "no_aircraft.yaml"
    path = tmp_path / "bad.yaml"
    path.write_text(section("plant", f"aircraft_file: '{aircraft}'"))
    done = hover_test("--out", tmp_path / "f", "--params", path)
    assert done.returncode == 2
    assert str(aircraft) in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


def test_interrupt_ends_everything_and_the_bag_opens(tmp_path, ros_env, living):
    folder = tmp_path / "flight"
    command = [*REALTIME, "--out", folder]
    process = subprocess.Popen(
        command, env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    # Real time says a line every tenth of the flight: at 3 s it certainly flies.
    assert "flown" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130, out + err
    assert living() == []
    assert read_bag(folder / "bag").streams["ground_truth/odom"].stamp_ns.size > 250


@pytest.mark.slow
def test_a_killed_supervisor_leaves_nothing_and_the_bag_opens(tmp_path, ros_env, living):
    folder = tmp_path / "flight"
    command = [*REALTIME, "--out", folder]
    process = subprocess.Popen(command, env=ros_env, stdout=subprocess.PIPE, text=True)
    assert "flown" in process.stdout.readline()
    process.kill()
    process.wait()
    assert living() == []
    process.stdout.close()
    assert read_bag(folder / "bag").streams["ground_truth/odom"].stamp_ns.size > 250


@pytest.mark.slow
@pytest.mark.parametrize(
    "home",
    ["/dev/null", "/proc", "/proc/nowhere", "", None],
    ids=["no folder", "not to be written", "not there", "empty", "unset"],
)
def test_a_flight_needs_no_home(hover_test, tmp_path, ros_env, home):
    """ROS keeps its log in the temporary folder then; the kernels are in the environment."""
    env = {"TMPDIR": str(tmp_path)}
    if home is None:
        del ros_env["HOME"]
    else:
        env["HOME"] = home
    done = hover_test("--duration", "1", "--out", tmp_path / "f", env=env)
    assert (done.returncode, done.stderr) == (0, "")
    assert [path.name for path in tmp_path.glob("heli_hover-*/*")] == ["ros_log"]


FOLDERS = (
    "HOME", "TMPDIR", "MPLCONFIGDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME",
    "XDG_STATE_HOME", "XDG_RUNTIME_DIR",
)  # fmt: skip
"""Variables that name a folder which a flight can do without."""


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["", "nowhere/at all", "/dev/null", "/proc", "/a\nline"])
def test_a_flight_needs_none_of_the_users_folders(hover_test, tmp_path, folder):
    env = dict.fromkeys(FOLDERS, folder)
    done = hover_test("--duration", "1", "--no-report", "--out", tmp_path / "f", env=env)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("variable", ["ROS_LOG_DIR", "ROS_HOME"])
def test_a_flight_needs_no_log_folder(hover_test, tmp_path, ros_env, variable):
    """It flies, and says in one line that what the user named cannot be used."""
    env = {"TMPDIR": str(tmp_path), variable: "/dev/null"}
    done = hover_test("--duration", "1", "--out", tmp_path / "f", env=env)
    assert done.returncode == 0 and len(done.stderr.splitlines()) == 1, done.stderr
    assert f"{variable}='/dev/null'" in done.stderr
    assert [path.name for path in tmp_path.glob("heli_hover-*/*")] == ["ros_log"]
