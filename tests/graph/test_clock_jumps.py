# SPDX-License-Identifier: Apache-2.0
"""The host's clock is set in flight, forward and back: nobody waits for it, nobody is lost by it.

The clock of this machine stays as it is: `support/clock_jumps.c` sets that of the test's processes.
"""

import contextlib
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[1] / "support" / "clock_jumps.c"
DAY_S, HOUR_S = 86400.0, 3600.0
JUMPS_S = [DAY_S, *(DAY_S - HOUR_S * number for number in range(1, 1000))]
"""From the clock as it was: a day on, then back by an hour each time."""
_PAUSE_S, _LIMIT_S = 0.4, 240.0

WAITS = """
import os, struct, threading, rclpy
from rclpy.clock import Clock, ClockType
from rclpy.experimental import EventsExecutor
from rclpy.task import Future
from heli_msgs_bridge.node_process import outlasts_set_clock

def set_clock(off_s):
    with open(os.environ["CLOCK_FILE"], "r+b") as file:
        file.write(struct.pack("<q", round(off_s * 1e9)))

rclpy.init()
node, executor, over = rclpy.create_node("waits"), EventsExecutor(), Future()
count = 0

def tick():
    global count
    count += 1
    if count == 5:
        threading.Thread(target=set_clock, args=(-3600.0,)).start()
    if count == 20:
        over.set_result(None)

node.create_timer(0.05, tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
executor.add_node(node)
with outlasts_set_clock(executor, [node]):
    executor.spin_until_future_complete(over, timeout_sec=100.0)
    print("timers", count, flush=True)
    executor.remove_node(node)
    # Nothing but the wait itself: the clock is set back again while it is under way.
    threading.Timer(0.2, set_clock, (-7200.0,)).start()
    executor.spin_once(0.4)
print("over", flush=True)
os._exit(0)
"""


@pytest.fixture(scope="module")
def shim(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler")
    library = tmp_path_factory.mktemp("shim") / "clock_jumps.so"
    words = ["cc", "-shared", "-fPIC", "-Wall", "-Werror", "-o", library, SOURCE, "-ldl"]
    subprocess.run(words, check=True)
    return library


@pytest.fixture
def clock(shim, ros_env, tmp_path):
    """Environment of processes whose clock is off by what its file holds, at first by nothing."""
    file = tmp_path / "clock"
    file.write_bytes(bytes(8))
    return ros_env | {"LD_PRELOAD": str(shim), "CLOCK_FILE": str(file)}


def set_clock(clock, off_s):
    """In the same file: who has opened it sees it."""
    with open(clock["CLOCK_FILE"], "r+b") as file:
        file.write(struct.pack("<q", round(off_s * 1e9)))


def flown(clock, out, *words):
    """Fly while the clock is set again and again; exit code and how often."""
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report"]
    command += ["--world", "paper", "--out", str(out), *words]
    count = 0
    with subprocess.Popen(command, env=clock, stdout=subprocess.DEVNULL) as flying:
        try:
            while flying.poll() is None and count * _PAUSE_S < _LIMIT_S:
                set_clock(clock, JUMPS_S[count])
                count += 1
                with contextlib.suppress(subprocess.TimeoutExpired):
                    flying.wait(_PAUSE_S)
        finally:
            flying.kill()
    return flying.returncode, count


def test_waits_and_timers_outlast_a_clock_that_is_set_back(clock):
    """The wheels' condition variables wait for the system clock: for an hour, without help."""
    done = subprocess.run(
        [sys.executable, "-c", WAITS], env=clock, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.splitlines() == ["timers 20", "over"], done.stderr


@pytest.mark.nightly
def test_a_flight_is_the_same_whatever_the_clock(hover_test, clock, tmp_path):
    plain = hover_test("--duration", "10", "--out", tmp_path / "plain")
    code, count = flown(clock, tmp_path / "set", "--duration", "10")
    assert (code, plain.returncode) == (0, 0) and count > 3
    truth = [(tmp_path / name / "truth.sums").read_bytes() for name in ("plain", "set")]
    assert truth[0] == truth[1] and len(truth[0]) == 8 * 1000
