# SPDX-License-Identifier: Apache-2.0
"""`TickNode` and peers that are silent or send what is of no use: waited for, refused, told."""

import time
from types import SimpleNamespace

import pytest

from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.tick_node import off_tick_refusal

BARO, WIND, SETPOINT = topics.BARO, topics.TRUTH_WIND, topics.ATTITUDE_SETPOINT
SILENCE = f"no message on '{WIND}' from plant: going on without"


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
    reason = off_tick_refusal(BARO, g.node.start_ns + 1)
    assert g.ticks == [] and g.node.core.refused[BARO] == reason
    g.send(SETPOINT, 3, late_ns=TICK_NS - 1)
    g.send(BARO, 3)
    assert g.ticks == [3]
    assert g.steps[0][1][SETPOINT][0] == 3
    assert SETPOINT not in g.node.core.refused


def test_a_silent_peer_is_waited_for_so_long_and_no_longer(graph):
    g = graph(peer_timeout_s=0.3)
    g.send(BARO, 0)
    g.send(BARO, 1)
    begun = time.monotonic()
    g.send(BARO, 2)
    assert g.ticks == [0, 1]
    g.spin_until(lambda: g.ticks != [0, 1])
    assert time.monotonic() - begun >= 0.3
    assert g.ticks == [0, 1, 2]
    assert WIND not in g.steps[2][1]
    assert g.node.core.pace.silent == {WIND} and g.node.silence() == SILENCE
    g.send(BARO, 3)
    g.send(BARO, 4)
    assert g.ticks == [0, 1, 2, 3, 4], "a silent peer is not waited for again"


def test_a_silent_peer_that_returns_is_waited_for_again(graph):
    g = graph(peer_timeout_s=0.1)
    for tick in range(3):
        g.send(BARO, tick)
    g.spin_until(lambda: g.ticks == [0, 1, 2])
    g.send(BARO, 3)
    g.send(WIND, 6, 0.6)
    assert g.node.silence() == ""
    g.send(BARO, 4)
    assert g.ticks == [0, 1, 2, 3], "it has come back: the step of tick 4 waits for it"
    g.send(WIND, 4, 0.4)
    g.send(BARO, 5)
    g.send(BARO, 6)
    assert g.ticks == [0, 1, 2, 3, 4, 5, 6]
    assert [WIND in arrived for _, arrived in g.steps] == [False] * 4 + [True, False, True]


def test_nobody_is_called_silent_while_the_trigger_is(graph):
    """Time stands still: the others have nothing to send."""
    g = graph(peer_timeout_s=0.05)
    g.send(BARO, 0)
    g.send(BARO, 1)
    g.send(WIND, 2)
    counted = []
    g.node.create_timer(0.1, lambda: counted.append(1))
    g.spin_until(lambda: len(counted) >= 5)
    assert g.ticks == [0, 1] and g.node.silence() == ""


def test_silence_is_told_unless_something_worse_is(graph):
    g = graph(peer_timeout_s=0.05)
    for tick in range(3):
        g.send(BARO, tick)
    g.spin_until(lambda: g.node.silence() != "")
    g.node.warn_or_ok(Level.OK, "flying", {})
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
    g.send(WIND, 2)
    g.send(BARO, 3)
    g.send(SETPOINT, tick, 0.5)
    g.send(BARO, tick)
    assert g.ticks == [3]
    g.node.warn_or_ok(Level.OK, "flying", {})
    health = g.node.health
    assert health.level == Level.WARN and why in health.message
    assert health.facts.keys() >= {f"refused.{BARO}", f"refused.{SETPOINT}"}
    g.send(SETPOINT, 4, 0.1)
    g.send(BARO, 4)
    g.send(BARO, 5)
    assert g.ticks == [3, 4, 5]
    assert g.steps[1][1][SETPOINT][0] == 4
    g.node.tick += 101
    g.node.warn_or_ok(Level.OK, "flying", {})
    assert (g.node.health.level, g.node.health.message) == (Level.OK, "flying")


def test_diagnostics_go_on_when_time_is_set_back(graph):
    """The first message had a stamp of another clock; the flight's own set the clock right."""
    g, seconds = graph(lockstep=False), []
    g.node._reporter._publisher = SimpleNamespace(
        publish=lambda array: seconds.append(array.header.stamp.sec)
    )
    for tick in (179_530_000, 5, *range(6, 207)):
        g.send(BARO, tick)
    assert g.ticks[:2] == [179_530_000, 6]
    assert list(dict.fromkeys(seconds)) == [1_795_301, 1, 2, 3]
