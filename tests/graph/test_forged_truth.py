# SPDX-License-Identifier: Apache-2.0
"""A stranger whose ground truth is recorded in the plant's place does not make the score."""

import errno
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_core.rows import PLANT
from heli_flight.graph.bag_record import TRUTH_SUMS, foreign_truth
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.signatures import read_checksums

TICKS = 300
# The supervisor finds no stranger, as it is not there yet; the recorder then hears it first.
FLIGHT = """
import json, sys, time
from pathlib import Path
import numpy as np
import rclpy
from rclpy.duration import Duration
from heli_flight.graph.flight import Graph, ended, running
from heli_flight.graph.flight import outcome
from heli_flight.graph.processes import start_server
from heli_flight.settings import resolve
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import CHANNELS, Encoder

forges, folder = sys.argv[1] == "forged", Path(sys.argv[2])
start_server()
settings = resolve(duration_s=3.0, world="paper", seed=1)
graph = Graph(settings, folder)


def forge(node):
    topic = topics.TRUTH_ODOM
    publisher = node.create_publisher(
        topics.message_class(topics.BY_NAME[topic].type), topic, topics.qos(topic)
    )

    def heard():
        hearers = [info.node_name for info in node.get_subscriptions_info_by_topic(topic)]
        return "recorder" in hearers and publisher.get_subscription_count() >= len(hearers)

    late_s = time.monotonic() + 120.0
    while not heard():
        assert time.monotonic() < late_s
        rclpy.spin_once(node, timeout_sec=0.01)
    row = np.zeros(CHANNELS[topic].size)
    row[PLANT.pos], row[PLANT.quat] = (0.0, 0.0, -10.5), (1.0, 0.0, 0.0, 0.0)
    encoder = Encoder(topic)
    for tick in range(settings.scenario.n_ticks):
        publisher.publish(encoder.encode(row, NS_PER_S + tick * TICK_NS))
    # The recorder has heard it before the plant begins.
    assert publisher.wait_for_all_acked(Duration(seconds=120.0))


with running(graph):
    graph.start()
    graph.prepare()
    if forges:
        forge(rclpy.create_node("stranger"))
    graph.activate()
    graph.fly(lambda flown_s: None)
    said = ended(graph)
result, _, _ = outcome(settings, folder, *said, 0.0)
print(json.dumps([result.exit_code(settings.gps), result.forged, result.lost]))
"""


def fly(kind, env, folder):
    folder.mkdir()
    command = [sys.executable, "-c", FLIGHT, kind, str(folder)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
def test_recorded_truth_that_is_not_the_plants_is_named_and_fails(ros_env, tmp_path):
    """The stranger's perfect hover is in the bag; without the sums nobody would know."""
    code, forged, lost = fly("forged", ros_env, tmp_path / "f")
    rows = read_bag(tmp_path / "f" / "bag").streams[topics.TRUTH_ODOM].rows
    # Which of both is followed from the second message on is a matter of who is discovered when.
    false = np.count_nonzero(np.all(rows[:, PLANT.pos] == (0.0, 0.0, -10.5), axis=1))
    assert false >= 1 and not lost
    assert code == 1 and forged.startswith(f"{topics.TRUTH_ODOM} "), forged
    assert f" {false} of {len(rows)} " in forged and " 0.00 s" in forged
    assert len(read_checksums(tmp_path / "f" / TRUTH_SUMS)) == TICKS
    # Whoever reads the folder later is told the same.
    command = [sys.executable, "-m", "heli_flight.cli.app", "report", str(tmp_path / "f")]
    done = subprocess.run(command, env=ros_env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1 and f"FORGED: {forged}" in done.stdout, done.stdout


def test_what_the_plant_sent_is_taken_for_what_it_is(ros_env, tmp_path):
    code, forged, _ = fly("own", ros_env, tmp_path / "f")
    assert (code, forged) == (0, "")
    stream = read_bag(tmp_path / "f" / "bag").streams[topics.TRUTH_ODOM]
    np.testing.assert_array_equal(stream.sums, read_checksums(tmp_path / "f" / TRUTH_SUMS))


class Bag:
    """What the check looks at of a flight."""

    def __init__(self, ticks, sums):
        self.truth_ticks, self.truth_sums = np.array(ticks), np.array(sums, np.uint64)


@pytest.mark.parametrize(
    ("ticks", "sums", "facts"),
    [
        ([0, 1, 2], [10, 11, 12], ()),
        ([0, 2], [10, 12], ()),  # one was lost on the way
        ([0, 1, 2], [10, 99, 12], (" 1 of 3 ", " 0.01 s")),
        ([0, 1, 3], [10, 11, 12], (" 1 of 3 ", " 0.03 s")),
        ([-1, 0], [10, 10], (" 1 of 2 ", " -0.01 s")),
    ],
)
def test_which_messages_are_the_plants(tmp_path, ticks, sums, facts):
    path = tmp_path / TRUTH_SUMS
    path.write_bytes(np.array([10, 11, 12], "<u8").tobytes())
    why = foreign_truth(Bag(ticks, sums), path, resolve().rate)
    assert bool(why) == bool(facts) and all(fact in why for fact in facts)


def test_a_plant_that_left_nothing_behind_proves_nothing(tmp_path):
    why = foreign_truth(Bag([0], [10]), tmp_path / TRUTH_SUMS, resolve().rate)
    assert why.endswith(f": {TRUTH_SUMS}: {os.strerror(errno.ENOENT)}")
