# SPDX-License-Identifier: Apache-2.0
"""The wait for peers: for one that gets ready long, for one that is not there not for long."""

import threading

import pytest
import rclpy
from rclpy.executors import ExternalShutdownException

from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import NodeState
from heli_msgs_bridge.lifecycle_node import (
    AbsentPeersError,
    ManagedNode,
    NodeSpec,
    wait_for_peers,
    waiting_for,
)

LIMIT_S = 0.1
GIVEN_UP = "nobody listens to 'imu/data_raw' after {:.3g} s: missing observer"


class Sender(ManagedNode):
    """A plant that sends nothing but must be heard by the observer."""

    SPEC = NodeSpec("plant", "heli_core", (), "common.yaml")
    links = ()

    def __init__(self, values, **options):
        self.waiting_reports, self.heard_early = threading.Semaphore(0), []
        super().__init__(values, **options)

    def configure(self):
        self.subscribe(topics.ACTUATORS, print)
        self.heard_early = self.get_subscriptions_info_by_topic("/actuators")
        return self.create_topic_publisher(topics.IMU)

    def awaited_links(self):
        return dict(self.links)

    def report(self, level, message, facts=None, state=NodeState.RUNNING):
        super().report(level, message, facts, state)
        if state == NodeState.WAITING:
            self.waiting_reports.release()


@pytest.fixture
def sender(ros_context):
    """A configured node with the observer as its peer."""
    values = Sender.SPEC.resolve() | {"peers": ("observer",), "connect_timeout_s": LIMIT_S}
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


def await_reports(sender, times):
    """Wait until the sender has said so many times more that it waits."""
    assert all(sender.waiting_reports.acquire(timeout=120) for _ in range(times))


def waits(sender):
    """Wait in a thread; returns what tells with which error it failed, if it did."""
    failure = []

    def wait():
        try:
            wait_for_peers(sender)
        except Exception as error:
            failure.append(error)

    thread = threading.Thread(target=wait)
    thread.start()

    def ended():
        thread.join(120.0)
        assert not thread.is_alive()
        return failure[0] if failure else None

    return ended


def test_one_that_compiles_is_waited_for_beyond_the_limit(sender, peer):
    observer = peer("observer")
    ended = waits(sender)
    # It says so ten times a second: this is five times the limit.
    await_reports(sender, 5)
    hear(observer, topics.IMU)
    assert ended() is None
    assert sender.health.state == NodeState.WAITING
    assert sender.health.message == waiting_for({"observer"})


def test_one_that_is_not_there_is_given_up(sender, peer):
    peer("observer", "/another")
    error = waits(sender)()
    assert isinstance(error, AbsentPeersError)
    assert (error.topic, error.peers) == (topics.IMU, {"observer"})
    assert error.waited_s >= LIMIT_S and str(error) == GIVEN_UP.format(error.waited_s)


@pytest.mark.slow
def test_one_that_ends_while_it_compiles_is_given_up(sender, peer, ros_context):
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=ros_context.get_domain_id())
    observer = rclpy.create_node("observer", context=context)
    # Long enough for another participant to be discovered.
    sender.values["connect_timeout_s"] = 3.0
    ended = waits(sender)
    await_reports(sender, 1)
    observer.destroy_node()
    rclpy.shutdown(context=context)
    assert ended().peers == {"observer"}


def test_another_name_is_known_by_what_it_sends(sender, peer):
    nav = peer("nav")
    ended = waits(sender)
    kind = topics.message_class(topics.BY_NAME[topics.ODOM].type)
    nav.create_publisher(kind, topics.ODOM, topics.qos(topics.ODOM))
    hear(nav, topics.IMU)
    assert ended() is None


def test_links_between_others_are_waited_for(sender, peer):
    """The plant's way: nothing flies before the inner loop is ready, though the observer be."""
    sender.links = {topics.ODOM: {"inner_loop"}}
    hear(peer("observer"), topics.IMU)
    inner = peer("inner_loop")
    ended = waits(sender)
    await_reports(sender, 3)
    hear(inner, topics.ODOM)
    assert ended() is None
    assert sender.health.message == waiting_for({"inner_loop"})


def test_one_that_is_asked_to_end_ceases_to_wait(sender, peer, ros_context):
    peer("observer")
    ended = waits(sender)
    await_reports(sender, 1)
    ros_context.try_shutdown()
    assert isinstance(ended(), ExternalShutdownException)


def test_who_is_not_configured_does_not_listen(sender):
    assert sender.heard_early == []
    assert len(sender.get_subscriptions_info_by_topic("/actuators")) == 1
