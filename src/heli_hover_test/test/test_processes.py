# SPDX-License-Identifier: Apache-2.0
"""No process is left behind: not one that ignores the interrupt, not when the parent is killed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from heli_hover_test import processes
from heli_hover_test.errors import StartError

BLOCK = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
print("up", flush=True)
signal.sigwait([signal.SIGUSR2])
"""


def wait_for_line(process, text, limit_s=10.0):
    import time

    deadline = time.monotonic() + limit_s
    while process.last_line() != text:
        assert time.monotonic() < deadline, f"{process.last_line()!r}"
        process.wait(0.01)


def start(tmp_path, code, name="child"):
    command = [sys.executable, "-c", code]
    return processes.NodeProcess(name, command, tmp_path / f"{name}.log", os.environ)


def alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_interrupt_ends_a_process_that_obeys(tmp_path):
    child = start(tmp_path, "import signal\nprint('up', flush=True)\nsignal.pause()")
    wait_for_line(child, "up")
    assert processes.stop([child], 5.0) == []
    assert child.exit_code() is not None


def test_one_that_ignores_the_interrupt_is_killed_and_named(tmp_path):
    child = start(tmp_path, BLOCK, "deaf")
    wait_for_line(child, "up")
    assert processes.stop([child], 0.5) == ["deaf"]
    assert not alive(child.pid)


def test_last_line_is_the_reason(tmp_path):
    child = start(tmp_path, "import sys\nprint('first')\nsys.exit('gamma 0.01 is infeasible')")
    assert child.wait(10.0)
    assert child.exit_code() == 1
    assert child.last_line() == "gamma 0.01 is infeasible"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="parent-death signal is Linux's")
def test_children_die_with_a_killed_parent(tmp_path):
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from heli_hover_test.processes import NodeProcess\n"
        f"command = [sys.executable, '-c', {BLOCK!r}]\n"
        f"child = NodeProcess('x', command, Path({str(tmp_path)!r}) / 'x', os.environ)\n"
        "print(child.pid, flush=True)\n"
        "signal.pause()\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    assert alive(pid)
    parent.kill()
    parent.wait()
    import time

    deadline = time.monotonic() + 5.0
    while alive(pid) and time.monotonic() < deadline:
        os.sched_yield()
    assert not alive(pid)
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
