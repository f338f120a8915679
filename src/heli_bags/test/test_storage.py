# SPDX-License-Identifier: Apache-2.0
"""Bags within the budget: compression of every kind is read, what is above it is refused."""

import shutil

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard

from heli_bags.opening import trouble_of
from heli_bags.reader import read_bag
from heli_bags.repair import repair
from heli_bags.storage import chunk_content, expand_file, expanded
from heli_bags.tools import bag_info, bag_messages, write_csv
from heli_bags.writer import BagCause, BagError, BagRecorder, Format
from heli_core.foreign_files import BUDGET_VARIABLE, FileCause, FileError
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder
from support import bombs
from support.fuzz_messages import good_row

NAMES, TICKS = (topics.BARO, topics.ACTUATORS), 40
FORMS = {"mcap": Format(), "sqlite3": Format("sqlite3")}


@pytest.fixture(params=FORMS)
def whole(request, tmp_path):
    """A bag of a kind of storage."""
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/", FORMS[request.param], NS_PER_S)
    encoders = {name: Encoder(name) for name in NAMES}
    for tick in range(TICKS):
        for name in NAMES:
            row = good_row(name)
            recorder.write(name, encoders[name].encode(row, NS_PER_S + tick * TICK_NS))
    recorder.close()
    return tmp_path / "bag"


def compressed(whole, folder, mode):
    """The same as `ros2 bag record --compression-mode MODE --compression-format zstd` leaves it."""
    shutil.copytree(whole, folder)
    text = (folder / "metadata.yaml").read_text(encoding="utf-8")
    about = yaml.safe_load(text)["rosbag2_bagfile_information"]
    for name in about["relative_file_paths"]:
        path = folder / name
        (folder / f"{name}.zstd").write_bytes(zstandard.compress(path.read_bytes()))
        path.unlink()
    about["relative_file_paths"] = [f"{name}.zstd" for name in about["relative_file_paths"]]
    about |= {"compression_mode": mode, "compression_format": "zstd"}
    text = yaml.safe_dump({"rosbag2_bagfile_information": about})
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    return folder


@pytest.mark.parametrize("mode", ["FILE", "file"])
def test_a_bag_that_is_compressed_file_by_file_says_the_same(whole, tmp_path, mode):
    packed = compressed(whole, tmp_path / "packed", mode)
    assert trouble_of(packed) is None and repair(packed) is None
    plain, info = bag_info(whole), bag_info(packed)
    assert (info.storage, info.messages, info.topics) == (
        plain.storage,
        plain.messages,
        plain.topics,
    )
    assert info.files == [f"{name}.zstd" for name in plain.files]
    one, other = read_bag(whole), read_bag(packed)
    assert one.streams.keys() == other.streams.keys() == set(NAMES)
    for name in NAMES:
        np.testing.assert_array_equal(one.streams[name].rows, other.streams[name].rows)
    told = [
        [(name, stamp) for name, _, stamp, _ in bag_messages(bag)] for bag in (whole, packed)
    ]  # fmt: skip
    assert told[0] == told[1] and len(told[0]) == plain.messages
    (tmp_path / "out").mkdir()
    assert sum(write_csv(packed, tmp_path / "out").values()) == plain.messages


def test_a_compressed_file_alone_is_a_bag(whole, tmp_path):
    (file,) = compressed(whole, tmp_path / "packed", "FILE").glob("*.zstd")
    assert bag_info(file).messages == bag_info(whole).messages


def test_a_compressed_bag_without_its_list_is_repaired(whole, tmp_path):
    packed = compressed(whole, tmp_path / "packed", "FILE")
    (packed / "metadata.yaml").unlink()
    done = repair(packed)
    assert done is not None and done.messages == bag_info(whole).messages
    assert bag_info(tmp_path / "packed_repaired").messages == done.messages


@pytest.mark.parametrize("whole", ["mcap"], indirect=True)
def test_of_a_compressed_bag_that_is_cut_off_the_beginning_is_repaired(whole, tmp_path):
    packed = compressed(whole, tmp_path / "packed", "FILE")
    (file,) = packed.glob("*.zstd")
    content = zstandard.ZstdDecompressor().decompress(file.read_bytes())
    half = len(content) // 2
    frames = [zstandard.compress(part) for part in (content[:half], content[half:])]
    file.write_bytes(frames[0] + frames[1][:-20])
    with pytest.raises(BagError) as caught:
        bag_info(packed)
    assert caught.value.cause == BagCause.DAMAGED
    done = repair(packed)
    assert done is not None and 0 < done.messages < bag_info(whole).messages


def test_another_compression_of_files_is_refused(whole, tmp_path):
    packed = compressed(whole, tmp_path / "packed", "FILE")
    metadata = packed / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("format: zstd", "format: lz5"))
    with pytest.raises(BagError) as caught:
        bag_info(packed)
    assert caught.value.cause == BagCause.DAMAGED


@pytest.mark.parametrize(
    ("kind", "press"),
    [("", bytes), ("zstd", zstandard.compress), ("lz4", lz4.frame.compress)],
)
def test_a_chunk_is_expanded_up_to_the_budget(kind, press, monkeypatch):
    monkeypatch.setenv(BUDGET_VARIABLE, "1")
    content = bombs.message(bytes(range(256)) * 2000)
    assert chunk_content(press(content), kind, len(content)) == content
    for size in (len(content) - 1, len(content) + 1):
        with pytest.raises(FileError) as caught:
            chunk_content(press(content), kind, size)
        assert caught.value.cause == FileCause.SYNTAX
    large = content * 3
    with pytest.raises(FileError) as caught:
        chunk_content(press(large), kind, len(large))
    assert caught.value.cause == FileCause.TOO_LARGE
    monkeypatch.setenv(BUDGET_VARIABLE, "2")
    assert chunk_content(press(large), kind, len(large)) == large


def test_a_chunk_that_is_damaged_is_told_by_its_sum():
    content = bombs.message(b"abc")
    with pytest.raises(FileError):
        chunk_content(content, "", len(content), crc=1)
    with pytest.raises(FileError):
        chunk_content(content, "brotli", len(content))


def test_a_file_may_become_sixteen_times_its_size_or_the_budget(tmp_path, monkeypatch):
    monkeypatch.setenv(BUDGET_VARIABLE, "1")
    packed, plain = tmp_path / "x.mcap.zstd", tmp_path / "x.mcap"
    noise = np.random.default_rng(1).bytes(1 << 18)
    packed.write_bytes(zstandard.compress(noise) + bombs.zstd_zeros(2 << 20))
    assert expand_file(packed, plain)
    assert plain.read_bytes() == noise + bytes(2 << 20)
    packed.write_bytes(bombs.zstd_zeros(2 << 20))
    with pytest.raises(FileError) as caught:
        expand_file(packed, plain)
    assert caught.value.cause == FileCause.TOO_LARGE


def test_a_message_is_expanded_as_far_as_it_goes():
    data = zstandard.compress(bytes(range(256)) * 5000)
    assert expanded(data) == bytes(range(256)) * 5000
    with pytest.raises(FileError):
        expanded(bombs.zstd_zeros(1 << 30))


def test_messages_of_one_time_are_not_held_above_the_budget(tmp_path):
    bag = tmp_path / "x.mcap"
    one = bombs.Chunk(bombs.zstd_zeros(40 << 20), 40 << 20, "zstd", 1, 100)
    bag.write_bytes(bombs.mcap(one, one))
    with pytest.raises(BagError) as caught:
        bag_info(bag)
    assert caught.value.cause == BagCause.TOO_LARGE
