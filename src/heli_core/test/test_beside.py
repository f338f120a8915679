# SPDX-License-Identifier: Apache-2.0
"""What takes long is worked out in another process, which ends with this one."""

import math
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from heli_core.beside import Beside, BesideError

LIMIT_S = 120.0


@pytest.fixture
def beside():
    made = Beside()
    yield made
    made.close()


def gone(pid):
    deadline_s = time.monotonic() + LIMIT_S
    while os.path.exists(f"/proc/{pid}"):
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    return True


def test_it_is_another_process_and_stays(beside):
    assert beside.pid is None
    first, second = beside.call(os.getpid), beside.call(os.getpid)
    assert first == second == beside.pid != os.getpid()
    assert beside.call(math.hypot, 3.0, 4.0) == 5.0


def test_a_refusal_is_one_and_nothing_else_is(beside):
    with pytest.raises(ValueError, match="math domain error"):
        beside.call(math.sqrt, -1.0)
    with pytest.raises(BesideError, match="ZeroDivisionError"):
        beside.call(divmod, 1, 0)
    for nothing_to_hand_over in (lambda: 1, threading.Lock):
        with pytest.raises(BesideError):
            beside.call(nothing_to_hand_over)
    assert beside.call(abs, -1) == 1


def test_what_is_printed_is_no_answer(beside):
    assert beside.call(os.write, 1, b"to the log\n") == 11
    assert beside.call(print, "to the log") is None
    assert beside.call(abs, -1) == 1


def test_one_that_has_died_is_told_and_started_again(beside):
    pid = beside.call(os.getpid)
    with pytest.raises(BesideError):
        beside.call(os._exit, 3)
    assert gone(pid) and beside.call(abs, -1) == 1
    pid = beside.call(os.getpid)
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(BesideError):
        while True:
            beside.call(abs, -1)
            if beside.pid != pid:
                raise BesideError("it was noticed")
    assert beside.call(abs, -1) == 1


def test_closing_ends_it_in_the_midst_of_work(beside):
    """And whoever waits for it is told; it is not started again."""
    pid, told = beside.call(os.getpid), []

    def wait():
        try:
            beside.call(signal.pause)
        except BesideError as error:
            told.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    beside.close()
    thread.join(LIMIT_S)
    assert gone(pid) and len(told) == 1
    with pytest.raises(BesideError):
        beside.call(abs, -1)


def test_it_outlives_the_terminals_signal_but_not_its_owner():
    """Ctrl-C reaches the whole group of processes."""
    program = (
        "import os, signal, sys, time\n"
        "from heli_core.beside import Beside\n"
        "beside = Beside()\n"
        "pid = beside.call(os.getpid)\n"
        "os.kill(pid, signal.SIGINT)\n"
        "assert beside.call(os.getpid) == pid\n"
        "print(pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert gone(int(done.stdout))
