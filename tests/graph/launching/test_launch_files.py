# SPDX-License-Identifier: Apache-2.0
"""What each launch file starts, and what each of its arguments changes in the nodes' parameters."""

import contextlib
import dataclasses
import re
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.command_line import config_folder, executable
from heli_core.parameters import load, with_common
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import NS_PER_S
from heli_flight.layers import GPS_PRESETS, scenario_names
from heli_flight.settings import resolve
from heli_flight.worlds import PACKAGED
from heli_inner_hinf.controller_state import CONTROLLERS
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[3]
LAUNCH_FILES = sorted(
    (path.parents[1].name, path.name) for path in (ROOT / "src").glob("*/launch/*.launch.py")
)
SINGLE = [(package, name) for package, name in LAUNCH_FILES if name != "hover.launch.py"]
HOVER = ("heli_flight", "hover.launch.py")
FLYING = ("plant", "observer", "inner_loop", "outer_loop")
OVER = re.compile(r"\bover\b.* 2 s\b")  # the plant's last line


def values(node, folder):
    """Parameters that a started node ends up with: packaged ones, then what launch gives it."""
    table = with_common(import_module(f"{node.package}.parameters").TABLE)
    common = config_folder("heli_core") / "common.yaml"
    packaged = config_folder(node.package) / f"{node.name}.yaml"
    return load(table, [common, packaged, *node.files(folder)], node.full_name)


def by_name(started):
    names = [node.name for node in started]
    assert len(names) == len(set(names))
    return {node.name: node for node in started}


@pytest.mark.parametrize(("package", "name"), LAUNCH_FILES)
def test_every_executable_exists(launch, package, name):
    started = launch(package, name)
    assert started
    for node in started:
        assert executable(node.package, node.executable)


@pytest.mark.parametrize(("package", "name"), SINGLE)
def test_a_single_node_takes_namespace_and_file(launch, package, name, tmp_path):
    only = name.removesuffix(".launch.py")
    (node,) = launch(package, name)
    assert (node.package, node.name, node.namespace) == (package, only, "")
    assert values(node, tmp_path)["autostart"] is True
    file = tmp_path / "my.yaml"
    file.write_text(f"/**/{only}:\n  ros__parameters:\n    autostart: false\n")
    (node,) = launch(package, name, "namespace:=heli1", f"params_file:={file}")
    assert node.full_name == f"/heli1/{only}"
    assert values(node, tmp_path)["autostart"] is False


def test_hover_starts_the_graph(launch):
    started = by_name(launch(*HOVER))
    assert set(started) == {*FLYING, "scenario", "recorder"}


def test_hover_without_arguments_flies_the_packaged_values(launch, tmp_path):
    """The parameter files decide what no argument speaks of."""
    for name, node in by_name(launch(*HOVER)).items():
        if name in FLYING:
            launched = values(node, tmp_path)
            defaults = config_folder(node.package) / f"{name}.yaml"
            common = config_folder("heli_core") / "common.yaml"
            table = with_common(import_module(f"{node.package}.parameters").TABLE)
            packaged = load(table, [common, defaults], name)
            assert launched["lockstep"] == packaged["lockstep"]
            assert launched.get("seed") == packaged.get("seed")


@pytest.mark.parametrize("lockstep", ["true", "false"])
def test_argument_lockstep(launch, tmp_path, lockstep):
    for name, node in by_name(launch(*HOVER, f"lockstep:={lockstep}", "live:=true")).items():
        if name in (*FLYING, "live_view"):
            assert values(node, tmp_path)["lockstep"] is (lockstep == "true"), name


# Argument, node, parameter, value by the argument, value by the user's file.
WINNING = [
    ("seed:=7", "plant", "seed", 7, "5"),
    ("duration:=3.5", "plant", "duration_s", 3.5, "4.0"),
    ("controller:=pid", "inner_loop", "controller", "pid", "lqr"),
    ("clock:=world", "plant", "clock", "world", "own"),
    ("bag:=by_argument", "recorder", "bag", "by_argument", "by_file"),
    *(("lockstep:=false", name, "lockstep", False, "true") for name in (*FLYING, "live_view")),
]


@pytest.mark.parametrize(("argument", "node", "key", "value", "in_file"), WINNING)
def test_an_argument_wins_over_the_users_file_and_that_over_defaults(
    launch, tmp_path, argument, node, key, value, in_file
):
    def launched(*arguments):
        return values(by_name(launch(*HOVER, "live:=true", *arguments))[node], tmp_path)[key]

    file = tmp_path / "my.yaml"
    file.write_text(f"/**/{node}:\n  ros__parameters:\n    {key}: {in_file}\n")
    assert str(launched(f"params_file:={file}")).lower() == in_file
    assert launched(f"params_file:={file}", argument) == value
    assert launched(argument) == value
    if key not in ("lockstep", "clock"):
        assert launched() not in (value, in_file)


def test_every_argument_has_a_test(describe):
    """In this file: an argument that is added is added here."""
    tested = {argument.split(":=")[0] for argument, *_ in WINNING}
    tested |= {"namespace", "params_file", "log_level", "scenario", "gps", "record", "live"}
    tested |= {"world", "laws", "actions", "composed"}
    # In test_launch_several.py, _respawn.py, _fleet.py and _manager.py.
    tested |= {"aircraft", "respawn", "fleet", "lifecycle_manager"}
    for package, name in LAUNCH_FILES:
        entities = describe(package, name).entities
        declared = {entity.name for entity in entities if hasattr(entity, "default_value")}
        expected = tested if name == HOVER[1] else {"namespace", "params_file", "log_level"}
        assert declared == expected, name


def test_the_laws_are_those_that_there_are(describe):
    (law,) = [e for e in describe(*HOVER).entities if getattr(e, "name", "") == "controller"]
    assert set(law.choices) == {"", *CONTROLLERS}


@pytest.mark.parametrize(("package", "name"), LAUNCH_FILES)
def test_argument_log_level(launch, tmp_path, package, name):
    for node in launch(package, name, "log_level:=debug"):
        words = node.command(tmp_path)
        assert words[words.index("--log-level") + 1] == "debug"
        assert "--ros-args" in words[: words.index("--log-level")]
    with pytest.raises(Exception, match="log_level"):
        launch(package, name, "log_level:=loud")


@pytest.mark.parametrize(("package", "name"), LAUNCH_FILES)
def test_a_users_file_that_is_not_there_starts_nothing(launch, package, name):
    """launch itself would warn and fly with the defaults."""
    with pytest.raises(ValueError, match="params_file:=/nowhere.yaml"):
        launch(package, name, "params_file:=/nowhere.yaml")


@pytest.mark.parametrize(("package", "name"), LAUNCH_FILES)
def test_the_end_of_any_node_ends_the_launch(launch, package, name):
    """With 0 if its work is done, with 1 if it failed; while launch ends all, nothing more."""
    for node in launch(package, name):
        assert node.ended(0) == 0
        assert node.ended(2) == node.ended(1) == node.ended(-11) == 1
        assert node.ended(0, shutting_down=True) is None
        assert node.ended(-2, shutting_down=True) is None


def test_argument_params_file_wins_over_scenario_and_preset(launch, tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("/**/plant:\n  ros__parameters:\n    sensors.gps.white_m: 0.123\n")
    plant = by_name(launch(*HOVER, "gps:=rtk", f"params_file:={file}"))["plant"]
    assert values(plant, tmp_path)["sensors.gps.white_m"] == 0.123


@pytest.mark.parametrize("gps", GPS_PRESETS)
def test_argument_gps(launch, tmp_path, gps):
    started = by_name(launch(*HOVER, f"gps:={gps}"))
    for name in ("plant", "observer"):
        assert f"gps_{gps}.yaml" in [layer.name for layer in started[name].files(tmp_path)]
        values(started[name], tmp_path)


@pytest.mark.parametrize("scenario", scenario_names())
def test_argument_scenario(launch, tmp_path, scenario):
    started = by_name(launch(*HOVER, f"scenario:={scenario}"))
    for name in ("scenario", *FLYING):
        assert f"{scenario}.yaml" in [layer.name for layer in started[name].files(tmp_path)]
    for name in FLYING:
        values(started[name], tmp_path)


def test_a_bag_needs_a_recorder(launch):
    with pytest.raises(ValueError, match="bag:=b.*record:=false"):
        launch(*HOVER, "bag:=b", "record:=false")


@pytest.mark.parametrize("space", ["", "heli1"])
def test_a_recorder_is_not_awaited_where_it_does_not_listen(launch, tmp_path, space):
    file = tmp_path / "my.yaml"
    file.write_text("/**/recorder:\n  ros__parameters:\n    exclude: [imu/mag, baro]\n")
    started = by_name(launch(*HOVER, f"params_file:={file}", f"namespace:={space}"))
    for name in FLYING:
        assert values(started[name], tmp_path)["unrecorded"] == ("imu/mag", "baro")
    started = by_name(launch(*HOVER, f"namespace:={space}"))
    assert values(started["plant"], tmp_path)["unrecorded"] == ("none",)


def test_arguments_record_live_and_actions(launch):
    assert "actions" in by_name(launch(*HOVER, "actions:=true"))
    assert "recorder" not in by_name(launch(*HOVER, "record:=false"))
    assert "live_view" in by_name(launch(*HOVER, "live:=true"))


def test_argument_composed(launch, tmp_path):
    """One process, in which each node has the parameters that it has alone."""
    file = tmp_path / "my.yaml"
    file.write_text("/**/plant:\n  ros__parameters:\n    {seed: 5, scale.mass: 1.25}\n")
    words = (f"params_file:={file}", "gps:=rtk", "world:=hard", "seed:=7", "namespace:=heli1")
    apart = by_name(launch(*HOVER, *words))
    started = {node.executable: node for node in launch(*HOVER, *words, "composed:=true")}
    assert set(started) == {"scenario", "recorder", "composed"}
    process = started["composed"]
    assert executable(process.package, process.executable)
    # A name would be that of each of them.
    assert not any("__node" in word for word in process.command(tmp_path))
    assert (process.ended(0), process.ended(1)) == (0, 1)
    for name in FLYING:
        one = dataclasses.replace(process, package=apart[name].package, name=name)
        np.testing.assert_equal(values(one, tmp_path), values(apart[name], tmp_path))
    assert values(apart["plant"], tmp_path)["seed"] == 7
    (last, *_) = [n for n in launch(*HOVER, "aircraft:=2", "composed:=true") if not n.name]
    assert last.ended(0) is None


def test_argument_namespace(launch):
    started = launch(*HOVER, "namespace:=heli1", "live:=true")
    assert {node.full_name for node in started} == {f"/heli1/{node.name}" for node in started}


@pytest.mark.parametrize(
    "argument",
    ["seed:=x", "seed:=-1", "seed:=1.5", "gps:=none", "lockstep:=yes", "sead:=1", "duration:=0",
     "duration:=nan", "duration:=long", "controller:=lqgg", "live:=1", "record:=no"],
)  # fmt: skip
def test_bad_arguments_start_nothing(launch, argument):
    with pytest.raises(Exception, match=argument.split(":=")[0]):
        launch(*HOVER, argument)


@pytest.fixture
def fly_launched(launch, tmp_path, ros_env, living):
    """Run the commands that launch would run, 2 s long: the plant's process, and all logs."""

    def fly(*arguments, limit_s=240, env=None):
        started = by_name(launch(*HOVER, "duration:=2", *arguments))
        env = ros_env | (env or {})
        with contextlib.ExitStack() as ending:
            for name, node in started.items():
                if name != "plant":
                    log = ending.enter_context(open(tmp_path / f"{name}.log", "wb"))
                    command = node.command(tmp_path)
                    process = subprocess.Popen(
                        command, env=env, stdout=log, stderr=subprocess.STDOUT
                    )
                    ending.callback(process.terminate)
            plant = subprocess.run(
                started["plant"].command(tmp_path), env=env, capture_output=True, text=True,
                timeout=limit_s,
            )  # fmt: skip
        assert living() == []
        logs = "".join(path.read_text() for path in tmp_path.glob("*.log"))
        return plant, plant.stdout + plant.stderr + logs

    return fly


def test_the_graph_of_the_launch_file_flies(fly_launched, tmp_path):
    """The flight ends, and the nodes with it."""
    plant, printed = fly_launched("namespace:=heli1", f"bag:={tmp_path / 'bag'}", "seed:=3")
    assert plant.returncode == 0, printed
    assert OVER.search(plant.stdout + plant.stderr)
    stamps_ns = read_bag(tmp_path / "bag").streams[topics.TRUTH_ODOM].stamp_ns
    # From the first tick on.
    assert stamps_ns[0] == NS_PER_S and len(stamps_ns) == 200


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_first_launch_compiles_and_flies(fly_launched, tmp_path):
    """As after `colcon build`: no kernel is in the cache; who is ready waits for who is not."""
    cold = {"HELI_KERNEL_CACHE": str(tmp_path / "cache"), "NUMBA_NUM_THREADS": "1"}
    plant, printed = fly_launched("record:=false", limit_s=800, env=cold)
    assert plant.returncode == 0, printed
    assert "waiting for" in printed
    assert "going on" not in printed and "missing" not in printed
    assert OVER.search(plant.stdout + plant.stderr)


@pytest.mark.parametrize(("gps", "laws"), list(zip(GPS_PRESETS, (PACKAGED, "paper"), strict=True)))
def test_a_world_and_laws_are_launched_as_they_are_flown(launch, tmp_path, gps, laws):
    """Every parameter of every node, what the seed draws of the aircraft, too."""
    started = by_name(launch(*HOVER, "world:=hard", "seed:=7", f"gps:={gps}", f"laws:={laws}"))
    flown = resolve("hover", gps, 7, world="hard", laws=laws).nodes
    launch_only = {"autostart", "peers"}
    for name in FLYING:
        launched = values(started[name], tmp_path)
        np.testing.assert_equal(
            {key: value for key, value in launched.items() if key not in launch_only},
            {key: value for key, value in flown[name].items() if key not in launch_only},
        )
    assert flown["plant"]["scale.mass"] != 1.0


@pytest.mark.parametrize(
    ("argument", "named"),
    [
        ("world:=heavy", "--world heavy: .*hard, honest, paper"),
        ("laws:=papers", "--control-preset papers: .*packaged, paper"),
    ],
)
def test_an_unknown_world_and_unknown_laws_are_refused(launch, argument, named):
    with pytest.raises(ParameterError, match=named):
        launch(*HOVER, argument)
