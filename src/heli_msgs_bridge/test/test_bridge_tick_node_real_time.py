# SPDX-License-Identifier: Apache-2.0
"""`TickNode` in real time: steps on the trigger, with what has come since."""

import numpy as np
from rclpy.lifecycle import TransitionCallbackReturn

from heli_msgs_bridge import topics

SUCCESS = TransitionCallbackReturn.SUCCESS
BARO, WIND = topics.BARO, topics.TRUTH_WIND


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
