# SPDX-License-Identifier: Apache-2.0
"""What the live view is made of: state, scene, access, servers. Only `ros_commands` needs ROS."""
