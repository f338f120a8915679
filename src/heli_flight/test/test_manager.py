# SPDX-License-Identifier: Apache-2.0
"""Nodes are led together: in which order, who is lost and comes back, who is reset. No graph."""

import itertools

import pytest
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.task import Future

from heli_flight.graph.lifecycle import ASK_AGAIN_S, TRANSITIONS, Answers
from heli_flight.graph.manager import (
    ACTIVATE,
    CLEANUP,
    CONFIGURE,
    DEACTIVATE,
    SHUTDOWN,
    Manager,
    Order,
    SystemCommand,
    SystemState,
    is_needed,
)
from heli_msgs_bridge.diagnostics import Level, NodeState

NAMES = ["observer", "inner_loop", "plant"]
VALUES = {
    "node_names": tuple(NAMES),
    "bond_timeout": 4.0,
    "attempt_respawn_reconnection": True,
    "bond_respawn_max_duration": 10.0,
    "service_timeout": 60.0,
    "lockstep": False,
    "peer_timeout_s": 10.0,
}
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
SAID = {UNCONFIGURED: NodeState.UNCONFIGURED, INACTIVE: NodeState.CONFIGURED,
        ACTIVE: NodeState.RUNNING}  # fmt: skip


class Graph:
    """Nodes that do at once what they are told, unless they are dead; a clock; a manager."""

    def __init__(self, **changes):
        self.now_s, self.asked, self.told = 0.0, [], []
        self.states = dict.fromkeys(NAMES, UNCONFIGURED)
        self.dead, self.refusing, self.absent = set(), set(), set()
        self.answers = []
        self.manager = Manager(
            {**VALUES, **changes}, self, lambda *said: self.told.append(said),
            lambda name: f"{name} does not want to", lambda: self.now_s,
        )  # fmt: skip

    def missing(self):
        return sorted(self.absent)

    def ask_state(self, name):
        future = Future()
        if name not in self.dead:
            future.set_result(GetState.Response(current_state=State(id=self.states[name])))
        return future

    def begin(self, names, transition):
        futures = {}
        for name in names:
            self.asked.append((name, transition))
            futures[name] = Future()
            if name in self.dead:
                continue
            success = name not in self.refusing
            if success:
                self.states[name] = TRANSITIONS[transition][1]
            futures[name].set_result(ChangeState.Response(success=success))
        target = TRANSITIONS[transition][1]
        return Answers(futures, self.ask_state, target, lambda: self.now_s)

    def command(self, command):
        self.asked.clear()
        self.manager.give(Order(command, lambda *answer: self.answers.append(answer)))

    def up(self):
        self.command(SystemCommand.STARTUP)
        assert self.manager.state == SystemState.ACTIVE
        self.speak()
        self.asked.clear()
        return self

    def speak(self, *silent):
        """All who live say where they are."""
        for name in set(NAMES) - self.dead - set(silent):
            self.manager.heard(name, SAID[self.states[name]])

    def wait(self, seconds):
        """Time goes by second by second; who lives speaks."""
        for _ in range(seconds):
            self.now_s += 1.0
            self.speak()
            self.manager.advance()


@pytest.fixture
def graph():
    return Graph()


def test_startup_configures_all_then_activates_in_order(graph):
    graph.command(SystemCommand.STARTUP)
    configured, activated = ([(name, t) for name in NAMES] for t in (CONFIGURE, ACTIVATE))
    assert graph.asked == configured + activated
    assert graph.manager.state == SystemState.ACTIVE
    assert [success for success, _ in graph.answers] == [True]


@pytest.mark.parametrize(
    ("command", "transitions", "state"),
    [(SystemCommand.PAUSE, [DEACTIVATE], SystemState.INACTIVE),
     (SystemCommand.RESET, [DEACTIVATE, CLEANUP], SystemState.UNCONFIGURED),
     (SystemCommand.SHUTDOWN, [DEACTIVATE, CLEANUP, SHUTDOWN], SystemState.FINALIZED)],
)  # fmt: skip
def test_down_goes_in_reverse(graph, command, transitions, state):
    graph.up().command(command)
    assert graph.asked == [(name, t) for t in transitions for name in reversed(NAMES)]
    assert graph.manager.state == state


def test_resume_activates_in_order_and_bonds_again(graph):
    graph.up().command(SystemCommand.PAUSE)
    graph.wait(20)
    assert graph.manager.state == SystemState.INACTIVE
    graph.command(SystemCommand.RESUME)
    assert graph.asked == [(name, ACTIVATE) for name in NAMES]
    graph.dead.add("plant")
    graph.wait(5)
    assert graph.manager.state == SystemState.RECONNECTING


def test_who_is_there_already_is_not_asked(graph):
    graph.states |= {"observer": INACTIVE, "plant": ACTIVE}
    graph.command(SystemCommand.STARTUP)
    assert graph.asked == [("inner_loop", CONFIGURE), ("observer", ACTIVATE),
                           ("inner_loop", ACTIVATE)]  # fmt: skip


@pytest.mark.parametrize("transition", TRANSITIONS)
@pytest.mark.parametrize("state", [UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED])
def test_a_transition_is_needed_where_the_life_cycle_has_it(transition, state):
    """Design article "Managed nodes" of ROS 2: from which state each leads to which."""
    leads = {(CONFIGURE, UNCONFIGURED), (ACTIVATE, INACTIVE), (ACTIVATE, UNCONFIGURED),
             (DEACTIVATE, ACTIVE), (CLEANUP, INACTIVE), (CLEANUP, ACTIVE),
             (SHUTDOWN, UNCONFIGURED), (SHUTDOWN, INACTIVE), (SHUTDOWN, ACTIVE)}  # fmt: skip
    assert is_needed(transition, state) == ((transition, state) in leads)


def test_resume_of_what_is_not_configured_is_refused(graph):
    graph.command(SystemCommand.RESUME)
    assert graph.answers == [(False, "observer: is not configured")]
    assert graph.manager.state == SystemState.FAILED and graph.asked == []


def test_who_refuses_is_named_with_its_own_words(graph):
    graph.refusing.add("inner_loop")
    graph.command(SystemCommand.STARTUP)
    sentence = "inner_loop: refused to configure: inner_loop does not want to"
    assert graph.answers == [(False, sentence)]
    assert graph.told[-1] == (Level.ERROR, sentence, SystemState.FAILED)


def test_startup_waits_for_who_is_not_there_and_says_so(graph):
    graph.absent.add("plant")
    graph.command(SystemCommand.STARTUP)
    graph.wait(100)
    assert graph.asked == [] and "waiting for plant" in graph.told[-1][1]
    graph.absent.clear()
    graph.manager.advance()
    assert graph.manager.state == SystemState.ACTIVE


def test_a_second_command_waits_for_the_first(graph):
    graph.absent.add("plant")
    graph.command(SystemCommand.STARTUP)
    with pytest.raises(ValueError, match="pause: startup is under way"):
        graph.command(SystemCommand.PAUSE)


def test_who_never_answers_is_named(graph):
    graph.dead.add("observer")
    graph.command(SystemCommand.STARTUP)
    graph.wait(61)
    (answer,) = graph.answers
    assert answer == (False, "observer: no answer to 'configure' in 60 s")


def test_nodes_that_speak_are_not_lost(graph):
    graph.up().wait(1000)
    assert graph.manager.state == SystemState.ACTIVE and graph.asked == []


def test_who_is_silent_for_the_bonds_time_is_lost(graph):
    graph.up().dead.add("observer")
    graph.wait(4)
    assert graph.manager.state == SystemState.ACTIVE
    graph.wait(1)
    assert graph.manager.state == SystemState.RECONNECTING
    level, sentence, _ = graph.told[-1]
    assert level == Level.ERROR and "observer" in sentence and "4 s" in sentence
    assert graph.asked == []


def test_who_is_lost_and_started_again_is_brought_up_alone(graph):
    graph.up().dead.add("observer")
    graph.wait(6)
    graph.dead.clear()
    graph.states["observer"] = UNCONFIGURED
    graph.wait(1)
    assert graph.asked == [("observer", CONFIGURE), ("observer", ACTIVATE)]
    assert graph.manager.state == SystemState.ACTIVE
    graph.wait(100)
    assert graph.manager.state == SystemState.ACTIVE


@pytest.mark.parametrize("noticed", ["by its state", "by the launch"])
def test_a_restart_is_noticed_at_once(graph, noticed):
    graph.up()
    graph.states["inner_loop"] = UNCONFIGURED
    if noticed == "by the launch":
        graph.manager.restarted("inner_loop")
        assert graph.manager.state == SystemState.RECONNECTING
        graph.now_s += 0.1
    graph.speak()
    assert graph.asked == [("inner_loop", CONFIGURE), ("inner_loop", ACTIVATE)]
    assert graph.manager.state == SystemState.ACTIVE


def test_who_was_only_held_up_needs_nothing(graph):
    graph.up().dead.add("observer")
    graph.wait(6)
    graph.dead.clear()
    graph.wait(1)
    assert graph.manager.state == SystemState.ACTIVE and graph.asked == []


@pytest.mark.parametrize(("reconnects", "waits_s"), [(True, 16), (False, 5)])
def test_who_does_not_come_back_takes_the_others_down(reconnects, waits_s):
    graph = Graph(attempt_respawn_reconnection=reconnects).up()
    graph.dead.add("observer")
    graph.wait(waits_s)
    others = ["plant", "inner_loop"]
    assert graph.asked == [(name, t) for t in (DEACTIVATE, CLEANUP) for name in others]
    assert graph.manager.state == SystemState.FAILED
    assert graph.told[-1][0] == Level.ERROR and "observer" in graph.told[-1][1]


def test_in_lockstep_time_stands_still_until_who_is_lost_is_back():
    graph = Graph(lockstep=True).up()
    graph.dead.add("observer")
    graph.wait(5)
    assert graph.asked == [("plant", DEACTIVATE)]
    graph.wait(3)
    graph.dead.clear()
    graph.states["observer"] = UNCONFIGURED
    graph.wait(1)
    assert graph.asked[1:] == [("observer", CONFIGURE), ("observer", ACTIVATE), ("plant", ACTIVATE)]
    assert graph.manager.state == SystemState.ACTIVE
    graph.wait(100)
    assert graph.manager.state == SystemState.ACTIVE


@pytest.mark.parametrize("lost", ["observer", "plant"])
def test_in_lockstep_who_does_not_come_back_takes_the_others_down(lost):
    graph = Graph(lockstep=True).up()
    graph.dead.add(lost)
    graph.wait(16)
    left = {name: UNCONFIGURED for name in NAMES if name != lost}
    assert {name: graph.states[name] for name in left} == left
    assert graph.manager.state == SystemState.FAILED and lost in graph.told[-1][1]


def test_in_lockstep_a_loss_is_told_though_time_cannot_be_stopped():
    graph = Graph(lockstep=True).up()
    graph.dead |= {"observer", "plant"}
    graph.wait(6)
    graph.dead.remove("observer")
    graph.states["observer"] = UNCONFIGURED
    graph.wait(200)
    assert graph.manager.state == SystemState.FAILED


def test_who_comes_back_and_refuses_takes_the_others_down(graph):
    graph.up().refusing.add("observer")
    graph.states["observer"] = UNCONFIGURED
    graph.speak()
    assert graph.manager.state == SystemState.FAILED
    assert graph.states == dict.fromkeys(NAMES, UNCONFIGURED)
    assert "does not want to" in graph.told[-1][1]


def test_after_a_loss_all_can_be_started_anew(graph):
    graph.up().dead.add("observer")
    graph.wait(20)
    graph.dead.clear()
    graph.command(SystemCommand.STARTUP)
    assert graph.manager.state == SystemState.ACTIVE and graph.answers[-1][0]


def test_what_was_said_before_the_activation_is_no_restart(graph):
    """/diagnostics comes by another way than the answer to the transition, and may come later."""
    graph.command(SystemCommand.STARTUP)
    graph.manager.heard("observer", NodeState.CONFIGURED)
    assert graph.manager.state == SystemState.ACTIVE


def test_who_has_finished_is_not_missed(graph):
    graph.up().manager.heard("observer", NodeState.FINISHED)
    graph.dead.add("observer")
    graph.wait(100)
    assert graph.manager.state == SystemState.ACTIVE and graph.asked == []


def test_when_the_last_has_finished_it_alone_is_shut_down(graph):
    """The plant's process ends then, as that of one that has started itself."""
    graph.up().manager.heard("plant", NodeState.FINISHED)
    assert graph.asked == [("plant", t) for t in (DEACTIVATE, CLEANUP, SHUTDOWN)]
    graph.dead.add("plant")
    graph.wait(100)
    assert graph.manager.state == SystemState.INACTIVE


def test_without_a_bond_nobody_is_lost():
    graph = Graph(bond_timeout=0.0).up()
    graph.dead |= set(NAMES)
    graph.wait(100)
    assert graph.manager.state == SystemState.ACTIVE


def test_a_lost_answer_is_asked_for_again(graph):
    """rmw drops an answer when the asker's reader is not known yet."""
    lost = itertools.chain([True], itertools.repeat(False))
    ask = graph.ask_state
    graph.ask_state = lambda name: Future() if next(lost) else ask(name)
    graph.command(SystemCommand.STARTUP)
    assert graph.asked == []
    graph.now_s += ASK_AGAIN_S
    graph.manager.advance()
    graph.manager.advance()
    assert graph.manager.state == SystemState.ACTIVE


@pytest.mark.parametrize(
    ("changes", "key"),
    [({"node_names": ("plant", "plant")}, "node_names"), ({"node_names": ("",)}, "node_names"),
     ({"bond_timeout": 0.5}, "bond_timeout"), ({"bond_timeout": 1.0}, "bond_timeout"),
     ({"lockstep": True, "bond_timeout": 10.0}, "bond_timeout")],
)  # fmt: skip
def test_bad_values_are_named(changes, key):
    with pytest.raises(ValueError, match=f"^{key}: "):
        Graph(**changes)
