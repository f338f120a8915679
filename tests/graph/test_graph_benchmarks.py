# SPDX-License-Identifier: Apache-2.0
"""The benchmarks of the graph run through, in short; how fast is no matter of tests."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def benchmark_of(ros_env, living):
    """Run a script of benchmarks/ and return what it prints as JSON."""

    def run(name, *words):
        done = subprocess.run(
            [sys.executable, BENCHMARKS / name, "--json", *words],
            env=ros_env, capture_output=True, text=True, timeout=400,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert living() == []
        return json.loads(done.stdout)

    return run


@pytest.mark.slow
def test_speed_beside_a_bare_ring(benchmark_of):
    result = benchmark_of("graph.py", "--quick")
    rates, ratios = result["rates"]["one process"], result["ratios"]["one process"]
    assert set(rates) == {"objects", "graph"} and min(rates.values()) > 0.0
    assert ratios["objects"] == pytest.approx(rates["graph"] / rates["objects"])


@pytest.mark.slow
def test_latency_beside_a_bare_ring(benchmark_of):
    result = benchmark_of("latency.py", "--seconds", "2", "--composed")
    for name in ("ring", "graph"):
        assert result[name]["ticks"] > 0
        assert 0.0 < result[name]["p50_us"] <= result[name]["p99_us"]
    assert result["ratios"]["p50_us"] == result["graph"]["p50_us"] / result["ring"]["p50_us"]


@pytest.mark.slow
def test_answers_of_nodes_beside_a_bare_one(benchmark_of):
    result = benchmark_of("answers.py", "--seconds", "5")
    assert {"configuring", "inactive", "active"} & set(result["states"])
    assert set(result["nodes"]) == {"plant", "observer", "inner_loop", "outer_loop", "recorder"}
    for row in (*result["nodes"].values(), result["bare"]):
        assert row["answers"] > 0 and 0.0 < row["p50_ms"] <= row["p99_ms"] <= row["max_ms"]


@pytest.mark.slow
def test_tuning_in_real_time(benchmark_of):
    result = benchmark_of("tuning.py", "--sets", "2", "--phase", "2")
    phases = result["phases"]
    assert [row["accepted"] for row in phases.values()] == [0, 2, 2, 0]
    assert all(row["ticks"] > 0 for row in phases.values())


@pytest.mark.slow
def test_endurance(benchmark_of):
    result = benchmark_of(
        "soak.py", "--seconds", "6", "--realtime-seconds", "2", "--starts", "1", "--interrupts", "1"
    )
    for name in ("lockstep", "realtime"):
        assert {"plant", "observer", "inner_loop", "outer_loop", "recorder"} <= set(
            result[name]["memory"]
        )
        for row in result[name]["memory"].values():
            for first, _, last in (row["files"], row["threads"]):
                assert 0 < last <= first + 4
        assert result[name]["wrong_counts"] == {}
    assert result["starts"]["odd_exit_codes"] == [] and result["interrupts"]["odd_exit_codes"] == []
    assert result["interrupts"]["hung"] == 0


def test_latency_that_is_asked_to_end_leaves_nothing(ros_env, living):
    """Its ring has four processes by then, and the listener is one, too."""
    command = [sys.executable, BENCHMARKS / "latency.py", "--seconds", "250"]
    measuring = subprocess.Popen(command, env=ros_env, stdout=subprocess.PIPE, text=True)
    started = time.monotonic()
    # Itself, listener, ring; and what multiprocessing has beside them.
    while len(living(0.0)) < 6:
        assert time.monotonic() - started < 120.0
        with pytest.raises(subprocess.TimeoutExpired):
            measuring.wait(0.05)
    measuring.terminate()
    out, _ = measuring.communicate(timeout=120)
    assert (measuring.returncode, out) == (130, "")
    assert living() == []
