# SPDX-License-Identifier: Apache-2.0
"""Start the H-infinity attitude loop.

ros2 launch heli_inner_hinf inner_loop.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Arguments namespace, params_file and log_level."""
    return single_node("heli_inner_hinf", "inner_loop")
