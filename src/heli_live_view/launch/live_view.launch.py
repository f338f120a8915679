# SPDX-License-Identifier: Apache-2.0
"""Start the live view: a page for browsers and a server for Foxglove.

ros2 launch heli_msgs_bridge live_view.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Argument params_file: a parameter file over the packaged values."""
    return single_node("heli_live_view", "live_view")
