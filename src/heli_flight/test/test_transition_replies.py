# SPDX-License-Identifier: Apache-2.0
"""Answers to a transition, of which one is lost on the way: the node's state counts then."""

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.task import Future

from heli_flight.graph.lifecycle import ASK_AGAIN_S, Answers

INACTIVE, UNCONFIGURED = State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_UNCONFIGURED


class Graph:
    """Nodes that answer when the test says so, and a clock."""

    def __init__(self, *names):
        self.now_s = 0.0
        self.changes = {name: Future() for name in names}
        self.asked = []
        self.answers = Answers(self.changes, self.ask, INACTIVE, lambda: self.now_s)

    def ask(self, name):
        self.asked.append((name, Future()))
        return self.asked[-1][1]

    def change(self, name, success=True):
        self.changes[name].set_result(ChangeState.Response(success=success))

    def state(self, number, state):
        self.asked[number][1].set_result(GetState.Response(current_state=State(id=state)))


def test_replies_that_come_are_enough():
    graph = Graph("plant", "observer")
    assert not graph.answers.complete() and graph.answers.silent() == ["plant", "observer"]
    graph.change("plant")
    graph.change("observer")
    graph.now_s = 10.0 * ASK_AGAIN_S
    assert graph.answers.complete() and graph.asked == [] and graph.answers.refused() == []


def test_who_refuses_is_named():
    graph = Graph("plant", "observer")
    graph.change("plant")
    graph.change("observer", success=False)
    assert graph.answers.complete() and graph.answers.refused() == ["observer"]


def test_a_lost_answer_is_replaced_by_the_state():
    graph = Graph("plant", "observer")
    graph.change("plant")
    graph.now_s = 0.9 * ASK_AGAIN_S
    assert not graph.answers.complete() and graph.asked == []
    graph.now_s = ASK_AGAIN_S
    assert not graph.answers.complete() and [name for name, _ in graph.asked] == ["observer"]
    graph.state(0, INACTIVE)
    assert graph.answers.complete() and graph.answers.silent() == graph.answers.refused() == []


def test_a_state_from_before_the_transition_says_nothing():
    """A node that compiles for minutes has not begun; it is asked again, and nobody else."""
    graph = Graph("plant", "observer")
    graph.change("plant")
    graph.now_s = ASK_AGAIN_S
    graph.answers.complete()
    graph.state(0, UNCONFIGURED)
    assert not graph.answers.complete() and graph.answers.silent() == ["observer"]
    graph.now_s = 2.0 * ASK_AGAIN_S
    assert not graph.answers.complete() and len(graph.asked) == 2
    graph.change("observer")
    assert graph.answers.complete()


def test_a_lost_state_is_asked_for_again():
    graph = Graph("observer")
    for number in (1, 2, 3):
        graph.now_s = number * ASK_AGAIN_S
        assert not graph.answers.complete() and len(graph.asked) == number
    graph.state(2, INACTIVE)
    assert graph.answers.complete()
