# SPDX-License-Identifier: Apache-2.0
"""Messages from outside the graph, as a user's `ros2 topic pub` sends them, in a flight."""

import json
import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from heli_bags.reader import read_bag
from heli_core.command_line import config_folder
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import TICK_NS
from heli_core.trajectory import Trajectory
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.graph.nodes import PROFILES
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder

HOVER_TEST = [
    sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--world", "paper",
]  # fmt: skip
NODES = {"plant", "observer", "inner_loop", "outer_loop"}
INPUTS = [
    t.name for t in topics.TABLE if t.name in CHANNELS and NODES & set(t.sinks) and not t.optional
]
LATE_2026_NS = 1_795_299_400_000_000_000


def a_message(name, stamp_ns):
    """Serialised message with values that would do harm."""
    row = np.full(CHANNELS[name].size, 0.3)
    if name == topics.ODOM:
        row[:] = 20.0
        row[NAV.quat] = 1.0, 0.0, 0.0, 0.0
    place = datum(1.0, 2.0, 3.0) if name == topics.GPS_FIX else None
    return Encoder(name, datum=place).encode(row, stamp_ns)


class Foreigner:
    """A node that is none of the graph's; its context is the test's."""

    def __init__(self, env):
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=int(env["ROS_DOMAIN_ID"]))
        self.node = rclpy.create_node("pilot", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.publishers = {}

    def join(self, names):
        for name in names:
            cls = topics.message_class(topics.BY_NAME[name].type)
            self.publishers[name] = self.node.create_publisher(cls, name, 10)

    def send(self, name, *messages):
        """Publish when all of the graph's listeners to a topic are met."""
        publisher, deadline = self.publishers[name], time.monotonic() + 120.0
        # The recorder hears all.
        listeners = len(topics.BY_NAME[name].sinks) + 1
        while publisher.get_subscription_count() < listeners:
            assert time.monotonic() < deadline, name
            rclpy.spin_once(self.node, executor=self.executor, timeout_sec=0.05)
        for message in messages:
            publisher.publish(message)

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def foreigner(ros_env, monkeypatch):
    """One that announces itself as often as the graph's own nodes, and is soon known by name."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    for name in PROFILES:
        monkeypatch.setenv(name, str(config_folder("heli_flight") / "fastdds.xml"))
    made = Foreigner(ros_env)
    yield made
    made.close()


@pytest.fixture
def terminal(ros_env, monkeypatch):
    """One with the middleware's defaults, as in a user's second terminal."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made = Foreigner(ros_env)
    yield made
    made.close()


def fly_with(foreigner, env, folder, act, *options, codes=(0,)):
    """A flight during which `act` is called once, when it has flown a tenth; its result."""
    flying = subprocess.Popen(
        [*HOVER_TEST, "--out", str(folder), *map(str, options)],
        env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "flown" in flying.stdout.readline()
    act()
    out, err = flying.communicate(timeout=200)
    assert flying.returncode in codes, out + err
    return json.loads((folder / "result.json").read_text())


def facts_of(folder):
    """All that nodes said in /diagnostics: per node the sentences, and facts by key."""
    sentences, facts = {}, {}
    for remark in read_bag(folder / "bag").remarks:
        sentences.setdefault(remark.node, set()).add(remark.message)
        facts.setdefault(remark.node, {}).update(remark.facts)
    return sentences, facts


def assert_held(folder):
    """By ground truth the helicopter stayed by its reference.

    The drift of its GPS is in it, and the shaping by which it follows a climb 2 m behind.
    """
    record = flight_from_bag(folder / "bag", resolve()).record
    away_m = np.abs(record.truth_pos_ned_m - record.reference[:, REFERENCE.pos]).max(axis=0)
    assert away_m.max() < 4.0, away_m


@pytest.mark.nightly  # a client has to keep up with the flight
@pytest.mark.parametrize(
    "options",
    [[], ["--realtime", "--duration", 25]],
    ids=["lockstep", "real"],
)
def test_a_message_of_the_future_on_each_input_leaves_the_flight_inside(
    foreigner, ros_env, tmp_path, options
):
    """One `topic pub --once` per input, stamped 2026: its sender is named, the flight goes on."""

    def act():
        foreigner.join(INPUTS)
        for name in INPUTS:
            foreigner.send(name, a_message(name, LATE_2026_NS))

    result = fly_with(foreigner, ros_env, tmp_path / "f", act, *options)
    assert result["exit_code"] == 0
    assert_held(tmp_path / "f")
    _, facts = facts_of(tmp_path / "f")
    for name in INPUTS:
        for node in NODES.intersection(topics.BY_NAME[name].sinks):
            assert "/pilot" in facts[node][f"senders.{name}"], (node, name)
            assert ": 1 messages" in facts[node][f"senders.{name}"], (node, name)
    assert any("/pilot" in note for note in result["notes"])


@pytest.mark.nightly  # a client has to keep up with the flight
def test_a_second_sender_on_each_input_does_not_fly_the_aircraft(foreigner, ros_env, tmp_path):
    """In lockstep, with the stamps of ticks to come: ground truth is the same, number for number.

    The second sender is named in the result.
    """

    def act():
        foreigner.join(INPUTS)
        for name in INPUTS:
            every = max(10, topics.BY_NAME[name].every_ticks)
            # Off the schedule of the slow topics: a sender that has the owner's numbers and stamps
            # at the same time is not told from it.
            stamps = (1_000_000_000 + tick * TICK_NS for tick in range(3, 4000, every))
            foreigner.send(name, *(a_message(name, stamp_ns) for stamp_ns in stamps))

    flights, results = [], []
    for name, what in (("without", lambda: None), ("with", act)):
        options = ("--duration", 40, "--seed", 5)
        results.append(fly_with(foreigner, ros_env, tmp_path / name, what, *options))
        flights.append(flight_from_bag(tmp_path / name / "bag", resolve(seed=5)).record)
    first, second = flights
    np.testing.assert_array_equal(first.truth_pos_ned_m, second.truth_pos_ned_m)
    np.testing.assert_array_equal(first.truth_q_nb, second.truth_q_nb)
    np.testing.assert_array_equal(first.nav_pos_ned_m, second.nav_pos_ned_m)
    assert len(first) == 4000 and results[0]["metrics"] == results[1]["metrics"]
    for name in INPUTS:
        notes = [note for note in results[1]["notes"] if f": {name}: sent by /" in note]
        assert notes and all("/pilot" in note for note in notes), (name, results[1]["notes"])


@pytest.mark.nightly  # a client has to keep up with the flight
def test_a_plain_topic_pub_moves_the_reference_within_its_bounds(foreigner, ros_env, tmp_path):
    """Default QoS. Too high a reference is refused by the node and named; the next is followed."""
    foreigner.join([topics.REFERENCE])
    there = np.array([4.0, 6.0, -14.0])

    def act():
        points = np.array([4.0, 6.0, -140.0]), there
        ways = [encode_reference(Trajectory.hover(point, 0.0)) for point in points]
        foreigner.send(topics.REFERENCE, *ways)

    # What is flown then is not the scenario: its verdict is nobody's matter here.
    fly_with(foreigner, ros_env, tmp_path / "f", act, "--gps", "rtk", codes=(0, 1))
    sentences, facts = facts_of(tmp_path / "f")
    count, _, why = facts["outer_loop"]["refused.reference"].partition("; ")
    assert count == "1" and why.startswith("reference: point 0 ")
    assert "140.0 m" in why and "2 to 100 m" in why
    assert any(message.endswith(f": {why}") for message in sentences["outer_loop"])
    record = flight_from_bag(tmp_path / "f" / "bag", resolve()).record
    assert np.abs(record.truth_pos_ned_m[-500:] - there).max() < 1.0


@pytest.mark.nightly  # a client has to keep up with the flight
def test_a_flight_does_not_begin_with_a_stranger_on_its_streams(terminal, hover_test, tmp_path):
    """Who sends first is flown: a forgotten `topic pub` is named before anything flies.

    Half of all times it is heard only when it announces itself again, after 3 s: three flights.
    """
    terminal.join([topics.ATTITUDE_SETPOINT])
    for attempt in range(3):
        done = hover_test("--out", tmp_path / f"f{attempt}", "--duration", 2)
        assert done.returncode == 2, done.stdout
        assert done.stderr.startswith("hover_test: /pilot ") and done.stderr.count("\n") == 1
        assert "'attitude_setpoint'" in done.stderr and "ROS_DOMAIN_ID" in done.stderr
