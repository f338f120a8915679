# SPDX-License-Identifier: Apache-2.0
"""Fly to a point by velocity commands, then land: velocity.py EAST NORTH SPEED, in m and m/s.

Another pilot takes off: what comes before the hover is refused.
"""

import math
import sys

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

east, north, speed = map(float, sys.argv[1:])
rclpy.init()
node = rclpy.create_node("velocity_pilot")
command = node.create_publisher(TwistStamped, "command_velocity", 10)
land = node.create_client(Trigger, "land")
heard = {"odom": None}
node.create_subscription(
    Odometry, "odom", lambda odom: heard.update(odom=odom), QoSProfile(depth=1)
)


def newest():
    """The newest odometry."""
    heard["odom"] = None
    while heard["odom"] is None:
        rclpy.spin_once(node)
    return heard["odom"]


def velocity_to_goal(odom):
    """Towards the goal, slower near it, and how far it is, m."""
    p = odom.pose.pose.position
    away = math.hypot(east - p.x, north - p.y)
    along = min(speed, 0.5 * away) / max(away, 1e-9)
    message = TwistStamped()
    message.header = odom.header  # flight time; frame map: east, north, up
    message.twist.linear.x, message.twist.linear.y = along * (east - p.x), along * (north - p.y)
    return message, away


while newest().pose.pose.position.z < 5.0:
    pass
away = math.inf
while away > 0.5:
    message, away = velocity_to_goal(newest())
    command.publish(message)
land.wait_for_service()
asked = land.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, asked)
print(asked.result().message)
