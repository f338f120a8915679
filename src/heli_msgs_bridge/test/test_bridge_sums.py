# SPDX-License-Identifier: Apache-2.0
"""Sums of messages beside DDS: the file, and what becomes of a disk that takes no more."""

import hashlib

import numpy as np

from heli_msgs_bridge.sums import SUM, ChecksumWriter, checksum, read_checksums


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
