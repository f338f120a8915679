# SPDX-License-Identifier: Apache-2.0
"""A node answers whatever it waits for: its kernels, its peers; peers come late, or not at all."""

import threading

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import GetAvailableTransitions, GetState
from rcl_interfaces.srv import GetParameters

from heli_bags.node import RecorderNode
from heli_dynamics_sim.node import PlantNode
from heli_flight.graph.lifecycle_manager_node import LifecycleManagerNode
from heli_flight.graph.scenario_node import ScenarioNode
from heli_inner_hinf.node import InnerLoopNode
from heli_live_view.node import LiveViewNode
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.lifecycle_node import NodeStartError
from heli_msgs_bridge.peers import begun_without
from heli_msgs_bridge.topics import ROTOR_SPEED
from heli_observer.node import ObserverNode

FLYING = ("plant", "observer", "inner_loop", "outer_loop")
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
LIMIT_S = 120.0
LONG_S = 3600.0


def answers(crew, name, times=20):
    """Ask a node for its state, its transitions and a parameter, so often; its states."""
    states = set()
    for _ in range(times):
        states.add(crew.state(name))
        crew.call(
            GetAvailableTransitions, f"/{name}/get_transition_graph",
            GetAvailableTransitions.Request(),
        )  # fmt: skip
        request = GetParameters.Request(names=["rate_hz"])
        (value,) = crew.call(GetParameters, f"/{name}/get_parameters", request).values
        assert value.integer_value == 100
    return states


@pytest.mark.parametrize("name", FLYING)
def test_one_that_waits_for_its_peers_is_active_and_answers(crew, name):
    """In /diagnostics it says for whom it waits; it may be left, and waits anew."""
    others = set(FLYING) - {name}
    one = crew(name, peers=list(FLYING), connect_timeout_s=LONG_S)
    node = one.nodes[name]
    # Alone it would begin by itself after a while: another one of the graph is there.
    other = one.join(*sorted(others)[:1]).nodes[sorted(others)[0]]
    for _ in range(2):
        one.bring_up(name)
        assert answers(one, name) == {State.PRIMARY_STATE_ACTIVE}
        assert not node.active and node.health.state == NodeState.WAITING
        missing = set(node.standing_facts()["missing_peers"].split(", "))
        assert missing and missing <= others
        assert all(peer in node.health.message for peer in missing)
        assert one.change(name, DEACTIVATE) and node.health.state == NodeState.INACTIVE
        assert one.change(name, CLEANUP)
    assert not other.configured
    one.bring_up(name)
    assert one.change(name, label="shutdown") and node.finished


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_plant_alone_flies_and_says_who_is_missing(crew, lockstep):
    """By the pace of the wall clock, on its fallback; those who come later fly it on."""
    one = crew(
        "plant", peers=list(FLYING), connect_timeout_s=0.1, lockstep=lockstep, duration_s=600.0,
        peer_timeout_s=60.0,
    )  # fmt: skip
    plant = one.nodes["plant"]
    one.bring_up("plant")
    one.spin_until(lambda: plant.tick >= 200)
    assert plant.missing == {"observer", "inner_loop", "outer_loop"}
    assert plant.health.level == Level.WARN and plant.health.state == NodeState.WITHOUT_INPUT
    assert plant.core.fallback.times == 1
    # Not faster than the wall clock: nobody waits for anybody.
    assert float(plant.health.facts["real_time_factor"]) < 1.2
    one.join("observer", "inner_loop", "outer_loop")
    one.bring_up("observer", "inner_loop", "outer_loop")
    one.spin_until(lambda: not plant.missing and not plant.core.pace.silent)
    flown = plant.core.fallback.ticks
    one.fly(300)
    assert plant.core.fallback.ticks == flown and not plant.core.over


def test_one_that_joins_in_flight_flies_though_the_plant_is_not_connected_to_it_yet(crew):
    """DDS connects topic by topic: the tick that the plant waits in may lack the rotor speed."""
    one = crew(
        "plant", peers=list(FLYING), connect_timeout_s=0.1, duration_s=600.0, peer_timeout_s=LONG_S
    )
    plant = one.nodes["plant"]
    one.bring_up("plant")
    one.spin_until(lambda: plant.tick >= 20)
    send = plant.core.send
    sent, send[ROTOR_SPEED] = send[ROTOR_SPEED], lambda row, stamp_ns: None
    one.join("observer", "inner_loop", "outer_loop")
    one.bring_up("observer", "inner_loop", "outer_loop")
    outer = one.nodes["outer_loop"]
    one.spin_until(lambda: outer.core.stepped is not None and not plant.core.pace.silent)
    one.fly(10)
    send[ROTOR_SPEED] = sent
    one.fly(10)
    assert not outer.core.pace.silent


def test_one_whose_peers_do_not_come_begins_without_them(crew):
    """Said as a warning, until they listen."""
    one = crew("observer", peers=["inner_loop"], connect_timeout_s=0.1)
    node = one.nodes["observer"]
    one.bring_up("observer")
    one.spin_until(lambda: node.active)
    assert node.missing == {"inner_loop"}
    assert node.health.level == Level.WARN
    assert node.health.message == begun_without({"inner_loop"})
    one.join("inner_loop")
    assert one.change("inner_loop", CONFIGURE)
    one.spin_until(lambda: not node.missing)
    assert "missing_peers" not in node.standing_facts()


def test_what_fails_after_the_wait_leaves_it_inactive(crew, monkeypatch):
    """As if the transition had failed, with the reason in /diagnostics."""

    def refuse(node):
        raise NodeStartError("the sky is closed")

    one = crew("observer", peers=["inner_loop"], connect_timeout_s=LONG_S)
    node = one.nodes["observer"]
    monkeypatch.setattr(ObserverNode, "engage", refuse)
    one.join("inner_loop").bring_up("observer")
    assert node.health.state == NodeState.WAITING
    assert one.change("inner_loop", CONFIGURE)
    one.spin_until(lambda: node.health.state == NodeState.FAILED)
    assert node.failure == node.health.message == "the sky is closed"
    assert one.state("observer") == State.PRIMARY_STATE_INACTIVE
    # It did not start itself: it is for whoever asked to try again.
    assert not node.not_started
    monkeypatch.undo()
    assert one.change("observer", ACTIVATE) and node.active


class Held:
    """A `configure` that goes on when it is let go."""

    def __init__(self, configure):
        self._configure, self.free = configure, threading.Event()
        self.thread = None

    def __call__(self, node):
        self.thread = threading.current_thread()
        assert self.free.wait(LIMIT_S)
        return self._configure(node)


@pytest.mark.parametrize(
    "kind",
    [ObserverNode, InnerLoopNode, PlantNode, RecorderNode, LiveViewNode, ScenarioNode,
     LifecycleManagerNode],
)  # fmt: skip
def test_one_that_is_being_configured_answers(crew, kind, monkeypatch):
    """Kernels and designs may take a minute; the state says so, and no transition is taken."""
    name, held = kind.SPEC.name, Held(kind.configure)
    monkeypatch.setattr(kind, "configure", lambda node: held(node))
    one = crew(name)
    node = one.nodes[name]
    change = one.ask_to_change(name, CONFIGURE)
    one.spin_until(lambda: held.thread is not None)
    assert held.thread is not threading.current_thread()
    assert answers(one, name) == {State.TRANSITION_STATE_CONFIGURING}
    for number in range(1, 8):
        assert not one.change(name, number)
    assert not one.change(name, label="transition_success")
    unchanged = one.ask_to_set(name, rate_hz=100)
    assert answers(one, name, 2) == {State.TRANSITION_STATE_CONFIGURING}
    assert not change.done() and not unchanged.done()
    held.free.set()
    one.spin_until(lambda: change.done() and unchanged.done())
    assert change.result().success and node.configured
    assert one.state(name) == State.PRIMARY_STATE_INACTIVE
    assert one.change(name, ACTIVATE)


def test_one_that_cannot_be_configured_says_why(crew, monkeypatch):
    """Beside the executor as in it."""

    def refuse(node):
        node.create_topic_publisher("odom")
        raise ValueError("no such filter")

    monkeypatch.setattr(ObserverNode, "configure", refuse)
    one = crew("observer")
    node = one.nodes["observer"]
    assert not one.change("observer", CONFIGURE)
    assert node.failure == "no such filter" and node.health.state == NodeState.FAILED
    assert one.state("observer") == State.PRIMARY_STATE_UNCONFIGURED and not node.outputs
    monkeypatch.undo()
    assert one.change("observer", CONFIGURE)
    assert one.call(GetState, "/observer/get_state", GetState.Request()).current_state.id == 2
