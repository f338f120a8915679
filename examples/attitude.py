# SPDX-License-Identifier: Apache-2.0
"""Lean to the right, then as long to the left, climbing, and hold: attitude.py DEG SECONDS CLIMB.

Another pilot takes off; it begins when that is done. CLIMB is in m/s.
"""

import math
import sys

import rclpy
from geometry_msgs.msg import QuaternionStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

right, lasts, climb = map(float, sys.argv[1:])
rclpy.init()
node = rclpy.create_node("attitude_pilot")
attitude = node.create_publisher(QuaternionStamped, "command_attitude", 10)
up = node.create_publisher(TwistStamped, "command_climb", 10)
hold = node.create_client(Trigger, "hold")
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


def seconds(odom):
    """Flight time, s."""
    return odom.header.stamp.sec + odom.header.stamp.nanosec / 1e9


def lean(odom, hover, angle_deg):
    """Command the attitude of a hover, turned about the nose, and the climb."""
    s, c = math.sin(math.radians(angle_deg) / 2.0), math.cos(math.radians(angle_deg) / 2.0)
    message = QuaternionStamped(header=odom.header)  # flight time; frame map: east, north, up
    q = message.quaternion
    q.w, q.x = hover.w * c - hover.x * s, hover.w * s + hover.x * c
    q.y, q.z = hover.y * c + hover.z * s, hover.z * c - hover.y * s
    attitude.publish(message)
    climbing = TwistStamped(header=odom.header)
    climbing.twist.linear.z = climb
    up.publish(climbing)


odom = newest()
moved = seconds(odom)
while seconds(odom) < moved + 2.0:
    odom = newest()
    if odom.pose.pose.position.z < 5.0 or abs(odom.twist.twist.linear.z) > 0.2:
        moved = seconds(odom)
hover, began = odom.pose.pose.orientation, seconds(odom)
for angle, until in ((right, began + lasts), (-right, began + 2.0 * lasts)):
    while seconds(odom) < until:
        lean(odom, hover, angle)
        odom = newest()
hold.wait_for_service()
asked = hold.call_async(Trigger.Request())
rclpy.spin_until_future_complete(node, asked)
print(asked.result().message)
