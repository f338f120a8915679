# SPDX-License-Identifier: Apache-2.0
"""No process is left behind: not one that ignores the interrupt, not when the parent is killed."""

import contextlib
import fcntl
import os
import select
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from heli_core.errors import StartError
from heli_flight.graph import flight, processes

MODULES = {
    "obedient": "import signal\ndef main(a):\n    print('up', flush=True)\n    signal.pause()\n",
    "deaf": (
        "import signal\ndef main(a):\n    signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "    print('up', flush=True)\n    signal.sigwait([signal.SIGUSR2])\n"
    ),
    "failing": ("def main(a):\n    print('first')\n    print('why', a[0])\n    return 2\n"),
}


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Start a node out of MODULES."""
    for name, code in MODULES.items():
        (tmp_path / f"{name}_node.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))

    def run(name, *arguments):
        log = tmp_path / f"{name}.log"
        return processes.NodeProcess(name, f"{name}_node", arguments, log, dict(os.environ))

    return run


def wait_for_line(process, text, limit_s=120.0):
    deadline = time.monotonic() + limit_s
    while process.last_line() != text:
        assert time.monotonic() < deadline, f"{process.last_line()!r}"
        process.wait(0.01)


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_interrupt_ends_a_process_that_obeys(start):
    child = start("obedient")
    wait_for_line(child, "up")
    assert processes.stop([child], 5.0) == []
    assert child.exit_code() is not None


def test_one_that_ignores_the_interrupt_is_killed_and_named(start):
    child = start("deaf")
    wait_for_line(child, "up")
    assert processes.stop([child], 0.5) == ["deaf"]
    assert not alive(child.pid)


def test_last_line_is_the_reason(start):
    child = start("failing", "0.01")
    assert child.wait(120.0)
    assert child.exit_code() == 2
    assert child.last_line() == "why 0.01"


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="parent-death signal is Linux's")
def test_children_die_with_a_killed_parent(start, tmp_path):
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "from heli_flight.graph.processes import NodeProcess, start_server\n"
        "start_server()\n"
        f"log = Path({str(tmp_path)!r}) / 'x'\n"
        "child = NodeProcess('x', 'obedient_node', [], log, os.environ)\n"
        "print(child.pid, flush=True)\n"
        "signal.pause()\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    assert alive(pid)
    orphan = os.pidfd_open(pid)
    parent.kill()
    parent.wait()
    assert select.select([orphan], [], [], 5.0)[0], "the child lives on"
    os.close(orphan)
    parent.stdout.close()


def test_one_flight_per_domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "231")
    with processes.domain_reserved():
        with pytest.raises(StartError, match="ROS domain 231"), processes.domain_reserved():
            raise AssertionError("two flights in one domain")
        monkeypatch.setenv("ROS_DOMAIN_ID", "230")
        with processes.domain_reserved():
            monkeypatch.setenv("ROS_DOMAIN_ID", "231")
    with processes.domain_reserved():
        monkeypatch.undo()


def test_a_domain_with_a_participant_is_not_empty(monkeypatch, tmp_path):
    """A socket on one of its 250 ports; the neighbours' do not count."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        for domain in range(90, 100):
            with contextlib.suppress(OSError):
                participant.bind(("127.0.0.1", 7400 + 250 * domain + 10))
                break
        assert processes.others_in(domain)
    table = tmp_path / "udp"
    table.write_text(
        "  sl  local_address rem_address   st\n"
        f"  12: 0100007F:{7400 + 250 * 7 + 249:04X} 00000000:0000 07\n"
    )
    monkeypatch.setattr(processes, "_UDP_SOCKETS", table)
    assert [processes.others_in(domain) for domain in (6, 7, 8)] == [False, True, False]
    monkeypatch.setattr(processes, "_UDP_SOCKETS", tmp_path / "no_such_table")
    assert processes.others_in(6)


def test_who_names_no_domain_gets_a_free_one(monkeypatch):
    """Two people fly at once; the second is told how to listen in, and nothing of it stays."""
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    with processes.domain_reserved() as first:
        assert os.environ["ROS_DOMAIN_ID"] == str(first)
        monkeypatch.delenv("ROS_DOMAIN_ID")
        lines = []
        with flight.running(flight.Graph(None, None, None, lines.append)):
            second = int(os.environ["ROS_DOMAIN_ID"])
        assert second > first
        assert len(lines) == 1 and f"ROS_DOMAIN_ID={second} " in lines[0]
        assert "ROS_DOMAIN_ID" not in os.environ
        monkeypatch.setenv("ROS_DOMAIN_ID", str(first))
        with (
            pytest.raises(StartError, match="ROS_DOMAIN_ID"),
            processes.domain_reserved(),
        ):
            raise AssertionError("two flights in one domain")
    assert "ROS_DOMAIN_ID" not in os.environ


def test_a_lock_that_another_user_made_is_a_lock(monkeypatch, tmp_path):
    """It cannot be written to, and need not be."""
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    lock = tmp_path / "heli_hover-domain-7.lock"
    lock.touch(mode=0o444)
    with open(lock) as others:
        fcntl.flock(others, fcntl.LOCK_EX)
        with pytest.raises(StartError, match="ROS domain 7"), processes.domain_reserved():
            raise AssertionError("two flights in one domain")
    with processes.domain_reserved() as domain:
        assert domain == 7


def test_a_domain_is_held_whatever_the_folder_of_temporary_files(monkeypatch, tmp_path):
    """As where each user has one of his own; no file is left in either."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "229")
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in folders:
        folder.mkdir()
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(folders[0]))
    with processes.domain_reserved():
        monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(folders[1]))
        with pytest.raises(StartError, match="ROS domain 229"), processes.domain_reserved():
            raise AssertionError("two flights in one domain")
        assert list(folders[0].iterdir()) and not list(folders[1].iterdir())
        monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(folders[0]))
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(folders[1]))
    with processes.domain_reserved() as domain:
        assert domain == 229
    assert not any(list(folder.iterdir()) for folder in folders)


@pytest.mark.parametrize("put", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_in_the_place_of_a_lock_holds_nobody_up(monkeypatch, tmp_path, put):
    """Another user may have put it there; the domain counts as taken."""
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    put(tmp_path / "heli_hover-domain-7.lock")
    with pytest.raises(StartError), processes.domain_reserved():
        raise AssertionError("flown beside who knows whom")


def test_a_lock_leaves_no_file(monkeypatch, tmp_path):
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with processes.domain_reserved():
        assert [path.name for path in tmp_path.iterdir()] == ["heli_hover-domain-7.lock"]
        with pytest.raises(StartError), processes.domain_reserved():
            raise AssertionError("two flights in one domain")
        assert list(tmp_path.iterdir()), "who was refused has removed the other's lock"
    assert list(tmp_path.iterdir()) == []


def test_a_lock_whose_file_was_removed_is_none(monkeypatch, tmp_path):
    """One flight opens the file just before another one, which holds it, ends and removes it."""
    monkeypatch.setattr(processes.tempfile, "gettempdir", lambda: str(tmp_path))
    path, lock = tmp_path / "heli_hover-domain-7.lock", fcntl.flock
    locked = []

    def removed_meanwhile(descriptor, how):
        lock(descriptor, how)
        if not locked:
            path.unlink()
        locked.append(os.fstat(descriptor).st_ino)

    monkeypatch.setattr(processes.fcntl, "flock", removed_meanwhile)
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with processes.domain_reserved():
        assert len(locked) == 2
        assert path.stat().st_ino == locked[-1]
        with pytest.raises(StartError), processes.domain_reserved():
            raise AssertionError("two flights in one domain")
    assert not path.exists()


@pytest.mark.slow
def test_a_long_tmpdir_is_no_hindrance(tmp_path):
    """A Unix socket's path has 107 bytes at most; its folder is the user's alone, and goes."""
    folder = tmp_path / ("t" * 120)
    folder.mkdir()
    (tmp_path / "obedient_node.py").write_text(MODULES["obedient"])
    code = (
        "import os, sys\n"
        "from multiprocessing import util\n"
        "from pathlib import Path\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "from heli_flight.graph.processes import NodeProcess, start_server, stop\n"
        "start_server()\n"
        f"child = NodeProcess('x', 'obedient_node', [], Path({str(tmp_path)!r}) / 'x', {{}})\n"
        "while child.last_line() != 'up':\n"
        "    assert not child.wait(0.01), child.last_line()\n"
        "assert stop([child]) == []\n"
        "made = util.get_temp_dir()\n"
        "print(made, oct(os.stat(made).st_mode & 0o777))\n"
    )
    env = os.environ | {"TMPDIR": str(folder)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    made, mode = done.stdout.split()
    assert len(str(folder)) >= 120 and len(made) < 60 and mode == "0o700"
    assert not Path(made).exists() and list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("reach", "expected"),
    [
        ("", ""),
        ("LOCALHOST", ""),
        ("SUBNET", ""),
        ("SYSTEM_DEFAULT", ""),
        ("OFF", "nodes do not find each other"),
        ("localhost", "allowed are LOCALHOST, SUBNET, SYSTEM_DEFAULT"),
    ],
)
def test_nodes_must_find_each_other(monkeypatch, reach, expected):
    """With OFF a flight waited 30 s for itself; a misspelt range was another one, silently."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", reach)
    monkeypatch.delenv("ROS_STATIC_PEERS", raising=False)
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.delenv("RMW_IMPLEMENTATION", raising=False)
    if not expected:
        processes.check_middleware()
        return
    with pytest.raises(StartError, match=expected):
        processes.check_middleware()


@pytest.mark.parametrize("reach", ["SUBNET", "LOCALHOST", ""])
def test_a_range_beyond_this_machine_is_said_first(monkeypatch, reach):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", reach)
    monkeypatch.setenv("ROS_DOMAIN_ID", "229")
    lines = []
    with flight.running(flight.Graph(None, None, None, lines.append)):
        expected = (
            "flying in ROS domain 229 with ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET, as it is set: "
            "other machines may listen and send"
        )
        assert lines == [expected] * (reach == "SUBNET")
