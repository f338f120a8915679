# SPDX-License-Identifier: Apache-2.0
"""Send the aircraft that flies to a point: goto.py EAST NORTH UP, in m, nose to the north."""

import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter

rclpy.init()
node = rclpy.create_node("pilot", parameter_overrides=[Parameter("use_sim_time", value=True)])
goto = node.create_publisher(PoseStamped, "goto", 10)
while not node.get_clock().now().nanoseconds or "outer_loop" not in [
    listener.node_name for listener in node.get_subscriptions_info_by_topic("goto")
]:
    rclpy.spin_once(node)
goal = PoseStamped()
goal.header.frame_id, goal.header.stamp = "map", node.get_clock().now().to_msg()
goal.pose.position.x, goal.pose.position.y, goal.pose.position.z = map(float, sys.argv[1:])
goal.pose.orientation.z = goal.pose.orientation.w = 0.5**0.5
goto.publish(goal)
goto.wait_for_all_acked()
print(
    "sent: east {} m, north {} m, up {} m; it says in /diagnostics if it refuses".format(
        *sys.argv[1:]
    )
)
