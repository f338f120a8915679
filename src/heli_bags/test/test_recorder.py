# SPDX-License-Identifier: Apache-2.0
"""Bags of the recorder: independent readers, definitions and hashes, splitting, a full disk."""

import errno
import json
import re
import sqlite3
import subprocess
import sys
import tracemalloc
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.storage_mcap import McapWriter

from heli_bags import storage_files
from heli_bags.node import RecorderNode
from heli_bags.repair import repair
from heli_bags.storage_files import ChunkIndex, McapFile
from heli_bags.writer import BagCause, BagError, BagRecorder, Format
from heli_core.command_line import share_folder
from heli_core.ticks import TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder, encode_header

NAMES = (topics.IMU, topics.ODOM, topics.ACTUATORS)
TICKS = 300
FORMS = {
    "mcap": Format(),
    "zstd": Format(zstd=True),
    "sqlite3": Format("sqlite3"),
    "split by size": Format(split_bytes=100_000),
    "split by time": Format("sqlite3", split_ns=1_000_000_000),
}


def stream(ticks=TICKS, names=NAMES):
    """Tick by tick: topic, stamp (ns), message with the tick in its first number."""
    encoders = {name: Encoder(name) for name in names}
    for tick in range(ticks):
        stamp_ns = 1_000_000_000 + tick * TICK_NS
        for name in names:
            row = np.zeros(CHANNELS[name].size)
            row[0] = tick
            if name == topics.ODOM:
                row[6] = 1.0
            yield name, stamp_ns, encoders[name].encode(row, stamp_ns)


@pytest.mark.parametrize("first", [topics.GPS_FIX, topics.IMU])
def test_a_sensor_that_is_late_has_gaps_only_where_messages_lack(tmp_path, first):
    """Sent in tick n, valid 12 ticks before; it may be heard before the others of its tick."""
    order, late_ticks = (first, *({topics.GPS_FIX, topics.IMU} - {first})), 12
    origin = datum(28.17, 112.93, 50.0)
    encoders = {n: Encoder(n, datum=origin if n == topics.GPS_FIX else None) for n in order}
    every = topics.BY_NAME[topics.GPS_FIX].every_ticks

    def missing(folder, lost):
        latency_ns = {topics.GPS_FIX: late_ticks * TICK_NS}
        bag = BagRecorder(folder, order, latency_ns=latency_ns)
        for tick in range(TICKS):
            for name in order:
                if name == topics.GPS_FIX and (tick % every or tick in lost):
                    continue
                valid = tick - late_ticks * (name == topics.GPS_FIX)
                row = np.zeros(CHANNELS[name].size)
                bag.write(name, encoders[name].encode(row, 1_000_000_000 + valid * TICK_NS))
        incomplete = bag.missing()
        bag.close()
        return incomplete

    assert missing(tmp_path / "whole", ()) == []
    assert missing(tmp_path / "middle", (140,)) == [topics.GPS_FIX]
    assert missing(tmp_path / "end", (260, 280)) == [topics.GPS_FIX]


@pytest.mark.parametrize(("told", "gaps"), [(True, []), (False, [topics.ODOM])])
def test_ticks_without_an_estimate_are_no_gap(tmp_path, told, gaps):
    """At the beginning, in the midst, at the end: another message says that there is none."""
    names, absent = (topics.IMU, topics.ODOM, topics.NO_ESTIMATE), {*range(20), 100, 101, 299}
    bag = BagRecorder(tmp_path / "bag", names)
    for name, stamp_ns, raw in stream(names=(topics.IMU, topics.ODOM)):
        lost = (stamp_ns - 1_000_000_000) // TICK_NS in absent
        if name == topics.IMU or not lost:
            bag.write(name, raw)
        elif told:
            bag.write(topics.NO_ESTIMATE, encode_header(stamp_ns, topics.MAP))
    assert bag.missing() == gaps
    bag.close()


def record(folder, form, ticks=TICKS, flush_every=50):
    """A bag of the stream; returns what went in."""
    recorder = BagRecorder(folder, NAMES, "/heli", form)
    sent = []
    for number, (name, stamp_ns, raw) in enumerate(stream(ticks)):
        recorder.write(name, raw)
        sent.append(in_bag(name, stamp_ns, raw))
        if number % flush_every == 0:
            recorder.flush()
    recorder.close()
    return sent


def in_bag(name, stamp_ns, raw):
    """What a bag has of a message: those of a tick follow one another by a nanosecond."""
    return f"/heli/{name}", stamp_ns + NAMES.index(name), raw


def by_rosbags(folder):
    with Reader(folder) as reader:
        return [(c.topic, stamp_ns, bytes(raw)) for c, stamp_ns, raw in reader.messages()]


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_what_went_in_comes_out(tmp_path, form):
    sent = record(tmp_path / "bag", form)
    assert sorted(by_rosbags(tmp_path / "bag")) == sorted(sent)
    suffix = ".db3" if form.storage == "sqlite3" else ".mcap"
    assert {p.suffix for p in (tmp_path / "bag").iterdir()} == {suffix, ".yaml"}


def test_mcap_bytes_are_those_of_the_writer_of_rosbags(tmp_path, monkeypatch):
    record(tmp_path / "bag", FORMS["mcap"])
    monkeypatch.setattr(McapFile, "write", McapWriter.write)
    record(tmp_path / "other" / "bag", FORMS["mcap"])
    ours, theirs = (tmp_path / where / "bag_0.mcap" for where in ("bag", "other/bag"))
    assert ours.read_bytes() == theirs.read_bytes()


def test_index_beside_the_file_gives_the_bytes_of_a_list(tmp_path, monkeypatch):
    record(tmp_path / "bag", FORMS["mcap"], flush_every=3)
    monkeypatch.setattr(storage_files, "ChunkIndex", _PlainIndex)
    record(tmp_path / "other" / "bag", FORMS["mcap"], flush_every=3)
    ours, theirs = (tmp_path / where / "bag_0.mcap" for where in ("bag", "other/bag"))
    assert ours.read_bytes() == theirs.read_bytes()
    with open(ours, "rb") as file:
        assert len(make_reader(file).get_summary().chunk_indexes) > 3 * 64


class _PlainIndex(list):
    """What the writer of rosbags has."""

    def __init__(self, folder):
        super().__init__()

    def close(self):
        """Nothing is to be given back."""


def test_memory_does_not_grow_with_the_number_of_chunks(tmp_path):
    recorder, sent = BagRecorder(tmp_path / "bag", NAMES), list(stream(4000))

    def fly(messages):
        for name, _, raw in messages:
            recorder.write(name, raw)
            recorder.flush()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        first = fly(sent[:2000])
        grown = fly(sent[2000:]) - first
    finally:
        tracemalloc.stop()
    # A list of them would take some 250 bytes for each of the 10 000 chunks.
    assert grown < 100_000
    recorder.close()
    assert len(by_rosbags(tmp_path / "bag")) == len(sent)


@pytest.mark.parametrize("kept", [0, 30, 64, 150, 200])
def test_index_is_cut_where_asked(tmp_path, kept):
    records, index = [bytes([n]) * (n + 1) for n in range(200)], ChunkIndex(tmp_path)
    for record_ in records[:170]:
        index.append(BytesIO(record_))
    del index[kept:]
    for record_ in records[170:]:
        index.append(BytesIO(record_))
    expected = records[: min(kept, 170)] + records[170:]
    assert [one.getvalue() for one in index] == expected and len(index) == len(expected)
    assert all(one.tell() == len(one.getvalue()) for one in index)
    index.close()
    assert not list(tmp_path.iterdir())


def test_index_stays_in_memory_where_the_disk_takes_none(small_disk):
    index, record_ = ChunkIndex(small_disk), bytes(5000)
    for _ in range(1500):
        index.append(BytesIO(record_))
    assert [one.getvalue() for one in index] == [record_] * 1500
    index.close()


@pytest.mark.parametrize("form", [FORMS["mcap"], FORMS["zstd"]], ids=["plain", "zstd"])
def test_second_reader_decodes_it_by_its_own_schemas(tmp_path, form):
    """mcap-ros2-support builds its decoders from the schemas alone, as Foxglove and PlotJuggler."""
    record(tmp_path / "bag", form)
    with open(tmp_path / "bag" / "bag_0.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        counts = dict.fromkeys(NAMES, 0)
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            name = channel.topic.removeprefix("/heli/")
            assert schema.encoding == "ros2msg" and channel.message_encoding == "cdr"
            stamp = decoded.header.stamp
            stamp_ns = stamp.sec * 10**9 + stamp.nanosec
            assert message.log_time == stamp_ns + NAMES.index(name)
            if name == topics.ACTUATORS:
                assert decoded.position[0] == counts[name]
            counts[name] += 1
        assert counts == dict.fromkeys(NAMES, TICKS)
        summary = reader.get_summary()
    assert summary.statistics.message_count == TICKS * len(NAMES)


def test_definitions_and_hashes_are_those_of_ros(tmp_path):
    """Against the hashes that ROS itself installs beside its messages."""
    names = [topic.name for topic in topics.TABLE]
    recorder = BagRecorder(tmp_path / "bag", names)
    recorder.close()
    with open(tmp_path / "bag" / "bag_0.mcap", "rb") as file:
        summary = make_reader(file).get_summary()
    metadata = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    listed = {
        row["topic_metadata"]["type"]: row["topic_metadata"]["type_description_hash"]
        for row in metadata["rosbag2_bagfile_information"]["topics_with_message_count"]
    }
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        package, _, message = schema.name.partition("/")
        described = share_folder(package) / f"{message}.json"
        rows = json.loads(described.read_text())["type_hashes"]
        official = {row["type_name"]: row["hash_string"] for row in rows}
        assert channel.metadata["topic_type_hash"] == official[schema.name]
        assert listed[schema.name] == official[schema.name]
        defined = set(re.findall(r"^MSG: (\w+)/(?:msg/)?(\w+)$", schema.data.decode(), re.M))
        needed = {tuple(name.split("/msg/")) for name in official if name != schema.name}
        assert needed <= defined


def test_metadata_is_what_rosbag2_expects(tmp_path):
    """Keys of version 9, as `ros2 bag record` of Jazzy writes them; sums over the files agree."""
    record(tmp_path / "bag", FORMS["split by size"])
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    info = content["rosbag2_bagfile_information"]
    assert set(info) == {
        "version", "storage_identifier", "duration", "starting_time", "message_count",
        "topics_with_message_count", "compression_format", "compression_mode",
        "relative_file_paths", "files", "custom_data", "ros_distro",
    }  # fmt: skip
    assert (info["version"], info["storage_identifier"], info["ros_distro"]) == (9, "mcap", "jazzy")
    assert info["starting_time"] == {"nanoseconds_since_epoch": 1_000_000_000}
    assert info["duration"] == {"nanoseconds": (TICKS - 1) * TICK_NS + len(NAMES) - 1}
    assert len(info["files"]) > 3
    assert [file["path"] for file in info["files"]] == info["relative_file_paths"]
    assert sum(file["message_count"] for file in info["files"]) == info["message_count"]
    assert info["message_count"] == TICKS * len(NAMES)
    for row in info["topics_with_message_count"]:
        assert row["message_count"] == TICKS
        (qos,) = row["topic_metadata"]["offered_qos_profiles"]
        assert (qos["reliability"], qos["durability"]) == ("reliable", "volatile")
        assert qos["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_sqlite_is_readable_without_any_bag_library(tmp_path):
    sent = record(tmp_path / "bag", FORMS["sqlite3"])
    uri = f"file:{tmp_path}/bag/bag_0.db3?immutable=1"
    with sqlite3.connect(uri, uri=True) as database:
        rows = database.execute(
            "SELECT topics.name, timestamp, data FROM messages "
            "JOIN topics ON topics.id = topic_id ORDER BY messages.id"
        ).fetchall()
        version = database.execute("SELECT schema_version FROM schema").fetchone()
        kinds = database.execute("SELECT topic_type, encoding FROM message_definitions").fetchall()
        (mode,) = database.execute("PRAGMA journal_mode").fetchone()
    assert rows == sent and version == (4,)
    assert len(kinds) == 3 and {kind for _, kind in kinds} == {"ros2msg"}
    assert mode != "wal"


def test_files_are_split_where_they_should(tmp_path):
    record(tmp_path / "bag", FORMS["split by time"])
    parts = sorted((tmp_path / "bag").glob("*.db3"))
    assert [p.name for p in parts] == ["bag_0.db3", "bag_1.db3", "bag_2.db3"]
    for part in parts:
        with Reader(part) as reader:
            assert reader.duration == 990_000_000 + len(NAMES) and reader.message_count == 300


def test_any_other_topic_by_its_type(tmp_path):
    """Also a type that is not among the standard ones but installed with its .msg file."""
    names = [topics.IMU, "/chat:std_msgs/msg/String"]
    recorder = BagRecorder(tmp_path / "bag", names, "/heli")
    recorder.write("/chat", b"\0\1\0\0\3\0\0\0hi\0\0")
    recorder.close()
    with AnyReader([tmp_path / "bag"]) as reader:
        ((connection, _, raw),) = reader.messages()
        assert connection.topic == "/chat"
        assert reader.deserialize(raw, connection.msgtype).data == "hi"


def test_installed_type_that_is_not_standard(tmp_path, monkeypatch):
    folder = tmp_path / "prefix/share/own_msgs/msg"
    folder.mkdir(parents=True)
    (folder / "Leg.msg").write_text("geometry_msgs/Point end\nfloat64 load\n")
    (folder / "Gear.msg").write_text("std_msgs/Header header\nLeg[2] legs\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    BagRecorder(tmp_path / "bag", ["gear:own_msgs/msg/Gear"]).close()
    with open(tmp_path / "bag" / "bag_0.mcap", "rb") as file:
        (schema,) = make_reader(file).get_summary().schemas.values()
    text = schema.data.decode()
    assert schema.name == "own_msgs/msg/Gear"
    assert "MSG: own_msgs/Leg" in text.replace("/msg/", "/")
    assert "MSG: geometry_msgs/Point" in text.replace("/msg/", "/")


@pytest.mark.parametrize(
    ("names", "form", "cause", "words"),
    [
        (["imu/data"], {}, BagCause.TOPIC, ["imu/data", "imu/data_raw", "name:package/msg/Type"]),
        (["x:no_msgs/msg/No"], {}, BagCause.TOPIC, ["topic x", "no_msgs/msg/No", "not installed"]),
        ([topics.IMU], {"storage": "hdf5"}, BagCause.OPTION, ["hdf5", "mcap", "sqlite3"]),
        ([topics.IMU], {"storage": "sqlite3", "zstd": True}, BagCause.OPTION, ["zstd", "mcap"]),
    ],
)
def test_bad_choices_are_one_sentence_and_leave_nothing(tmp_path, names, form, cause, words):
    with pytest.raises(BagError) as error:
        BagRecorder(tmp_path / "bag", names, form=Format(**form))
    assert error.value.cause == cause and all(word in str(error.value) for word in words)
    assert not (tmp_path / "bag").exists()


FULL_DISK = """
import json, resource, signal, sys
from test_recorder import NAMES, FORMS, stream
from heli_bags.writer import BagError, BagRecorder
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
recorder = BagRecorder(sys.argv[1], NAMES, "/heli", FORMS[sys.argv[2]])
if int(sys.argv[3]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
errors = []
for number, (name, stamp_ns, raw) in enumerate(stream(6000)):
    try:
        recorder.write(name, raw)
        if number % int(sys.argv[4]) == 0:
            recorder.flush()
    except BagError as error:
        errors.append(error)
recorder.close()
(error,) = errors
why = error.__cause__
full = getattr(why, "sqlite_errorname", None) == "SQLITE_FULL" or getattr(why, "errno", 0) == 28
print(json.dumps([error.cause.name, error.kept, full, str(error)]))
"""


KEPT, NO_ROOM = "the bag holds {} messages", "cannot be written: No space left"
ADVICE = "'heli bag repair' restores what was written"


def fill(folder, form, limit, flush_every=20):
    """Record until the disk is full; messages kept, whether the disk was, and the sentence."""
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, folder, form, str(limit), str(flush_every)],
        cwd=Path(__file__).parent, capture_output=True, text=True, timeout=150,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    cause, kept, full, sentence = json.loads(done.stdout)
    assert cause == BagCause.STOPPED.name
    assert sentence.startswith(f"{folder}: recording stopped: ") and "\n" not in sentence
    return kept, full, sentence


def is_beginning(folder):
    """Number of messages of a bag, which are exactly the first that were sent."""
    kept = by_rosbags(folder)
    sent = [in_bag(*message) for message in stream(len(kept))]
    assert sorted(kept) == sorted(sent[: len(kept)])
    return len(kept)


@pytest.mark.parametrize("flush_every", [20, 10**6], ids=["often", "never"])
@pytest.mark.parametrize("form", ["mcap", "sqlite3"])
def test_full_disk_ends_the_recording_and_the_bag_opens(small_disk, form, flush_every):
    kept, full, sentence = fill(small_disk / "bag", form, 0, flush_every)
    assert full and kept == is_beginning(small_disk / "bag") > 1500
    assert KEPT.format(kept) in sentence


@pytest.mark.parametrize(
    ("form", "limit"), [("mcap", 400_000), ("zstd", 60_000), ("sqlite3", 400_000)]
)
def test_disk_without_room_for_the_index_is_repaired(tmp_path, form, limit):
    """Writes fail in the middle of a file and ever after (by the limit of a file's size)."""
    kept, _, sentence = fill(tmp_path / "bag", form, limit)
    assert (ADVICE in sentence) == (kept is None)
    if kept is None:
        assert repair(tmp_path / "bag", tmp_path / "new").messages > 300
        assert is_beginning(tmp_path / "new") > 300
    else:
        assert kept == is_beginning(tmp_path / "bag") > 300


def test_no_room_at_all_is_said_before_anything_is_recorded(small_disk):
    (small_disk / "other").write_bytes(bytes(3_000_000))
    with pytest.raises(BagError) as caught:
        BagRecorder(small_disk / "bag", NAMES)
    assert caught.value.cause == BagCause.UNWRITABLE
    assert caught.value.__cause__.errno == errno.ENOSPC and NO_ROOM in str(caught.value)
    assert not (small_disk / "bag").exists()


def test_the_recorder_speaks_of_the_time_that_it_records(bench, tmp_path):
    """It makes no ticks; what it says of itself carries the stamp of what it wrote last."""
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"), topics=(topics.IMU,))
    recorder.fly()
    assert recorder.node.now_ns() == recorder.node.start_ns
    recorder.node.core.bag.write(topics.IMU, Encoder(topics.IMU).encode(np.zeros(6), 7 * 10**9))
    assert recorder.node.now_ns() == 7 * 10**9
