# SPDX-License-Identifier: Apache-2.0
"""Serve the actions takeoff, goto, follow and land of a graph that flies.

ros2 launch heli_actions actions.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Arguments namespace, params_file and log_level."""
    return single_node("heli_actions", "actions")
