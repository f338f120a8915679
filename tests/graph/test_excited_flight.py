# SPDX-License-Identifier: Apache-2.0
"""Excitation through the graph: what is added to actuators, wind and attitude is in the
bag, and nothing else
is."""

import json
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.signals import swept_angle
from heli_core.ticks import TICK_S
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_inner_hinf.excitation import ExcitationStatus, disturbance_params
from heli_msgs_bridge import topics

EXCITED = """
/**/inner_loop:
  ros__parameters:
    controller: pid
    excitation:
      frequency_hz: [0.5, 1.0, 2.0]
      amplitude: [0.05, 0.0, 0.0, 0.02, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.08, 0.0]
      phase_rad: [0.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
      start_s: 1.0
      duration_s: 6.0
      fade_s: 1.0
    disturbance:
      axis: yaw
      amplitude_deg: 1.5
      from_hz: 0.5
      to_hz: 2.0
      start_s: 1.0
      duration_s: 6.0
/**/plant:
  ros__parameters:
    wind:
      sines:
        frequency_hz: [0.5, 1.5]
        amplitude_mps: [1.0, 0.0, 0.5, 0.0, 1.0, 0.0]
        phase_rad: [0.0, 0.0, 1.0, 0.0, 0.5, 0.0]
        start_s: 1.0
        duration_s: 5.0
        fade_s: 1.0
"""


@pytest.mark.slow
def test_graph_and_one_process_loop_excite_alike(hover_test, tmp_path):
    change = tmp_path / "excited.yaml"
    change.write_text(EXCITED)
    done = hover_test("--out", tmp_path / "a", "--duration", 8, "--params", change, "--seed", 4)
    # Excited flights are not scored: 1 says "outside the paper's figures", 2 would be a failure.
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert "LOST" not in done.stdout
    settings = resolve(seed=4, duration_s=8.0, params=[change])
    graph = flight_from_bag(tmp_path / "a" / "bag", settings).record
    alone = simulate(settings).record
    for name in ("truth_pos_ned_m", "nav_pos_ned_m", "u", "excitation_u", "gust_ned_mps", "imu"):
        np.testing.assert_allclose(getattr(graph, name), getattr(alone, name), atol=1e-6)
    assert np.abs(graph.excitation_u).max(axis=0).min() > 0.015
    assert np.abs(graph.gust_ned_mps).max(axis=0).min() > 0.2
    bag = read_bag(tmp_path / "a" / "bag")
    assert bag.streams[topics.EXCITATION_ACTUATORS].stamp_ns.size == 800
    added = bag.streams[topics.EXCITATION_ATTITUDE].rows
    assert added.shape == (800, 3) and not added[:, :2].any()
    kernel = disturbance_params(settings.nodes["inner_loop"])
    expected = [swept_angle(TICK_S * tick, kernel) for tick in range(800)]
    np.testing.assert_allclose(added[:, 2], expected, atol=1e-12)
    assert any(r.message == ExcitationStatus.EXCITING.sentence for r in bag.remarks)


@pytest.mark.slow
def test_leaving_the_attitude_limit_ends_the_excitation_and_is_said(hover_test, tmp_path):
    change = tmp_path / "tight.yaml"
    change.write_text(
        EXCITED.replace("    excitation:\n", "    excitation:\n      attitude_limit_deg: 0.5\n")
    )
    done = hover_test("--out", tmp_path / "a", "--duration", 6, "--params", change)
    # Excited flights are not scored: 1 says "outside the paper's figures", 2 would be a failure.
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert "LOST" not in done.stdout
    notes = json.loads((tmp_path / "a" / "result.json").read_text())["notes"]
    assert f"inner_loop: {ExcitationStatus.ATTITUDE.sentence}" in notes
    settings = resolve(duration_s=6.0, params=[change])
    record = flight_from_bag(tmp_path / "a" / "bag", settings).record
    assert np.abs(record.excitation_u[200:300]).max() > 0.0
    np.testing.assert_array_equal(record.excitation_u[-100:], 0.0)


@pytest.mark.slow
@pytest.mark.nightly
def test_heli_identify_flies_fits_designs_and_hovers(ros_env, tmp_path):
    """The whole command through the graph, and once more from the bags that it left."""

    def identify(*arguments):
        command = [sys.executable, "-m", "heli_flight.cli.app", "identify", *map(str, arguments)]
        return subprocess.run(command, env=ros_env, capture_output=True, text=True, timeout=600)

    done = identify("--out", tmp_path / "a", "--seed", 2, "--hover")
    assert done.returncode == 0, done.stdout + done.stderr
    first = json.loads((tmp_path / "a" / "identification.json").read_text())
    assert first["misses"] == []
    assert json.loads((tmp_path / "a" / "hover" / "result.json").read_text())["exit_code"] == 0
    bags = (
        "--actuators",
        tmp_path / "a" / "actuators",
        "--gusts",
        tmp_path / "a" / "gusts" / "bag",
    )
    done = identify("--out", tmp_path / "b", *bags, "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    again = json.loads(done.stdout)
    assert again["compared_with"] is None
    assert [e["identified"] for e in again["entries"] if e["group"] == "E"] == [
        e["identified"] for e in first["entries"] if e["group"] == "E"
    ]
    swapped = identify("--out", tmp_path / "c", "--actuators", bags[3], "--gusts", bags[1])
    assert swapped.returncode == 2
    assert "'excitation/actuators'" in swapped.stderr
    assert not (tmp_path / "c").exists()
