# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the closed loop in its short form: it runs, and a wrong word is bad input."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks/closed_loop.py"


def run(*words):
    return subprocess.run([sys.executable, SCRIPT, *words], capture_output=True, text=True)


def test_the_short_form_measures_every_part_and_needs_no_peer():
    done = run("--quick", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    parts = ("resolve_s", "build_s", "fly_s", "score_s", "command_s")
    assert all(found[part] > 0.0 for part in parts)
    assert found["times_real_time"] == pytest.approx(5.0 / found["fly_s"])
    assert "times_peer" not in found


def test_a_word_that_is_not_known_is_refused():
    done = run("--quik")
    assert done.returncode == 2
    assert done.stderr == "--quik: unknown; allowed: --quick, --json\n"
