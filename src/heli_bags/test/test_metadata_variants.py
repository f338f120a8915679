# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of all versions, with fields left out, added and filled differently: read alike."""

import copy
import shutil

import pytest
import zstandard

from heli_bags.opening import TroubleKind, trouble, trouble_of
from heli_bags.reader import read_bag
from heli_bags.repair import repair
from heli_bags.tools import bag_info, bag_messages, write_csv
from heli_bags.writer import BagCause, BagError
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder
from support import foreign_bags as foreign
from support.foreign_bags import Sent
from support.fuzz_messages import good_row

NAMES, TICKS = (topics.IMU, topics.ACTUATORS), 20
TYPES = {f"/heli/{name}": topics.BY_NAME[name].type for name in NAMES}
ABSENT = object()


def with_field(*path, value=ABSENT):
    """Metadata of which a field is another, or is not there."""

    def changed(about):
        about = copy.deepcopy(about)
        place = about
        for key in path[:-1]:
            place = place[key]
        if value is ABSENT:
            place.pop(path[-1], None)
        else:
            place[path[-1]] = value
        return about

    return changed


def in_topics(field, value=ABSENT):
    def changed(about):
        about = copy.deepcopy(about)
        for row in about["topics_with_message_count"]:
            row["topic_metadata"].pop(field, None)
            if value is not ABSENT:
                row["topic_metadata"][field] = value
        return about

    return changed


def prefixed(prefix):
    def changed(about):
        files = [prefix + name for name in about["relative_file_paths"]]
        return {**about, "relative_file_paths": files}

    return changed


NOTHING = {"nanoseconds": 0}
OPTIONAL = (
    "version", "storage_identifier", "duration", "starting_time", "message_count",
    "topics_with_message_count", "compression_format", "compression_mode", "files", "custom_data",
    "ros_distro",
)  # fmt: skip
OF_TOPICS = ("type", "serialization_format", "offered_qos_profiles", "type_description_hash")
VARIANTS = {
    "as it is": lambda about: about,
    **{f"{name} left out": with_field(name) for name in OPTIONAL},
    **{f"{name} null": with_field(name, value=None) for name in OPTIONAL},
    **{f"{name} of topics left out": in_topics(name) for name in OF_TOPICS},
    **{f"{name} of topics null": in_topics(name, None) for name in OF_TOPICS},
    "a name of topics left out": in_topics("name"),
    "no topics": with_field("topics_with_message_count", value=[]),
    "topics that are none": with_field("topics_with_message_count", value=["/odom", 3, {}]),
    "no files": with_field("files", value=[]),
    "empty custom data": with_field("custom_data", value={}),
    "custom data": with_field("custom_data", value={"pilot": "none", "": ""}),
    "a field of tomorrow": with_field("shutter", value={"a": [1, 2]}),
    "a version of tomorrow": with_field("version", value=10),
    "no time": lambda about: {**about, "duration": NOTHING, "message_count": 0},
    "durations of zero": with_field("duration", value=NOTHING),
    "compression NONE": with_field("compression_mode", value="NONE"),
    "compression of messages": lambda about: {
        **about, "compression_mode": "MESSAGE", "compression_format": "zstd",
    },
    "an empty storage": with_field("storage_identifier", value=""),
    "another storage": with_field("storage_identifier", value="my_plugin"),
    "empty profiles": in_topics("offered_qos_profiles", ""),
    "profiles that are none": in_topics("offered_qos_profiles", "- history: 3\n"),
    "profiles that are no YAML": in_topics("offered_qos_profiles", "- {"),
    "profiles of another world": in_topics("offered_qos_profiles", [{"depth": "deep"}]),
    "an unknown hash": in_topics("type_description_hash", ""),
    "paths with the bag's folder": prefixed("flight/"),
    "paths from here": prefixed("./"),
    "absolute paths": prefixed("/media/disk/"),
}  # fmt: skip


def sent():
    encoders = {name: Encoder(name) for name in NAMES}
    return [
        Sent(f"/heli/{name}", stamp_ns, bytes(encoders[name].encode(good_row(name), stamp_ns)))
        for stamp_ns in range(NS_PER_S, NS_PER_S + TICKS * TICK_NS, TICK_NS)
        for name in NAMES
    ]


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def split(request, tmp_path_factory):
    """Folder of a bag in two files, its storage and messages; metadata.yaml is the test's."""
    folder, messages = tmp_path_factory.mktemp("bag"), sent()
    half, kinds = len(messages) // 2, foreign.ours(TYPES)
    for number, part in enumerate((messages[:half], messages[half:])):
        if request.param == "mcap":
            foreign.write_mcap(folder / f"bag_{number}.mcap", kinds, part)
        else:
            foreign.write_sqlite(folder / f"bag_{number}.db3", kinds, part)
    return folder, request.param, messages


def described(split, version, change=lambda about: about):
    """The bag with a metadata.yaml."""
    folder, storage, messages = split
    files = sorted(path.name for path in folder.glob("bag_*"))
    about = foreign.metadata(version, storage, files, foreign.ours(TYPES), messages)
    foreign.write_metadata(folder, change(about))
    return folder


def judge(bag, storage, tmp_path):
    """Every reader gives what is in the files."""
    info = bag_info(bag)
    assert (info.storage, info.messages) == (storage, len(NAMES) * TICKS)
    assert info.start_s == 1.0 and info.duration_s == pytest.approx((TICKS - 1) / 100)
    assert {(row.topic, row.type, row.messages, row.unreadable) for row in info.topics} == {
        (name, kind, TICKS, "") for name, kind in TYPES.items()
    }
    assert info.missing == [] and trouble(bag) == "" and repair(bag) is None
    read = read_bag(bag)
    assert read.notes == [] and {s.stamp_ns.size for s in read.streams.values()} == {TICKS}
    assert read.streams.keys() == set(NAMES)
    short, folder = [], tmp_path / "csv"
    folder.mkdir()
    assert set(write_csv(bag, folder, shortfall=short).values()) == {TICKS}
    assert len(list(bag_messages(bag, ["/heli/actuators"], shortfall=short))) == TICKS
    assert short == []


@pytest.mark.parametrize("version", foreign.METADATA_VERSIONS)
def test_every_version_is_read(split, version, tmp_path):
    judge(described(split, version), split[1], tmp_path)


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_variant_is_read(split, variant, tmp_path):
    for version in (1, 9):
        folder = tmp_path / str(version)
        folder.mkdir()
        judge(described(split, version, VARIANTS[variant]), split[1], folder)


@pytest.mark.parametrize("mode", ["FILE", "file"])
@pytest.mark.parametrize("version", [3, 5, 9])
def test_files_that_are_compressed_as_wholes(split, mode, version, tmp_path):
    bag, storage, _ = split
    packed = tmp_path / "packed"
    packed.mkdir()
    files = sorted(bag.glob("bag_*"))
    for file in files:
        (packed / f"{file.name}.zstd").write_bytes(zstandard.compress(file.read_bytes()))
    about = foreign.metadata(
        version, storage, [f"{file.name}.zstd" for file in files], foreign.ours(TYPES), sent()
    )
    foreign.write_metadata(
        packed, {**about, "compression_mode": mode, "compression_format": "zstd"}
    )
    judge(packed, storage, tmp_path)


@pytest.mark.parametrize("change", [
    with_field("relative_file_paths"), with_field("relative_file_paths", value=[]),
    with_field("relative_file_paths", value=None), with_field("relative_file_paths", value="bag_0"),
])  # fmt: skip
def test_without_the_list_of_files_a_repair_is_advised(split, change, tmp_path):
    bag = described(split, 9, change)
    with pytest.raises(BagError) as caught:
        bag_info(bag)
    assert caught.value.cause == BagCause.NOT_WHOLE
    done = repair(bag, tmp_path / "new")
    assert done is not None and done.messages == len(NAMES) * TICKS
    judge(tmp_path / "new", split[1], tmp_path)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("rosbag2_bagfile_information:\n  version: &v 5\n  also: *v\n", "line 3"),
        ("rosbag2_bagfile_information:\n  version: [5\n", "YAML"),
        ("- a list\n", ""),
        ("", ""),
    ],
    ids=["alias", "no YAML", "a list", "empty"],
)
def test_metadata_that_cannot_be_read_is_what_is_wrong(split, tmp_path, text, line):
    """Not that it does not list a file; and a repair brings the messages back."""
    folder = shutil.copytree(split[0], tmp_path / "bag")
    (folder / "metadata.yaml").write_text(text)
    wrong = trouble_of(folder)
    assert (wrong.kind, wrong.names) == (TroubleKind.UNREADABLE, ("metadata.yaml",))
    assert line in wrong.sentence
    with pytest.raises(BagError, match="heli bag repair"):
        bag_info(folder)
    restored = repair(folder, tmp_path / "new")
    assert restored.is_whole and restored.messages == len(NAMES) * TICKS
