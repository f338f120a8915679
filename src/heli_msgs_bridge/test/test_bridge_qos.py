# SPDX-License-Identifier: Apache-2.0
"""Who meets whom: foreign nodes of default QoS and ours, on every topic; nothing heard twice."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
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


def made_of(kind, context, lockstep, overrides=()):
    """A node that is not configured yet."""
    values = load(with_common(()), [config_folder("heli_core") / "common.yaml"], "both")
    changes = {"peers": [], "lockstep": lockstep}
    return kind(values | changes, context=context, parameter_overrides=list(overrides))


@pytest.fixture
def ours(ros_context):
    """Make one of ours, configured and active."""
    made = []

    def make(kind, lockstep=True, overrides=()):
        node = made_of(kind, ros_context, lockstep, overrides)
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


BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
OVERRIDE = f"qos_overrides./{topics.IMU}.subscription.reliability"


@pytest.mark.parametrize("profile", [BEST_EFFORT, RELIABLE])
def test_in_real_time_a_driver_is_heard_whatever_its_reliability(ours, foreign, profile):
    """Each sensor's; many real drivers send with the QoS of sensor data."""
    node = ours(Both, lockstep=False)
    senders = {}
    for name in topics.SENSORS:
        kind = topics.message_class(topics.BY_NAME[name].type)
        senders[name] = foreign.create_publisher(kind, name, profile), kind

    def all_heard():
        heard = {name for name, _ in node.core}
        for name, (sender, kind) in senders.items():
            if name not in heard:
                sender.publish(kind())
        return senders.keys() <= heard

    assert len(senders) >= 7 and until(all_heard, node)


@pytest.mark.parametrize(
    ("lockstep", "given", "flown"),
    [
        (True, None, ReliabilityPolicy.RELIABLE),
        (False, None, ReliabilityPolicy.BEST_EFFORT),
        (False, "reliable", ReliabilityPolicy.RELIABLE),
    ],
)
def test_reliability_is_chosen_per_topic_as_ros_has_it(ours, lockstep, given, flown):
    overrides = [] if given is None else [RosParameter(OVERRIDE, value=given)]
    node = ours(Both, lockstep=lockstep, overrides=overrides)
    found = {s.topic_name: s.qos_profile.reliability for s in node.subscriptions}
    assert found[f"/{topics.IMU}"] == flown
    assert node.get_parameter(OVERRIDE).value == flown.name.lower()
    # Of another topic nothing was said; what nodes send each other is reliable.
    assert found[f"/{topics.GPS_FIX}"] == (RELIABLE if lockstep else BEST_EFFORT).reliability
    assert found[f"/{topics.ODOM}"] == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize(
    ("lockstep", "given", "word"), [(True, "best_effort", "lockstep"), (False, "quick", "quick")]
)
def test_an_override_that_cannot_be_is_refused_by_name(ros_context, lockstep, given, word):
    node = made_of(Both, ros_context, lockstep, [RosParameter(OVERRIDE, value=given)])
    assert node.trigger_configure() != SUCCESS
    assert word in node.failure and "reliability" in node.failure
    node.end()
    node.destroy_node()
