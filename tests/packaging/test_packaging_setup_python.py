# SPDX-License-Identifier: Apache-2.0
"""scripts/setup_env.sh: which Python it takes, and what becomes of its environment."""

import shutil

import pytest


def test_no_python(checkout):
    checkout.one_line_error(checkout.start(), "no Python 3.11 or newer", "PYTHON=")
    assert not (checkout.top / ".venv").exists()


def test_python_too_old(checkout):
    checkout.add_command("python3", "#!/usr/bin/env bash\nexit 3\n")
    checkout.one_line_error(checkout.start(), "no Python 3.11 or newer")


def test_chosen_python_missing_is_not_replaced(checkout):
    checkout.add_python()
    result = checkout.start(PYTHON="/nowhere/python3.12")
    checkout.one_line_error(result, "no Python 3.11 or newer", "/nowhere/python3.12")
    assert checkout.calls() == []


def test_no_venv_module(checkout):
    blocked = checkout.top.parent / "blocked"
    blocked.mkdir()
    (blocked / "ensurepip.py").write_text(
        "raise ImportError('as on Debian without python3-venv')\n"
    )
    wrapper = f'#!/usr/bin/env bash\nPYTHONPATH={blocked} exec {checkout.base_python} "$@"\n'
    python = checkout.add_command("python3", wrapper)
    checkout.one_line_error(checkout.start(), "no venv module", str(python), "python3-venv")
    assert not (checkout.top / ".venv").exists()


def test_python_without_venv_is_passed_over(checkout):
    checkout.add_command("python3.13", "#!/usr/bin/env bash\nexit 4\n")
    checkout.add_python(name="python3.11")
    assert checkout.start().returncode == 0


@pytest.fixture
def two_pythons(checkout):
    """The Python that set-up finds by itself, and one that only PYTHON= can name."""
    default = checkout.add_python()
    (checkout.top.parent / "elsewhere").mkdir()
    return default, shutil.copy2(default, checkout.top.parent / "elsewhere" / "python3")


def test_environment_of_a_chosen_python_stays_without_the_choice(checkout, two_pythons):
    _, chosen = two_pythons
    checkout.start(PYTHON=str(chosen))
    checkout.calls()
    for choice in ({}, {"PYTHON": str(chosen)}, {"PYTHON": ""}):
        assert checkout.start(**choice).returncode == 0
        assert checkout.kinds_of_calls() == ["flight"]


def test_another_chosen_python_makes_another_environment(checkout, two_pythons):
    default, chosen = two_pythons
    for choice in (chosen, default):
        assert checkout.start(PYTHON=str(choice)).returncode == 0
        assert checkout.kinds_of_calls()[0] == "venv"
        assert (checkout.top / ".venv/heli_python").read_text() == f"{choice}\n"


def test_changed_pins_keep_the_chosen_python(checkout, two_pythons):
    _, chosen = two_pythons
    checkout.start(PYTHON=str(chosen))
    with open(checkout.top / "requirements/constraints.txt", "a") as pins:
        pins.write("# changed\n")
    assert checkout.start().returncode == 0
    assert checkout.kinds_of_calls().count("venv") == 2
    assert (checkout.top / ".venv/heli_python").read_text() == f"{chosen}\n"


def test_chosen_python_that_is_gone_is_replaced(checkout, two_pythons):
    default, chosen = two_pythons
    checkout.start(PYTHON=str(chosen))
    chosen.unlink()
    (checkout.top / ".venv/bin/python").unlink()
    assert checkout.start().returncode == 0
    assert (checkout.top / ".venv/heli_python").read_text() == f"{default}\n"


def test_environment_whose_python_vanished_is_made_anew(checkout):
    checkout.add_python()
    checkout.start()
    (checkout.top / ".venv/bin/python").unlink()
    assert checkout.start().returncode == 0
    assert (checkout.top / ".venv/bin/python").exists()


def test_an_environment_whose_python_only_another_user_may_run(checkout):
    """As set up by root, whose Python lies in its home: neither executed nor made anew."""
    checkout.add_python()
    assert checkout.start().returncode == 0
    python = checkout.top / ".venv/bin/python"
    python.chmod(0o644)
    lock = checkout.top / ".venv.lock"
    lock.unlink()
    lock.mkdir()  # for root, too, no file that can be written
    checkout.one_line_error(checkout.start(), str(python), "HELI_VENV=")
    shutil.rmtree(checkout.top / ".venv")
    checkout.one_line_error(checkout.start(), "cannot write", ".venv")
