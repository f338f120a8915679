# SPDX-License-Identifier: Apache-2.0
"""ROS nodes in this process; a decoder that refuses what is not the usual layout."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor


@pytest.fixture
def two_nodes(ros_context):
    """Two nodes, and what spins the second for a time (s) or until something has come."""
    nodes = [rclpy.create_node(name, context=ros_context) for name in ("sender", "listener")]
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(nodes[1])
    yield *nodes, executor.spin_once
    executor.shutdown()
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def fast_decoder():
    """Make a Decoder that reads messages of the usual layout and refuses all others."""
    from heli_msgs_bridge.messages import Decoder

    def slowly(raw):
        raise AssertionError("not the usual layout: it takes the ordinary decoder")

    return lambda topic, datum=None: Decoder(topic, datum, slowly)
