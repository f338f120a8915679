# SPDX-License-Identifier: Apache-2.0
"""Who leaves DDS does so with its exit code, though Fast DDS turn in a loop for ever."""

import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from heli_msgs_bridge import node_process
from heli_msgs_bridge.node_process import NOT_LEFT, exit_within, wait_for_dds_shutdown

# PyDLL keeps Python's lock, as rclpy does while it destroys a node.
STUCK = """
import ctypes, threading
from heli_msgs_bridge.node_process import exit_within
threading.Thread(target=threading.Event().wait, daemon=True).start()
with exit_within({code}, 0.1):
    while True:
        ctypes.PyDLL(None).sleep(1000)
"""


@pytest.mark.parametrize("code", [0, 1, 2])
def test_who_cannot_leave_ends_with_its_code(code):
    stuck = [sys.executable, "-c", STUCK.format(code=code)]
    ended = subprocess.run(stuck, timeout=120, check=False, stderr=subprocess.PIPE, text=True)
    # Who failed has said why, and that stays its last line.
    assert (ended.returncode, ended.stderr) == (code, "" if code else f"{NOT_LEFT}\n")


def test_who_leaves_in_time_goes_on():
    before = signal.getsignal(signal.SIGALRM)
    with exit_within(3, 1000.0):
        assert signal.getitimer(signal.ITIMER_REAL)[0] > 0.0
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
    assert signal.getsignal(signal.SIGALRM) == before


class Graph:
    """A node's look at a graph in which somebody leaves with each look, so many times."""

    def __init__(self, leave, there=True):
        self.looks, self.leave = 0, leave
        self.context = SimpleNamespace(ok=lambda: there)

    def get_node_names_and_namespaces(self):
        self.looks += 1
        return [(f"node{i}", "/") for i in range(max(self.leave - self.looks, 0))]

    def get_topic_names_and_types(self):
        return [("/odom", [])]

    def count_publishers(self, name):
        return 1

    count_subscribers = count_publishers


@pytest.mark.parametrize(("leave", "looks"), [(0, 6), (5, 10), (1000, 51)])
def test_one_waits_until_nobody_leaves_but_not_for_ever(monkeypatch, leave, looks):
    now = [0.0]
    clock = SimpleNamespace(
        monotonic=lambda: round(now[0], 6), sleep=lambda s: now.__setitem__(0, now[0] + s)
    )
    monkeypatch.setattr(node_process, "time", clock)
    graph = Graph(leave)
    wait_for_dds_shutdown(graph)
    assert abs(graph.looks - looks) <= 1


def test_where_ros_has_ended_nobody_is_waited_for():
    graph = Graph(5, there=False)
    wait_for_dds_shutdown(graph)
    assert graph.looks == 0
