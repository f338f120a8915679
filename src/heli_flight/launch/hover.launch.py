# SPDX-License-Identifier: Apache-2.0
"""Fly the whole stack: `ros2 launch heli_flight hover.launch.py gps:=rtk seed:=7`.

Starts plant, observer, inner and outer loop, recorder and scenario. Scoring against the paper, and
bringing the nodes up in order, is what `./hover_test.sh` does beyond this.

An argument that is given wins over params_file, and that over the scenario, the receiver's preset
and the packaged values.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

SCENARIOS = ["hover", "attitude", "attitude_gusts", "identify_actuators", "identify_gusts"]
RECEIVERS = ["standalone", "rtk"]
# Before the plant: who is there already hears its first tick.
NODES = (
    ("heli_outer_pd", "outer_loop"),
    ("heli_inner_hinf", "inner_loop"),
    ("heli_observer", "observer"),
    ("heli_dynamics_sim", "plant"),
)
ARGUMENTS = (
    ("namespace", "", None, "Prefix of all names"),
    ("scenario", "hover", SCENARIOS, "What is flown"),
    ("gps", "standalone", RECEIVERS, "Receiver: its errors in the plant, their size in the filter"),
    ("seed", "", None, "Seed of wind and sensors, a whole number (default: the parameter files')"),
    (
        "lockstep",
        "",
        ["", "true", "false"],
        "true: deterministic, as fast as possible; false: at the pace of the wall clock "
        "(default: the parameter files')",
    ),
    ("record", "true", ["true", "false"], "Write a bag"),
    ("live", "false", ["true", "false"], "Serve the live view"),
    ("params_file", "", None, "Parameter file over scenario, preset and packaged values"),
)


def _config(package, name):
    return str(Path(get_package_share_directory(package)) / "config" / name)


def _overrides(given):
    """Parameters that arguments set, for all nodes and for the plant alone."""
    common, plant = {}, {}
    if given["lockstep"]:
        common["lockstep"] = given["lockstep"] == "true"
    if given["seed"]:
        if not given["seed"].isdecimal():
            raise ValueError(f"seed:={given['seed']}: write a whole number that is not negative")
        plant["seed"] = int(given["seed"])
    return common, plant


def _graph(context):
    """Every node configures and activates itself; in lockstep the plant waits for its peers."""
    given = context.launch_configurations
    common, plant = _overrides(given)
    scenario = _config("heli_flight", f"scenarios/{given['scenario']}.yaml")
    users = [given["params_file"]] if given["params_file"] else []
    preset = f"gps_{given['gps']}.yaml"

    def node(package, name, *layers):
        return Node(
            package=package,
            executable=name,
            name=name,
            namespace=given["namespace"],
            parameters=[layer for layer in layers if layer],
            output="screen",
        )

    found = [node("heli_flight", "scenario", scenario, *users)]
    if given["record"] == "true":
        found.append(node("heli_bags", "recorder", *users))
    if given["live"] == "true":
        found.append(node("heli_live_view", "live_view", *users, common))
    for package, name in NODES:
        path = _config(package, preset)
        receiver = path if Path(path).is_file() else None
        own = plant if name == "plant" else {}
        found.append(node(package, name, receiver, scenario, *users, {**common, **own}))
    return found


def generate_launch_description():
    """Arguments as in ARGUMENTS; the nodes follow from their values."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, choices=choices, description=text)
        for name, value, choices, text in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_graph)])
