# SPDX-License-Identifier: Apache-2.0
"""What a command costs where nothing is set up is said before it is done."""

import importlib.util
from pathlib import Path

import pytest

from evidence import files

ROOT = Path(__file__).resolve().parents[2]


def results(name):
    return files.read(ROOT, name)["found"]


@pytest.mark.parametrize(
    "words",
    [
        ["hover"],
        ["--help"],
        ["python", "x.py", "--help"],
        ["run", "a", "b", "--help"],
        ["hover", "--", "--help"],
    ],
)
def test_every_command_sets_up(checkout, words):
    checkout.add_python()
    done = checkout.start("heli", *words)
    assert done.returncode == 0, done.stderr
    assert (checkout.top / ".venv/heli_stamp").is_file()
    costs = f"downloads {results('setup_size')['download_mb']} MB"
    assert costs in done.stderr.splitlines()[0]


def test_completion_sets_up(checkout):
    checkout.add_python()
    assert checkout.start("heli", _HELI_COMPLETE="complete_bash").returncode == 0
    assert (checkout.top / ".venv").is_dir()


def test_the_tests_tell_what_they_are_without_set_up(checkout):
    done = checkout.start("run_tests.sh", "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: ./run_tests.sh")
    assert f"test tools add {results('setup_size')['test_mb']} MB" in done.stdout
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
