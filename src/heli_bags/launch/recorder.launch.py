# SPDX-License-Identifier: Apache-2.0
"""Start the flight recorder.

ros2 launch heli_bags recorder.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Arguments namespace, params_file and log_level."""
    return single_node("heli_bags", "recorder")
