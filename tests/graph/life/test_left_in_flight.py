# SPDX-License-Identifier: Apache-2.0
"""Lockstep: a node other than the plant is left in flight and taken up again. That is no pause."""

import time

import numpy as np
import pytest

from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.lockstep import Lockstep

FLYING = ("scenario", "outer_loop", "inner_loop", "observer", "plant")
ACTIVATE, DEACTIVATE = 3, 4
TICK_S = 0.01


class WallTime:
    """What the nodes wait by, s: it stands between `stop` and `go_on`, however long that takes."""

    def __init__(self):
        self._behind_s, self._stopped_s = 0.0, None

    def __call__(self):
        now_s = time.monotonic() if self._stopped_s is None else self._stopped_s
        return now_s - self._behind_s

    def stop(self):
        self._stopped_s = time.monotonic()

    def go_on(self):
        self._behind_s += time.monotonic() - self._stopped_s
        self._stopped_s = None


@pytest.fixture
def wall(monkeypatch):
    time_s = WallTime()

    class Waiting(Lockstep):
        def __init__(self, *values, **named):
            super().__init__(*values, **named, now_s=time_s)

    monkeypatch.setattr("heli_msgs_bridge.tick_node.Lockstep", Waiting)
    return time_s


def assert_it_flies_on(one):
    """All is well again after two seconds of flight, and the helicopter is where it was."""
    plant = one.nodes["plant"]
    before = plant.core.state.x[:3].copy()
    one.fly(200)
    # On loaded cores a message may be late at any moment: that is said, and is over soon.
    one.spin_until(lambda: all(node.health.level == Level.OK for node in one.nodes.values()))
    one.fly(300)
    assert np.abs(plant.core.state.x[:3] - before).max() < 2.0


def left_in_flight(crew, name, peer_timeout_s, before=lambda: None):
    """A crew 5 s into its flight whose node `name` has just been deactivated.

    `before`: is called when the flight is about to be left.
    """
    one = crew(*FLYING, duration_s=600.0, peer_timeout_s=peer_timeout_s, seed=3)
    one.bring_up()
    one.fly(500)
    before()
    assert one.change(name, DEACTIVATE)
    return one, one.nodes["plant"], one.nodes[name]


@pytest.mark.parametrize("name", ["observer", "inner_loop", "outer_loop"])
def test_a_node_left_for_a_moment_costs_two_ticks_at_most(crew, wall, name):
    """Within `peer_timeout_s` time stands still; the tick that was lost takes that wait."""
    one, plant, node = left_in_flight(crew, name, peer_timeout_s=3.0, before=wall.stop)
    left_tick = plant.tick
    for _ in range(10):
        one.state(name)
    assert plant.tick <= left_tick + 1
    assert one.change(name, ACTIVATE)
    stepped, taken_up = node.tick, plant.tick
    wall.go_on()
    one.spin_until(lambda: node.tick > stepped)
    # An outer loop steps every tick, and sends every fourth.
    assert node.tick <= taken_up + 2 and plant.tick <= taken_up + 3
    assert_it_flies_on(one)


@pytest.mark.parametrize("name", ["observer", "inner_loop", "outer_loop"])
def test_a_node_left_for_long_is_named_and_flown_without(crew, name):
    """After `peer_timeout_s` the flight goes on with what was commanded last, no faster than the
    wall clock."""
    one, plant, node = left_in_flight(crew, name, peer_timeout_s=0.3)
    # The outer loop is the inner one's to miss, the others are the plant's.
    misses = one.nodes["inner_loop" if name == "outer_loop" else "plant"]
    one.spin_until(misses.silence)
    begun_s, begun_tick = time.monotonic(), plant.tick
    one.fly(10)
    if name != "outer_loop":
        assert plant.tick - begun_tick <= (time.monotonic() - begun_s) / TICK_S + 2
        assert plant.health.state == NodeState.WITHOUT_INPUT
        assert "'actuators'" in plant.health.message and "inner_loop" in plant.health.message
    assert one.change(name, ACTIVATE)
    stepped, taken_up = node.tick, plant.tick
    one.spin_until(lambda: node.tick > stepped)
    assert node.tick <= taken_up + 5
    assert_it_flies_on(one)
