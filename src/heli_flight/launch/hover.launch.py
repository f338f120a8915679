# SPDX-License-Identifier: Apache-2.0
"""Fly the whole stack: `ros2 launch heli_flight hover.launch.py gps:=rtk seed:=7`.

Starts plant, observer, inner and outer loop, recorder and scenario. Scoring against the paper, and
bringing the nodes up in order, is what `./hover_test.sh` does beyond this.

An argument that is given wins over params_file, and that over the scenario, the receiver's preset
and the packaged values. The end of the flight, or of any node, ends the launch: with exit code 0,
or 1 if a node failed or the helicopter was lost.
"""

import math
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import OpaqueFunction

from heli_msgs_bridge.launching import COMMON, Argument, declare, node, users_files

SCENARIOS = ["hover", "attitude", "attitude_gusts", "identify_actuators", "identify_gusts"]
RECEIVERS = ["standalone", "rtk"]
LAWS = ["hinf", "lqr", "pid"]
# Before the plant: who is there already hears its first tick.
NODES = (
    ("heli_outer_pd", "outer_loop"),
    ("heli_inner_hinf", "inner_loop"),
    ("heli_observer", "observer"),
    ("heli_dynamics_sim", "plant"),
)
ARGUMENTS = (
    *COMMON,
    Argument("scenario", "hover", SCENARIOS, "What is flown"),
    Argument(
        "gps",
        "standalone",
        RECEIVERS,
        "Receiver: its errors in the plant, their size in the filter",
    ),
    Argument(
        "seed", "", None, "Seed of wind and sensors, a whole number (default: the parameter files')"
    ),
    Argument("duration", "", None, "Length of the flight, s (default: the parameter files')"),
    Argument("controller", "", ["", *LAWS], "Attitude law (default: the parameter files')"),
    Argument(
        "lockstep",
        "",
        ["", "true", "false"],
        "true: deterministic, as fast as possible; false: at the pace of the wall clock "
        "(default: the parameter files')",
    ),
    Argument("record", "true", ["true", "false"], "Write a bag"),
    Argument(
        "bag", "", None, "Folder of the bag, must not exist (default: bags/ with date and time)"
    ),
    Argument("live", "false", ["true", "false"], "Serve the live view"),
)


def _config(package, name):
    return str(Path(get_package_share_directory(package)) / "config" / name)


def _seed(text):
    if not text.isdecimal():
        raise ValueError(f"seed:={text}: write a whole number that is not negative")
    return int(text)


def _duration_s(text):
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ValueError(f"duration:={text}: write a number of seconds above 0")
    return value


def _overrides(given):
    """Parameters that arguments set, per node."""
    found = {name: {} for _, name in NODES} | {"recorder": {}, "live_view": {}}
    if given["lockstep"]:
        for name in (*(name for _, name in NODES), "live_view"):
            found[name]["lockstep"] = given["lockstep"] == "true"
    if given["seed"]:
        found["plant"]["seed"] = _seed(given["seed"])
    if given["duration"]:
        found["plant"]["duration_s"] = _duration_s(given["duration"])
    if given["controller"]:
        found["inner_loop"]["controller"] = given["controller"]
    if given["bag"]:
        if given["record"] != "true":
            raise ValueError(f"bag:={given['bag']}: does not go with record:=false")
        found["recorder"]["bag"] = given["bag"]
    return found


def _graph(context):
    """Every node configures and activates itself; in lockstep the plant waits for its peers."""
    given = context.launch_configurations
    arguments, users = _overrides(given), users_files(given)
    scenario = _config("heli_flight", f"scenarios/{given['scenario']}.yaml")
    preset = f"gps_{given['gps']}.yaml"
    recorded = given["record"] == "true"
    # So that the bag begins with the first tick.
    peers = {"peers": [*(name for _, name in NODES), *(["recorder"] if recorded else [])]}
    found = [node("heli_flight", "scenario", given, [scenario, *users])]
    if recorded:
        found.append(node("heli_bags", "recorder", given, [*users, arguments["recorder"]]))
    if given["live"] == "true":
        found.append(node("heli_live_view", "live_view", given, [*users, arguments["live_view"]]))
    for package, name in NODES:
        path = _config(package, preset)
        receiver = path if Path(path).is_file() else None
        layers = [peers, receiver, scenario, *users, arguments[name]]
        found.append(node(package, name, given, layers))
    return found


def generate_launch_description():
    """Arguments as in ARGUMENTS; the nodes follow from their values."""
    return LaunchDescription([*declare(ARGUMENTS), OpaqueFunction(function=_graph)])
