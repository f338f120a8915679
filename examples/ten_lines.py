# SPDX-License-Identifier: Apache-2.0
"""Take off, go 9 m east, 6 m north, 12 m up, land, in ten lines of rclpy (--scenario by_hand)."""

import rclpy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from rclpy.wait_for_message import wait_for_message
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("pilot")
goto = node.create_publisher(PoseStamped, "goto", 10)
goal = Pose(position=Point(x=9.0, y=6.0, z=12.0), orientation=Quaternion(z=0.5**0.5, w=0.5**0.5))
for name in ("takeoff", "land"):
    _, odom = wait_for_message(Odometry, node, "odom", qos_profile=qos_profile_sensor_data)
    while name == "land" and abs(odom.pose.pose.position.x - goal.position.x) > 0.3:
        goto.publish(PoseStamped(header=odom.header, pose=goal))  # refused until it is in the air
        _, odom = wait_for_message(Odometry, node, "odom", qos_profile=qos_profile_sensor_data)
    service = node.create_client(Trigger, name)
    service.wait_for_service()
    asked = service.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, asked)
    print(asked.result().message, flush=True)
