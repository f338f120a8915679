# SPDX-License-Identifier: Apache-2.0
"""Who meets whom: foreign nodes of default QoS and ours, on every topic; nothing heard twice."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.serialization import deserialize_message

from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_msgs_bridge import topics
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec

LIMIT_S = 120.0
SUCCESS = TransitionCallbackReturn.SUCCESS
DEFAULT = 10
"""What `create_publisher` and `create_subscription` of a tutorial get: reliable, volatile."""


class Both(ManagedNode[list, None]):
    """Hears every topic of the table, or sends on every one."""

    SPEC = NodeSpec("both", "heli_core", (), "common.yaml")
    sends = False

    def configure(self):
        heard = []
        for name in (t.name for t in topics.TABLE if t.name != topics.DIAGNOSTICS):
            if self.sends:
                self.create_topic_publisher(name)
            else:
                self.subscribe(name, lambda raw, name=name: heard.append((name, raw)), raw=True)
        return heard


class Sender(Both):
    sends = True


@pytest.fixture
def ours(ros_context):
    """Make one of ours, configured and active."""
    made = []

    def make(kind):
        values = load(with_common(()), [config_folder("heli_core") / "common.yaml"], "both")
        node = kind(values | {"peers": []}, context=ros_context)
        made.append(node)
        assert node.trigger_configure() == SUCCESS and node.trigger_activate() == SUCCESS
        return node

    yield make
    for node in made:
        node.end()
        node.destroy_node()


@pytest.fixture
def foreign(ros_context):
    node = rclpy.create_node("foreign", context=ros_context)
    yield node
    node.destroy_node()


def until(condition, *nodes, executor=SingleThreadedExecutor):
    """Spin the nodes until the condition holds; returns whether it does."""
    spinner = executor(context=nodes[0].context)
    for node in nodes:
        spinner.add_node(node)
    deadline = time.monotonic() + LIMIT_S
    while not condition() and time.monotonic() < deadline:
        spinner.spin_once(timeout_sec=0.1)
    spinner.shutdown()
    return condition()


@pytest.mark.parametrize("executor", [SingleThreadedExecutor, EventsExecutor])
def test_a_message_of_a_default_publisher_arrives_on_every_topic(ours, foreign, executor):
    node = ours(Both)
    senders = {}
    for topic in topics.TABLE:
        if topic.name != topics.DIAGNOSTICS:
            cls = topics.message_class(topic.type)
            senders[topic.name] = foreign.create_publisher(cls, topic.name, DEFAULT)
            senders[topic.name].publish(cls())

    def all_heard():
        missing = set(senders) - {name for name, _ in node.core}
        for name in missing:
            if senders[name].get_subscription_count():
                senders[name].publish(topics.message_class(topics.BY_NAME[name].type)())
        return not missing

    assert until(all_heard, node, executor=executor), set(senders) - {n for n, _ in node.core}
    assert node.crash is None


def test_a_message_of_ours_arrives_at_a_default_subscriber_on_every_topic(ours, foreign):
    node, heard = ours(Sender), set()
    for topic in topics.TABLE:
        cls = topics.message_class(topic.type)
        foreign.create_subscription(
            cls, topic.name, lambda _, name=topic.name: heard.add(name), DEFAULT
        )

    def all_heard():
        for name in set(node.outputs) - heard:
            node.outputs[name].publish(topics.message_class(topics.BY_NAME[name].type)())
        return set(node.outputs) <= heard

    assert until(all_heard, foreign), set(node.outputs) - heard


@pytest.mark.parametrize("executor", [SingleThreadedExecutor, EventsExecutor])
def test_a_latched_message_is_heard_late_and_once(ours, foreign, executor):
    """All that is kept, sent before anybody listens; then once more, to both subscriptions."""
    cls = topics.message_class(topics.BY_NAME[topics.REFERENCE].type)
    latched = foreign.create_publisher(cls, topics.REFERENCE, topics.qos(topics.REFERENCE))
    plain = foreign.create_publisher(cls, topics.REFERENCE, DEFAULT)
    before = [f"before {i}" for i in range(topics.BY_NAME[topics.REFERENCE].kept)]
    for name in before:
        latched.publish(cls(joint_names=[name]))
    node = ours(Both)

    def names():
        return [deserialize_message(raw, cls).joint_names[0] for _, raw in node.core]

    assert until(lambda: names() == before, node, executor=executor), names()
    assert until(
        lambda: latched.get_subscription_count() == 2 and plain.get_subscription_count() == 1, node
    )
    latched.publish(cls(joint_names=["after"]))
    plain.publish(cls(joint_names=["plain"]))
    assert until(lambda: len(node.core) >= len(before) + 2, node, executor=executor), names()
    latched.publish(cls(joint_names=["last"]))
    assert until(lambda: "last" in names(), node, executor=executor)
    assert sorted(names()) == sorted(["after", *before, "last", "plain"])
