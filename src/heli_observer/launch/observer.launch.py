# SPDX-License-Identifier: Apache-2.0
"""Start the navigation filter and the rotor-state observer.

ros2 launch heli_observer observer.launch.py params_file:=my.yaml
"""

from heli_msgs_bridge.launching import single_node


def generate_launch_description():
    """Arguments namespace, params_file and log_level."""
    return single_node("heli_observer", "observer")
