# SPDX-License-Identifier: Apache-2.0
"""`heli joy` where there is neither joystick nor terminal: one line, exit code 2."""

import subprocess
import sys

import pytest


def joy(*words):
    command = [sys.executable, "-m", "heli_flight.cli.app", "joy", *words]
    return subprocess.run(
        command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--device", "77"], "no joystick"),
        (["--keyboard"], "no keyboard: standard input is no terminal"),
        (["--rate", "1"], "--rate"),
    ],
)
def test_what_is_not_there_is_said(words, sentence):
    done = joy(*words)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert sentence in done.stderr


def test_the_joysticks_are_listed():
    done = joy("--list")
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
