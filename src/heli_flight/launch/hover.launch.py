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
from heli_flight.fleet import read_fleet
from heli_flight.graph.respawn import AGAIN, MOST, WITHIN_S
from heli_flight.layers import Reader, layered
from heli_flight.settings import MOST_AIRCRAFT, seed_of
from heli_flight.worlds import HOVER_TEST_WORLD, PACKAGED, PAPER, WORLD_SECTION, WORLDS
from heli_flight.worlds import LAWS as LAW_FILES
from heli_msgs_bridge.launching import (
    COMMON,
    Argument,
    NodeRestarter,
    declare,
    node,
    together,
    users_files,
)

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
        "Attitude controller, position controller and observer: packaged, paper, or a YAML file "
        "(default: those of the controller's name, else packaged)",
    ),
    Argument(
        "seed",
        "",
        None,
        "Seed of wind and sensors (default: the parameter files'; of several aircraft 1)",
    ),
    Argument("duration", "", None, "Length of the flight, s (default: the parameter files')"),
    Argument("controller", "", ["", *LAWS], "Attitude controller (default: the parameter files')"),
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
        "fleet", "", None, "YAML file: namespace, type, place and parameters of each aircraft"
    ),
    Argument(
        "lifecycle_manager",
        "false",
        ["true", "false"],
        "A lifecycle manager brings the nodes up in order and watches that they live",
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


def _overrides(launch_args):
    """Parameters that arguments set, per node."""
    overrides = {name: {} for _, name in NODES} | {"recorder": {}, "live_view": {}}
    if launch_args["lockstep"]:
        for name in (*(name for _, name in NODES), "live_view"):
            overrides[name]["lockstep"] = launch_args["lockstep"] == "true"
    if launch_args["seed"]:
        overrides["plant"]["seed"] = _seed(launch_args["seed"])
        for _, name in NODES:
            overrides[name]["link_seed"] = _seed(launch_args["seed"])
    if launch_args["duration"]:
        overrides["plant"]["duration_s"] = _duration_s(launch_args["duration"])
    if launch_args["clock"]:
        overrides["plant"]["clock"] = launch_args["clock"]
    if launch_args["controller"]:
        overrides["inner_loop"]["controller"] = launch_args["controller"]
    if launch_args["bag"]:
        if launch_args["record"] != "true":
            raise ValueError(f"bag:={launch_args['bag']}: does not go with record:=false")
        overrides["recorder"]["bag"] = launch_args["bag"]
    return overrides


def _laws(launch_args):
    """Those that are named, else those of the controller's name, else the packaged ones."""
    controller = launch_args["controller"]
    return launch_args["laws"] or (controller if controller in LAW_FILES.names() else PACKAGED)


def _around(launch_args, users):
    """Presets of sensors, files of world and control preset, and what the seed draws, per node."""
    hovers = launch_args["scenario"] == "hover"
    world = launch_args["world"] or (HOVER_TEST_WORLD if hovers else PAPER)
    read, laws = Reader(), _laws(launch_args)
    layers = layered(
        read,
        launch_args["scenario"],
        launch_args["gps"],
        world,
        [read(path) for path in users],
        _seed(launch_args["seed"]) if launch_args["seed"] else None,
        laws,
    )
    grade = layers.values[WORLD_SECTION]["sensors." + launch_args["gps"]]
    # One file tells the plant and the observer.
    sensors = _config("heli_dynamics_sim", f"sensors_{grade}.yaml")
    plant = {key: layers.values["plant"][key] for key in layers.drawn}
    files = [str(WORLDS.file(world)), str(LAW_FILES.file(laws))]
    return sensors, files, {"plant": plant}


def _unrecorded(launch_args, users):
    """Topics that the user's recorder leaves out: the others must not wait for it there."""
    files = [_config("heli_core", "common.yaml"), _config("heli_bags", f"{RECORDER}.yaml")]
    values = load(
        with_common(RECORDER_TABLE), [*files, *users], f"{launch_args['namespace']}/{RECORDER}"
    )
    return list(unrecorded(values["topics"], values["exclude"]))


def _again(launch_args):
    """Who is started again, if asked for."""
    if launch_args["respawn"] != "true":
        return None
    for name, plain in (("composed", "false"), ("aircraft", "1"), ("fleet", "")):
        if launch_args[name] != plain:
            raise ValueError(f"respawn:=true: does not go with {name}:={launch_args[name]}")
    return NodeRestarter(AGAIN, MOST, WITHIN_S)


def _managed(launch_args, beside):
    """What the nodes are told of who starts them, and what the manager is told of them.

    The plant is last: time begins with it, when all others are active.
    """
    if launch_args["lifecycle_manager"] != "true":
        return {}, {}
    names = [*beside, "scenario", "observer", "inner_loop", "outer_loop", "plant"]
    return {"autostart": False}, {"node_names": names}


def _aircraft(launch_args, own=None):
    """Nodes of one aircraft, one of a fleet if given.

    Each configures and activates itself, unless a manager does; the plant waits for the rest.
    """
    arguments, users = _overrides(launch_args), users_files(launch_args)
    at = {"scenario": {}}
    if own is not None:
        users = [str(path) for path in (own.design, *users, own.params_file) if path]
        at = own.overrides()
        arguments["plant"] |= at["plant"]
    scenario = _config("heli_flight", f"scenarios/{launch_args['scenario']}.yaml")
    sensors, files, drawn = _around(launch_args, users)
    recorded = launch_args["record"] == "true"
    again = _again(launch_args)
    beside = {"recorder": recorded} | {
        name: launch_args[argument] == "true"
        for name, argument in (("live_view", "live"), ("actions", "actions"))
    }
    led, manager = _managed(launch_args, [name for name, there in beside.items() if there])
    for values in arguments.values():
        values |= led
    # So that the bag begins with the first tick.
    peers = {"peers": [*(name for _, name in NODES), *(["recorder"] if recorded else [])]}
    peers["unrecorded"] = _unrecorded(launch_args, users)
    told = [scenario, *users, at["scenario"] | led]
    nodes = [node("heli_flight", "scenario", launch_args, told, again=again)]
    if manager:
        told = [manager, *users]
        nodes.append(node("heli_flight", "lifecycle_manager", launch_args, told, again=again))
    if recorded:
        parameters = [*users, arguments["recorder"]]
        nodes.append(node("heli_bags", "recorder", launch_args, parameters, again=again))
    if launch_args["live"] == "true":
        parameters = [*users, arguments["live_view"]]
        nodes.append(node("heli_live_view", "live_view", launch_args, parameters, again=again))
    if launch_args["actions"] == "true":
        nodes.append(node("heli_actions", "actions", launch_args, [*users, led], again=again))
    layers = {}
    for package, name in NODES:
        receiver, grade = (
            [path] if Path(path).is_file() else []
            for path in (_config(package, f"gps_{launch_args['gps']}.yaml"), sensors)
        )
        around = receiver, grade, [*files, drawn.get(name)], [scenario, *users]
        layers[name] = [[peers], *around, [arguments[name]]]
    # Of several aircraft the last flight ends the launch, by the clock of their world.
    alone = launch_args["aircraft"] == "1" and own is None
    if launch_args["composed"] == "true":
        return [*nodes, together("heli_flight", "composed", launch_args, layers, alone)]
    for package, name in NODES:
        parameters = [layer for group in layers[name] for layer in group]
        nodes.append(node(package, name, launch_args, parameters, name != "plant" or alone, again))
    return nodes


def _several(launch_args, fleet):
    """Several aircraft and the clock of their world; of each its namespace and what is its own."""
    if launch_args["live"] == "true":
        asked = launch_args["fleet"] and f"fleet:={launch_args['fleet']}"
        raise ValueError(
            f"live:=true: shows one aircraft, not {asked or 'aircraft:=' + launch_args['aircraft']}"
        )
    base = launch_args["namespace"].strip("/")
    names = [f"{base}/{name}".strip("/") for name, _ in fleet]
    bags = Path(launch_args["bag"] or f"bags/{time.strftime('%Y%m%d-%H%M%S')}")
    nodes = [
        node("heli_flight", "world_clock", {**launch_args, "namespace": ""}, [{"aircraft": names}])
    ]
    for number, (name, own) in enumerate(fleet):
        its_args = {"namespace": names[number], "clock": "world", "bag": str(bags / name)}
        seed = seed_of(_seed(launch_args["seed"] or "1"), number)
        its_args["seed"] = str(seed if own is None or own.seed is None else own.seed)
        if launch_args["record"] != "true":
            its_args["bag"] = ""
        nodes += _aircraft({**launch_args, **its_args}, own)
    return nodes


def _fleet(launch_args):
    """Who flies beside whom: (namespace, FleetAircraft or None) of each; empty for one alone."""
    count, file = launch_args["aircraft"], launch_args["fleet"]
    if not (count.isdecimal() and 1 <= int(count) <= MOST_AIRCRAFT):
        raise ValueError(f"aircraft:={count}: write a whole number from 1 to {MOST_AIRCRAFT}")
    if not file:
        return [(f"heli{i + 1}", None) for i in range(int(count))] if int(count) > 1 else []
    if count != "1":
        raise ValueError(
            f"fleet:={file}: names the aircraft; it does not go with aircraft:={count}"
        )
    return [(one.namespace, one) for one in read_fleet(file)]


def _graph(context):
    launch_args = context.launch_configurations
    fleet = _fleet(launch_args)
    return _several(launch_args, fleet) if fleet else _aircraft(launch_args)


def generate_launch_description():
    """Arguments as in ARGUMENTS; the nodes follow from their values."""
    return LaunchDescription([*declare(ARGUMENTS), OpaqueFunction(function=_graph)])
