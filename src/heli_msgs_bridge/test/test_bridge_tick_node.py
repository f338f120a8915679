# SPDX-License-Identifier: Apache-2.0
"""`TickNode` in lockstep: a real node, fed by the callbacks of its own subscriptions."""

import numpy as np
import pytest
from rclpy.lifecycle import TransitionCallbackReturn

from heli_msgs_bridge import topics

SUCCESS = TransitionCallbackReturn.SUCCESS
BARO, WIND, SETPOINT = topics.BARO, topics.TRUTH_WIND, topics.ATTITUDE_SETPOINT


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
    for tick in range(3):
        g.send(BARO, tick)
    assert g.ticks == [0, 1]
    g.send(BARO, 5)
    assert g.ticks == [0, 1, 2, 3, 4, 5]
    assert [sorted(arrived) for _, arrived in g.steps] == [[BARO]] * 3 + [[], [], [BARO]]
    assert g.node.silence() == ""


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
    for tick in range(3):
        g.send(BARO, tick)
    g.receive(WIND, b"\x00\x01\x00\x00")
    assert g.ticks == [0, 1] and "cut off" in g.node.core.refused[WIND]
    g.send(WIND, 2, 0.2)
    assert g.ticks == [0, 1, 2] and g.steps[2][1][WIND][1] is not None


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
