# SPDX-License-Identifier: Apache-2.0
"""An executor that serves with patience: all that waits, and nothing is kept for good."""

import gc
import sys

import rclpy
from rclpy.experimental import EventsExecutor
from std_msgs.msg import String

from heli_msgs_bridge.node_process import Spinning

PATIENCE_S = 1e-4


def test_patience_serves_all_that_waits_and_keeps_nothing(ros_context):
    """In real time the recorder is served 200 times a second: 30 bytes each were 20 MB an hour."""
    node = rclpy.create_node("patient", context=ros_context)
    executor = EventsExecutor(context=ros_context)
    executor.add_node(node)
    spinning, heard = Spinning(executor, PATIENCE_S), []
    node.create_subscription(String, "said", heard.append, 100)
    publisher = node.create_publisher(String, "said", 100)
    for _ in range(50):
        publisher.publish(String())
    while len(heard) < 50:
        spinning.serve()
    for _ in range(50):
        spinning.serve()
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(2000):
        spinning.serve()
    gc.collect()
    assert sys.getallocatedblocks() - before < 500
    executor.shutdown()
    node.destroy_node()
