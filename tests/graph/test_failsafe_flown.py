# SPDX-License-Identifier: Apache-2.0
"""A receiver that gets stuck, through the graph: as in one process, landed by itself, and told."""

import subprocess
import sys

import numpy as np
import pytest

from heli_flight.flight_file import fault_overrides
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report"]
SECONDS = 30.0
FAULTS = "faults:\n  - {what: gps, kind: freeze, start_s: 6.0}\n"
SOON = """\
/**/outer_loop:
  ros__parameters:
    failsafe:
      land_after_s: 2.0
/**/scenario:
  ros__parameters:
    climb:
      start_s: 200.0
      end_s: 202.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("world", ["paper", "honest"])
def test_the_graph_lands_what_is_lost_as_one_process_does(ros_env, tmp_path, world):
    """Honest: the height of the ground follows from where the reference was engaged."""
    faults, params, folder = tmp_path / "faults.yaml", tmp_path / "soon.yaml", tmp_path / "f"
    faults.write_text(FAULTS)
    params.write_text(SOON)
    words = ["--faults", str(faults), "--params", str(params), "--seed", "3", "--world", world,
             "--duration", str(SECONDS), "--out", str(folder)]  # fmt: skip
    done = subprocess.run(
        [*HOVER, *words], env=ros_env, capture_output=True, text=True, timeout=280
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    overrides = fault_overrides(faults)
    settings = resolve("hover", seed=3, duration_s=SECONDS, world=world, params=[params],
                       overrides=overrides)  # fmt: skip
    alone = simulate(settings).record
    flown = flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    assert alone.mode[-1] == flown.mode[-1] == "standing"
    # What it did by itself is in both records, from the same tick on.
    np.testing.assert_array_equal(flown.failsafe, alone.failsafe)
    assert "LAND" in alone.failsafe
