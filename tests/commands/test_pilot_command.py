# SPDX-License-Identifier: Apache-2.0
"""`heli takeoff`, `goto`, `land`, `mode` where nothing flies: one line, exit code 2."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "words",
    [
        ["takeoff", "5"],
        ["goto", "1", "-2", "5", "--heading", "-90"],
        ["land", "--quiet"],
        ["mode", "hover", "--namespace", "heli2"],
    ],
    ids=lambda words: words[0],
)
def test_without_a_flight_it_says_so(own_domain, words):
    done = subprocess.run(
        [sys.executable, "-m", "heli_flight.cli.app", *words, "--wait", "0.1"],
        env={"PATH": "/usr/bin:/bin", "ROS_DOMAIN_ID": str(own_domain)},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert "no flight is heard" in done.stderr


@pytest.mark.parametrize("words", [["goto", "1", "2"], ["takeoff", "high"], ["mode"]])
def test_what_is_no_command_is_said(words):
    command = [sys.executable, "-m", "heli_flight.cli.app", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
