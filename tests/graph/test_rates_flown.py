# SPDX-License-Identifier: Apache-2.0
"""The graph at 400 Hz: every stream at its own time, the same flight as in one process."""

import json

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_msgs_bridge import topics


@pytest.mark.slow
def test_the_graph_at_400_hz_agrees_with_the_one_process_loop(hover_test, tmp_path):
    folder = tmp_path / "flight"
    done = hover_test("--out", folder, "--rate", 400, "--seed", 5, "--gps", "rtk", "--duration", 3)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "400 Hz" in done.stdout
    result = json.loads((folder / "result.json").read_text())
    assert (result["rate_hz"], result["lost"], result["notes"]) == (400, "", [])
    assert result["flown_s"] == 3.0

    # params.yaml alone says the rate, too
    settings = resolve(params=[folder / "params.yaml"])
    graph, alone = flight_from_bag(folder / "bag", settings).record, simulate(settings).record
    assert len(graph) == len(alone) == 1200
    np.testing.assert_array_equal(graph.time_s, alone.time_s)
    np.testing.assert_allclose(graph.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(graph.nav_pos_ned_m, alone.nav_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(graph.setpoint, alone.setpoint, atol=1e-6)
    np.testing.assert_allclose(graph.u, alone.u, atol=1e-6)

    streams = read_bag(folder / "bag").streams
    for name in (topics.IMU, topics.MAG, topics.BARO, topics.ATTITUDE_SETPOINT, topics.ACTUATORS):
        period_ns = topics.BY_NAME[name].period_ns(settings.rate)
        assert set(np.diff(streams[name].stamp_ns)) == {period_ns}, name
        assert streams[name].stamp_ns.size == 3_000_000_000 // period_ns, name
    assert set(np.diff(streams[topics.GPS_VELOCITY].stamp_ns)) == {200_000_000}
