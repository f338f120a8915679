# SPDX-License-Identifier: Apache-2.0
"""House rules for files: licence header, no machine paths, sizes; YAML and launch files hold."""

import ast
import importlib
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from heli_core.parameters import load, with_common
from heli_dynamics_sim.aircraft import HelicopterParameters

ROOT = Path(__file__).resolve().parents[2]
COMMON = ROOT / "src/heli_core/config/common.yaml"
# Node -> module with its table, folder of its defaults.
TABLES = {
    "plant": ("heli_dynamics_sim.parameters", "heli_dynamics_sim"),
    "observer": ("heli_observer.parameters", "heli_observer"),
    "inner_loop": ("heli_inner_hinf.parameters", "heli_inner_hinf"),
    "outer_loop": ("heli_outer_pd.parameters", "heli_outer_pd"),
    "recorder": ("heli_bags.parameters", "heli_bags"),
    "live_view": ("heli_live_view.parameters", "heli_live_view"),
    "actions": ("heli_actions.parameters", "heli_actions"),
    "world_clock": ("heli_flight.graph.world_clock_node", "heli_flight"),
    "lifecycle_manager": ("heli_flight.graph.manager", "heli_flight"),
}
FEW_LINES = 80
BEGINS_A_PROCESS = ("cli.hover_test", "start", "graph.bound", "graph.composed", "graph.hog",
                    "graph.preload", "graph.scenario_node", "graph.standby")  # fmt: skip
SHORT = {
    "heli.gym": "imported by its name, before gymnasium.make; says what is missing without",
    **{f"heli_flight.{name}": "begins a process" for name in BEGINS_A_PROCESS},
    "heli_actions.parameters": "a node's table, which its node and a pilot read",
    "heli_analysis.identification.doubts": "of a fit that is done, for its command and its report",
    "heli_core.atmosphere": "of the plant and of the observer, which do not know each other",
    "heli_core.faces": "of each package's face",
    "heli_core.inbox": "of each loop",
    "heli_core.version": "of the command, of Python and of what is recorded",
    "heli_flight.cli.sections": "of the group of commands, and of the site's reference",
    "heli_flight.graph.log_folder": "decided by variables alone, before ROS is there",
    "heli_inner_hinf.controller_template": "is copied",
    "heli_msgs_bridge.message_size": "of nodes, and of bags where no ROS is",
}
"""Modules of less than that, and why each is one of its own."""
CODE_SUFFIXES = {".py", ".sh", ".yaml", ".yml", ".toml", ".cfg", ".xml"}


def tracked_files():
    """Files of the repository, new ones too, as git sees them."""
    command = ["git", "-C", ROOT, "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [ROOT / line for line in listed.splitlines() if (ROOT / line).is_file()]


def code_files():
    """Files that a licence header belongs to: by suffix, or scripts without one."""
    paths = []
    for path in tracked_files():
        if path.suffix in CODE_SUFFIXES or (not path.suffix and path.parent.name == "scripts"):
            paths.append(path)
    return paths


def test_every_code_file_names_its_licence():
    def named(path):
        return "SPDX-License-Identifier: Apache-2.0" in "\n".join(
            path.read_text(encoding="utf-8").splitlines()[:4]
        )

    # Parameter files start with what they are for; the licence file covers them.
    python_and_shell = [p for p in code_files() if p.suffix not in (".yaml", ".yml")]
    assert len(python_and_shell) > 50
    assert [str(p.relative_to(ROOT)) for p in python_and_shell if not named(p)] == []


def test_no_path_of_a_machine():
    """Neither home folders nor the places where somebody's tools happened to lie."""
    pattern = re.compile(r"/(?:home|Users|root|work|mnt|opt/(?!ros\b))/[A-Za-z0-9._]")
    places = []
    for path in tracked_files():
        if path == Path(__file__):
            continue
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError:
            continue
        places += [f"{path.relative_to(ROOT)}: {line}" for line in lines if pattern.search(line)]
    assert places == []


def test_test_files_have_names_of_their_own():
    names = [path.name for path in code_files() if path.name.startswith("test_")]
    assert {name for name in names if names.count(name) > 1} == set()


def test_no_two_classes_of_the_product_have_one_name():
    files = [path for path in (ROOT / "src").rglob("*.py") if "test" not in path.parts]
    names = Counter(
        node.name
        for path in files
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef)
    )
    assert [name for name, count in names.items() if count > 1] == []


def test_a_short_module_has_a_reason():
    """A face (`__init__`) is short; any other module of few lines belongs to who imports it."""
    short = set()
    for package in (path.parent for path in (ROOT / "src").glob("*/setup.py")):
        for file in (package / package.name).rglob("*.py"):
            lines = len(file.read_text(encoding="utf-8").splitlines())
            if lines < FEW_LINES and file.name != "__init__.py":
                short.add(".".join(file.relative_to(package).with_suffix("").parts))
    assert short == set(SHORT)


@pytest.mark.parametrize("node", TABLES)
def test_packaged_defaults_fill_the_table(node):
    module, package = TABLES[node]
    table = with_common(importlib.import_module(module).TABLE)
    file = ROOT / "src" / package / "config" / f"{node}.yaml"
    values = load(table, [COMMON, file], node)
    assert set(values) == {row.name for row in table}


@pytest.mark.parametrize("node", TABLES)
def test_presets_and_scenarios_fit_every_node(node):
    module, package = TABLES[node]
    table = with_common(importlib.import_module(module).TABLE)
    folder = ROOT / "src" / package / "config"
    scenarios = sorted((ROOT / "src/heli_flight/config/scenarios").glob("*.yaml"))
    assert len(scenarios) >= 2
    designs = sorted((ROOT / "src/heli_flight/config/designs").glob("*.yaml"))
    assert len(designs) >= 2
    worlds = sorted((ROOT / "src/heli_flight/config/worlds").glob("*.yaml"))
    assert {path.stem for path in worlds} == {"paper", "honest", "hard"}
    laws = sorted((ROOT / "src/heli_flight/config/laws").glob("*.yaml"))
    assert {path.stem for path in laws} >= {
        "packaged",
        "paper",
        "hinf",
        "hinf_output",
        "pid",
        "lqr",
        "indi",
    }
    grades = sorted((ROOT / "src/heli_dynamics_sim/config").glob("sensors_*.yaml"))
    assert len(grades) >= 3
    for overlay in [*folder.glob("gps_*.yaml"), *scenarios, *designs, *worlds, *laws, *grades]:
        load(table, [COMMON, folder / f"{node}.yaml", overlay], node)


def test_scenarios_fill_the_scenario_table():
    from heli_flight.scenario import NODE_NAME, TABLE

    folder = ROOT / "src/heli_flight/config"
    for file in (folder / "scenarios").glob("*.yaml"):
        assert set(load(TABLE, [folder / "scenario.yaml", file], NODE_NAME)) == {
            row.name for row in TABLE
        }


def test_aircraft_files_load():
    files = sorted((ROOT / "src/heli_dynamics_sim/config/aircraft").glob("*.yaml"))
    assert files
    for file in files:
        HelicopterParameters.from_yaml(file)


def test_no_yaml_is_outside_these_tests():
    """A parameter file that nothing loads would rot."""
    flight = ROOT / "src/heli_flight/config"
    sections = ("flight", "robust", "scenario", "tune")
    known = {COMMON, *(flight / f"{name}.yaml" for name in sections)}
    for node, (_, package) in TABLES.items():
        folder = ROOT / "src" / package / "config"
        known |= {folder / f"{node}.yaml", *folder.glob("aircraft/*"), *folder.glob("linear/*")}
        known |= {*folder.glob("gps_*.yaml"), *folder.glob("sensors_*.yaml")}
    known |= {flight / name for name in ("tuned_pid.yaml", "tune_cascade.yaml")}
    for kind in ("scenarios", "worlds", "laws", "designs", "identify"):
        known |= set((ROOT / "src/heli_flight/config" / kind).glob("*.yaml"))
    assert set((ROOT / "src").glob("*/config/**/*.yaml")) - known == set()


@pytest.mark.parametrize("node", TABLES)
def test_every_parameter_is_explained(node):
    """A comment stands above the key, its block, or the paragraph of keys that it is in."""
    file = ROOT / "src" / TABLES[node][1] / "config" / f"{node}.yaml"
    bare, explained_at = [], {}
    after_comment = False
    for line in file.read_text().splitlines():
        key = re.match(r"( *)[A-Za-z_0-9]+:", line)
        if not line.strip():
            explained_at = {
                depth: explained for depth, explained in explained_at.items() if depth < 4
            }
        elif line.lstrip().startswith("#"):
            after_comment = True
        elif key and "ros__parameters" not in line:
            depth = len(key.group(1))
            explained_at = {d: explained for d, explained in explained_at.items() if d <= depth}
            explained_at[depth] = after_comment or "#" in line or explained_at.get(depth, False)
            if not line.endswith(":") and not any(explained_at.values()):
                bare.append(line.strip())
            after_comment = False
    assert bare == []
