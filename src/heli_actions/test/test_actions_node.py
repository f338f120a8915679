# SPDX-License-Identifier: Apache-2.0
"""The node alone, no flight beside it; whole numbers stand in for its types."""

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from test_msgs.action import Fibonacci

from heli_actions.goals import Code, GoalRequest, Kind
from heli_actions.interfaces import Interfaces
from heli_actions.node import ActionsNode
from heli_msgs_bridge.diagnostics import FACT_GOALS, GoalAnswer, GoalState, goals_text
from heli_msgs_bridge.layouts import MessageError

LIMIT_S = 120.0


class StandIns(Interfaces):
    """A goal of order 7 is none; a result says its code."""

    def __init__(self):
        super().__init__(dict.fromkeys(Kind, Fibonacci))

    def order(self, kind, goal, now_ns):
        if goal.order == 7:
            raise MessageError("seven; allowed: others")
        return GoalRequest(kind)

    def result(self, kind, outcome, code, sentence, cause):
        return Fibonacci.Result(sequence=[int(code)])


class Actions(ActionsNode):
    def interfaces(self):
        return StandIns()


@pytest.fixture
def alone(bench, ros_context):
    """A node that is active, a client of its take-off, and what both are spun by."""
    made = bench(Actions)
    made.fly()
    node = made.node
    pilot = rclpy.create_node("pilot", context=ros_context)
    client = ActionClient(pilot, Fibonacci, "actions/takeoff")
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    executor.add_node(pilot)

    def wait(future):
        executor.spin_until_future_complete(future, LIMIT_S)
        return future.result()

    assert client.wait_for_server(LIMIT_S)
    yield node, client, wait
    executor.shutdown()
    pilot.destroy_node()


def test_deactivated_it_lets_go_of_its_goals_and_takes_none(alone):
    node, client, wait = alone
    handle = wait(client.send_goal_async(Fibonacci.Goal(order=1)))
    assert handle.accepted  # it waits for an outer loop that is not there
    node.trigger_deactivate()
    ended = wait(handle.get_result_async())
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert list(ended.result.sequence) == [Code.CLOSED]
    assert not wait(client.send_goal_async(Fibonacci.Goal(order=1))).accepted


def test_what_is_no_goal_is_refused_with_a_result(alone):
    _, client, wait = alone
    handle = wait(client.send_goal_async(Fibonacci.Goal(order=7)))
    ended = wait(handle.get_result_async())
    assert ended.status == GoalStatus.STATUS_ABORTED
    assert list(ended.result.sequence) == [Code.REFUSED]


def test_limits_change_in_flight(alone):
    node, *_ = alone
    (result,) = node.set_parameters([rclpy.Parameter("answer_s", value=7.5)])
    assert result.successful and node.core.manager.limits.answer_s == 7.5


def test_a_refusal_of_an_outer_loop_that_has_never_flown_is_heard(alone):
    """It tells no mode yet, but answers goals."""
    node, client, wait = alone
    handle = wait(client.send_goal_async(Fibonacci.Goal(order=1)))
    (goal,) = node.core.manager.goals
    answer = GoalAnswer(goal.key, "takeoff", GoalState.REFUSED, "takeoff: not active")
    facts = [KeyValue(key=FACT_GOALS, value=goals_text([answer]))]
    node._on_diagnostics(DiagnosticArray(status=[DiagnosticStatus(name="outer", values=facts)]))
    ended = wait(handle.get_result_async())
    assert list(ended.result.sequence) == [Code.REFUSED]
