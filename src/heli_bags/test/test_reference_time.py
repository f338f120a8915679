# SPDX-License-Identifier: Apache-2.0
"""A reference counts from when the outer loop followed it, whenever the recorder heard of it."""

import numpy as np
from rclpy.serialization import serialize_message

from heli_bags.reader import read_bag
from heli_bags.writer import BagRecorder, Format
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import MAX_POINTS, Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference, key_of
from heli_msgs_bridge.diagnostics import FACT_WAYS
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder

START_NS, LATE_TICK = NS_PER_S, 250
NAMES = (topics.ACTUATORS, topics.REFERENCE, topics.DIAGNOSTICS)


def hover(north_m):
    return encode_reference(Trajectory.hover(np.array([north_m, 0.0, -10.0]), 0.0))


def diagnostics_message(trajectories, stamp_ns):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    facts = [KeyValue(key=FACT_WAYS, value=str(trajectories))]
    message = DiagnosticArray(status=[DiagnosticStatus(name="heli/outer_loop", values=facts)])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    return serialize_message(message)


def recorded(folder, late, statuses):
    """References that are recorded 2.5 s after the flight began, and what is told at its end."""
    recorder = BagRecorder(folder, NAMES, "/heli", Format("mcap"), START_NS)
    actuators = Encoder(topics.ACTUATORS)
    for tick in range(400):
        stamp_ns = START_NS + tick * TICK_NS
        recorder.write(
            topics.ACTUATORS, actuators.encode(np.zeros(CHANNELS[topics.ACTUATORS].size), stamp_ns)
        )
        if tick == LATE_TICK:
            for message in late:
                recorder.write(topics.REFERENCE, serialize_message(message))
    for trajectories in statuses:
        recorder.write(topics.DIAGNOSTICS, diagnostics_message(trajectories, stamp_ns))
    recorder.close()
    return [
        (round(since_ns / NS_PER_S, 2), way.points[0, 0].item())
        for since_ns, way in read_bag(folder).references
    ]


def trajectories(*pairs):
    return [[round(since_s * NS_PER_S), key_of(hover(north_m))] for since_s, north_m in pairs]


def test_what_is_told_counts_and_else_when_it_was_recorded(tmp_path):
    late = [hover(1.0), hover(2.0), hover(3.0)]
    dated = recorded(
        tmp_path / "b", late, [trajectories((1.2, 1.0), (1.7, 2.0)), trajectories((1.7, 2.0))]
    )
    assert dated == [(1.2, 1.0), (1.7, 2.0), (3.5, 3.0)]


def test_the_same_way_flown_again_counts_again(tmp_path):
    late = [hover(1.0), hover(2.0), hover(1.0)]
    dated = recorded(tmp_path / "b", late, [trajectories((1.2, 1.0), (1.7, 2.0), (2.4, 1.0))])
    assert dated == [(1.2, 1.0), (1.7, 2.0), (2.4, 1.0)]


def test_what_cannot_be_read_is_as_if_it_were_not_told(tmp_path):
    for number, status in enumerate(["[[1", "[1, 2]", "[[1, 2, 3]]", "{}", [["a", "b"]]]):
        assert recorded(tmp_path / str(number), [hover(1.0)], [status]) == [(3.5, 1.0)]


def test_ways_that_differ_in_one_place_have_another_key():
    keys = {key_of(hover(north_m)) for north_m in (0.0, 1.0, -1.0, 1e-9)}
    assert len(keys) == 4 and key_of(hover(1.0)) in keys


def test_of_a_message_that_is_too_long_to_be_decoded_no_more_is_read_for_its_key():
    message = hover(1.0)
    message.points = message.points * MAX_POINTS
    as_long = key_of(message)
    message.points = message.points + hover(2.0).points * 10
    message.points[0].transforms = message.points[0].transforms * 3
    assert key_of(message) == as_long


def test_what_is_said_counts_when_it_was_so_however_early_it_was_heard(tmp_path):
    """Before the messages that tell a lagging recorder the time, seconds of flight time."""
    recorder = BagRecorder(tmp_path / "b", NAMES, "/heli", Format("mcap"), START_NS)
    row = np.zeros(CHANNELS[topics.ACTUATORS].size)
    for tick in range(1000):
        stamp_ns = START_NS + tick * TICK_NS
        recorder.write(topics.ACTUATORS, Encoder(topics.ACTUATORS).encode(row, stamp_ns))
        if tick == LATE_TICK:
            for said_s in (2.0, 9.0, 10.0):
                recorder.write(
                    topics.DIAGNOSTICS, diagnostics_message([], round(said_s * NS_PER_S))
                )
            recorder.write(topics.DIAGNOSTICS, diagnostics_message([], 3600 * NS_PER_S))
    recorder.close()
    dated = [remark.stamp_ns / NS_PER_S for remark in read_bag(tmp_path / "b").remarks]
    assert dated == [2.0, 3.5, 9.0, 10.0]
