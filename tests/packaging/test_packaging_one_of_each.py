# SPDX-License-Identifier: Apache-2.0
"""One framework for commands, one progress bar: what would be a second one is not imported."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CLI = ("heli_flight/cli/", "heli_studies/cli", "heli_studies/tune_command.py")
TERMINAL = "heli_flight/terminal.py"
ONLY_IN = {
    "argparse": (),
    "getopt": (),
    "optparse": (),
    "click": (),
    "typer": CLI,
    "rich.progress": (TERMINAL,),
    "rich.live": (),
    "tqdm": (),
}
"""Modules, and where in the packages they may be imported. Scripts have argparse, as a node has
its own reader of ROS's arguments (heli_core/command_line.py)."""


def sources(*patterns):
    """Files by name: of packages `package/module.py`, of scripts `scripts/script.py`."""
    for pattern in patterns:
        for path in sorted(ROOT.glob(pattern)):
            inside = path.relative_to(ROOT).parts
            yield "/".join(inside[2:] if inside[0] == "src" else inside), path


@cache
def imported_by_file():
    """Names of the packages' files, and the full names that each imports."""
    files = sources("src/*/heli*/**/*.py", "src/*/launch/*.py")
    return {name: set(imported(path.read_text(encoding="utf-8"))) for name, path in files}


def imported(text):
    """Full names that a source imports."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("module", ONLY_IN)
def test_a_second_one_is_not_imported(module):
    files = imported_by_file()
    users = {
        file
        for file, names in files.items()
        if any(name == module or name.startswith(f"{module}.") for name in names)
    }
    assert len(files) > 150
    assert {name for name in users if not name.startswith(ONLY_IN[module])} == set()
    assert bool(users) == bool(ONLY_IN[module])


def test_nobody_draws_progress_by_hand():
    """A carriage return goes back to the beginning of the line: a progress bar of one's own."""
    drawing = {
        name
        for name, path in sources("src/*/heli*/**/*.py", "scripts/*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and "\r" in node.value
    }
    assert drawing == set()
