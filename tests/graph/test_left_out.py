# SPDX-License-Identifier: Apache-2.0
"""A recorder that leaves topics out: nobody waits for it there."""

import json

import pytest

from heli_bags.reader import read_bag
from heli_msgs_bridge import topics

FILE = "/**/recorder:\n  ros__parameters:\n    exclude: [{}]\n"


@pytest.mark.slow
def test_a_flight_whose_recorder_leaves_topics_out_begins_at_once(hover_test, tmp_path):
    file, out = tmp_path / "my.yaml", tmp_path / "flight"
    file.write_text(FILE.format("imu/mag, baro"))
    done = hover_test("--duration", 3, "--params", file, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    streams = read_bag(out / "bag").streams
    assert len(streams[topics.TRUTH_ODOM].stamp_ns) == 300
    assert not {topics.MAG, topics.BARO} & set(streams)
    result = json.loads((out / "result.json").read_text())
    # The wait for a peer that does not come takes 30 s.
    assert result["start_up_s"] < 30.0 and result["notes"] == []


@pytest.mark.parametrize("name", [topics.TRUTH_ODOM, topics.REFERENCE])
def test_what_a_flight_is_scored_by_is_recorded(hover_test, tmp_path, name):
    file, out = tmp_path / "my.yaml", tmp_path / "flight"
    file.write_text(FILE.format(name))
    done = hover_test("--params", file, "--out", out)
    expected = f"hover_test: recorder: leaves out {name}: a flight is scored by it\n"
    assert (done.returncode, done.stderr) == (2, expected)
    assert not out.exists()
