# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C at any time: exit code 130, one line, nothing left behind.

Each run is interrupted as a terminal does it, the whole process group at once, at a time drawn
between its start and the end of an undisturbed run.
"""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from heli_bags.reader import read_bag
from heli_msgs_bridge.node_process import NOT_LEFT

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 120.0
GRAPH = (ROOT / "hover_test.sh", "--duration", "4")
ONE_PROCESS = (ROOT / "heli", "hover", "--one-process", "--duration", "4")
DESIGN = (ROOT / "heli", "design", "--out", "design")
PROGRESS = {DESIGN: ["design: 1 of 2", "design: 2 of 2"]}
"""All that a whole run says on stderr; an interrupted one says some of it, then its one line."""
# Runs a command where /dev/shm is its own, and writes down what it leaves there.
OWN_SHARED_MEMORY = """
mount -t tmpfs tmpfs /dev/shm || exit 77
trap : INT
"$@"
code=$?
ls /dev/shm >left_in_shm
exit "$code"
"""


@pytest.fixture(autouse=True)
def environment_stands():
    """The commands make a stale environment anew, and these tests run in it."""
    wanted = "".join(path.read_text() for path in sorted((ROOT / "requirements").glob("*.txt")))
    stamp = (Path(sys.prefix) / "heli_stamp").read_text()
    assert stamp.startswith(wanted), "stale environment: ./run_tests.sh first"


@pytest.fixture
def tmp_path(tmp_path_factory):
    """A folder with a short name: the path of a socket in TMPDIR has at most 107 characters."""
    return tmp_path_factory.mktemp("i")


@pytest.fixture
def start(tmp_path, ros_env):
    """Start a command in a folder of its own, as the leader of a process group."""
    folders = ("work", "tmp")

    def run(command):
        for name in folders:
            (tmp_path / name).mkdir(exist_ok=True)
        return subprocess.Popen(
            command,
            env=ros_env | {"TMPDIR": str(tmp_path / "tmp")},
            cwd=tmp_path / "work",
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # A test run started with `&` ignores SIGINT, and so would what it starts.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    return run


def half_made(folder):
    """What is neither a finished flight or design nor a flight whose bag opens."""
    paths = []
    for made in [*folder.glob("flights/*"), *folder.glob("design")]:
        if (made / "bag").exists():
            read_bag(made / "bag")
        elif not ((made / "result.json").exists() or (made / "design.json").exists()):
            paths.append(made)
        page = made / "report.html"
        if page.exists() and not page.read_text().rstrip().endswith("</html>"):
            paths.append(page)
    if (folder / "flights").exists() and not any(folder.glob("flights/*")):
        paths.append(folder / "flights")
    return paths


def interrupt(start, command, when_s):
    """Start a command and interrupt it after a time, unless it has ended before."""
    process = start(command)
    try:
        process.wait(when_s)
    except subprocess.TimeoutExpired:
        signal_group(process)
    return process


def check_interrupted(process, folder, living, when):
    out, err = process.communicate(timeout=LIMIT_S)
    assert living() == [], when
    assert half_made(folder / "work") == [], when
    assert list((folder / "tmp").iterdir()) == []
    progress = PROGRESS.get(process.args, [])
    if process.returncode == -signal.SIGINT:
        # The first line of the script had not run. A shell calls that 130, too.
        assert out == err == "", when
    elif process.returncode in (0, 1):
        assert re.search("^written: ", out, re.MULTILINE), when  # it had ended before
        assert err.splitlines() == progress, when
    else:
        shown = progress[: len(err.splitlines()) - 1]
        expected = "".join(f"{line}\n" for line in (*shown, "interrupted"))
        assert (process.returncode, err) == (130, expected), f"{when}\n{out}\n{err}"


def interrupt_at_random(start, command, folder, living, count, seed):
    design = folder / "work/design"  # the next run wants a folder that does not exist
    once = command if command == DESIGN else (*command, "--no-report")
    start(once).communicate(timeout=LIMIT_S)  # what is made once, is made now
    shutil.rmtree(design, ignore_errors=True)
    begun = time.monotonic()
    whole = start(command)
    _, err = whole.communicate(timeout=LIMIT_S)
    assert whole.returncode in (0, 1) and err.splitlines() == PROGRESS.get(command, []), err
    duration_s = time.monotonic() - begun
    draw = random.Random(seed)
    for i in range(count):
        shutil.rmtree(design, ignore_errors=True)
        when_s = draw.uniform(0.0, duration_s)
        process = interrupt(start, command, when_s)
        check_interrupted(process, folder, living, f"interrupt {i} after {when_s:.3f} s")


def signal_group(process):
    # It has not been waited for, so the group cannot be somebody else's.
    os.killpg(process.pid, signal.SIGINT)


@pytest.mark.slow
@pytest.mark.timeout(600)  # seven flights, each with its report
@pytest.mark.parametrize("command", [GRAPH, ONE_PROCESS], ids=["graph", "one process"])
def test_interrupted_at_some_time(start, command, tmp_path, living):
    interrupt_at_random(start, command, tmp_path, living, 5, seed=1)


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "command", [GRAPH, ONE_PROCESS, DESIGN], ids=["graph", "one process", "design"]
)
def test_interrupted_at_any_time(start, command, tmp_path, living):
    interrupt_at_random(start, command, tmp_path, living, 50, seed=2)


@pytest.mark.parametrize("command", [GRAPH, ONE_PROCESS], ids=["graph", "one process"])
def test_interrupted_at_once(start, command, tmp_path, living):
    """In the first moments, where an interpreter starts."""
    for when_s in (0.0, 0.01, 0.03, 0.1, 0.2):
        process = interrupt(start, command, when_s)
        check_interrupted(process, tmp_path, living, f"after {when_s} s")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["flown", "interrupted", "killed"])
def test_no_shared_memory_stays(start, tmp_path, how, living):
    """Fast DDS takes its segments away only if every participant is destroyed.

    Of one that was killed, or whose way out of DDS had no end, the flight does; the file of its
    port, 50 kB at most, stays for the next.
    """
    command = (ROOT / "hover_test.sh", "--world", "paper", "--duration", "20", "--no-report")
    if how == "killed":
        faults = tmp_path / "faults.yaml"
        faults.write_text("faults:\n  - {what: process, node: observer, kind: kill, start_s: 9}\n")
        command = (*command, "--respawn", "--faults", faults)
    alone = ("unshare", "--mount", "--map-root-user", "bash", "-c", OWN_SHARED_MEMORY, "bash")
    process = start((*alone, *command))
    first = process.stdout.readline()
    if not first and process.wait(LIMIT_S) in (1, 77):
        pytest.skip("a file system of one's own needs the right to mount")
    assert "flown" in first
    if how == "interrupted":
        signal_group(process)
    process.communicate(timeout=LIMIT_S)
    # How well a flight goes on after a kill depends on how fast its node comes back.
    assert process.returncode in {"flown": (0,), "interrupted": (130,), "killed": (0, 1)}[how]
    assert living() == []
    left = (tmp_path / "work/left_in_shm").read_text().splitlines()
    left = [name for name in left if "fastrtps" in name]
    logs = [path.read_text() for path in (tmp_path / "work/flights").glob("*/logs/*.log")]
    ports_stay = how == "killed" or any(NOT_LEFT in log for log in logs)
    assert [name for name in left if not (ports_stay and "fastrtps_port" in name)] == []
