# SPDX-License-Identifier: Apache-2.0
"""A flight of a campaign, of an aircraft of its own, flown through the graph as a check."""

import json
import subprocess
import sys

import pytest

SPEC = """flights: 2
world: honest
gps: rtk
duration_s: 6.0
disperse:
  plant.scale.mass: {uniform: [0.9, 1.1]}
  aircraft.flapping.flap_back_radpmps: {uniform: [0.0, 0.0015]}
"""


@pytest.mark.slow
def test_a_campaigns_flight_is_the_same_through_the_graph(ros_env, tmp_path):
    file, out = tmp_path / "spec.yaml", tmp_path / "out"
    file.write_text(SPEC)
    words = ["campaign", file, "--out", out, "--workers", 0, "--via", "graph", "--sample", 1]
    done = subprocess.run(
        [sys.executable, "-m", "heli_flight.start", "heli", *map(str, words), "--json"],
        env=ros_env, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    campaign = json.loads(done.stdout)
    assert campaign["flights"] == 2
    (one,) = campaign["graph"]
    assert one["same"] and one["figure"].startswith("max") and one["difference"] <= 1e-6, one
    assert (out / "graph" / "flight_1" / "flight" / "bag" / "metadata.yaml").is_file()
