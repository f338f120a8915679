# SPDX-License-Identifier: Apache-2.0
"""Fly the whole stack: `ros2 launch heli_flight hover.launch.py gps:=rtk seed:=7`.

Starts plant, observer, inner and outer loop, recorder and scenario. Scoring against the paper, and
bringing the nodes up in order, is what `./hover_test.sh` does beyond this.

An argument that is given wins over params_file, and that over the scenario, the laws, the world
with what the seed draws in it, the receiver's preset and the packaged values. The end of the
flight, or of any node, ends the launch: with exit code 0, or 1 if a node failed or the helicopter
was lost.
"""

import math
import time
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import OpaqueFunction

from heli_bags.parameters import NODE_NAME as RECORDER
from heli_bags.parameters import TABLE as RECORDER_TABLE
from heli_bags.parameters import unrecorded
from heli_core.parameters import load, with_common
from heli_flight.graph.respawn import AGAIN, MOST, WITHIN_S
from heli_flight.settings import (
    HOVER_TEST_WORLD,
    MOST_AIRCRAFT,
    PACKAGED,
    PAPER,
    WORLD_SECTION,
    WORLDS,
    Reader,
    layered,
    seed_of,
)
from heli_flight.settings import LAWS as LAW_FILES
from heli_msgs_bridge.launching import COMMON, Again, Argument, declare, node, together, users_files

SCENARIOS = [
    "hover", "attitude", "attitude_gusts", "attitude_sweep", "attitude_steps",
    "attitude_disturbance",
    "figure_eight", "orbit", "waypoints", "forward_flight", "takeoff_land", "by_hand",
    "sequence",
    "mte_hover", "mte_vertical", "mte_pirouette", "mte_slalom", "mte_lateral_reposition",
    "mte_depart_abort",
    "identify_actuators", "identify_gusts",
]  # fmt: skip
RECEIVERS = ["standalone", "rtk"]
LAWS = ["hinf_output", "hinf", "lqr", "lqg", "pid", "indi", "matrices"]
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
        "world",
        "",
        None,
        "Air, sensors and what the seed draws of the aircraft: paper, honest, hard, or a YAML file "
        "(default: the hover test's)",
    ),
    Argument(
        "laws",
        "",
        None,
        "Attitude law, position law and observer: packaged, paper, or a YAML file "
        "(default: those of the controller's name, else packaged)",
    ),
    Argument(
        "seed",
        "",
        None,
        "Seed of wind and sensors (default: the parameter files'; of several aircraft 1)",
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
    Argument(
        "composed",
        "false",
        ["true", "false"],
        "Plant, observer, inner and outer loop in one process, still by topics; twice as fast",
    ),
    Argument(
        "respawn",
        "false",
        ["true", "false"],
        "Start observer, inner or outer loop again when its process dies in flight",
    ),
    Argument("record", "true", ["true", "false"], "Write a bag"),
    Argument(
        "bag", "", None, "Folder of the bag, must not exist (default: bags/ with date and time)"
    ),
    Argument("live", "false", ["true", "false"], "Serve the live view"),
    Argument(
        "actions", "false", ["true", "false"], "Serve the actions; heli_interfaces has to be built"
    ),
    Argument(
        "aircraft", "1", None, "How many, in the namespaces heli1, heli2 ...; each has its own seed"
    ),
    Argument(
        "clock", "", ["", "own", "world"], "Who sends /clock: the plant, or a world_clock elsewhere"
    ),
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
        for _, name in NODES:
            found[name]["link_seed"] = _seed(given["seed"])
    if given["duration"]:
        found["plant"]["duration_s"] = _duration_s(given["duration"])
    if given["clock"]:
        found["plant"]["clock"] = given["clock"]
    if given["controller"]:
        found["inner_loop"]["controller"] = given["controller"]
    if given["bag"]:
        if given["record"] != "true":
            raise ValueError(f"bag:={given['bag']}: does not go with record:=false")
        found["recorder"]["bag"] = given["bag"]
    return found


def _laws(given):
    """Those that are named, else those of the controller's name, else the packaged ones."""
    of_controller = given["controller"] if given["controller"] in LAW_FILES.names() else PACKAGED
    return given["laws"] or of_controller


def _around(given, users):
    """Presets of sensors, files of world and laws, and what the seed draws, per node."""
    hovers = given["scenario"] == "hover"
    world = given["world"] or (HOVER_TEST_WORLD if hovers else PAPER)
    read, laws = Reader(), _laws(given)
    found = layered(
        read,
        given["scenario"],
        given["gps"],
        world,
        [read(path) for path in users],
        _seed(given["seed"]) if given["seed"] else None,
        laws,
    )
    grade = found.values[WORLD_SECTION]["sensors." + given["gps"]]
    # One file tells the plant and the observer.
    sensors = _config("heli_dynamics_sim", f"sensors_{grade}.yaml")
    plant = {key: found.values["plant"][key] for key in found.drawn}
    files = [str(WORLDS.file(world)), str(LAW_FILES.file(laws))]
    return sensors, files, {"plant": plant}


def _unrecorded(given, users):
    """Topics that the user's recorder leaves out: the others must not wait for it there."""
    files = [_config("heli_core", "common.yaml"), _config("heli_bags", f"{RECORDER}.yaml")]
    values = load(with_common(RECORDER_TABLE), [*files, *users], f"{given['namespace']}/{RECORDER}")
    return list(unrecorded(values["topics"], values["exclude"]))


def _again(given):
    """Who is started again, if asked for."""
    if given["respawn"] != "true":
        return None
    for name, plain in (("composed", "false"), ("aircraft", "1")):
        if given[name] != plain:
            raise ValueError(f"respawn:=true: does not go with {name}:={given[name]}")
    return Again(AGAIN, MOST, WITHIN_S)


def _aircraft(given):
    """Nodes of one aircraft; each configures and activates itself, the plant waits for the rest."""
    arguments, users = _overrides(given), users_files(given)
    scenario = _config("heli_flight", f"scenarios/{given['scenario']}.yaml")
    sensors, files, drawn = _around(given, users)
    recorded = given["record"] == "true"
    again = _again(given)
    # So that the bag begins with the first tick.
    peers = {"peers": [*(name for _, name in NODES), *(["recorder"] if recorded else [])]}
    peers["unrecorded"] = _unrecorded(given, users)
    found = [node("heli_flight", "scenario", given, [scenario, *users], again=again)]
    if recorded:
        own = [*users, arguments["recorder"]]
        found.append(node("heli_bags", "recorder", given, own, again=again))
    if given["live"] == "true":
        own = [*users, arguments["live_view"]]
        found.append(node("heli_live_view", "live_view", given, own, again=again))
    if given["actions"] == "true":
        found.append(node("heli_actions", "actions", given, users, again=again))
    layers = {}
    for package, name in NODES:
        receiver, grade = (
            [path] if Path(path).is_file() else []
            for path in (_config(package, f"gps_{given['gps']}.yaml"), sensors)
        )
        around = receiver, grade, [*files, drawn.get(name)], [scenario, *users]
        layers[name] = [[peers], *around, [arguments[name]]]
    # Of several aircraft the last flight ends the launch, by the clock of their world.
    alone = given["aircraft"] == "1"
    if given["composed"] == "true":
        return [*found, together("heli_flight", "composed", given, layers, alone)]
    for package, name in NODES:
        own = [layer for group in layers[name] for layer in group]
        found.append(node(package, name, given, own, name != "plant" or alone, again))
    return found


def _several(given, count):
    """Several aircraft and the clock of their world."""
    if given["live"] == "true":
        raise ValueError(f"live:=true: shows one aircraft, not aircraft:={count}")
    base = given["namespace"].strip("/")
    names = [f"{base}/heli{i + 1}".strip("/") for i in range(count)]
    bags = Path(given["bag"] or f"bags/{time.strftime('%Y%m%d-%H%M%S')}")
    found = [node("heli_flight", "world_clock", {**given, "namespace": ""}, [{"aircraft": names}])]
    for number, name in enumerate(names):
        own = {"namespace": name, "clock": "world", "bag": str(bags / f"heli{number + 1}")}
        own["seed"] = str(seed_of(_seed(given["seed"] or "1"), number))
        if given["record"] != "true":
            own["bag"] = ""
        found += _aircraft({**given, **own})
    return found


def _graph(context):
    given = context.launch_configurations
    count = given["aircraft"]
    if not (count.isdecimal() and 1 <= int(count) <= MOST_AIRCRAFT):
        raise ValueError(f"aircraft:={count}: write a whole number from 1 to {MOST_AIRCRAFT}")
    return _aircraft(given) if int(count) == 1 else _several(given, int(count))


def generate_launch_description():
    """Arguments as in ARGUMENTS; the nodes follow from their values."""
    return LaunchDescription([*declare(ARGUMENTS), OpaqueFunction(function=_graph)])
