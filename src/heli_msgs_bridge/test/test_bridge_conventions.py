# SPDX-License-Identifier: Apache-2.0
"""What foreign tools assume of messages: frames (REP-105), variances, the status of a fix."""

import math

import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import FixedMessage
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS, FIX_STATUS
from heli_msgs_bridge.messages import Decoder, Encoder, rclpy_deserializer

ORIGIN = datum(28.17, 112.93, 50.0)


def row_of(topic):
    row = np.zeros(CHANNELS[topic].size)
    if topic in (topics.ODOM, topics.TRUTH_ODOM):
        row[6] = 1.0
    return row


def sent(topic, row=None, **options):
    place = ORIGIN if topic == topics.GPS_FIX else None
    raw = Encoder(topic, datum=place, **options).encode(row_of(topic) if row is None else row, 5)
    return deserialize_message(raw, topics.message_class(topics.BY_NAME[topic].type))


def frames(message):
    child = getattr(message, "child_frame_id", "")
    return (message.header.frame_id, child) if child else (message.header.frame_id,)


def test_what_a_gps_corrects_is_given_in_map():
    """REP-105: odom is continuous; an estimate that jumps with the GPS belongs in map."""
    for topic in (topics.ODOM, topics.TRUTH_ODOM):
        assert frames(sent(topic)) == ("map", "base_link")
    assert frames(sent(topics.ATTITUDE_SETPOINT)) == ("map",)


@pytest.mark.parametrize("topic", CHANNELS)
def test_an_aircrafts_frames_carry_its_namespace(topic):
    """All but map, which the aircraft of one world share; no namespace leaves them as they are."""
    for namespace in ("heli2", "/heli2", "/fleet/heli2"):
        for plain, owned in zip(
            frames(sent(topic)), frames(sent(topic, namespace=namespace)), strict=True
        ):
            assert "/" not in plain
            assert owned == ("map" if plain == "map" else f"{namespace.strip('/')}/{plain}")
    assert frames(sent(topic, namespace="/")) == frames(sent(topic))


def test_the_reference_names_the_aircraft_that_follows_it():
    way = Trajectory.hover(np.zeros(3), 0.0)
    assert encode_reference(way).joint_names == ["base_link"]
    assert encode_reference(way, "/heli2").joint_names == ["heli2/base_link"]
    assert encode_reference(way, "/heli2").header.frame_id == "map"


@pytest.mark.parametrize("topic", CHANNELS)
@pytest.mark.parametrize("others", [("heli2/here", "heli2/there"), ("odom", "tail")])
def test_a_sender_with_other_frames_is_read_fast_from_its_second_message_on(topic, others):
    """An aircraft in a namespace, and bags of the versions that said odom where map is meant."""
    place, channel = ORIGIN if topic == topics.GPS_FIX else None, CHANNELS[topic]
    usual = FixedMessage(channel.layout())
    assert usual.decode(Encoder(topic, datum=place).encode(row_of(topic), 5))
    other = FixedMessage(channel.layout_in(others[: len(channel.frames)]))
    other.block[:] = usual.block
    slow, deserialize = [], rclpy_deserializer(topic)
    decoder = Decoder(topic, place, lambda raw: slow.append(raw) or deserialize(raw))
    for stamp_ns in range(5):
        assert decoder.decode(other.encode(stamp_ns)) == pytest.approx(row_of(topic), abs=1e-6)
        assert (decoder.stamp_ns, len(slow)) == (stamp_ns, 1)


# --- variances ---------------------------------------------------------------------------------


def diagonals(message):
    """Every covariance of a message: name -> its diagonal."""
    by_name = {}

    def look(part, path):
        for name in part.get_fields_and_field_types():
            value = getattr(part, name)
            if name.endswith("covariance"):
                size = math.isqrt(len(value))
                by_name[f"{path}{name}"] = np.array(value).reshape(size, size).diagonal()
            elif name == "variance":
                by_name[f"{path}{name}"] = np.array([value])
            elif hasattr(value, "get_fields_and_field_types"):
                look(value, f"{path}{name}.")

    look(message, "")
    return by_name


@pytest.mark.parametrize("topic", CHANNELS)
def test_no_variance_is_zero(topic):
    """Zero is read as "unknown" by some and as "exact" by others."""
    row = row_of(topic)
    if topic == topics.ODOM:
        row[22:31] = 0.1
    for name, diagonal in diagonals(sent(topic, row)).items():
        if name == "orientation_covariance":
            assert diagonal[0] == -1.0, "sensor_msgs/Imu: there is no such estimate"
        else:
            assert (diagonal > 0.0).all(), name


def test_what_is_not_measured_has_a_variance_that_nobody_believes():
    assert (diagonals(sent(topics.GPS_VELOCITY))["twist.covariance"] >= 1e6).all()
    covariances = diagonals(sent(topics.GPS_VELOCITY, variances=(0.01,)))["twist.covariance"]
    assert covariances[:3].tolist() == [0.01] * 3 and (covariances[3:] >= 1e6).all()
    rate = diagonals(sent(topics.ODOM, variances=(4e-6,)))["twist.covariance"][3:]
    assert rate.tolist() == [4e-6] * 3


def test_a_perfect_sensor_is_not_one_of_unknown_quality():
    covariances = diagonals(sent(topics.IMU, variances=(0.0, 0.0)))
    for name in ("angular_velocity_covariance", "linear_acceleration_covariance"):
        assert (covariances[name] > 0.0).all() and (covariances[name] < 1e-12).all()


def test_up_has_a_variance_of_its_own():
    covariances = diagonals(sent(topics.GPS_FIX, variances=((1.0, 1.0, 2.25),)))
    assert covariances["position_covariance"].tolist() == [1.0, 1.0, 2.25]


# --- the receiver ------------------------------------------------------------------------------


def test_the_status_says_what_corrects_the_fixes():
    status = sent(topics.GPS_FIX).status
    wanted = {
        "none": status.STATUS_FIX,
        "satellite": status.STATUS_SBAS_FIX,
        "ground": status.STATUS_GBAS_FIX,
    }
    assert wanted == FIX_STATUS
    for code in FIX_STATUS.values():
        message = sent(topics.GPS_FIX, fix_status=code)
        assert message.status.status == code
        assert message.position_covariance_type == message.COVARIANCE_TYPE_DIAGONAL_KNOWN


def test_without_a_fix_its_errors_are_not_known_either():
    encoder, lost = Encoder(topics.GPS_FIX, (0.25,), ORIGIN, fix_status=2), np.full(3, math.nan)
    kind = topics.message_class(topics.BY_NAME[topics.GPS_FIX].type)
    messages = [
        deserialize_message(encoder.encode(row, 5), kind) for row in (lost, np.zeros(3), lost)
    ]
    assert [m.status.status for m in messages] == [-1, 2, -1]
    assert [m.position_covariance_type for m in messages] == [0, 2, 0]
