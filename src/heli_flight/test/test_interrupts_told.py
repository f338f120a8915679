# SPDX-License-Identifier: Apache-2.0
"""An interrupt that C code has swallowed is told as one; one that must wait waits."""

import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from heli_flight import interrupts
from heli_flight.graph import nodes


def test_a_failure_after_a_swallowed_interrupt_is_the_interrupt(monkeypatch):
    monkeypatch.setattr(interrupts, "_interrupted", True)
    with pytest.raises(KeyboardInterrupt), interrupts.interrupts_reported():
        raise ValueError("Invalid bounding box")


def test_a_failure_of_its_own_stays_what_it_is(monkeypatch):
    monkeypatch.setattr(interrupts, "_interrupted", False)
    with pytest.raises(ValueError, match="too long"), interrupts.interrupts_reported():
        raise ValueError("too long")


def test_what_does_not_fail_stands(monkeypatch):
    """The result of a command that has ended is there, interrupted or not."""
    monkeypatch.setattr(interrupts, "_interrupted", True)
    with interrupts.interrupts_reported():
        done = True
    assert done


STEP = """
import os
import signal
import sys
import threading

from heli_flight import interrupts

ended, reached, whole = threading.Event(), [], False
others = [threading.Thread(target=ended.wait) for _ in range(int(sys.argv[1]))]
for other in others:
    other.start()
try:
    with interrupts.held_back():
        os.kill(os.getpid(), signal.SIGINT)
        reached.extend(range(1000))
        whole = True
    # Another thread may take the signal a moment later; asking so runs its handler.
    for _ in range(6000):
        threading.Event().wait(0.01)
        signal.pthread_sigmask(signal.SIG_BLOCK, ())
except KeyboardInterrupt:
    print("interrupted after", len(reached), whole)
ended.set()
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""


@pytest.mark.parametrize("threads", [0, 1])
def test_an_interrupt_waits_for_the_end_of_a_step_whoever_takes_it(threads):
    """A thread that was there before does not hold the signal back, and so may be given it.

    In a process of its own: threads of other tests' libraries would be among those asked.
    """
    command = [sys.executable, "-c", STEP, str(threads)]
    completed = subprocess.run(command, capture_output=True, text=True)
    assert completed.stdout.split()[-3:] == ["1000", "True", "True"], completed.stderr


def test_a_command_that_fails_of_an_interrupt_ends_as_interrupted(capsys, monkeypatch):
    """C code may drop the exception and raise its own, as bindings do between two calls."""
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(interrupts, "_interrupted", False)

    def command():
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise RuntimeError("Unable to convert call argument '0'") from None
        return 0

    hook = sys.unraisablehook
    try:
        assert interrupts.run(lambda: command) == interrupts.EXIT_CODE
    finally:
        signal.signal(signal.SIGINT, before)
        sys.unraisablehook = hook
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.parametrize(
    ("interrupted", "comes"), [(True, KeyboardInterrupt), (False, RuntimeError)]
)
def test_a_ctrl_c_that_rclpy_dropped_is_one_all_the_same(monkeypatch, interrupted, comes):
    """Its C++ then fails to convert an argument; seen once, in `heli echo`."""
    ended = SimpleNamespace(ok=lambda: False)
    node = SimpleNamespace(destroy_node=lambda: None, context=ended)
    monkeypatch.setattr(nodes, "check_middleware", lambda: None)
    monkeypatch.setattr(nodes, "Node", lambda *_, **__: node)
    monkeypatch.setattr(nodes.rclpy, "init", lambda **_: None)
    monkeypatch.setattr(nodes.rclpy, "try_shutdown", lambda: None)
    monkeypatch.setattr(interrupts, "_interrupted", interrupted)
    with pytest.raises(comes), nodes.ros_node("listener"):
        raise RuntimeError("Unable to convert call argument '0' to Python object")
