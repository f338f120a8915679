# SPDX-License-Identifier: Apache-2.0
"""How a node's process ends: exit code and what it says, in processes of their own."""

import os
import re
import signal
import subprocess
import sys

import pytest

NODE = """
import os, signal, sys
from heli_msgs_bridge import topics
from heli_msgs_bridge.lifecycle_node import ManagedNode
from heli_msgs_bridge.node_process import run, run_together
from heli_msgs_bridge.lifecycle_node import NodeSpec, NodeStartError

class Short(ManagedNode):
    SPEC = NodeSpec("short", "heli_core", (), "common.yaml")
    PATIENCE_S = 0.01 * ("patient" in sys.argv)

    def configure(self):
        if "refuse" in sys.argv:
            raise NodeStartError("the box\\nis empty")
        self.create_wall_timer(0.01, self.work)
        return self.create_topic_publisher(topics.TRUTH_WIND)

    def work(self):
        print("works", flush=True)
        if "finish" in sys.argv:
            self.finished = True
            self.exit_code = int("badly" in sys.argv)
        elif "fail" in sys.argv:
            raise RuntimeError("divided by nought")
        elif "signal" in sys.argv:
            # As if it came from outside, in the middle of a callback.
            os.kill(os.getpid(), signal.SIGTERM)
            while not self.leaving():
                signal.sigtimedwait([], 0.01)
            self.core(bytes(12))

    def release(self):
        print("torn down", flush=True)

class Long(Short):
    SPEC = NodeSpec("long", "heli_core", (), "common.yaml")

    def configure(self):
        return self.create_topic_publisher(topics.TRUTH_WIND)

if "together" in sys.argv:
    sys.exit(run_together([Long, Short], [], "both"))
wrong = ["--ros-args", "-p", "peer_timeout_s:=x"]
sys.exit(run(Short, wrong if "nonsense" in sys.argv else []))
"""

ENDS = {
    "finish": (0, []),
    "fail": (1, ["short: failed in flight: RuntimeError: divided by nought"]),
    "refuse": (2, ["short: the box is empty"]),
}
"""How it ends: exit code and complaints."""


@pytest.fixture
def start(own_domain):
    """Start a node that ends in a certain way."""
    started = []

    def begin(*how):
        env = dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
        env["ROS_DOMAIN_ID"] = str(own_domain)
        command = [sys.executable, "-c", NODE, *how]
        started.append(
            subprocess.Popen(
                command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
        )
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def ended(process):
    """Exit code, standard output, and what the nodes themselves complained of."""
    out, err = process.communicate(timeout=120)
    assert "Traceback" not in out + err and "Exception" not in err
    return (
        process.returncode,
        out,
        [line for line in err.splitlines() if re.match("(short|long|both):", line)],
    )


def test_one_that_has_done_its_work_ends_with_0(start):
    code, out, complaints = ended(start("finish"))
    assert (code, complaints) == (0, []) and out.endswith("torn down\n")


def test_one_whose_work_came_to_a_bad_end_ends_with_1(start):
    code, out, complaints = ended(start("finish", "badly"))
    assert (code, complaints) == (1, []) and out.endswith("torn down\n")


@pytest.mark.parametrize("how", ["prompt", "patient"])
def test_one_that_fails_in_flight_ends_with_1_and_one_line(start, how):
    code, out, complaints = ended(start("fail", how))
    assert (code, complaints) == ENDS["fail"]
    assert out.endswith("torn down\n")


def test_a_send_after_the_signal_is_no_failure(start):
    code, out, complaints = ended(start("signal"))
    assert (code, complaints) == (0, [])
    assert out.endswith("torn down\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_one_that_is_asked_to_end_ends_with_0(start, number):
    process = start()
    assert process.stdout.readline() == "works\n"
    process.send_signal(number)
    code, out, complaints = ended(process)
    assert (code, complaints) == (0, []) and out.endswith("torn down\n")


def test_one_that_cannot_start_ends_with_2_and_one_line(start):
    code, _, complaints = ended(start("refuse"))
    assert (code, complaints) == ENDS["refuse"]
    code, _, complaints = ended(start("nonsense"))
    assert code == 2 and len(complaints) == 1 and "peer_timeout_s" in complaints[0]


@pytest.mark.parametrize("how", ENDS)
def test_of_several_in_a_process_the_one_that_ends_is_named(start, how):
    """And all of them are torn down."""
    code, out, complaints = ended(start(how, "together"))
    assert (code, complaints) == ENDS[how]
    assert out.count("torn down\n") == (1 if how == "refuse" else 2)
