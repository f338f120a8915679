# SPDX-License-Identifier: Apache-2.0
"""`--vehicles 2`: side by side by one clock, each as if alone, each with its bag and report."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.loop import simulate
from heli_flight.report.write import report_of_bag
from heli_flight.settings import resolve, seed_of
from heli_msgs_bridge import topics

LENGTH_S = 3.0


@pytest.mark.slow
def test_two_aircraft(hover_test, tmp_path):
    out = tmp_path / "flight"
    done = hover_test("--vehicles", 2, "--seed", 5, "--duration", LENGTH_S, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    tracks = []
    for number, name in enumerate(("heli1", "heli2")):
        result = json.loads((out / name / "result.json").read_text())
        assert result["seed"] == seed_of(5, number)
        assert result["mode"] == "lockstep" and result["flown_s"] == LENGTH_S
        truth = read_bag(out / name / "bag").streams[topics.TRUTH_ODOM]
        settings = resolve(duration_s=LENGTH_S, params=[out / name / "params.yaml"])
        alone = simulate(settings).record.truth_pos_ned_m
        tracks.append(truth.rows[:, PLANT.pos])
        assert tracks[-1].shape == alone.shape
        assert np.abs(tracks[-1] - alone).max() < 1e-6
        assert f"{name}, seed {seed_of(5, number)}:" in done.stdout
    assert np.abs(tracks[0] - tracks[1]).max() > 1e-3
    assert "gaps" not in done.stdout, "a bag that lacks ticks of the clock"
    assert "going on" not in "".join(p.read_text() for p in out.glob("*/logs/*.log"))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_three_aircraft_each_named(hover_test, tmp_path, mode):
    """In both modes: table, result and page; a page that is made of the bag alone, too."""
    out = tmp_path / "flight"
    done = hover_test("--vehicles", 3, "--duration", 6, f"--{mode}", "--out", out)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    expected = NS_PER_S + TICK_NS * np.arange(600)
    for name in ("heli1", "heli2", "heli3"):
        result = json.loads((out / name / "result.json").read_text())
        assert result["mode"].replace(" ", "") == mode and result["flown_s"] == 6.0
        assert result["aircraft"] == name and not result["lost"]
        truth = read_bag(out / name / "bag").streams[topics.TRUTH_ODOM]
        assert np.array_equal(truth.stamp_ns, expected)
        assert f" of {name}, " in done.stdout
    reported = out / "heli3"
    if mode == "lockstep":
        reported = tmp_path / "only_heli3"
        shutil.copytree(out / "heli3" / "bag", reported)
    text = report_of_bag(reported).read_text(encoding="utf-8")
    assert re.search("<h1>[^<]*: heli3</h1>", text)
    assert re.search(r"<title>[^<]*: heli3, seed \d", text)


@pytest.mark.slow
def test_what_goes_wrong_names_its_aircraft(ros_env, tmp_path, holder_of, living):
    """A process of the second one is killed in flight: one line says whose."""
    out = tmp_path / "flight"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
    flying = subprocess.Popen(
        [*command, "--vehicles", "2", "--duration", "30", "--out", str(out)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "flown" in flying.stdout.readline()
    os.kill(holder_of(out / "heli2" / "logs" / "inner_loop.log"), signal.SIGKILL)
    _, err = flying.communicate(timeout=120)
    assert flying.returncode == 1 and re.search("heli2: inner_loop: .*SIGKILL", err), err
    assert living() == []


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--vehicles", 99], "allowed are 1 to 9"),
        (["--vehicles", 2, "--live"], "--live"),
        (["--vehicles", 2, "--one-process"], "one process"),
        (["--vehicles", 0], "--vehicles"),
    ],
)
def test_what_does_not_go(refused, tmp_path, arguments, word):
    assert word in refused("--out", tmp_path / "flight", *arguments)
    assert not (tmp_path / "flight").exists()
