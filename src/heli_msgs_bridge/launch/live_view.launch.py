# SPDX-License-Identifier: Apache-2.0
"""Start the live view: a page for browsers and a server for Foxglove.

ros2 launch heli_msgs_bridge live_view.launch.py params_file:=my.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory("heli_msgs_bridge")) / "config"


def generate_launch_description():
    """One node; it configures and activates itself unless the parameter autostart is false."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Prefix of all names"),
            DeclareLaunchArgument(
                "params_file",
                default_value=str(CONFIG / "live_view.yaml"),
                description="Parameter file over the packaged values",
            ),
            Node(
                package="heli_msgs_bridge",
                executable="live_view",
                name="live_view",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
