# SPDX-License-Identifier: Apache-2.0
"""What each launch file starts, and what each of its arguments changes in the nodes' parameters."""

import contextlib
import subprocess
from importlib import import_module
from pathlib import Path

import pytest

from heli_flight.loop.layers import GPS_PRESETS, scenario_names
from heli_parameters.common_table import with_common
from heli_parameters.locate import config_folder, executable
from heli_parameters.parameters import load

ROOT = Path(__file__).resolve().parents[3]
LAUNCH_FILES = sorted(
    (path.parents[1].name, path.name) for path in (ROOT / "src").glob("*/launch/*.launch.py")
)
SINGLE = [(package, name) for package, name in LAUNCH_FILES if name != "hover.launch.py"]
HOVER = ("heli_flight", "hover.launch.py")
FLYING = ("plant", "observer", "inner_loop", "outer_loop")


def values(node, folder):
    """Parameters that a started node ends up with: packaged ones, then what launch gives it."""
    table = with_common(import_module(f"{node.package}.parameter_table").TABLE)
    common = config_folder("heli_parameters") / "common.yaml"
    own = config_folder(node.package) / f"{node.name}.yaml"
    return load(table, [common, own, *node.files(folder)], node.full_name)


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
            found = values(node, tmp_path)
            own = config_folder(node.package) / f"{name}.yaml"
            common = config_folder("heli_parameters") / "common.yaml"
            table = with_common(import_module(f"{node.package}.parameter_table").TABLE)
            packaged = load(table, [common, own], name)
            assert found["lockstep"] == packaged["lockstep"]
            assert found.get("seed") == packaged.get("seed")


@pytest.mark.parametrize("given", ["true", "false"])
def test_argument_lockstep(launch, tmp_path, given):
    for name, node in by_name(launch(*HOVER, f"lockstep:={given}", "live:=true")).items():
        if name in (*FLYING, "live_view"):
            assert values(node, tmp_path)["lockstep"] is (given == "true"), name


def test_argument_seed_wins_over_the_users_file(launch, tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text("/**/plant:\n  ros__parameters:\n    seed: 5\n")
    plant = by_name(launch(*HOVER, f"params_file:={file}"))["plant"]
    assert values(plant, tmp_path)["seed"] == 5
    plant = by_name(launch(*HOVER, f"params_file:={file}", "seed:=7"))["plant"]
    assert values(plant, tmp_path)["seed"] == 7


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


def test_arguments_record_and_live(launch):
    assert "recorder" not in by_name(launch(*HOVER, "record:=false"))
    assert "live_view" in by_name(launch(*HOVER, "live:=true"))


def test_argument_namespace(launch):
    started = launch(*HOVER, "namespace:=heli1", "live:=true")
    assert {node.full_name for node in started} == {f"/heli1/{node.name}" for node in started}


@pytest.mark.parametrize(
    "argument", ["seed:=x", "seed:=-1", "seed:=1.5", "gps:=none", "lockstep:=yes", "sead:=1"]
)
def test_bad_arguments_start_nothing(launch, argument):
    with pytest.raises(Exception, match=argument.split(":=")[0]):
        launch(*HOVER, argument)


@pytest.fixture
def fly_launched(launch, tmp_path, ros_env, living):
    """Run the commands that launch would run, 2 s long: the plant's process, and all logs."""

    def fly(*arguments, limit_s=240, env=None):
        file = tmp_path / "short.yaml"
        file.write_text("/**/plant:\n  ros__parameters:\n    duration_s: 2.0\n")
        started = by_name(launch(*HOVER, f"params_file:={file}", *arguments))
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


def test_the_graph_of_the_launch_file_flies(fly_launched):
    """The flight ends, and the nodes with it."""
    plant, said = fly_launched("namespace:=heli1", "record:=false", "seed:=3")
    assert plant.returncode == 0, said
    assert "flight over after 2 s" in plant.stdout + plant.stderr


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_the_first_launch_compiles_and_flies(fly_launched, tmp_path):
    """As after `colcon build`: no kernel is in the cache; who is ready waits for who is not."""
    cold = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_NUM_THREADS": "1"}
    plant, said = fly_launched("record:=false", limit_s=800, env=cold)
    assert plant.returncode == 0, said
    assert "to get ready" in said
    assert "going on" not in said and "missing" not in said
    assert "flight over after 2 s" in plant.stdout + plant.stderr
