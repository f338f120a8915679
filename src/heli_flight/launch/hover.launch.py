# SPDX-License-Identifier: Apache-2.0
"""Fly the whole stack: `ros2 launch heli_flight hover.launch.py gps:=rtk seed:=7`.

Starts plant, observer, inner and outer loop, recorder and scenario. Scoring against the paper, and
bringing the nodes up in order, is what `./hover_test.sh` does beyond this.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def _config(package, *parts):
    """File of a package's config folder, parts may hold launch arguments."""
    folder = str(Path(get_package_share_directory(package)) / "config")
    return PathJoinSubstitution([folder, *parts])


def _gps_preset(package):
    return _config(package, PythonExpression(["'gps_' + '", LaunchConfiguration("gps"), ".yaml'"]))


def _node(package, name, *layers, condition=None, **values):
    """One node with its parameter layers, weakest first: presets, arguments, the user's file."""
    parameters = [*layers, *([values] if values else []), LaunchConfiguration("params_file")]
    return Node(
        package=package,
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=parameters,
        output="screen",
        condition=condition,
    )


def _arguments():
    """Launch arguments with their meaning."""
    gps = "GPS receiver: its errors in the plant, their size in the observer"
    pace = "true: deterministic, as fast as possible; false: at the pace of the wall clock"
    common = str(Path(get_package_share_directory("heli_parameters")) / "config" / "common.yaml")
    return [
        DeclareLaunchArgument("namespace", default_value="", description="Prefix of all names"),
        DeclareLaunchArgument(
            "scenario",
            default_value="hover",
            choices=["hover", "attitude", "attitude_gusts", "identify_actuators", "identify_gusts"],
        ),
        DeclareLaunchArgument(
            "gps", default_value="standalone", choices=["standalone", "rtk"], description=gps
        ),
        DeclareLaunchArgument("seed", default_value="1", description="Seed of wind and sensors"),
        DeclareLaunchArgument("lockstep", default_value="true", description=pace),
        DeclareLaunchArgument("record", default_value="true", description="Write a bag"),
        DeclareLaunchArgument("live", default_value="false", description="Serve the live view"),
        DeclareLaunchArgument(
            "params_file",
            default_value=common,
            description="Parameter file, stronger than the rest",
        ),
    ]


def generate_launch_description():
    """Every node configures and activates itself; in lockstep the plant waits for its peers."""
    scenario = _config(
        "heli_flight",
        "scenarios",
        PythonExpression(["'", LaunchConfiguration("scenario"), "' + '.yaml'"]),
    )
    lockstep = ParameterValue(LaunchConfiguration("lockstep"), value_type=bool)
    seed = ParameterValue(LaunchConfiguration("seed"), value_type=int)
    return LaunchDescription(
        [
            *_arguments(),
            _node("heli_flight", "scenario", scenario),
            _node("heli_bags", "recorder", condition=IfCondition(LaunchConfiguration("record"))),
            _node(
                "heli_live_view",
                "live_view",
                condition=IfCondition(LaunchConfiguration("live")),
                lockstep=lockstep,
            ),
            _node("heli_outer_pd", "outer_loop", scenario, lockstep=lockstep),
            _node("heli_inner_hinf", "inner_loop", scenario, lockstep=lockstep),
            _node(
                "heli_observer",
                "observer",
                _gps_preset("heli_observer"),
                scenario,
                lockstep=lockstep,
            ),
            _node(
                "heli_dynamics_sim",
                "plant",
                _gps_preset("heli_dynamics_sim"),
                scenario,
                lockstep=lockstep,
                seed=seed,
            ),
        ]
    )
