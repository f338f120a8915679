# SPDX-License-Identifier: Apache-2.0
"""Every module serves something that a user can start, and what must start fast imports little."""

import ast
import os
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/package.xml"))
# Copied by whoever writes a law of his own (CONTRIBUTING.md); tests/recipes does so.
COPIED = {"heli_inner_hinf.law_template"}


@cache
def modules():
    """Full name -> file of every module under src/."""
    found = {}
    for package in PACKAGES:
        top = ROOT / "src" / package
        for file in (top / package).rglob("*.py"):
            parts = file.relative_to(top).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


@cache
def named_in(file):
    """Modules that a file imports, anywhere in it, or names in full in a string (`python -m`)."""
    found = set()
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
            found |= {".".join(parts[:i]) for i in range(1, len(parts) + 1)} & set(modules())
    return found


def starts():
    """Files that a user starts: commands, nodes, launch files, scripts."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    commands = [modules()[entry.split(":")[0]] for entry in project["project"]["scripts"].values()]
    packaged = [*(ROOT / "src").glob("*/scripts/*"), *(ROOT / "src").glob("*/launch/*.py")]
    return [*commands, *packaged, *(ROOT / "scripts").glob("*.py")]


def reached():
    """Modules that are imported, directly or not, by what a user starts."""
    seen, waiting = set(), set().union(*map(named_in, starts()))
    while waiting:
        seen |= waiting
        waiting = set().union(*(named_in(modules()[name]) for name in waiting)) - seen
    return seen


def is_testing(name):
    return "testing" in name.split(".")


def test_no_module_is_for_tests_only():
    """Code that only tests use stands in a `testing` folder of its package, or goes."""
    left = set(modules()) - reached() - COPIED
    assert {name for name in left if not is_testing(name)} == set()


def test_nothing_that_flies_imports_what_is_for_tests():
    for name, file in modules().items():
        if not is_testing(name):
            assert not {other for other in named_in(file) if is_testing(other)}, name


def test_start_does_not_wait_for_python_control():
    """Nodes, `heli` and flights come without it and without matplotlib: seconds to import."""
    started = [f"{p}.node" for p in PACKAGES if f"{p}.node" in modules()]
    started += ["heli_flight.cli.app", "heli_flight.cli.hover_test", "heli_flight.graph.flight"]
    started += ["heli_flight.graph.preload", "heli_flight.loop.closed_loop", "heli_flight.report"]
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
