# SPDX-License-Identifier: Apache-2.0
"""The launch description of one node, which every package's launch file asks for."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def single_node(package: str, name: str) -> LaunchDescription:
    """Launch arguments namespace and params_file, and the node of this name.

    The node configures and activates itself unless its parameter autostart is false.
    """
    packaged = Path(get_package_share_directory(package)) / "config" / f"{name}.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="Prefix of all names"),
            DeclareLaunchArgument(
                "params_file",
                default_value=str(packaged),
                description="Parameter file over the packaged values",
            ),
            Node(
                package=package,
                executable=name,
                name=name,
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
