# SPDX-License-Identifier: Apache-2.0
"""Start the simulated helicopter.

ros2 launch heli_dynamics_sim plant.launch.py params_file:=my.yaml
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory("heli_dynamics_sim")) / "config"


def generate_launch_description():
    """One node; it configures and activates itself unless the parameter autostart is false."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Prefix of all names"),
            DeclareLaunchArgument(
                "params_file",
                default_value=str(CONFIG / "plant.yaml"),
                description="Parameter file over the packaged values",
            ),
            Node(
                package="heli_dynamics_sim",
                executable="plant",
                name="plant",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
