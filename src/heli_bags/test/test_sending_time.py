# SPDX-License-Identifier: Apache-2.0
"""A bag has each message at the time at which it was sent, however the recorder came to hear it."""

import random

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.reader import make_reader
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader

from heli_bags.node import RecorderNode
from heli_bags.writer import BagRecorder, Format
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import FACT_GPS_LATENCY
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder, encode_transforms, fixed_to_base

LATENCY_NS, TICKS = 15 * TICK_NS, 400
NAMES = (topics.ACTUATORS, topics.IMU, topics.GPS_FIX, topics.ODOM, topics.GPS_VELOCITY, topics.MAG)
IN_ORDER = (topics.MAG, topics.GPS_FIX, topics.GPS_VELOCITY, topics.IMU, topics.ODOM,
            topics.ACTUATORS)  # fmt: skip
ORIGIN = datum(28.17, 112.93, 50.0)


def sent_in_a_flight():
    """Topic and message of each tick, in the order of sending."""
    encoders = {n: Encoder(n, datum=ORIGIN if n == topics.GPS_FIX else None) for n in IN_ORDER}
    for tick in range(TICKS):
        for name in IN_ORDER:
            if topics.due(name, tick):
                late_ns = LATENCY_NS if name in (topics.GPS_FIX, topics.GPS_VELOCITY) else 0
                row = np.ones(CHANNELS[name].size)
                yield name, encoders[name].encode(row, NS_PER_S + tick * TICK_NS - late_ns)


def in_turns(messages):
    """As a recorder hears them that lags: the queue of each topic in its turn, some at a time."""
    queues = {name: [raw for topic, raw in messages if topic == name] for name in NAMES}
    turns, heard = random.Random(4), []
    while any(queues.values()):
        name = turns.choice(NAMES)
        count = turns.randint(1, 90)
        heard += [(name, raw) for raw in queues[name][:count]]
        del queues[name][:count]
    return heard


def by_rosbags(folder):
    with Reader(folder) as reader:
        return [(c.topic[1:], log_ns, bytes(raw)) for c, log_ns, raw in reader.messages()]


def by_mcap(folder):
    with open(folder / f"{folder.name}_0.mcap", "rb") as file:
        return [(channel.topic[1:], message.log_time, message.data)
                for _, channel, message in make_reader(file).iter_messages()]  # fmt: skip


@pytest.mark.parametrize(
    ("storage", "read"), [("mcap", by_rosbags), ("mcap", by_mcap), ("sqlite3", by_rosbags)]
)
def test_readers_give_what_was_sent_in_the_order_of_sending(tmp_path, storage, read):
    sent = list(sent_in_a_flight())
    latency_ns = dict.fromkeys((topics.GPS_FIX, topics.GPS_VELOCITY), LATENCY_NS)
    bag = BagRecorder(
        tmp_path / "bag", NAMES, "/", Format(storage), NS_PER_S, latency_ns=latency_ns
    )
    for number, (name, raw) in enumerate(in_turns(sent)):
        bag.write(name, raw)
        if number % 7 == 0:
            bag.flush()
    assert bag.missing() == [] and bag.odd_stamps == {}
    bag.close()
    messages = read(tmp_path / "bag")
    assert [(name, raw) for name, _, raw in messages] == sent
    for name, log_ns, raw in messages:
        sent_ns = stamp_of(raw) + latency_ns.get(name, 0)
        assert log_ns == sent_ns + IN_ORDER.index(name)


def test_transforms_are_where_their_stamps_say(tmp_path):
    """Their stamps stand behind a count. What is latched, or has none, is where it was heard."""
    names = (topics.IMU, topics.TF, topics.TF_STATIC)
    bag = BagRecorder(tmp_path / "bag", names, start_ns=NS_PER_S)
    imu, row = Encoder(topics.IMU), np.zeros(CHANNELS[topics.IMU].size)
    for tick in range(500):
        bag.write(topics.IMU, imu.encode(row, NS_PER_S + tick * TICK_NS))
    mounts = fixed_to_base({"imu_link": (0.0, 0.0, 0.0)}, "/")
    heard_ns, told_ns = NS_PER_S + 499 * TICK_NS, [NS_PER_S + 40 * TICK_NS * n for n in range(10)]
    for stamp_ns in told_ns:
        bag.write(topics.TF, encode_transforms(mounts, stamp_ns))
    bag.write(topics.TF, b"\0\1\0\0\0\0\0\0")
    bag.write(topics.TF_STATIC, encode_transforms(mounts, NS_PER_S))
    bag.close()
    in_bag = {}
    for name, log_ns, _ in by_rosbags(tmp_path / "bag"):
        in_bag.setdefault(name, []).append(log_ns // TICK_NS * TICK_NS)
    assert in_bag["tf"] == [*told_ns, heard_ns] and in_bag["tf_static"] == [heard_ns]


def said_by(name, latency_ns):
    facts = [KeyValue(key=FACT_GPS_LATENCY, value=str(latency_ns))]
    return serialize_message(DiagnosticArray(status=[DiagnosticStatus(name=name, values=facts)]))


@pytest.mark.parametrize(
    ("plant", "latency_ns", "ticks"),
    [("plant", 30 * TICK_NS, 30), ("plant", 15 * TICK_NS, None), ("plant", -1, None),
     ("plant", "9" * 4000, None), ("heli2/plant", TICK_NS, None)],
    ids=["other", "same", "negative", "endless", "not ours"],
)  # fmt: skip
def test_a_plant_that_sends_later_than_the_recorder_is_told_is_named(
    bench, tmp_path, plant, latency_ns, ticks
):
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"))
    recorder.fly()
    info = {"publication_sequence_number": 1, "source_timestamp": 1}
    recorder.node._write(topics.DIAGNOSTICS, said_by(plant, latency_ns), info)
    named = recorder.node.health.facts.get("schedule.gps_latency_ticks")
    assert (named is None) == (ticks is None)
    assert ticks is None or named.endswith(f" to {ticks}")
