# SPDX-License-Identifier: Apache-2.0
"""The clock of several aircraft: ahead of none, and held up by none whose flight is over."""

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile

from heli_core.ticks import TICK_NS
from heli_flight.graph.world_clock_node import WorldClockNode
from heli_flight.settings import seed_of
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.messages import ClockEncoder


@pytest.fixture
def world(ros_context):
    """A clock of two aircraft that are listened to; `reach(aircraft, tick)`, `over`, `shown`."""
    node = WorldClockNode(WorldClockNode.SPEC.resolve(), context=ros_context)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    shown = []
    node.core.send = lambda raw: shown.append((stamp_of(raw) - node.start_ns) // TICK_NS)
    node.core.heard = True
    encode = ClockEncoder().encode

    class World:
        ticks, clock = shown, node

        def reach(self, aircraft, tick):
            node._on_truth(aircraft, encode(node.start_ns + tick * TICK_NS))

        def over(self, name):
            status = DiagnosticStatus(name=name, message="flight over")
            status.values = [KeyValue(key="over", value="true")]
            node._on_diagnostics(DiagnosticArray(status=[status]))

    yield World()
    node.end()
    node.destroy_node()


def test_nobody_is_listened_to_before_the_clock_is_connected(world, monkeypatch):
    """A reader in the graph that is not connected yet would miss the first clock."""
    node, offered = world.clock, world.clock.outputs[topics.CLOCK].qos_profile
    never = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    readers = [SimpleNamespace(qos_profile=qos) for qos in (offered, never, offered)]
    publisher = SimpleNamespace(qos_profile=offered)
    monkeypatch.setattr(node, "count_subscribers", lambda name: 9)
    monkeypatch.setattr(node, "get_subscriptions_info_by_topic", lambda name: readers)
    monkeypatch.setitem(node.outputs, topics.CLOCK, publisher)
    node.core.heard = False
    for connected, heard in ((0, False), (1, False), (2, True)):
        publisher.get_subscription_count = lambda n=connected: n
        node._look()
        assert node.core.heard is heard


def test_it_shows_what_all_have_reached(world):
    world.reach("heli1", 0)
    assert world.ticks == []
    world.reach("heli2", 0)
    assert world.ticks == [0]
    world.reach("heli1", 1)
    world.reach("heli2", 1)
    world.reach("heli2", 2)
    assert world.ticks == [0, 1]
    world.reach("heli1", 2)
    assert world.ticks == [0, 1, 2]


def test_it_leaves_no_tick_out_and_never_goes_back(world):
    world.reach("heli1", 5)
    world.reach("heli2", 3)
    world.reach("heli2", 1)
    world.reach("heli2", 5)
    assert world.ticks == [0, 1, 2, 3, 4, 5]


def test_one_whose_flight_is_over_holds_nobody_up(world):
    world.reach("heli1", 0)
    world.reach("heli2", 0)
    world.reach("heli1", 2)
    world.over("heli2/observer")
    world.over("heli3/plant")
    assert world.ticks == [0]
    world.over("/heli2/plant")
    assert world.ticks == [0, 1, 2] and not world.clock.finished
    world.reach("heli2", 9)
    world.over("heli1/plant")
    assert world.ticks == [0, 1, 2] and world.clock.finished


@pytest.mark.parametrize("names", [("heli1", "/heli1"), ("heli1", "")])
def test_names_that_are_none_are_refused(ros_context, names):
    node = WorldClockNode(WorldClockNode.SPEC.resolve() | {"aircraft": names}, context=ros_context)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert f"aircraft: {[name.strip('/') for name in names]}: " in node.failure
    node.end()
    node.destroy_node()


def test_seeds_of_several_are_their_own():
    """Of one another and of the number of aircraft; allowed values of the plant's parameter."""
    seeds = [seed_of(seed, number) for seed in (1, 2, 7) for number in range(9)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert seed_of(1, 0) == seed_of(1, 0)
