# SPDX-License-Identifier: Apache-2.0
"""Every node survives every path through its life cycle, against the design of managed nodes."""

import itertools

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test
from lifecycle_msgs.msg import State, Transition

KINDS = (
    'scenario', 'recorder', 'live_view', 'outer_loop', 'inner_loop', 'observer', 'plant'
)  # fmt: skip
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
UNCONFIGURED, INACTIVE = State.PRIMARY_STATE_UNCONFIGURED, State.PRIMARY_STATE_INACTIVE
ACTIVE, FINALIZED = State.PRIMARY_STATE_ACTIVE, State.PRIMARY_STATE_FINALIZED
EDGES = {
    (UNCONFIGURED, CONFIGURE): INACTIVE,
    (INACTIVE, CLEANUP): UNCONFIGURED,
    (INACTIVE, ACTIVATE): ACTIVE,
    (ACTIVE, DEACTIVATE): INACTIVE,
    (UNCONFIGURED, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN): FINALIZED,
    (INACTIVE, Transition.TRANSITION_INACTIVE_SHUTDOWN): FINALIZED,
    (ACTIVE, Transition.TRANSITION_ACTIVE_SHUTDOWN): FINALIZED,
}
"""Design of managed nodes (design.ros2.org, node_lifecycle): what a supervisor may ask for."""
NUMBERS = (CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE)
LABELS = {CONFIGURE: "configure", CLEANUP: "cleanup", ACTIVATE: "activate"}
LABELS |= {DEACTIVATE: "deactivate", 5: "shutdown", 6: "shutdown", 7: "shutdown"}


NODES = st.sampled_from(sorted(KINDS))


def entities(node):
    """How many things a node has in the graph: none may pile up, stage after stage."""
    kinds = (node.publishers, node.subscriptions, node.timers, node.services, node.clients)
    return *(len(list(kind)) for kind in kinds), len(node._managed_entities)


class Lives(RuleBasedStateMachine):
    """The whole graph, whose nodes are told to change their states in any order, in flight too."""

    crew_of = None

    def __init__(self):
        super().__init__()
        self.crew = self.crew_of(*KINDS)
        self.expected = dict.fromkeys(KINDS, UNCONFIGURED)
        self.entities_of = {}

    def _change(self, name, number, label=""):
        state = self.expected[name]
        if label:
            number = next((n for n, word in LABELS.items() if word == label), 0)
            if label == "shutdown":
                number = {UNCONFIGURED: 5, INACTIVE: 6, ACTIVE: 7}.get(state, 0)
        goal = EDGES.get((state, number))
        done = self.crew.change(name, number, label)
        node = self.crew.nodes[name]
        assert done == (goal is not None), (name, state, number, label, node.failure)
        self.expected[name] = goal or state

    @rule(name=NODES, number=st.sampled_from([1, 2, 3, 4, 1, 2, 3, 4, 5, 6, 7]))
    def change(self, name, number):
        self._change(name, number)

    @rule(name=NODES, number=st.integers(0, 255))
    def change_to_anything(self, name, number):
        self._change(name, number)

    @rule(name=NODES, label=st.sampled_from([*LABELS.values(), "destroy", "transition_success"]))
    def change_by_label(self, name, label):
        self._change(name, 0, label)

    @rule(name=NODES, steps=st.integers(1, 4))
    def go_on(self, name, steps):
        """The next of the usual steps, so that most nodes are up most of the time."""
        for _ in range(steps):
            number = {UNCONFIGURED: 1, INACTIVE: 3, ACTIVE: 4}.get(self.expected[name])
            if number:
                self._change(name, number)

    @rule()
    def bring_all_up(self):
        for number, state in ((1, UNCONFIGURED), (3, INACTIVE)):
            for name in KINDS:
                if self.expected[name] == state:
                    self._change(name, number)

    @rule(ticks=st.integers(1, 10))
    def fly(self, ticks):
        if self.expected["plant"] == ACTIVE:
            self.crew.fly(ticks)

    @rule(name=NODES)
    def start_the_process_again(self, name):
        if self.expected[name] == FINALIZED:
            self.crew.leave(name)
            self.crew.join(name)
            self.expected[name] = UNCONFIGURED

    @rule(gamma=st.sampled_from([5.0, 4.3, 0.5]))
    def tune(self, gamma):
        """An unconfigured node takes what its table allows, and judges it when it is configured."""
        state = self.expected["inner_loop"]
        if gamma > 4.0 or state in (INACTIVE, ACTIVE):
            (result,) = self.crew.set("inner_loop", output__gamma=gamma)
            assert result.successful == (gamma > 4.0), result.reason

    @invariant()
    def states_are_those_of_the_design(self):
        for name, state in self.expected.items():
            node = self.crew.nodes[name]
            assert self.crew.state(name) == state, name
            assert node.configured == (state in (INACTIVE, ACTIVE)), name
            assert node._active == (state == ACTIVE), name
            assert node.finished == (state == FINALIZED), name
            assert entities(node) == self.entities_of.setdefault((name, state), entities(node)), (
                name
            )

    def teardown(self):
        self.crew.close()


@pytest.mark.parametrize(
    "search",
    [
        pytest.param((5, 40, True), id="short", marks=pytest.mark.slow),
        pytest.param((300, 80, False), id="long", marks=pytest.mark.nightly),
    ],
    indirect=True,
)
@pytest.mark.timeout(7200)
def test_any_path_of_any_node_in_flight_and_before(crew, monkeypatch, search):
    # Nodes that were paused leave gaps, which nobody will fill: no need to wait for repetitions.
    monkeypatch.setattr("heli_bags.node._REPEAT_S", 0.2)

    class Here(Lives):
        crew_of = staticmethod(crew)

    # To shrink a path takes minutes, as each example opens a graph.
    once = settings(search, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    run_state_machine_as_test(Here, settings=once)


def walk():
    """Transitions from unconfigured on: in them all sequences of three, begun in every state.

    Each step is the end of one sequence and the middle of the next ones, so that a fifth of the
    transitions is enough that one sequence after the other would take.
    """
    missing = {
        (state, *three)
        for state in (UNCONFIGURED, INACTIVE, ACTIVE)
        for three in itertools.product(NUMBERS, repeat=3)
    }
    path, states = [], [UNCONFIGURED]
    while missing:
        for tail in itertools.chain.from_iterable(
            itertools.product(NUMBERS, repeat=length) for length in itertools.count(1)
        ):
            ahead, reached = path[-2:], states[-3:]
            for number in tail:
                ahead = [*ahead, number]
                reached = [*reached, EDGES.get((reached[-1], number), reached[-1])]
            new = {(reached[i], *ahead[i : i + 3]) for i in range(len(ahead) - 2)} & missing
            if new:
                missing -= new
                path += tail
                states += reached[-len(tail) :]
                break
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_path_of_a_node_by_itself(crew, name):
    """All sequences of three transitions from every state, of which most are refused."""
    one, state = crew(name), UNCONFIGURED
    for at, number in enumerate(walk()):
        goal = EDGES.get((state, number))
        assert one.change(name, number) == (goal is not None), (at, number)
        state = goal or state
        assert one.state(name) == state, (at, number)
