# SPDX-License-Identifier: Apache-2.0
"""`heli bag repair`: bags cut off anywhere give back exactly their complete messages."""

import shutil
import sqlite3

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    Reader,
    StoragePlugin,
    Writer,
)
from rosbags.typesys import Stores, get_typestore

from heli_bags.opening import TroubleKind, trouble, trouble_of
from heli_bags.reader import read_bag
from heli_bags.repair import repair
from heli_bags.tools import bag_info
from heli_bags.writer import METADATA, BagCause, BagError, BagRecorder, Format
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder

NAMES = (topics.IMU, topics.ACTUATORS)
FORMS = {"mcap": Format(), "zstd": Format(zstd=True), "sqlite3": Format("sqlite3")}
TICKS = 400
ADVICE = "'heli bag repair {}' restores what can be"


def stream():
    encoders = {name: Encoder(name) for name in NAMES}
    numbers = np.random.default_rng(5)
    for tick in range(TICKS):
        stamp_ns = 1_000_000_000 + tick * TICK_NS
        for name in NAMES:
            row = numbers.normal(size=CHANNELS[name].size)
            yield name, stamp_ns, encoders[name].encode(row, stamp_ns)


# Messages of a tick follow one another by a nanosecond in a bag.
SENT = [(f"/{name}", stamp_ns + NAMES.index(name), raw) for name, stamp_ns, raw in stream()]


def record(folder, form, close=True, flush_every=60):
    """A bag of SENT; one that is not closed is what a `kill -9` leaves."""
    recorder = BagRecorder(folder, NAMES, form=form)
    for number, (name, _, raw) in enumerate(stream()):
        recorder.write(name, raw)
        if number % flush_every == flush_every - 1:
            recorder.flush()
    if close:
        recorder.close()
    return recorder


def content(folder):
    with Reader(folder) as reader:
        return [(c.topic, stamp_ns, bytes(raw)) for c, stamp_ns, raw in reader.messages()]


def data_file(bag):
    (path,) = [p for p in bag.iterdir() if p.suffix in (".mcap", ".db3")]
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """One closed bag of each form."""
    folder = tmp_path_factory.mktemp("whole")
    for name, form in FORMS.items():
        record(folder / name, form)
    return folder


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("cut")


def cut(whole, scratch, form, size):
    """A copy of a bag without metadata, its file cut to a size; the bag and its repair's folder."""
    bag, new = scratch / "bag", scratch / "new"
    for folder in (bag, new):
        shutil.rmtree(folder, ignore_errors=True)
    bag.mkdir()
    file = data_file(whole / form)
    (bag / f"bag_0{file.suffix}").write_bytes(file.read_bytes()[:size])
    return bag, new


@pytest.mark.parametrize("form", ["mcap", "zstd"])
@settings(
    max_examples=40, deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
@given(part=st.floats(0.0, 1.0))
def test_cut_anywhere(whole, scratch, form, part):
    """What is left is a beginning of what was sent, and no complete message is missing."""
    file = data_file(whole / form)
    size = round(part * file.stat().st_size)
    bag, new = cut(whole, scratch, form, size)
    before = data_file(bag).read_bytes()
    try:
        result = repair(bag, new)
    except BagError as error:
        assert str(bag) in str(error) and not new.exists()
        assert size < 20_000
        return
    assert result is not None and result.folder == str(new)
    kept = content(new)
    assert result.messages == len(kept)
    assert kept == sorted(SENT[: len(kept)], key=lambda row: row[1])
    assert data_file(bag).read_bytes() == before
    if form == "mcap":
        # The file's own bytes are the second opinion: every whole message in it is there.
        assert len(kept) == sum(raw in before for _, _, raw in SENT)
    with open(file, "rb") as opened:
        chunks = make_reader(opened).get_summary().chunk_indexes
    inside = [c for c in chunks if c.chunk_start_offset + c.chunk_length <= size]
    last_ns = max((c.message_end_time for c in inside), default=0)
    assert len(kept) >= sum(stamp_ns < last_ns for _, stamp_ns, _ in SENT)


@pytest.mark.parametrize("part", [0.05, 0.3, 0.5, 0.77, 0.9, 0.999])
def test_cut_database(whole, scratch, part):
    """Pages behind the cut are lost; every message in front of it is restored."""
    file = data_file(whole / "sqlite3")
    bag, new = cut(whole, scratch, "sqlite3", round(part * file.stat().st_size))
    try:
        result = repair(bag, new)
    except BagError as error:
        assert error.cause == BagCause.NOTHING_LEFT and part < 0.1
        return
    kept = content(new)
    assert result.messages == len(kept) and set(kept) <= set(SENT)
    assert len(kept) > (part - 0.3) * len(SENT)


@pytest.mark.parametrize("form", FORMS)
def test_recorder_that_never_closed(tmp_path, form):
    """Everything up to the last flush is there, and every tool says what to do."""
    alive = record(tmp_path / "bag", FORMS[form], close=False)
    shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    alive.close()
    bag = tmp_path / "killed"
    with pytest.raises(BagError) as caught:
        read_bag(bag)
    assert caught.value.cause == BagCause.NOT_WHOLE
    assert str(caught.value).endswith(ADVICE.format(bag))
    result = repair(bag)
    assert result.folder == f"{bag}_repaired"
    flushed = len(SENT) // 60 * 60
    assert content(bag.with_name("killed_repaired")) == SENT[:flushed]
    assert trouble(bag.with_name("killed_repaired")) == ""


@pytest.mark.parametrize("form", FORMS)
def test_missing_metadata_is_written_anew(whole, tmp_path, form):
    shutil.copytree(whole / form, tmp_path / form)
    (tmp_path / form / "metadata.yaml").unlink()
    wrong = trouble_of(tmp_path / form)
    assert (wrong.kind, wrong.names) == (TroubleKind.MISSING, (METADATA,))
    result = repair(tmp_path / form, in_place=True)
    assert result.trouble == wrong.sentence and result.lost_bytes == 0
    assert content(tmp_path / form) == SENT
    assert content(data_file(tmp_path / f"{form}_damaged")) == SENT
    restored, original = bag_info(tmp_path / form), bag_info(whole / form)
    assert restored.topics == original.topics
    assert restored.duration_s == original.duration_s == pytest.approx((TICKS - 1) / 100)


def test_split_bag_whose_last_file_is_cut_off(tmp_path):
    """The finished files open as they are; the repair brings the last one in, as it was split."""
    form = Format(split_ns=1_000_000_000)
    alive = record(tmp_path / "bag", form, close=False, flush_every=10)
    shutil.copytree(tmp_path / "bag", tmp_path / "killed")
    alive.close()
    assert len(content(tmp_path / "killed")) == 600
    wrong = trouble_of(tmp_path / "killed")
    assert (wrong.kind, wrong.names) == (TroubleKind.CUT_OFF, ("bag_3.mcap",))
    repair(tmp_path / "killed", tmp_path / "new")
    assert content(tmp_path / "new") == SENT
    assert len(list((tmp_path / "new").glob("*.mcap"))) == 4


def test_bag_of_another_recorder(tmp_path):
    """Definitions but no hashes in its channels, all in one chunk: hashes are computed."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = topics.BY_NAME[topics.IMU].type
        connection = writer.add_connection("/imu", kind, typestore=store)
        for _, stamp_ns, raw in SENT[::2]:
            writer.write(connection, stamp_ns, raw)
    file = data_file(tmp_path / "bag")
    file.write_bytes(file.read_bytes()[:50_000])
    result = repair(tmp_path / "bag", tmp_path / "new")
    assert 100 < result.messages < 200
    (row,) = bag_info(tmp_path / "new").topics
    assert row.hash == store.hash_rihs01(kind)


@pytest.mark.parametrize("form", ["mcap", "zstd"])
def test_damaged_chunk_is_left_out(whole, tmp_path, form):
    """Found by the check sum where only numbers are damaged, which any bytes are."""
    shutil.copytree(whole / form, tmp_path / "bag")
    file = data_file(tmp_path / "bag")
    with open(file, "rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    chunk = chunks[len(chunks) // 2]
    raw = bytearray(file.read_bytes())
    middle = chunk.chunk_start_offset + chunk.chunk_length // 2
    raw[middle : middle + 200] = bytes(200)
    file.write_bytes(raw)
    result = repair(tmp_path / "bag")
    assert result.damaged_chunks == 1
    assert len(SENT) - 60 <= result.messages < len(SENT)


def test_messages_that_were_compressed_one_by_one(tmp_path):
    """As `ros2 bag record --compression-mode message` does; one that is damaged is left out."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(tmp_path / "bag", version=9)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/imu", topics.BY_NAME[topics.IMU].type, typestore=store)
        for _, stamp_ns, raw in SENT[::2]:
            writer.write(connection, stamp_ns, raw)
    with sqlite3.connect(data_file(tmp_path / "bag")) as database:
        (raw,) = database.execute("SELECT data FROM messages WHERE id = 7").fetchone()
        damaged = raw[:20] + bytes(len(raw) - 20)
        database.execute("UPDATE messages SET data = ? WHERE id = 7", (damaged,))
    result = repair(tmp_path / "bag", tmp_path / "new")
    assert (result.damaged_chunks, result.messages) == (1, TICKS - 1)
    whole = [raw for _, _, raw in SENT[::2]]
    assert [raw for _, _, raw in content(tmp_path / "new")] == whole[:6] + whole[7:]


def test_whole_bag_is_left_alone(whole, tmp_path):
    for form in FORMS:
        assert repair(whole / form, tmp_path / "new") is None
    assert not (tmp_path / "new").exists()


def test_refusals_are_one_sentence(whole, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "a.mcap").write_text("no bag at all, only words")
    (tmp_path / "note.txt").write_text("no bag")
    for bag, cause in (
        ("nowhere", BagCause.MISSING),
        ("empty", BagCause.NO_BAG),
        ("text", BagCause.NO_BAG),
        ("note.txt", BagCause.NO_BAG),
    ):
        with pytest.raises(BagError) as error:
            repair(tmp_path / bag)
        assert error.value.cause == cause
        assert str(tmp_path / bag) in str(error.value) and "\n" not in str(error.value)
    shutil.copytree(whole / "mcap", tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="exists already") as error:
        repair(tmp_path / "bag", tmp_path / "text")
    assert error.value.cause == BagCause.EXISTS
    with pytest.raises(BagError, match="not both") as error:
        repair(tmp_path / "bag", tmp_path / "new", in_place=True)
    assert error.value.cause == BagCause.OPTION
