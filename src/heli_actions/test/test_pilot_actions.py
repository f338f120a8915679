# SPDX-License-Identifier: Apache-2.0
"""The pilot over the actions: the node that serves them, an outer loop of a few lines.

Whole numbers stand in for the types: each is the place of what was meant in a list.
"""

import queue
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
import rclpy
from rclpy.action import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from test_msgs.action import Fibonacci

from heli_actions import FlightNotHeard, FlightSilent, GoalCanceled, GoalRefused, Pilot
from heli_actions.goals import Kind
from heli_actions.interfaces import PREFIX, Interfaces
from heli_actions.node import ActionsNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import GoalState

LIMIT_S = 120.0


class StandIns(Interfaces):
    meant = []

    def __init__(self):
        super().__init__(dict.fromkeys(Kind, Fibonacci), String)

    def _number(self, what):
        self.meant.append(what)
        return len(self.meant) - 1

    def goal(self, request):
        return Fibonacci.Goal(order=self._number(request))

    def order(self, kind, goal, now_ns):
        return self.meant[goal.order]

    def feedback(self, kind, feedback):
        return Fibonacci.Feedback(sequence=[self._number(feedback)])

    def status(self, status):
        return String(data=repr(status))

    def read_feedback(self, kind, message):
        return self.meant[message.sequence[0]]

    def result(self, kind, outcome, code, sentence, cause):
        return Fibonacci.Result(sequence=[self._number((code, sentence, cause))])

    def read_result(self, kind, message):
        return self.meant[message.sequence[0]]


class Actions(ActionsNode):
    def interfaces(self):
        return StandIns()


@pytest.fixture
def served(bench, ros_context):
    """A node that serves the actions, in a thread."""
    made = bench(Actions)
    made.fly()
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(made.node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    yield
    executor.shutdown()
    thread.join()


@pytest.fixture
def pilot(ros_context, outer_loop, served):
    with Pilot(context=ros_context, actions=True, interfaces=StandIns(), wait_s=LIMIT_S) as one:
        assert one.over_actions
        yield one


def test_a_takeoff_is_done_and_a_goto_refused(pilot, outer_loop):
    with ThreadPoolExecutor(1) as pool:
        flown = pool.submit(pilot.takeoff, 6.5)
        assert outer_loop.fly("takeoff", "hover", (0.0, 0.0, 6.5)).argument == 6.5
        assert flown.result(LIMIT_S) == "takeoff: done, mode hover"
        flown = pool.submit(pilot.goto, 900.0, 0.0, 5.0)
        outer_loop.answer(outer_loop.next_goal(), GoalState.REFUSED, "goto: too far", "DISTANCE")
        with pytest.raises(GoalRefused, match="too far") as caught:
            flown.result(LIMIT_S)
    assert caught.value.cause == "DISTANCE"


def test_it_tells_where_it_is_and_can_be_cancelled(pilot, outer_loop):
    told = queue.Queue()
    goal = pilot.goto(30.0, 0.0, 5.0, wait=False, on_feedback=told.put)
    asked = outer_loop.next_goal()
    outer_loop.mode = "trajectory"
    outer_loop.answer(asked, GoalState.ACTIVE, end=[0.0, 30.0, -5.0], lasts_s=1e6)
    assert told.get(timeout=LIMIT_S).left_m > 30.0
    goal.cancel()
    hold = outer_loop.next_goal()
    assert hold.command == "hold"
    outer_loop.answer(hold, GoalState.SUCCEEDED, "hold: to here")
    with pytest.raises(GoalCanceled):
        goal.result(LIMIT_S)


def test_the_aircrafts_state_is_told_with_its_types(ros_context, outer_loop, served):
    told, node = queue.Queue(), rclpy.create_node("watcher", context=ros_context)
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, topics.STATUS, told.put, qos)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    while told.empty():
        executor.spin_once(timeout_sec=1.0)
    assert "mode='standing'" in told.get().data
    executor.shutdown()
    node.destroy_node()


def test_who_serves_may_go(ros_context, outer_loop):
    """Its process ends in the midst of a goal that it has taken."""
    node, taken = rclpy.create_node("actions", context=ros_context), threading.Event()
    servers = [
        ActionServer(
            node, Fibonacci, f"{PREFIX}/{kind}", lambda handle: None,
            handle_accepted_callback=lambda handle: taken.set(),
        )
        for kind in Kind
    ]  # fmt: skip
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    with Pilot(context=ros_context, actions=True, interfaces=StandIns(), wait_s=LIMIT_S) as pilot:
        goal = pilot.land(wait=False)
        assert taken.wait(LIMIT_S)
        executor.shutdown()
        thread.join()
        for server in servers:
            server.destroy()
        node.destroy_node()
        with pytest.raises(FlightSilent, match="nobody serves actions/land"):
            goal.result(LIMIT_S)


def test_unless_somebody_serves_the_topic_is_taken(ros_context, outer_loop):
    with Pilot(context=ros_context, interfaces=StandIns(), wait_s=LIMIT_S) as pilot:
        assert not pilot.over_actions
    with pytest.raises(FlightNotHeard, match="nobody serves the actions"):
        Pilot(context=ros_context, actions=True, interfaces=StandIns(), wait_s=1.0)
