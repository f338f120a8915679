# SPDX-License-Identifier: Apache-2.0
"""`TickNode`: a real node, fed by the callbacks of its own subscriptions, message by message."""

import time
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.lifecycle import TransitionCallbackReturn

from heli_math.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.messages import CHANNELS
from heli_msgs_bridge.node_spec import NodeSpec
from heli_msgs_bridge.tick_node import Input, TickCore, TickNode

SUCCESS = TransitionCallbackReturn.SUCCESS
BARO, WIND, SETPOINT = topics.BARO, topics.TRUTH_WIND, topics.ATTITUDE_SETPOINT


@dataclass(kw_only=True)
class ProbeCore(TickCore):
    steps: list = field(default_factory=list)
    ready: bool = True


class Probe(TickNode[ProbeCore, None]):
    """Steps on a pressure per tick; wants a wind every second one, takes a setpoint as it comes."""

    SPEC = NodeSpec("probe", "heli_parameters", (), "common.yaml")

    def configure(self):
        inputs = (
            Input(BARO, Demand()),
            Input(WIND, Demand(every_ticks=2, first_tick=2)),
            Input(SETPOINT, Demand(every_ticks=1_000_000, first_tick=1), off_tick=True),
        )
        return ProbeCore(pace=self.listen(inputs))

    def is_ready(self):
        return self.core.ready

    def step(self, tick, arrived):
        self.core.steps.append((tick, dict(arrived)))


class Graph:
    """A `Bench` with a probe on it, whose messages hold one number, and what it made of them."""

    def __init__(self, bench):
        self._bench = bench
        self.node, self.receive, self.fly = bench.node, bench.receive, bench.fly
        self.spin_until = bench.spin_until

    def send(self, topic, tick, value=0.0, late_ns=0):
        self._bench.send(topic, tick, np.full(CHANNELS[topic].size, value), late_ns)

    @property
    def steps(self):
        assert self.node.crash is None
        return self.node.core.steps

    @property
    def ticks(self):
        return [tick for tick, _ in self.steps]


@pytest.fixture
def graph(bench):
    def make(fly=True, **changes):
        made = Graph(bench(Probe, **changes))
        if fly:
            made.fly()
        return made

    return make


# --- lockstep ------------------------------------------------------------------------------------


def test_steps_are_made_in_order_with_what_belongs_to_them(graph):
    """Messages in any order: a step waits for its own, and takes neither older nor newer ones."""
    g = graph()
    g.send(BARO, 0, 100.0)
    g.send(WIND, 4, 0.4)
    g.send(BARO, 1, 101.0)
    g.send(BARO, 2, 102.0)
    assert g.ticks == [0, 1]
    g.send(WIND, 2, 0.2)
    assert g.ticks == [0, 1, 2]
    g.send(BARO, 3, 103.0)
    g.send(BARO, 4, 104.0)
    assert g.ticks == [0, 1, 2, 3, 4]
    for tick, arrived in g.steps:
        stamp, pressure = arrived[BARO]
        assert (stamp, pressure[0]) == (tick, 100.0 + tick)
        assert (WIND in arrived) == (tick in (2, 4))
        if WIND in arrived:
            stamp, wind = arrived[WIND]
            assert stamp == tick and np.all(np.abs(wind) == tick / 10)


def test_a_value_is_not_changed_by_the_next_message(graph):
    """The decoder's array is overwritten; what was handed to a step is not."""
    g = graph()
    g.send(BARO, 0, 1.0)
    g.send(BARO, 1, 2.0)
    assert [arrived[BARO][1][0] for _, arrived in g.steps] == [1.0, 2.0]


def test_the_first_trigger_is_the_first_tick(graph):
    """Another topic alone begins nothing."""
    g = graph()
    g.send(WIND, 6, 1.0)
    g.send(WIND, 8, 1.0)
    assert g.ticks == []
    g.send(BARO, 7)
    g.send(BARO, 8)
    assert g.ticks == [7, 8]
    assert WIND in g.steps[1][1]


def test_a_trigger_of_a_later_tick_ends_the_waiting(graph):
    """Its sender has gone on: nothing more will come for the ticks between."""
    g = graph()
    g.send(BARO, 1)
    g.send(BARO, 2)
    assert g.ticks == [1]
    g.send(BARO, 5)
    assert g.ticks == [1, 2, 3, 4, 5]
    assert [sorted(arrived) for _, arrived in g.steps] == [[BARO], [BARO], [], [], [BARO]]
    assert g.node.silence() == ""


def test_duplicates_and_late_messages_change_nothing(graph):
    g = graph()
    g.send(BARO, 2, 1.0)
    g.send(WIND, 2, 1.0)
    for _ in range(3):
        g.send(BARO, 2, 9.0)
        g.send(BARO, 1, 9.0)
        g.send(WIND, 2, 9.0)
    g.send(BARO, 3, 3.0)
    g.send(BARO, 3, 9.0)
    assert g.ticks == [2, 3]
    assert [arrived[BARO][1][0] for _, arrived in g.steps] == [1.0, 3.0]


def test_a_message_of_a_far_tick_is_refused(graph):
    """A stamp of another clock must not make the node run ahead."""
    g = graph()
    g.send(BARO, 0)
    g.send(BARO, 100_000)
    g.send(BARO, 1)
    assert g.ticks == [0, 1]


def test_a_stamp_between_two_ticks_is_refused_unless_the_topic_may(graph):
    g = graph()
    g.send(BARO, 0, late_ns=1)
    assert g.ticks == [] and "not on a tick" in g.node.core.refused[BARO]
    g.send(SETPOINT, 3, late_ns=TICK_NS - 1)
    g.send(BARO, 3)
    assert g.ticks == [3]
    assert g.steps[0][1][SETPOINT][0] == 3
    assert SETPOINT not in g.node.core.refused


def test_a_message_that_cannot_be_used_came_nevertheless(graph):
    """The step is made at once, with None in its place: the core decides what to do."""
    g = graph()
    g.send(BARO, 0, np.nan)
    assert g.ticks == [0]
    assert g.steps[0][1][BARO] == (0, None)
    assert "not finite" in g.node.core.refused[BARO]
    g.send(BARO, 1, 5.0)
    assert g.steps[1][1][BARO][1][0] == 5.0


def test_a_message_without_a_stamp_is_nobodys(graph):
    """It must not count as the message of the tick that came before it."""
    g = graph()
    g.send(BARO, 1)
    g.send(BARO, 2)
    g.receive(WIND, b"\x00\x01\x00\x00")
    assert g.ticks == [1] and "cut off" in g.node.core.refused[WIND]
    g.send(WIND, 2, 0.2)
    assert g.ticks == [1, 2] and g.steps[1][1][WIND][1] is not None


def test_a_cut_off_trigger_before_the_flight_begins_nothing(graph):
    g = graph(fly=False)
    assert g.node.trigger_configure() == SUCCESS
    g.receive(BARO, b"")
    assert g.node.trigger_activate() == SUCCESS
    g.send(BARO, 5)
    assert g.ticks == [5]


def test_what_came_while_getting_ready_is_taken_up(graph):
    """Configured but not yet active: messages wait, none is lost, none is stepped."""
    g = graph(fly=False)
    assert g.node.trigger_configure() == SUCCESS
    for tick in range(4):
        g.send(BARO, tick)
    g.send(WIND, 2)
    assert g.ticks == []
    assert g.node.trigger_activate() == SUCCESS
    assert g.ticks == [0, 1, 2, 3]


def test_deactivation_forgets(graph):
    """What waited, what came meanwhile and who was silent: the next flight begins by itself."""
    g = graph()
    g.send(BARO, 0)
    g.send(BARO, 2)
    assert g.ticks == [0, 1]
    assert g.node.trigger_deactivate() == SUCCESS
    g.send(WIND, 2)
    g.send(BARO, 4)
    assert g.node.trigger_activate() == SUCCESS
    assert g.ticks == [0, 1]
    g.send(WIND, 2)
    g.send(BARO, 20)
    g.send(WIND, 20)
    assert g.ticks == [0, 1, 20]
    assert sorted(g.steps[-1][1]) == [BARO, WIND]


@pytest.mark.parametrize("lockstep", [True, False])
def test_time_may_begin_anew_after_a_deactivation(graph, lockstep):
    """The plant was started again: its first tick is before the last one that was stepped."""
    g = graph(lockstep=lockstep)
    g.send(BARO, 501)
    assert g.node.trigger_deactivate() == SUCCESS
    assert g.node.trigger_activate() == SUCCESS
    g.send(BARO, 0)
    assert g.ticks == [501, 0]


def test_clean_up_leaves_nothing_and_the_node_can_begin_again(graph):
    g = graph()
    g.send(BARO, 0)
    before = sorted(s.topic_name for s in g.node.subscriptions)
    assert g.node.trigger_deactivate() == SUCCESS
    assert g.node.trigger_cleanup() == SUCCESS
    assert set(before) - {s.topic_name for s in g.node.subscriptions} == {
        f"/{name}" for name in (BARO, WIND, SETPOINT)
    }
    g.fly()
    assert sorted(s.topic_name for s in g.node.subscriptions) == before
    g.send(BARO, 7)
    assert g.ticks == [7]


def test_a_node_that_is_not_ready_waits_and_resumes(graph):
    """As the outer loop does for its reference."""
    g = graph()
    g.node.core.ready = False
    for tick in (0, 1, 3):
        g.send(BARO, tick)
    assert g.ticks == []
    g.node.core.ready = True
    g.node.core.pace.resume()
    assert g.ticks == [0, 1, 2, 3]
    assert g.steps[2] == (2, {}), "its trigger's sender had gone on"


# --- silence -------------------------------------------------------------------------------------


def test_a_silent_peer_is_waited_for_so_long_and_no_longer(graph):
    g = graph(peer_timeout_s=0.3)
    g.send(BARO, 1)
    begun = time.monotonic()
    g.send(BARO, 2)
    assert g.ticks == [1]
    g.spin_until(lambda: g.ticks != [1])
    assert time.monotonic() - begun >= 0.3
    assert g.ticks == [1, 2]
    assert WIND not in g.steps[1][1]
    assert g.node.silence() == f"no message on '{WIND}' from plant: going on without"
    g.send(BARO, 3)
    g.send(BARO, 4)
    assert g.ticks == [1, 2, 3, 4], "a silent peer is not waited for again"


def test_a_silent_peer_that_returns_is_waited_for_again(graph):
    g = graph(peer_timeout_s=0.1)
    g.send(BARO, 1)
    g.send(BARO, 2)
    g.spin_until(lambda: g.ticks == [1, 2])
    g.send(BARO, 3)
    g.send(WIND, 6, 0.6)
    assert g.node.silence() == ""
    g.send(BARO, 4)
    assert g.ticks == [1, 2, 3], "it has come back: the step of tick 4 waits for it"
    g.send(WIND, 4, 0.4)
    g.send(BARO, 5)
    g.send(BARO, 6)
    assert g.ticks == [1, 2, 3, 4, 5, 6]
    assert [WIND in arrived for _, arrived in g.steps] == [False] * 3 + [True, False, True]


def test_nobody_is_called_silent_while_the_trigger_is(graph):
    """Time stands still: the others have nothing to send."""
    g = graph(peer_timeout_s=0.05)
    g.send(BARO, 1)
    g.send(WIND, 2)
    counted = []
    g.node.create_timer(0.1, lambda: counted.append(1))
    g.spin_until(lambda: len(counted) >= 5)
    assert g.ticks == [1] and g.node.silence() == ""


def test_silence_is_told_unless_something_worse_is(graph):
    g = graph(peer_timeout_s=0.05)
    g.send(BARO, 1)
    g.send(BARO, 2)
    g.spin_until(lambda: g.node.silence() != "")
    g.node.warn_or_ok(Level.OK, "all is well", {})
    assert (g.node.health.level, g.node.health.message) == (Level.WARN, g.node.silence())
    g.node.warn_or_ok(Level.ERROR, "not finite", {})
    assert (g.node.health.level, g.node.health.message) == (Level.ERROR, "not finite")


def test_what_was_not_used_is_told(graph):
    g = graph()
    for tick in (1, 0, 1, 100_000):
        g.send(BARO, tick)
    g.node.warn_or_ok(Level.WARN, "look", {"own": 1})
    late = {"own": 1, "messages_late": 2, "messages_ahead": 1}
    odd = "1; baro: stamped 1001.00 s, ahead of this node's clock, 1.02 s"
    assert g.node.health.facts == late | {"refused.baro": odd}


@pytest.mark.parametrize("lockstep", [True, False])
@pytest.mark.parametrize(
    ("tick", "why"),
    [
        (179_530_000, "ahead of this node's clock"),
        (-100, "the stamp is zero"),
        (-101, "before the flight's first moment"),
        (-2_000_000, "before the flight's first moment"),
    ],
)
def test_a_stamp_of_another_clock_is_refused_aloud_for_a_second(graph, lockstep, tick, why):
    """It is said with topic, stamp and clock; the stream goes on with its next message."""
    g = graph(lockstep=lockstep)
    g.send(BARO, 3)
    g.send(SETPOINT, tick, 0.5)
    g.send(BARO, tick)
    assert g.ticks == [3]
    g.node.warn_or_ok(Level.OK, "all is well", {})
    health = g.node.health
    assert health.level == Level.WARN and why in health.message
    assert health.facts.keys() >= {f"refused.{BARO}", f"refused.{SETPOINT}"}
    g.send(SETPOINT, 4, 0.1)
    g.send(BARO, 4)
    g.send(BARO, 5)
    assert g.ticks == [3, 4, 5]
    assert g.steps[1][1][SETPOINT][0] == 4
    g.node.tick += 101
    g.node.warn_or_ok(Level.OK, "all is well", {})
    assert (g.node.health.level, g.node.health.message) == (Level.OK, "all is well")


def test_diagnostics_go_on_when_time_is_set_back(graph):
    """The first message had a stamp of another clock; the flight's own set the clock right."""
    g, said = graph(lockstep=False), []
    g.node._reporter._publisher = SimpleNamespace(
        publish=lambda array: said.append(array.header.stamp.sec)
    )
    for tick in (179_530_000, 5, *range(6, 207)):
        g.send(BARO, tick)
    assert g.ticks[:2] == [179_530_000, 6]
    assert list(dict.fromkeys(said)) == [1_795_301, 1, 2, 3]


# --- real time -----------------------------------------------------------------------------------


def test_real_time_steps_on_the_trigger_with_what_came_since(graph):
    """The newest of each topic, once; nothing is waited for."""
    g = graph(lockstep=False)
    g.send(WIND, 0, 0.1)
    g.send(WIND, 2, 0.2)
    assert g.ticks == []
    g.send(BARO, 2)
    g.send(BARO, 5)
    assert g.ticks == [2, 5]
    assert np.all(np.abs(g.steps[0][1][WIND][1]) == 0.2)
    assert sorted(g.steps[1][1]) == [BARO]


def test_real_time_drops_what_is_older_than_what_it_has(graph):
    g = graph(lockstep=False)
    g.send(BARO, 5, 1.0)
    for tick in (3, 4, 5):
        g.send(BARO, tick, 9.0)
    g.send(WIND, 6, 0.6)
    g.send(WIND, 4, 0.4)
    g.send(BARO, 6, 2.0)
    assert g.ticks == [5, 6]
    assert np.all(np.abs(g.steps[1][1][WIND][1]) == 0.6)


def test_real_time_collects_nothing_before_activation_and_forgets_at_its_end(graph):
    g = graph(fly=False, lockstep=False)
    assert g.node.trigger_configure() == SUCCESS
    g.send(WIND, 0)
    assert g.node.trigger_activate() == SUCCESS
    g.send(BARO, 0)
    assert sorted(g.steps[0][1]) == [BARO]
    g.send(WIND, 2)
    assert g.node.trigger_deactivate() == SUCCESS
    assert g.node.trigger_activate() == SUCCESS
    g.send(BARO, 3)
    assert sorted(g.steps[1][1]) == [BARO]
