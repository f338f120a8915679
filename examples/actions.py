# SPDX-License-Identifier: Apache-2.0
"""Take off, fly there, land, by actions (types of heli_interfaces): actions.py EAST NORTH UP, m."""

import sys

import rclpy
from rclpy.action import ActionClient

from heli_interfaces.action import Goto, Land, Takeoff

rclpy.init()
node = rclpy.create_node("pilot")


def fly(action, goal):
    """Send a goal, print what is told of it, and leave if it is not done."""
    client = ActionClient(node, action, f"actions/{action.__name__.lower()}")
    client.wait_for_server()
    sent = client.send_goal_async(goal, lambda told: print(told.feedback.mode, flush=True))
    rclpy.spin_until_future_complete(node, sent)
    ended = sent.result().get_result_async()
    rclpy.spin_until_future_complete(node, ended)
    print(ended.result().result.message, flush=True)
    if not ended.result().result.success:
        sys.exit(1)


there = Goto.Goal()
there.pose.header.frame_id = "map"
at, there.pose.pose.orientation.w = there.pose.pose.position, 1.0
at.x, at.y, at.z = map(float, sys.argv[1:])
for action, goal in ((Takeoff, Takeoff.Goal()), (Goto, there), (Land, Land.Goal())):
    fly(action, goal)
