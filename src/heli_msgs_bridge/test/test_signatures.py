# SPDX-License-Identifier: Apache-2.0
"""Who sent a message: signatures with a flight's key, and sums beside DDS."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

from heli_msgs_bridge import topics
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Decoder, Encoder
from heli_msgs_bridge.signatures import (
    KEY_BYTES,
    KEY_VARIABLE,
    SUM,
    ChecksumWriter,
    KeyFileError,
    Signature,
    checksum,
    flight_key,
    read_checksums,
    read_key,
    signature_of,
    unsigned,
)


def test_the_file_holds_a_sum_per_message_in_order(tmp_path):
    path, raws = tmp_path / "sums", [bytes([i]) * 700 for i in range(50)]
    writer = ChecksumWriter(path)
    for raw in raws:
        writer.add(raw)
    writer.close()
    writer.close()
    expected = [hashlib.blake2b(raw, digest_size=8).digest() for raw in raws]
    assert path.read_bytes() == b"".join(expected)
    np.testing.assert_array_equal(read_checksums(path), np.array(expected, "S8").view(SUM))


def test_one_bit_makes_another_sum():
    raw = bytearray(700)
    sums = {checksum(bytes(raw))}
    for bit in range(8 * 700):
        raw[bit // 8] ^= 1 << bit % 8
        sums.add(checksum(bytes(raw)))
    assert len(sums) == 1 + 8 * 700


def test_a_full_disk_ends_no_flight():
    writer = ChecksumWriter("/dev/full")
    for _ in range(5000):
        writer.add(b"message")
    writer.close()


def test_a_file_that_was_cut_off_holds_what_is_whole(tmp_path):
    path = tmp_path / "sums"
    path.write_bytes(checksum(b"a") + checksum(b"b")[:5])
    assert len(read_checksums(path)) == 1


KEY, TOPIC = bytes(range(KEY_BYTES)), "/odom"
RAW = b"\0\1\0\0" + bytes(range(200)) + b"\7" * 500


def test_a_message_is_signed_for_its_topic_with_a_key():
    signature = Signature(KEY, TOPIC)
    signed = signature.sign(RAW)
    assert signature.is_genuine(signed) and signature.sign(signed) == signed
    assert unsigned(signed) == RAW and not signature.is_genuine(RAW)
    assert not Signature(KEY, "/ground_truth/odom").is_genuine(signed)
    assert not Signature(KEY[::-1], TOPIC).is_genuine(signed)
    assert not any(map(signature.is_genuine, (b"", signed[:3], signed[:-1], signed + b"\0")))
    # What ends between two words of 4 bytes comes filled up.
    assert signature.is_genuine(signature.sign(RAW[:-3]) + bytes(3))
    assert not signature.is_genuine(signature.sign(RAW[:-3]) + b"\0\0\1")


def test_a_forger_needs_as_many_tries_as_the_signature_has_values():
    """Every bit of the content counts; of 20,000 guessed ones as many pass as chance says."""
    signature, passed = Signature(KEY, TOPIC), 0
    for n in range(20_000):
        passed += signature.is_genuine(RAW[:2] + b"\x10\x20" + RAW[4:] + n.to_bytes(4, "little"))
    assert passed <= 8  # 1.2 on average; more than 8 of 20,000: 1e-5
    tags = {signature.sign(RAW + n.to_bytes(4, "little"))[2:4] for n in range(20_000)}
    assert len(tags) == pytest.approx(2**14 * (1.0 - np.exp(-20_000 / 2**14)), rel=0.03)
    assert all(tag[1] & 0b11 == 0 for tag in tags)


def test_a_readers_message_is_the_same():
    message = Odometry()
    message.header.frame_id, message.pose.pose.position.x = "odom", 3.5
    raw = serialize_message(message)
    assert deserialize_message(Signature(KEY, TOPIC).sign(raw), Odometry) == message
    store = get_typestore(Stores.ROS2_JAZZY)
    read = store.deserialize_cdr(Signature(KEY, TOPIC).sign(raw), "nav_msgs/msg/Odometry")
    assert read.pose.pose.position.x == 3.5


def test_a_key_is_this_users_alone_and_gone_with_the_flight(tmp_path):
    path = tmp_path / "key"
    with flight_key(path):
        assert path.stat().st_mode & 0o777 == 0o600 and len(read_key(path)) == KEY_BYTES
        with pytest.raises(KeyFileError), flight_key(path):
            raise AssertionError
    assert not path.exists()


def test_where_files_have_no_rights_nobody_signs(tmp_path, monkeypatch):
    """As on FAT, or on another system's disk: whatever mode is asked for, all can read it."""
    opened = os.open
    monkeypatch.setattr(os, "open", lambda path, flags, mode: opened(path, flags, 0o644))
    with flight_key(tmp_path / "key") as key:
        assert key is None
    assert not (tmp_path / "key").exists()


@pytest.mark.parametrize("topic", CHANNELS)
def test_what_is_signed_is_read_as_fast(topic):
    """From its bytes: through the objects of rclpy a flight would take twice as long."""

    def deserialize(raw):
        raise AssertionError(topic)

    origin = datum(28.17, 112.93, 50.0) if topic == topics.GPS_FIX else None
    encoder, decoder = Encoder(topic, datum=origin), Decoder(topic, origin, deserialize)
    values = np.linspace(0.1, 0.2, CHANNELS[topic].size)
    if topic in (topics.ODOM, topics.TRUTH_ODOM):
        values[6:10] = 0.5  # a unit quaternion
    raw = encoder.encode(values, 10_000_000)
    plain = decoder.decode(raw).copy()
    signed = Signature(KEY, topic).sign(raw)
    assert signed != raw
    np.testing.assert_array_equal(decoder.decode(signed), plain)
    assert encoder.encode(values, 10_000_000) == raw


def _of_others(path):
    path.write_bytes(KEY)
    path.chmod(0o640)


def _short(path):
    path.touch(0o600)


def _link(path):
    path.with_name("real").write_bytes(KEY)
    path.with_name("real").chmod(0o600)
    path.symlink_to("real")


@pytest.mark.parametrize("make", [_of_others, _short, _link, os.mkfifo, Path.mkdir, Path.exists])
def test_what_is_no_key_is_refused(tmp_path, monkeypatch, make):
    path = tmp_path / "key"
    make(path)
    monkeypatch.setenv(KEY_VARIABLE, str(path))
    with pytest.raises(KeyFileError):
        signature_of(TOPIC)


def test_without_a_key_nobody_signs(monkeypatch):
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    assert signature_of(TOPIC) is None
