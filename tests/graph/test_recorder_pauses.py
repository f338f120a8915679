# SPDX-License-Identifier: Apache-2.0
"""A recorder that cannot run for a while, as on a machine full of other work, loses nothing."""

import json

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_bags.tools import bag_info
from heli_msgs_bridge import topics

SECONDS = 60.0
# More than senders keep for each other, and more than the window in which a stamp is believed.
PAUSE_S = 35.0
# Of a process that is stopped for seconds Fast DDS may take the shared memory away, and not all of
# it comes back (rarely, on loaded cores): the recorder then does not hear some nodes any more.
FLIGHTS = 3


def with_pause(hover_test, tmp_path):
    """Folder and result of a flight; one whose recorder no longer answers says so."""
    faults = tmp_path / "faults.yaml"
    pause = f"node: recorder, kind: pause, start_s: 10, duration_s: {PAUSE_S}"
    faults.write_text(f"faults:\n  - {{what: process, {pause}}}\n")
    for number in range(FLIGHTS):
        folder = tmp_path / f"f{number}"
        done = hover_test("--duration", SECONDS, "--faults", faults, "--out", folder)
        assert done.returncode in (0, 1), done.stderr
        assert (folder / "result.json").is_file(), done.stdout + done.stderr
        result = json.loads((folder / "result.json").read_text())
        if not result["unheard"]:
            return folder, result
        assert done.returncode == 1 and f"PARTIAL: {result['partial']}" in done.stdout
    raise AssertionError(f"{FLIGHTS} recorders in turn no longer answered after a pause")


@pytest.mark.slow
def test_in_lockstep_its_pause_costs_no_message(hover_test, tmp_path):
    """Nobody waits for it: the others are 3500 ticks on when it runs again."""
    folder, result = with_pause(hover_test, tmp_path)
    # In lockstep the flight goes on while somebody looks whether a fault is due.
    (fault,) = result["process_faults_done"]
    assert 10.0 <= fault["begun_s"] < SECONDS - PAUSE_S
    assert not any("gaps" in note or "lacks" in note for note in result["notes"])
    counts = {row.topic.lstrip("/"): row.messages for row in bag_info(folder).topics}
    replaced = topics.BY_NAME[topics.NO_ESTIMATE].replaces
    for topic in topics.TABLE:
        if topic.every_ticks and not topic.optional and topic.name.lstrip("/") in counts:
            due = len(range(0, round(SECONDS * 100), topic.every_ticks))
            absent = counts[topics.NO_ESTIMATE] if topic.name in replaced else 0
            assert counts[topic.name.lstrip("/")] == due - absent, topic.name
    bag = read_bag(folder / "bag")
    assert not bag.refused
    stamps = bag.streams[topics.GPS_VELOCITY].stamp_ns
    assert np.all(np.diff(stamps) > 0)
