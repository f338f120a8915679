# SPDX-License-Identifier: Apache-2.0
"""Every module and every name serves something that a user can start; what must start fast imports
little.
"""

import ast
import importlib
import os
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from vulture import Vulture

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/setup.py"))
# Copied by whoever writes a law of his own (CONTRIBUTING.md); tests/recipes does so.
COPIED = {"heli_inner_hinf.controller_template"}
TRANSITIONS = ("configure", "cleanup", "activate", "deactivate", "shutdown", "error")
ALWAYS = ("__*__", *(f"on_{name}" for name in TRANSITIONS))
"""What Python itself reads, and the transitions that rclpy calls."""
CALLED_BY_OTHERS = {
    "generate_launch_description": "by launch",
    "format_commands": "by click, for the help of a group",
    "user_law": "by whoever copies law_template",
    "signum": "of a signal handler's arguments, which Python gives",
    **dict.fromkeys(("_type_of_vector", "_type_of_matrix", "_on_stack", "_ByReferenceModel",
                     "_unbox", "_Members", "generic_resolve", "_member"), "by numba, to compile"),
    "readings": "by estimators of others (Estimator)",
}  # fmt: skip
SET_FOR_OTHERS = {
    "robust_parsing": "pymavlink's reader",
    "unraisablehook": "sys", "CACHE_DIR": "numba.config", "tempdir": "tempfile",
    "_protected_args": "typer.Context", "handlers": "logging.Logger",
    "no_wrap": "rich.text.Text", "charset": "aiohttp's response",
    "_context": "keeps Foxglove's context alive",
    "home_known": "a message", "markers": "a message", "hardware_id": "a message",
    "floating_point_range": "a message", "integer_range": "a message",
    **dict.fromkeys(("current_position", "current_velocity", "current_acceleration",
                     "target_position", "target_velocity", "max_velocity", "max_acceleration",
                     "max_jerk", "synchronization", "control_interface"), "ruckig.InputParameter"),
}  # fmt: skip
READ_BY_FIELD = {
    "duplicate": "Counters, told by asdict",
    "force_per_collective_sigma": "IdentifiedCollective, written by asdict",
    "force_per_w": "IdentifiedCollective, written by asdict",
    "force_per_w_sigma": "IdentifiedCollective, written by asdict",
}
OFFERED = {
    "vel_enu_mps": "to modes of others (heli_actions.Moment)",
    "over_actions": "by a pilot in Python, to scripts (heli_actions.Pilot)",
    "to_dataframe": "by scripts and notebooks that have pandas (heli)",
    "fuse_velocity": "to estimators of others (heli.Observer)",
    "plant_of": "to scripts that tune a plant of their own (docs/tune.md)",
}
READ_BY_TEMPLATE = {"verdicts": "report/page/base.html"}
NUMBERED = {
    "STALE": "a level that others send (heli_flight.report.data.LEVELS)",
}  # fmt: skip
"""Names that the search for dead code does not see used, and what uses them."""
KNOWN = CALLED_BY_OTHERS | SET_FOR_OTHERS | READ_BY_FIELD | READ_BY_TEMPLATE | OFFERED | NUMBERED


@cache
def modules():
    """Full name -> file of every module under src/."""
    files = {}
    for package in PACKAGES:
        top = ROOT / "src" / package
        for file in (top / package).rglob("*.py"):
            parts = file.relative_to(top).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return files


@cache
def named_in(file):
    """Modules that a file imports, anywhere in it, or names in full in a string (`python -m`)."""
    imported = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names = [node.value]
        for name in names:
            parts = name.split(".")
            imported |= {".".join(parts[:i]) for i in range(1, len(parts) + 1)} & set(modules())
    return imported


def commands():
    """Modules in which the commands of pyproject.toml begin."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    return {entry.split(":")[0] for entry in project["project"]["scripts"].values()}


def started():
    """Files outside of the packages' code that a user starts: nodes, launch files, scripts."""
    packaged = [*(ROOT / "src").glob("*/scripts/*"), *(ROOT / "src").glob("*/launch/*.py")]
    return [*packaged, *(ROOT / "scripts").glob("*.py"), *(ROOT / "evidence").rglob("*.py")]


def reached():
    """Modules that are imported, directly or not, by what a user starts, or from `heli`."""
    face = {name for name in modules() if name.split(".")[0] == "heli"}
    visited, waiting = set(), commands().union(face, *map(named_in, started()))
    while waiting:
        visited |= waiting
        waiting = set().union(*(named_in(modules()[name]) for name in waiting)) - visited
    return visited


def test_no_module_is_for_tests_only():
    """Code that only tests use stands in tests/support, or goes."""
    assert set(modules()) - reached() - COPIED == set()


@cache
def public_names():
    """What packages and their sub-packages offer to their users: `__all__` of each."""
    faces = [name for name, file in modules().items() if file.stem == "__init__"]
    loaded = map(importlib.import_module, faces)
    return {name for face in loaded for name in getattr(face, "__all__", ())}


def unused(files, known):
    """file:line: kind name of what is defined and never used, tests left out of account."""
    names = [*ALWAYS, *sorted(known)]
    search = Vulture(
        ignore_names=names, ignore_decorators=["@*.command*", "@*.callback*", "@table"]
    )
    search.scavenge(list(files))
    return [f"{i.filename}:{i.first_lineno}: {i.typ} {i.name}" for i in search.get_unused_code()]


@cache
def unused_in_the_product():
    """What is unused among the files of what a user can start or import, and is not offered."""
    return unused([*modules().values(), *started()], public_names())


@pytest.mark.slow
def test_no_name_is_for_tests_only():
    """Functions, methods, attributes, fields and constants that only tests use go, too."""
    lines = [line for line in unused_in_the_product() if line.rsplit(" ", 1)[1] not in KNOWN]
    hint = "use it, move it to tests/support, delete it, or say in KNOWN what uses it"
    assert lines == [], f"{hint}:\n" + "\n".join(lines)


def test_every_exception_is_needed():
    names = {line.rsplit(" ", 1)[1] for line in unused_in_the_product()}
    assert names == set(KNOWN)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("class C:\n    def __init__(self):\n        self.unusual = 0\nC()", "unusual"),
        ("class C:\n    def turn(self):\n        return 1\nC()", "turn"),
        ("class C:\n    foreign: list = []\nC(foreign=[])", "foreign"),
        ("class C:\n    @property\n    def active(self):\n        return 1\nC()", "active"),
        ("def fly():\n    return 1", "fly"),
        ("LIMIT = 3", "LIMIT"),
    ],
)
def test_the_search_finds(tmp_path, text, name):
    (tmp_path / "some.py").write_text(text)
    (line,) = unused([tmp_path / "some.py"], set())
    assert line.endswith(f" {name}")


def test_who_starts_a_graph_waits_for_no_loop_no_report_and_no_scipy():
    """A flight of the graph begins when its command has imported what it needs."""
    code = (
        "import sys, heli_flight.fly, heli_flight.graph.flight\n"
        "print({'scipy.linalg', 'scipy.optimize', 'jinja2', 'heli_flight.loop',\n"
        "       'heli_flight.report.write'} & set(sys.modules))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_start_does_not_wait_for_python_control():
    """Nodes, `heli` and flights come without it and without matplotlib: seconds to import."""
    started = [f"{p}.node" for p in PACKAGES if f"{p}.node" in modules()]
    started += ["heli_flight.cli.app", "heli_flight.cli.hover_test", "heli_flight.graph.flight"]
    started += ["heli_flight.graph.preload", "heli_flight.loop", "heli_flight.report"]
    code = (
        "import importlib, sys\n"
        f"for name in {started!r}:\n"
        "    importlib.import_module(name)\n"
        "    slow = {'control', 'matplotlib.pyplot', 'scipy.signal'} & set(sys.modules)\n"
        "    assert not slow, (name, slow)\n"
    )
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
