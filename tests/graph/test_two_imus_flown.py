# SPDX-License-Identifier: Apache-2.0
"""Two IMUs through the graph: both recorded, the wrong one left, as in one process, and told."""

import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.flight_file import fault_overrides
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import build, fly_loop
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import COUNTED, PLACE
from heli_observer.layout import ObserverStatus

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report"]
SECONDS = 14.0
FAULTS = """\
faults:
  - {what: gyro2, kind: bias, start_s: 6.0, value: [0.1, 0.0, 0.0]}
  - {what: link, from: plant, to: observer, topic: imu2/data_raw, kind: loss, value: 0.3,
     start_s: 3.0, duration_s: 2.0}
  - {what: link, from: plant, to: observer, topic: imu2/data_raw, kind: delay, value: 0.03,
     start_s: 8.0, duration_s: 1.0}
  - {what: imu2, kind: nan, start_s: 12.0, duration_s: 0.5}
"""
TWO = """\
/**/plant:
  ros__parameters:
    sensors.imu2.enabled: true
/**/observer:
  ros__parameters:
    imu2.enabled: true
"""


@pytest.mark.slow
def test_the_graph_leaves_the_wrong_imu_as_one_process_does(ros_env, tmp_path):
    faults, params, folder = tmp_path / "faults.yaml", tmp_path / "two.yaml", tmp_path / "f"
    faults.write_text(FAULTS)
    params.write_text(TWO)
    words = ["--faults", str(faults), "--params", str(params), "--seed", "3", "--world", "honest",
             "--duration", str(SECONDS), "--out", str(folder)]  # fmt: skip
    done = subprocess.run(
        [*HOVER, *words], env=ros_env, capture_output=True, text=True, timeout=280
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    overrides = fault_overrides(faults)
    settings = resolve("hover", seed=3, duration_s=SECONDS, world="honest", params=[params],
                       overrides=overrides)  # fmt: skip
    loop = build(settings)
    alone = fly_loop(loop, settings).record
    counted = loop.links.s.counts[PLACE[topics.IMU2, "observer"]]
    alone_counts = dict(zip(COUNTED, counted.tolist(), strict=True))
    flown = flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)

    bag = read_bag(folder / "bag")
    first, second = bag.streams[topics.IMU], bag.streams[topics.IMU2]
    # Samples that are no numbers are no rows; all others are there.
    assert len(first.rows) == 1400 and len(second.rows) == 1350
    apart = second.rows[:1200, 3] - first.rows[:1200, 3]
    assert abs(np.mean(apart[:600])) < 0.02 and abs(np.mean(apart[600:]) - 0.1) < 0.02
    facts = [remark.facts for remark in bag.remarks if remark.node == "observer"]
    lost = alone_counts["lost"]
    assert lost > 40 and f"lost {lost}, delayed 100" in facts[-1]["link.imu2/data_raw"]
    assert ObserverStatus.IMU_LEFT.name in {fact.get("status") for fact in facts}
