# SPDX-License-Identifier: Apache-2.0
"""An engine that stops, through the graph: landed without it as in one process, and told."""

import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.flight_file import fault_overrides
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_FAILSAFE
from heli_outer_pd.failsafes import Action

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report"]
SECONDS = 9.0
FAULTS = """\
faults:
  - {what: engine, kind: stop, start_s: 3.0}
  - {what: rotor_speed, kind: loss, start_s: 1.0, duration_s: 0.5}
  - {what: link, from: plant, to: outer_loop, topic: rotor_speed, kind: loss, value: 0.2,
     start_s: 3.0}
"""


@pytest.mark.slow
def test_the_graph_lands_without_its_engine_as_one_process_does(ros_env, tmp_path):
    faults, folder = tmp_path / "faults.yaml", tmp_path / "f"
    faults.write_text(FAULTS)
    words = ["--faults", str(faults), "--seed", "1", "--world", "honest", "--gps", "rtk",
             "--duration", str(SECONDS), "--out", str(folder)]  # fmt: skip
    done = subprocess.run(
        [*HOVER, *words], env=ros_env, capture_output=True, text=True, timeout=280
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    settings = resolve("hover", "rtk", 1, SECONDS, world="honest",
                       overrides=fault_overrides(faults))  # fmt: skip
    alone = simulate(settings).record
    flown = flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    np.testing.assert_array_equal(flown.failsafe, alone.failsafe)
    assert Action.AUTOROTATE.name in alone.failsafe

    bag = read_bag(folder / "bag")
    speed = bag.streams[topics.ROTOR_SPEED].rows[:, 0]
    # Samples that were lost at the sensor are no rows; those that the link lost are.
    assert len(speed) == len(alone.time_s) // 2 + len(alone.time_s) % 2 - 25
    assert abs(speed[:100].mean() - 193.73) < 2.0 and speed[-1] < 0.8 * 193.73
    by_outer_loop = [remark for remark in bag.remarks if remark.node == "outer_loop"]
    assert Action.AUTOROTATE.name in {remark.facts.get(FACT_FAILSAFE) for remark in by_outer_loop}
