# SPDX-License-Identifier: Apache-2.0
"""Take off, fly to a point, land: takeoff_goto_land.py EAST NORTH UP, in m (--scenario by_hand)."""

import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("pilot", parameter_overrides=[Parameter("use_sim_time", value=True)])
goto = node.create_publisher(PoseStamped, "goto", 10)
at = {"point": None}
node.create_subscription(
    Odometry,
    "odom",
    lambda odom: at.update(point=odom.pose.pose.position),
    qos_profile_sensor_data,
)


def ask(service):
    """Call a service without arguments; whether it was granted."""
    client = node.create_client(Trigger, service)
    client.wait_for_service()
    asked = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, asked)
    print(asked.result().message, flush=True)
    return asked.result().success


def wait_until(there):
    """Spin until the aircraft is there."""
    while at["point"] is None or not there(at["point"]):
        rclpy.spin_once(node)


def seconds():
    """Flight time, s."""
    return node.get_clock().now().nanoseconds / 1e9


east, north, up = map(float, sys.argv[1:])
wait_until(lambda p: seconds() > 0.0)
ground = at["point"].z
if not ask("takeoff"):
    sys.exit(1)
wait_until(lambda p: p.z > ground + 9.8)  # of 10 m, takeoff.height_m
there = seconds()
wait_until(lambda p: seconds() > there + 4.0)
goal = PoseStamped()
goal.header.frame_id, goal.header.stamp = "map", node.get_clock().now().to_msg()
goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = east, north, up
goal.pose.orientation.z = goal.pose.orientation.w = 0.5**0.5
goto.publish(goal)
wait_until(lambda p: abs(p.x - east) + abs(p.y - north) + abs(p.z - up) < 0.5)
ask("land")
