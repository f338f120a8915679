# SPDX-License-Identifier: Apache-2.0
"""By hand, attitude held, hover and by hand again through the graph: as in one process."""

import subprocess
import sys

import numpy as np
import pytest

from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--scenario", "sequence"]


@pytest.mark.slow
def test_the_graph_flies_by_hand_as_one_process_does(ros_env, tmp_path):
    """The pilot's deflections go with the collective, tick for tick, in both directions."""
    folder = tmp_path / "f"
    done = subprocess.run(
        [*HOVER, "--world", "paper", "--gps", "rtk", "--seed", "5", "--duration", "66",
         "--no-report", "--out", str(folder)],
        env=ros_env, capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    # 1: a flight that ends in the air has not reached the ground's figures.
    assert done.returncode in (0, 1), done.stdout + done.stderr
    settings = resolve("sequence", gps="rtk", seed=5, duration_s=66.0)
    flown = flight_from_bag(folder / "bag", settings).record
    alone = simulate(settings).record
    by_hand = alone.mode == "manual"
    assert by_hand[:2000].sum() > 1500 and by_hand[6100:].all()
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    changes = np.flatnonzero(np.r_[True, flown.mode[1:] != flown.mode[:-1]])
    assert {"manual", "attitude", "trajectory"} <= set(flown.mode[changes])
