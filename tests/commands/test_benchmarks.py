# SPDX-License-Identifier: Apache-2.0
"""Benchmarks in their short form: they run, and a wrong word is bad input."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


def run(name, *words):
    command = [sys.executable, FOLDER / f"{name}.py", *words]
    return subprocess.run(command, capture_output=True, text=True)


def quick(name):
    done = run(name, "--quick", "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_the_closed_loop_is_measured_in_parts_and_needs_no_peer():
    result = quick("closed_loop")
    assert all(
        result[f"{part}_s"] > 0.0 for part in ("resolve", "build", "fly", "score", "command")
    )
    assert result["times_real_time"] == pytest.approx(5.0 / result["fly_s"])
    assert "times_peer" not in result


@pytest.mark.slow
def test_tasks_come_back_and_participants_find_each_other():
    result = quick("scaling")
    assert result["empty_tasks"]["tasks_per_s"] > 0.0
    assert [(row["count"], row["seen"]) for row in result["participants"]] == [(2, 2), (4, 4)]


@pytest.mark.slow
def test_a_campaign_flies_on_one_and_two_workers_and_its_memory_is_looked_at():
    result = quick("campaign")
    assert set(result["speed"]["rates"]) == {"1", "2"}
    assert result["speed"]["flights_1000_s"] == pytest.approx(
        1000.0 / result["speed"]["rates"]["2"]
    )
    assert [look["flights"] for look in result["memory"]["looks"]] == [10, 20]
    assert all(look["resident_mb"] > 10.0 for look in result["memory"]["looks"])


@pytest.mark.slow
def test_a_frame_of_ardupilot_is_measured_beside_an_echo():
    rates = quick("ardupilot")["rates"]
    assert set(rates) == {"400", "1200"}
    for row in rates.values():
        assert 0.0 < row["answer"]["cpu_us"] < 1000.0 and row["round_trip_over_echo"] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["closed_loop", "scaling", "campaign", "ardupilot"])
def test_a_word_that_is_not_known_is_refused(name):
    done = run(name, "--quik")
    assert done.returncode == 2
    assert re.search("error: .*: --quik\n$", done.stderr)
