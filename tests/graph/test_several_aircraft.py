# SPDX-License-Identifier: Apache-2.0
"""`--aircraft 2`: side by side by one clock, each as if alone, each with its bag and report."""

import json

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.settings import resolve
from heli_flight.loop.several import seed_of
from heli_math.rows import PLANT
from heli_msgs_bridge import topics

LENGTH_S = 3.0


def test_two_aircraft(hover_test, tmp_path):
    out = tmp_path / "flight"
    done = hover_test("--aircraft", 2, "--seed", 5, "--duration", LENGTH_S, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    tracks = []
    for number, name in enumerate(("heli1", "heli2")):
        result = json.loads((out / name / "result.json").read_text())
        assert result["seed"] == seed_of(5, number)
        assert result["mode"] == "lockstep" and result["flown_s"] == LENGTH_S
        truth = read_bag(out / name / "bag").streams[topics.TRUTH_ODOM]
        own = resolve(duration_s=LENGTH_S, params=[out / name / "params.yaml"])
        alone = simulate(own).record.truth_pos_ned_m
        tracks.append(truth.rows[:, PLANT.pos])
        assert tracks[-1].shape == alone.shape
        assert np.abs(tracks[-1] - alone).max() < 1e-6
        assert f"{name}, seed {seed_of(5, number)}:" in done.stdout
    assert np.abs(tracks[0] - tracks[1]).max() > 1e-3
    assert "gaps" not in done.stdout, "a bag that lacks ticks of the clock"
    assert "going on" not in "".join(p.read_text() for p in out.glob("*/logs/*.log"))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--aircraft", 99], "allowed are 1 to 9"),
        (["--aircraft", 2, "--live"], "--live"),
        (["--aircraft", 2, "--one-process"], "one process"),
        (["--aircraft", 0], "--aircraft"),
    ],
)
def test_what_does_not_go(hover_test, tmp_path, arguments, word):
    done = hover_test("--out", tmp_path / "flight", *arguments)
    assert done.returncode == 2 and word in done.stderr, done.stderr
    assert not (tmp_path / "flight").exists()
