# SPDX-License-Identifier: Apache-2.0
"""Start the live view: a page for browsers and a server for Foxglove.

ros2 launch heli_live_view live_view.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Arguments namespace, params_file and log_level."""
    return single_node("heli_live_view", "live_view")
