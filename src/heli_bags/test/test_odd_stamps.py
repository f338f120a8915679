# SPDX-License-Identifier: Apache-2.0
"""Messages with stamps of another time in a bag: its duration, order and readers are as without."""

import functools

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import Reader

from heli_bags.bag_clock import BagClock
from heli_bags.reader import read_bag
from heli_bags.tools import bag_info, bag_messages, write_csv
from heli_bags.writer import BagRecorder, Format
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import ClockEncoder, Encoder

START_NS = NS_PER_S
STREAMS = (topics.IMU, topics.ODOM, topics.TRUTH_ODOM, topics.ACTUATORS)
NAMES = (topics.CLOCK, *STREAMS, topics.REFERENCE, topics.DIAGNOSTICS)
ODD_NS = {
    "2026": 1_795_299_400 * NS_PER_S,
    "an hour ahead": 3600 * NS_PER_S,
    "zero": 0,
    "negative": -5 * NS_PER_S,
    "the first moment": -(2**31) * NS_PER_S,
    "the last moment": (2**31 - 1) * NS_PER_S,
}


encoder = functools.cache(Encoder)


def stream_message(name, stamp_ns, value=0.0):
    row = np.full(CHANNELS[name].size, value)
    if name in (topics.ODOM, topics.TRUTH_ODOM):
        row[6:10] = 1.0, 0.0, 0.0, 0.0
    return encoder(name).encode(row, stamp_ns)


def diagnostics_message(stamp_ns, text="here"):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    message = DiagnosticArray(status=[DiagnosticStatus(name="heli/pilot", message=text)])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    return serialize_message(message)


def reference(stamp_ns, up_m=10.0):
    way = Trajectory(stamp_ns, np.array([0]), np.array([[0.0, 0.0, -up_m, 0.0, 0.0, 0.0, 0.0]]))
    return serialize_message(encode_reference(way))


def foreign(stamp_ns):
    """One message per topic, from outside."""
    yield topics.CLOCK, ClockEncoder().encode(stamp_ns)
    yield topics.DIAGNOSTICS, diagnostics_message(stamp_ns)
    yield topics.REFERENCE, reference(stamp_ns)
    for name in STREAMS:
        yield name, stream_message(name, stamp_ns, 9.0)


def flight(first_tick, ticks):
    """Topic and message, tick by tick."""
    yield topics.REFERENCE, reference(START_NS)
    for tick in range(first_tick, first_tick + ticks):
        stamp_ns = START_NS + tick * TICK_NS
        for name in STREAMS:
            yield name, stream_message(name, stamp_ns, tick / 1e4)
        yield topics.CLOCK, ClockEncoder().encode(stamp_ns)


def record(folder, odd_ns=None, first_tick=0, names=NAMES, at=150, storage="mcap"):
    """A bag of a flight of 1 s, foreign messages in its middle or before it; what is missing."""
    recorder = BagRecorder(folder, names, "/heli", Format(storage), START_NS)
    for number, (name, raw) in enumerate(flight(first_tick, 100)):
        if odd_ns is not None and number == at:
            for other, message in foreign(odd_ns):
                if other in names:
                    recorder.write(other, message)
        if name in names:
            recorder.write(name, raw)
        if number % 100 == 0:
            recorder.flush()
    recorder.close()
    return recorder.missing()


def same_streams(first, second):
    assert first.streams.keys() == second.streams.keys()
    for name, stream in first.streams.items():
        np.testing.assert_array_equal(stream.stamp_ns, second.streams[name].stamp_ns)
        np.testing.assert_array_equal(stream.rows, second.streams[name].rows)


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def plain(request, tmp_path_factory):
    """Storage; what `bag_info` and `read_bag` say of a bag in it without a foreign message."""
    folder = tmp_path_factory.mktemp("bag") / "plain"
    assert record(folder, storage=request.param) == []
    return request.param, bag_info(folder), read_bag(folder)


@pytest.mark.parametrize("odd_ns", ODD_NS.values(), ids=ODD_NS)
@pytest.mark.parametrize("at", [0, 150], ids=["before", "within"])
def test_odd_stamps_change_neither_duration_nor_order_nor_readers(tmp_path, odd_ns, at, plain):
    storage, without, first = plain
    assert record(tmp_path / "odd", odd_ns, at=at, storage=storage) == []
    odd = bag_info(tmp_path / "odd")
    assert odd.start_s == without.start_s == 1.0
    assert odd.duration_s == pytest.approx(without.duration_s) == 0.99
    assert odd.messages == without.messages + 7
    stamps = [stamp_ns for _, _, stamp_ns, _ in bag_messages(tmp_path / "odd")]
    assert stamps == sorted(stamps)
    second = read_bag(tmp_path / "odd")
    same_streams(first, second)
    assert second.refused == dict.fromkeys(STREAMS, 1)
    assert "recorded at" in second.reasons[topics.IMU]
    remark, where_s = second.remarks[-1], 1.0 if at == 0 else 1.29
    assert remark.message == "here" and remark.stamp_ns / NS_PER_S == pytest.approx(
        where_s, abs=0.1
    )
    (tmp_path / "csv").mkdir()
    rows = write_csv(tmp_path / "odd", tmp_path / "csv")
    assert {count for name, count in rows.items() if "diag" not in name} == {101, 2}


def test_a_recorder_that_is_started_in_flight_has_the_flights_time(tmp_path):
    assert record(tmp_path / "bag", first_tick=60_000) == []
    info = bag_info(tmp_path / "bag")
    assert (info.start_s, round(info.duration_s, 6)) == (601.0, 0.99)


def test_without_clock_any_stream_tells_the_time(tmp_path):
    names = tuple(name for name in NAMES if name != topics.CLOCK)
    assert record(tmp_path / "bag", ODD_NS["2026"], 60_000, names) == []
    info = bag_info(tmp_path / "bag")
    assert (info.start_s, round(info.duration_s, 6)) == (601.0, 0.99)


def test_time_that_is_begun_anew_is_followed():
    """One message of another time is none of it; two of the clock in a row are."""
    clock = BagClock(START_NS, NAMES)
    assert clock.admits(topics.CLOCK, START_NS) and clock.known
    assert not clock.admits(topics.CLOCK, 900 * NS_PER_S)
    assert clock.admits(topics.CLOCK, START_NS + TICK_NS)
    assert not clock.admits(topics.ODOM, 900 * NS_PER_S)
    assert not clock.admits(topics.ODOM, 900 * NS_PER_S + TICK_NS)
    assert not clock.admits(topics.CLOCK, 900 * NS_PER_S)
    assert clock.admits(topics.CLOCK, 900 * NS_PER_S + TICK_NS)
    assert clock.now_ns == 900 * NS_PER_S + TICK_NS


def test_a_gap_is_still_a_gap(tmp_path):
    """A message with an odd stamp does not stand in for one that was lost."""
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/heli", start_ns=START_NS)
    for number, (name, raw) in enumerate(flight(0, 100)):
        lost = name == topics.ODOM and 200 < number < 206
        recorder.write(name, stream_message(name, ODD_NS["2026"]) if lost else raw)
    recorder.close()
    assert recorder.missing() == [topics.ODOM]
    assert recorder.odd_stamps == {topics.ODOM: 1}


def test_what_is_said_twice_fills_no_gap(tmp_path):
    """As by a node that was started again: its predecessor took one message with it."""
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/heli", start_ns=START_NS)
    for name, raw in flight(0, 100):
        stamp_ns = stamp_of(raw)
        if name == topics.ODOM and stamp_ns == START_NS + 50 * TICK_NS:
            continue
        for _ in range(1 + (name == topics.ODOM and stamp_ns == START_NS + 60 * TICK_NS)):
            recorder.write(name, raw)
    recorder.close()
    assert recorder.missing() == [topics.ODOM]


def test_messages_that_dds_repeats_after_long_are_where_they_belong(tmp_path):
    """A full queue: two topics come half a minute of the flight after the others."""
    names = (*NAMES, topics.GPS_VELOCITY)
    latency_ns = {topics.GPS_VELOCITY: 10 * TICK_NS}
    recorder = BagRecorder(
        tmp_path / "bag", names, "/heli", start_ns=START_NS, latency_ns=latency_ns
    )
    late = []
    for name, raw in flight(0, 3000):
        late += [(name, raw)] if name == topics.TRUTH_ODOM else []
        if name != topics.TRUTH_ODOM:
            recorder.write(name, raw)
    fixes_ns = START_NS + TICK_NS * np.arange(-10, 2990, 20)  # stamped with their validity
    late += [(topics.GPS_VELOCITY, stream_message(topics.GPS_VELOCITY, ns)) for ns in fixes_ns]
    for name, raw in late:
        recorder.write(name, raw)
    recorder.close()
    assert recorder.missing() == [] and recorder.odd_stamps == {}
    bag = read_bag(tmp_path / "bag")
    assert bag.refused == {} and bag.streams[topics.TRUTH_ODOM].stamp_ns.size == 3000
    assert bag.streams[topics.GPS_VELOCITY].stamp_ns.tolist() == fixes_ns.tolist()
    assert behind_ns(tmp_path / "bag", topics.GPS_VELOCITY) == {10 * TICK_NS}


def behind_ns(folder, topic):
    """By how much the bag has messages of a topic after their stamps, ns: the different ones.

    Without the nanoseconds that tell the order of a tick's messages.
    """
    with Reader(folder) as reader:
        return {
            (log_ns - stamp_of(raw)) // TICK_NS * TICK_NS
            for connection, log_ns, raw in reader.messages()
            if connection.topic.endswith(f"/{topic}")
        }


def test_a_status_that_is_heard_late_is_of_when_it_was_said(tmp_path):
    """On loaded cores it comes seconds of the flight late, others in time: the order is theirs."""
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/heli", start_ns=START_NS)
    said_ns = {"standing": START_NS, "takeoff": START_NS + NS_PER_S}
    for number, (name, raw) in enumerate(flight(0, 600)):
        recorder.write(name, raw)
        if number == 600:
            recorder.write(topics.DIAGNOSTICS, diagnostics_message(said_ns["takeoff"], "takeoff"))
        if number == 2200:
            recorder.write(topics.DIAGNOSTICS, diagnostics_message(said_ns["standing"], "standing"))
    recorder.close()
    assert behind_ns(tmp_path / "bag", "diagnostics") == {0}
    remarks = read_bag(tmp_path / "bag").remarks
    assert [(r.message, r.stamp_ns) for r in remarks] == list(said_ns.items())


def test_fixes_that_are_heard_before_the_time_wait_for_it(tmp_path):
    """After a pause of the recorder: the whole queue of one topic, then that of the next."""
    latency_ns = {topics.GPS_VELOCITY: 15 * TICK_NS}
    bag = BagRecorder(tmp_path / "bag", (topics.IMU, topics.GPS_VELOCITY), latency_ns=latency_ns)
    encoders = {name: Encoder(name) for name in bag.rows}

    def queue(name, first, last):
        for tick in range(first, last, topics.BY_NAME[name].every_ticks):
            row = np.zeros(CHANNELS[name].size)
            bag.write(name, encoders[name].encode(row, NS_PER_S + tick * TICK_NS))

    queue(topics.IMU, 0, 100)
    queue(topics.GPS_VELOCITY, 0, 6000)
    queue(topics.IMU, 100, 6000)
    # This one's time never comes.
    bag.write(topics.GPS_VELOCITY, encoders[topics.GPS_VELOCITY].encode(np.zeros(3), 90 * NS_PER_S))
    assert bag.odd_stamps == {} and bag.missing() == []
    bag.close()
    assert bag.odd_stamps == {topics.GPS_VELOCITY: 1}
    assert bag.counts[topics.GPS_VELOCITY] == 301
    odd_ns = NS_PER_S + 5999 * TICK_NS - 90 * NS_PER_S
    assert behind_ns(tmp_path / "bag", topics.GPS_VELOCITY) == {15 * TICK_NS, odd_ns}
