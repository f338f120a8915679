# SPDX-License-Identifier: Apache-2.0
"""The wait for peers: for one that gets ready long, for one that is not there not for long."""

import time

import pytest
import rclpy

from heli_msgs_bridge import topics
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec
from heli_msgs_bridge.peers import (
    ALONE_S,
    READY_LIMIT_S,
    PeerWait,
    still_missing,
    waiting_for,
)

CONNECT_S = 30.0
LIMIT_S = 120.0


class Sender(ManagedNode):
    """A plant that sends nothing but must be heard by the observer."""

    SPEC = NodeSpec("plant", "heli_core", (), "common.yaml")
    links = ()

    def __init__(self, values, **options):
        self.heard_early = []
        super().__init__(values, **options)

    def configure(self):
        self.subscribe(topics.ACTUATORS, print)
        self.heard_early = self.get_subscriptions_info_by_topic("/actuators")
        return self.create_topic_publisher(topics.IMU)

    def awaited_links(self):
        return dict(self.links)


class Wait(PeerWait):
    """A wait by a clock of its own, s."""

    def __init__(self, node):
        self.s = 0.0
        super().__init__(node, lambda: self.s)

    def over_after(self, s):
        self.s += s
        return self.over()

    def until(self, condition):
        """Look, while its clock stands still, until the graph has made something known."""
        deadline_s = time.monotonic() + LIMIT_S
        over = False
        while not condition(over):
            assert time.monotonic() < deadline_s
            self._looked_s = self._named_s = -LIMIT_S
            over = self.over()

    def ends(self):
        """Whether it ends with what the graph makes known."""
        self.until(lambda over: over)
        return True

    def says(self, sentence):
        """Whether it comes to say this."""
        self.until(lambda over: self.sentence == sentence)
        return True


@pytest.fixture
def sender(ros_context):
    """A configured node with the observer as its peer."""
    values = Sender.SPEC.resolve() | {"peers": ("observer",), "connect_timeout_s": CONNECT_S}
    node = Sender(values, context=ros_context)
    node.trigger_configure()
    yield node
    node.end()
    node.destroy_node()


@pytest.fixture
def peer(ros_context):
    """Make a node of a name, in a namespace."""
    made = []

    def make(name, namespace=None):
        made.append(rclpy.create_node(name, namespace=namespace, context=ros_context))
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()


def hear(node, topic):
    kind = topics.message_class(topics.BY_NAME[topic].type)
    node.create_subscription(kind, topic, print, topics.qos(topic))


def test_one_that_compiles_is_waited_for_beyond_the_limit(sender, peer):
    observer = peer("observer")
    wait = Wait(sender)
    assert not wait.over() and not wait.over_after(5 * CONNECT_S)
    assert wait.sentence == waiting_for({"observer"})
    hear(observer, topics.IMU)
    assert wait.ends() and not wait.missing


def test_one_that_compiles_is_not_waited_for_for_ever(sender, peer):
    peer("observer")
    wait = Wait(sender)
    assert not wait.over_after(READY_LIMIT_S - 1.0)
    assert not wait.over_after(2.0) and wait.over_after(CONNECT_S)
    assert wait.missing == {"observer"}


def test_one_that_is_not_there_is_given_up(sender, peer):
    """Another node of the graph is there, so it may come; that of another graph is none."""
    peer("observer", "/another"), peer("recorder")
    wait = Wait(sender)
    assert not wait.over_after(CONNECT_S - 1.0)
    assert wait.sentence == waiting_for({"observer"}, False, CONNECT_S)
    assert wait.over_after(2.0) and wait.missing == {"observer"}


def test_one_that_is_alone_begins_soon(sender, peer):
    """Tools of the command line are no company."""
    peer("_ros2cli_daemon"), peer("rviz")
    wait = Wait(sender)
    assert not wait.over_after(ALONE_S - 1.0)
    assert wait.sentence == waiting_for({"observer"}, False, ALONE_S)
    assert wait.over_after(2.0) and wait.missing == {"observer"}


def test_who_is_missed_may_come_later(sender, peer):
    missing = {"observer", "inner_loop"}
    sender.links = {topics.ODOM: {"inner_loop"}}
    assert still_missing(sender, missing) == missing
    hear(peer("inner_loop"), topics.ODOM)
    deadline_s = time.monotonic() + LIMIT_S
    while still_missing(sender, missing) != {"observer"}:
        assert time.monotonic() < deadline_s


@pytest.mark.slow
def test_one_that_ends_while_it_compiles_is_given_up(sender, peer, ros_context):
    peer("recorder")
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=ros_context.get_domain_id())
    observer = rclpy.create_node("observer", context=context)
    wait = Wait(sender)
    assert wait.says(waiting_for({"observer"}))
    observer.destroy_node()
    rclpy.shutdown(context=context)
    assert wait.says(waiting_for({"observer"}, False, CONNECT_S))
    assert wait.over_after(CONNECT_S + 1.0) and wait.missing == {"observer"}


def test_another_name_is_known_by_what_it_sends(sender, peer):
    nav = peer("nav")
    wait = Wait(sender)
    kind = topics.message_class(topics.BY_NAME[topics.ODOM].type)
    nav.create_publisher(kind, topics.ODOM, topics.qos(topics.ODOM))
    hear(nav, topics.IMU)
    assert wait.ends()


def test_links_between_others_are_waited_for(sender, peer):
    """The plant's way: nothing flies before the inner loop is ready, though the observer be."""
    sender.links = {topics.ODOM: {"inner_loop"}}
    hear(peer("observer"), topics.IMU)
    inner = peer("inner_loop")
    wait = Wait(sender)
    assert wait.says(waiting_for({"inner_loop"}))
    hear(inner, topics.ODOM)
    assert wait.ends()


def test_one_that_is_asked_to_end_does_not_begin(sender, peer, ros_context):
    peer("observer")
    wait = Wait(sender)
    assert not wait.over()
    ros_context.try_shutdown()
    assert not wait.over_after(2 * READY_LIMIT_S)


def test_who_is_not_configured_does_not_listen(sender):
    assert sender.heard_early == []
    assert len(sender.get_subscriptions_info_by_topic("/actuators")) == 1
