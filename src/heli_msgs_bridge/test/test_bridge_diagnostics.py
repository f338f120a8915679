# SPDX-License-Identifier: Apache-2.0
"""What a node says on /diagnostics: how often, of which aircraft, at what time."""

import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_core.ticks import NS_PER_S, TICKS_PER_S
from heli_msgs_bridge.diagnostics import (
    FACT_STATE,
    Level,
    NodeState,
    Reporter,
    hardware_of,
    refusal_of,
    refusal_text,
    state_of,
)
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec

LIMIT_S = 120.0


class Idle(ManagedNode[None, None]):
    """Does nothing, and says so."""

    SPEC = NodeSpec("idle", "heli_core", (), "common.yaml")

    def configure(self):
        return None


@pytest.fixture
def watched_node(ros_context):
    """A node in a namespace that nothing happens to: what it says, and when it was sent, s."""
    values = load(with_common(()), [config_folder("heli_core") / "common.yaml"], "idle")
    node = Idle(values | {"peers": []}, context=ros_context, namespace="heli2")
    listener = rclpy.create_node("listener", context=ros_context)
    executor, heard = SingleThreadedExecutor(context=ros_context), []

    def hear(message, info):
        heard.append((info["source_timestamp"] / NS_PER_S, message))

    listener.create_subscription(DiagnosticArray, "/diagnostics", hear, 10)
    executor.add_node(node)
    executor.add_node(listener)

    def wait_for(count):
        deadline = time.monotonic() + LIMIT_S
        while len(heard) < count:
            assert time.monotonic() < deadline, f"{len(heard)} messages"
            executor.spin_once(timeout_sec=1.0)
        return heard[:count]

    yield node, wait_for
    executor.shutdown()
    node.end()
    node.destroy_node()
    listener.destroy_node()


@pytest.mark.slow
def test_a_node_whose_time_stands_still_speaks_once_a_second(watched_node):
    _, wait_for = watched_node
    times = [at for at, _ in wait_for(6)]
    # A crowded machine makes one late, and so the period after it short.
    assert 0.8 < np.median(np.diff(times)) < 1.5, times


def test_a_status_is_of_an_aircraft_and_of_now(watched_node):
    node, wait_for = watched_node
    node.tick = 700
    (_, message) = wait_for(1)[0]
    (status,) = message.status
    assert (status.name, status.hardware_id) == ("heli2/idle", "heli2")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (8, 0)


def test_hardware_is_named_without_a_namespace_too():
    assert hardware_of("/") == "helicopter"
    assert hardware_of("/fleet/heli2") == "fleet/heli2"


class Kept:
    def __init__(self):
        self.stamps = []

    def publish(self, array):
        stamp = array.header.stamp
        self.stamps.append(stamp.sec * NS_PER_S + stamp.nanosec)


def test_a_flying_node_speaks_once_a_second_of_its_own_time():
    """However fast the flight goes; and then it need not be repeated by the wall clock."""
    sink = Kept()
    reporter = Reporter(sink, "node", "helicopter")
    assert reporter.was_silent()
    for tick in range(10 * TICKS_PER_S):
        if reporter.is_due(tick, Level.OK, "flying", NodeState.RUNNING):
            reporter.publish(tick * NS_PER_S // TICKS_PER_S, tick, Level.OK, "flying", {})
    assert sink.stamps == [second * NS_PER_S for second in range(10)]
    assert not reporter.was_silent() and reporter.was_silent()


def test_a_change_of_state_alone_is_said_at_once():
    reporter = Reporter(Kept(), "node", "helicopter")
    reporter.publish(0, 1, Level.ERROR, "gaps", {}, NodeState.RUNNING)
    assert not reporter.is_due(2, Level.ERROR, "gaps", NodeState.RUNNING)
    assert reporter.is_due(2, Level.ERROR, "gaps", NodeState.INACTIVE)


@pytest.mark.parametrize(
    ("message", "state"),
    [
        ("unconfigured", NodeState.UNCONFIGURED), ("configured", NodeState.CONFIGURED),
        ("active", NodeState.ACTIVE), ("inactive", NodeState.INACTIVE),
        ("waiting for observer to get ready", NodeState.WAITING),
        ("no message on 'imu' from plant: going on without", NodeState.WITHOUT_INPUT),
        ("the flight is over", NodeState.FINISHED), ("flying", NodeState.RUNNING),
    ],
)  # fmt: skip
def test_the_state_is_a_key_and_in_bags_from_before_it_a_sentence(message, state):
    assert state_of({}, message) == state
    assert state_of({FACT_STATE: "finished"}, message) == NodeState.FINISHED


@pytest.mark.parametrize("why", ["goto: far; allowed: 2 m", "a; b; 3", ""])
def test_a_refusal_comes_back_out_of_its_text(why):
    assert refusal_of(refusal_text(3, why)) == (3, why)
    assert refusal_of("none") == (0, "")
