# SPDX-License-Identifier: Apache-2.0
"""Links with faults through the graph, in lockstep: the numbers of one process, and it is told."""

import subprocess
import sys

import numpy as np

from heli_bags.reader import read_bag
from heli_flight.flight_file import fault_overrides, flown_faults
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_outer_pd.failsafes import Condition, of

HOVER = [sys.executable, "-m", "heli_flight.cli.app", "hover", "--no-report"]
SECONDS = 12.0
FAULTS = """\
faults:
  - {what: link, from: any, to: any, kind: loss, value: 0.2, start_s: 2.0}
  - {what: link, from: any, to: any, kind: delay, value: 0.03, start_s: 3.0}
  - {what: link, from: outer_loop, to: inner_loop, topic: collective, kind: reorder, start_s: 4.0}
  - {what: link, from: observer, to: any, topic: odom, kind: duplicate, value: 0.5, start_s: 4.0}
  - {what: link, from: inner_loop, to: plant, kind: loss, start_s: 6.0, duration_s: 0.3}
  - {what: link, from: outer_loop, to: inner_loop, kind: loss, start_s: 7.0, duration_s: 0.8}
"""


def test_the_graph_flies_the_numbers_of_one_process_and_tells_what_was_lost(ros_env, tmp_path):
    faults, folder = tmp_path / "faults.yaml", tmp_path / "f"
    faults.write_text(FAULTS)
    words = ["--faults", str(faults), "--seed", "3", "--world", "paper",
             "--duration", str(SECONDS), "--out", str(folder)]  # fmt: skip
    done = subprocess.run(
        [*HOVER, *words], env=ros_env, capture_output=True, text=True, timeout=280
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    settings = resolve("hover", seed=3, duration_s=SECONDS, world="paper",
                       overrides=fault_overrides(faults))  # fmt: skip
    alone = simulate(settings).record
    sound = simulate(resolve("hover", seed=3, duration_s=SECONDS, world="paper")).record
    flown = flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    assert np.abs(sound.u - alone.u)[700:].max() > 1e-2
    assert flown_faults(settings)[0].words in done.stdout
    facts, sentences = {}, {}
    for remark in read_bag(folder / "bag").remarks:
        facts.setdefault(remark.node, {}).update(remark.facts)
        sentences.setdefault(remark.node, []).append(remark.message)
    assert "lost" in facts["inner_loop"]["link.odom"]
    assert "twice" in facts["outer_loop"]["link.odom"]
    assert "overtaken" in facts["inner_loop"]["link.collective"]
    assert "lost" in facts["observer"]["link.imu/data_raw"]
    assert facts["plant"]["without_commands"].startswith("1 times")
    assert any("odom loss" in message for message in sentences["outer_loop"])
    assert of(Condition.SETPOINT_GONE).status in sentences["inner_loop"]
