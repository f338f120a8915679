# SPDX-License-Identifier: Apache-2.0
"""--help where nothing is set up: at once, in the commands' own words, and without a trace."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from heli_flight.studies.results import files

ROOT = Path(__file__).resolve().parents[2]
STORED = (ROOT / "scripts/help.txt").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"\f([^\n]+)\n([^\f]+)", STORED))
NAMES = sorted(SECTIONS)


def found(name):
    return files.read(ROOT, name)["found"]


def test_the_stored_help_is_what_the_commands_say():
    """./heli python scripts/help_text.py writes it."""
    script = ROOT / "scripts/help_text.py"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert {"heli", "hover_test", "heli hover", "heli bag ulog", "heli campaign rare"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_command_answers_without_set_up(checkout, name):
    program, *words = name.split()
    script = {"heli": "heli", "hover_test": "hover_test.sh"}[program]
    done = checkout.start(script, *words, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(SECTIONS[name].rstrip() + "\n\n")
    costs = done.stdout.removeprefix(SECTIONS[name].rstrip())
    for number in (
        f"downloads {found('setup_size')['download_mb']} MB",
        f"takes {found('setup_size')['disk_mb']} MB of disk",
        f"took {found('setup')['setup_s']} s",
    ):
        assert number in costs
    assert not list(checkout.top.glob(".venv*"))


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["hover", "--seed", "3", "--help"], "heli hover"),
        (["campaign", "spec.yaml", "--help"], "heli campaign"),
        (["--help", "hover"], "heli"),
        (["python", "--help"], "heli python"),
    ],
)
def test_what_stands_before_help_decides(checkout, words, name):
    assert checkout.start("heli", *words).stdout.startswith(SECTIONS[name])


@pytest.mark.parametrize("name", ["heli", "heli bag", "heli compare", "heli results"])
def test_where_a_command_has_to_follow_it_is_the_help_and_exit_code_2(checkout, name):
    """With and without environment."""
    bare = checkout.start(*name.split())
    assert bare.returncode == 2 and bare.stdout == ""
    assert bare.stderr.startswith(SECTIONS[name])
    assert not list(checkout.top.glob(".venv*"))
    command = [sys.executable, "-m", "heli_flight.start", *name.split()]
    env = os.environ | {"COLUMNS": "80"}
    own = subprocess.run(command, capture_output=True, text=True, env=env)
    assert own.returncode == 2 and own.stdout == ""
    assert own.stderr.split() == SECTIONS[name].split()


def test_a_command_that_is_none_is_refused(checkout):
    done = checkout.start("heli", "nonsense", "--help")
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["heli: No such command 'nonsense'."]
    assert not list(checkout.top.glob(".venv*"))


@pytest.mark.parametrize(
    "words",
    [
        ["hover"],
        ["python", "x.py", "--help"],
        ["run", "a", "b", "--help"],
        ["hover", "--", "--help"],
    ],
)
def test_what_asks_for_no_help_sets_up(checkout, words):
    checkout.add_python()
    done = checkout.start("heli", *words)
    assert done.returncode == 0, done.stderr
    assert (checkout.top / ".venv/heli_stamp").is_file()
    costs = f"downloads {found('setup_size')['download_mb']} MB"
    assert costs in done.stderr.splitlines()[0]


def test_an_environment_answers_itself(checkout):
    checkout.add_python()
    assert checkout.start("hover_test.sh").returncode == 0
    checkout.calls()
    assert checkout.start("hover_test.sh", "--help").stdout == ""  # of the stand-in
    assert [line for line in checkout.calls() if "heli_flight.start hover_test --help" in line]


def test_completion_is_no_question_for_help(checkout):
    checkout.add_python()
    assert checkout.start("heli", _HELI_COMPLETE="complete_bash").returncode == 0
    assert (checkout.top / ".venv").is_dir()


def test_the_tests_tell_what_they_are_without_set_up(checkout):
    done = checkout.start("run_tests.sh", "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: ./run_tests.sh")
    assert f"test tools add {found('setup_size')['test_mb']} MB" in done.stdout
    assert not list(checkout.top.glob(".venv*"))


def test_sizes_are_those_of_the_files_that_would_be_installed():
    spec = importlib.util.spec_from_file_location("setup_size", ROOT / "scripts/setup_size.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    ranks = ("cp311-cp311-manylinux_2_28_x86_64", "py3-none-any")
    tags = {
        tag: rank
        for rank, name in enumerate(ranks)
        for tag in script.parse_wheel_filename(f"a-1-{name}.whl")[3]
    }

    def wheel(tag, size):
        return {"url": f"https://x/a-1-{tag}.whl", "size": size}

    both = [wheel("py3-none-any", 1), wheel(ranks[0], 2), wheel("cp312-cp312-win32", 4)]
    assert script.chosen_bytes({"wheels": both}, tags) == 2
    assert script.chosen_bytes({"wheels": both[:1]}, tags) == 1
    assert script.chosen_bytes({"wheels": both[2:], "sdist": {"size": 8}}, tags) == 8
    assert script.chosen_bytes({"wheels": both, "marker": "sys_platform == 'win32'"}, tags) == 0
