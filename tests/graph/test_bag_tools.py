# SPDX-License-Identifier: Apache-2.0
"""Recorder, `heli topics`, `heli echo` and `heli bag play` on a living graph."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[2]
HELI = [sys.executable, "-m", "heli_flight.cli.app"]


@pytest.fixture
def heli(ros_env):
    """Run a command of `heli` in the test's graph; returns the finished process."""

    def run(*words, code=0):
        command = [*HELI, *map(str, words)]
        done = subprocess.run(command, env=ros_env, capture_output=True, text=True, timeout=150)
        assert done.returncode == code, done.stdout + done.stderr
        return done

    return run


def interrupted(process):
    """Exit code of a command that gets Ctrl-C; it has nothing to complain of."""
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert err.splitlines()[-1] == "interrupted" and "Traceback" not in err
    return process.returncode


@pytest.mark.slow
def test_recorder_killed_in_flight(tmp_path, ros_env, heli, living, holder_of):
    """Watch a flight, kill its recorder, repair the bag, report it, play it."""
    flight = tmp_path / "flight"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--realtime", "--no-report"]
    flying = subprocess.Popen(
        [*command, "--gps", "rtk", "--duration", "300", "--out", str(flight)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    recorded = flight / "bag" / "bag_0.mcap"
    # Real time says a line every tenth of the flight: by then seconds of it are in the file.
    assert "flown" in flying.stdout.readline()
    assert recorded.stat().st_size > 300_000
    asked = heli("topics", "--rate", "--json")
    assert "1.5 s (--settle)" in asked.stderr
    listed = {row["topic"]: row for row in json.loads(asked.stdout)}
    odom = listed["/odom"]
    assert (odom["type"], odom["publishers"]) == ("nav_msgs/msg/Odometry", 1)
    assert odom["subscribers"] == 3
    # On loaded cores it is heard more slowly than it flies.
    assert 0 < odom["rate_hz"] < 130 and 0 < listed["/imu/mag"]["rate_hz"] < 65
    text = heli("echo", "odom", "--count", 2).stdout
    assert text.count("---\n") == 2 and "child_frame_id: base_link\n" in text
    status = json.loads(heli("echo", "/diagnostics", "--count", 1, "--json").stdout)
    assert status["status"][0]["name"]
    os.kill(holder_of(recorded), signal.SIGKILL)
    out, err = flying.communicate(timeout=120)
    assert flying.returncode == 1 and re.search("recorder: .*SIGKILL", err), out + err

    advice = heli("report", flight, code=2).stderr
    assert f"bag repair {flight / 'bag'}'" in advice and len(advice.splitlines()) == 1
    printed = heli("bag", "repair", flight / "bag", "--in-place").stdout
    assert "bag_0.mcap" in printed and str(flight / "bag_damaged") in printed
    restored = int(re.search(r"restored: (\d+) messages", printed).group(1))
    stamps = read_bag(flight / "bag").streams[topics.TRUTH_ODOM].stamp_ns
    assert stamps.size > 300 and restored > 7 * stamps.size
    assert np.all(np.diff(stamps) == TICK_NS)
    # The page is of what there is, and the command says that it is not the flight that was ordered.
    partial, written = heli("report", flight, code=1).stdout.splitlines()
    assert partial.startswith("PARTIAL: ") and written == f"written: {flight / 'report.html'}"
    assert living() == []


@pytest.mark.slow
def test_play_and_listen(tmp_path, ros_env, heli, hover_test, living):
    """The bag's own topics, QoS and clock; echo hears a latched message that was sent before."""
    assert hover_test("--out", tmp_path / "flight", "--duration", 2, "--gps", "rtk").returncode < 2
    played = json.loads(
        heli("bag", "play", tmp_path / "flight", "--rate", 20, "--start", 0.5, "--exclude",
             "odom", "--json").stdout
    )  # fmt: skip
    assert played["/imu/data_raw"] == played["/clock"] == 150
    assert played["/reference"] == 1 and "/odom" not in played
    player = subprocess.Popen(
        [*HELI, "bag", "play", str(tmp_path / "flight"), "--loop", "--exclude", "/clock"],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    way = json.loads(heli("echo", "reference", "--count", 1, "--json", "--timeout", 60).stdout)
    assert way["points"]
    clock = json.loads(heli("echo", "clock", "--count", 1, "--json", "--timeout", 60).stdout)
    assert 1 <= clock["clock"]["sec"] <= 3
    listener = subprocess.Popen(
        [*HELI, "echo", "odom"],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert listener.stdout.readline() == "header:\n"
    assert interrupted(listener) == 130
    assert interrupted(player) == 130
    stderr = heli("echo", "odom", "--timeout", 1, code=2).stderr
    assert " odom " in stderr and len(stderr.splitlines()) == 1
    assert living() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "seconds", [2, pytest.param(30, marks=pytest.mark.nightly)], ids=["short", "long"]
)
def test_nothing_is_lost_at_5000_messages_per_second(ros_env, seconds):
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts/bench_recorder.py"), "--json", "--rate", "5000",
         "--topics", "10", "--seconds", str(seconds)],
        env=ros_env, capture_output=True, text=True, timeout=150,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    counts = json.loads(done.stdout)
    assert counts["sent"] == 5000 * seconds
    assert (counts["lost"], counts["topics"], counts["acknowledged"]) == (0, 10, True)


@pytest.mark.slow
def test_full_disk_in_flight(small_disk, hover_test):
    """The flight goes on, and of what was recorded it is said how much it is, and why."""
    done = hover_test("--out", small_disk / "flight", "--duration", 20, "--gps", "rtk")
    assert done.returncode == 1, done.stdout + done.stderr
    result_json = json.loads((small_disk / "flight" / "result.json").read_text())
    assert (result_json["verdict"], result_json["exit_code"]) == ("partial", 1)
    coverage = result_json["coverage"]
    assert coverage["share"] < 1.0 and coverage["first_gap_s"][1] == coverage["spans_s"][0][1]
    assert f"PARTIAL: {result_json['partial']}" in " ".join(done.stdout.split())
    printed = " ".join(done.stdout.split())
    assert printed.count(os.strerror(errno.ENOSPC)) == 1, done.stdout
    assert "20.00 s flown" not in done.stdout
    bag = read_bag(small_disk / "flight" / "bag")
    assert bag.streams[topics.TRUTH_ODOM].stamp_ns.size > 300
