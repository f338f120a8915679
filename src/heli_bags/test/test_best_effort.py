# SPDX-License-Identifier: Apache-2.0
"""A best-effort driver is recorded in real time; in lockstep nothing of the graph may be lost."""

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from heli_bags.node import RecorderNode
from heli_msgs_bridge import topics

SUCCESS = TransitionCallbackReturn.SUCCESS
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def recorder(ros_context, tmp_path):
    """Make a configured recorder."""
    made = []

    def make(lockstep, overrides=()):
        changes = {"peers": [], "bag": str(tmp_path / "bag"), "lockstep": lockstep}
        values = RecorderNode.SPEC.resolve() | changes
        node = RecorderNode(values, context=ros_context, parameter_overrides=list(overrides))
        made.append(node)
        assert node.trigger_configure() == SUCCESS
        return node

    yield make
    for node in made:
        node.end()
        node.destroy_node()


@pytest.fixture
def driver(ros_context):
    """Publisher of a driver's Imu, best effort."""
    import rclpy

    node = rclpy.create_node("driver", context=ros_context)
    kind = topics.message_class(topics.BY_NAME[topics.IMU].type)
    yield node.create_publisher(kind, topics.IMU, BEST_EFFORT), kind()
    node.destroy_node()


def test_in_real_time_a_best_effort_driver_is_recorded(recorder, driver):
    node, (publisher, message) = recorder(lockstep=False), driver
    message.header.stamp.sec = 1
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    for _ in range(3000):
        publisher.publish(message)
        executor.spin_once(timeout_sec=0.1)
        if node.core.bag.counts[topics.IMU]:
            break
    executor.shutdown()
    assert node.core.bag.counts[topics.IMU]
    reliability = node.core.subscriptions[topics.IMU].qos_profile.reliability
    assert reliability == ReliabilityPolicy.BEST_EFFORT
    # What the graph itself sends stays reliable.
    odom = node.core.subscriptions[topics.ODOM].qos_profile
    assert odom.reliability == ReliabilityPolicy.RELIABLE


def test_in_lockstep_sensors_stay_reliable(recorder, driver):
    node = recorder(lockstep=True)
    publishers = node.get_publishers_info_by_topic
    while not publishers(f"/{topics.IMU}"):
        continue
    node._flush()
    reliability = node.core.subscriptions[topics.IMU].qos_profile.reliability
    assert reliability == ReliabilityPolicy.RELIABLE


def test_a_users_override_holds_for_the_recorder(recorder):
    name = f"qos_overrides./{topics.MAG}.subscription.reliability"
    node = recorder(False, [Parameter(name, value="best_effort")])
    reliability = node.core.subscriptions[topics.MAG].qos_profile.reliability
    assert reliability == ReliabilityPolicy.BEST_EFFORT
