# SPDX-License-Identifier: Apache-2.0
"""What nobody here can read hides nothing else of a bag, and is named and counted."""

import json

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import IndexType

from heli_bags.opening import opened
from heli_bags.reader import read_bag
from heli_bags.repair import repair
from heli_bags.tools import bag_info, bag_messages, write_csv
from heli_bags.writer import BagCause, BagError
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.cli import app as cli
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.messages import Encoder
from support import foreign_bags as foreign
from support.foreign_bags import FOREIGN, SCHEMALESS, Kind, Sent
from support.fuzz_messages import good_row

NAMES, TICKS = (topics.IMU, topics.ACTUATORS), 100
TYPES = {f"/heli/{name}": topics.BY_NAME[name].type for name in NAMES}
CUT_OFF = "/acme/cut_off"
OPAQUE = sorted(FOREIGN.keys() - {CUT_OFF})
FORMS = {
    "mcap": ("mcap", {}),
    "mcap of no profile": ("mcap", {"profile": ""}),
    "mcap without chunks": ("mcap", {"chunk_bytes": 0}),
    "mcap without summary": ("mcap", {"summary": False}),
    "mcap without index of messages": ("mcap", {"index": IndexType.CHUNK}),
    "mcap without both": ("mcap", {"chunk_bytes": 0, "summary": False}),
    **{f"sqlite3 {v}": ("sqlite3", {"version": v}) for v in foreign.SQLITE_VERSIONS},
}


def flight(ticks=TICKS, start_ns=NS_PER_S):
    encoders = {name: Encoder(name) for name in NAMES}
    for tick in range(ticks):
        stamp_ns = start_ns + tick * TICK_NS
        for name in NAMES:
            yield Sent(
                f"/heli/{name}", stamp_ns, bytes(encoders[name].encode(good_row(name), stamp_ns))
            )


@pytest.fixture(scope="module", params=FORMS)
def bags(request, tmp_path_factory):
    """A bag of ours alone, and one with all that is foreign."""
    folder, (storage, how) = tmp_path_factory.mktemp("bags"), FORMS[request.param]
    sent = list(flight())
    plain = foreign.write_bag(folder / "plain", foreign.ours(TYPES), sent, storage, **how)
    kinds, mixed = foreign.kinds(TYPES), foreign.among(sent)
    if storage == "mcap":
        kinds[SCHEMALESS] = Kind("", "", b"")
        mixed += [Sent(SCHEMALESS, sent[-1].log_ns, b"\0\1\0\0\1")]
    return plain, foreign.write_bag(folder / "mixed", kinds, mixed, storage, **how), len(mixed)


def test_ours_is_read_as_if_there_was_nothing_else(bags):
    plain, mixed, _ = bags
    one, other = read_bag(plain), read_bag(mixed)
    assert one.streams.keys() == other.streams.keys() == set(NAMES)
    for name in NAMES:
        assert other.streams[name].stamp_ns.size == TICKS
        np.testing.assert_array_equal(one.streams[name].rows, other.streams[name].rows)
    assert set(FOREIGN) <= set(other.foreign) and other.notes == []


def test_each_foreign_topic_is_listed_with_its_count_and_why(bags):
    _, mixed, count = bags
    info = bag_info(mixed)
    rows = {row.topic: row for row in info.topics}
    assert info.messages == count == sum(row.messages for row in info.topics)
    assert info.missing == [] and len(info.flights) == 1
    for name in FOREIGN:
        assert rows[name].messages == len(NAMES) * TICKS // foreign.EVERY_MESSAGES
    assert all(rows[name].unreadable for name in OPAQUE)
    assert not any(rows[name].unreadable for name in TYPES)


def test_tables_are_written_of_what_can_be_read_and_the_rest_is_named(bags, tmp_path):
    _, mixed, _ = bags
    (tmp_path / "out").mkdir()
    short = []
    rows = write_csv(mixed, tmp_path / "out", shortfall=short)
    assert rows == {f"heli__{name.replace('/', '__')}.csv": TICKS for name in NAMES}
    named = {line.partition(":")[0] for line in short}
    assert set(FOREIGN) <= named and not named & set(TYPES)


def test_a_foreign_topic_that_is_named_is_refused_and_one_of_ours_is_whole(bags):
    _, mixed, _ = bags
    for name in OPAQUE:
        with pytest.raises(BagError) as caught:
            list(bag_messages(mixed, [name]))
        assert caught.value.cause == BagCause.TOPIC and name in str(caught.value)
    short = []
    assert len(list(bag_messages(mixed, ["/heli/actuators"], shortfall=short))) == TICKS
    assert short == []
    with pytest.raises(BagError) as caught:
        list(bag_messages(mixed, [CUT_OFF], shortfall=short))
    assert caught.value.cause == BagCause.NOTHING_LEFT
    assert f"{CUT_OFF}: {len(NAMES) * TICKS // foreign.EVERY_MESSAGES} " in str(caught.value)


def test_the_commands_exit_with_1_where_they_read_less(bags, tmp_path, capsys):
    _, mixed, count = bags
    assert cli.main(["bag", "info", str(mixed), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] == count
    assert cli.main(["bag", "csv", str(mixed), "--out", str(tmp_path / "all")]) == 1
    assert capsys.readouterr().err.count("not read: ") >= len(FOREIGN)
    words = ["bag", "csv", str(mixed), "--out", str(tmp_path / "one"), "--topic", "heli/actuators"]
    assert cli.main(words) == 0
    capsys.readouterr()
    for name in (CUT_OFF, OPAQUE[0]):
        assert cli.main(["bag", "echo", str(mixed), name]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_ours_in_another_form_is_named(tmp_path):
    """Our own topic as JSON: said with its count, and the others are read."""
    kinds = foreign.ours(TYPES)
    kinds["/heli/actuators"] = Kind(TYPES["/heli/actuators"], "jsonschema", b"{}", "json")
    bag = foreign.write_bag(tmp_path / "bag", kinds, list(flight()), "mcap")
    read = read_bag(bag)
    assert read.refused == {topics.ACTUATORS: TICKS} and len(read.notes) == 1
    assert set(read.streams) == {topics.IMU}


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_more_messages_in_the_list_than_in_the_files(tmp_path, storage, capsys):
    sent = list(flight())
    bag = foreign.write_bag(tmp_path / "bag", foreign.ours(TYPES), sent, storage)
    (file,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    about = foreign.metadata(9, storage, [file.name], foreign.ours(TYPES), sent)
    about["topics_with_message_count"][1]["message_count"] += 7
    foreign.write_metadata(bag, about)
    (line,) = bag_info(bag).missing
    assert line.startswith("/heli/actuators: 7 ")
    assert read_bag(bag).notes == [line]
    assert cli.main(["bag", "info", str(bag)]) == 1
    assert cli.main(["bag", "csv", str(bag), "--out", str(tmp_path / "csv")]) == 1
    capsys.readouterr()


@pytest.mark.parametrize("form", FORMS)
def test_messages_of_one_time_come_in_the_order_of_writing(tmp_path, form):
    """As in simulated time, of which a tick has many; over the ends of chunks, too."""
    storage, how = FORMS[form]
    names, said = list(TYPES), []
    for tick in range(60):
        order = names if tick % 3 else names[::-1]
        said += [(name, NS_PER_S + tick // 20 * TICK_NS, tick) for name in order]
    encoders = {f"/heli/{name}": Encoder(name) for name in NAMES}
    rows = {f"/heli/{name}": good_row(name) for name in NAMES}
    sent = [Sent(name, ns, bytes(encoders[name].encode(rows[name], k))) for name, ns, k in said]
    if storage == "mcap" and how.get("chunk_bytes", 1):
        how = {**how, "chunk_bytes": 512}
    bag = foreign.write_bag(tmp_path / "bag", foreign.ours(TYPES), sent, storage, **how)
    with opened(bag) as reader:
        read = [(c.topic, ns, stamp_of(raw)) for c, ns, raw in reader.messages()]
    assert read == said


def test_two_definitions_of_one_type_and_one_that_is_no_utf8(tmp_path):
    """A cut-off definition of another topic's type, and a comment in Latin-1, are theirs alone."""
    kinds, sent = foreign.ours(TYPES), list(flight())
    imu = kinds["/heli/imu/data_raw"]
    kinds["/heli/imu/data_raw"] = Kind(imu.type, imu.schema, imu.definition + b"\n# m/s\xb2\n")
    kinds["/other/imu/data_raw"] = Kind(imu.type, imu.schema, imu.definition[:40])
    kinds["/empty"] = foreign.ours({"": "std_msgs/msg/Empty"})[""]
    sent += [Sent("/other/imu/data_raw", NS_PER_S, sent[0].raw)]
    sent += [Sent("/empty", NS_PER_S, b"\0\1\0\0\0")]
    bag = foreign.write_bag(tmp_path / "bag", kinds, sent, "mcap")
    (tmp_path / "csv").mkdir()
    short = []
    rows = write_csv(bag, tmp_path / "csv", shortfall=short)
    assert rows == {
        "heli__imu__data_raw.csv": TICKS, "heli__actuators.csv": TICKS, "empty.csv": 1,
    }  # fmt: skip
    (line,) = short
    assert line.startswith("/other/imu/data_raw: 1 ")


def test_a_file_without_a_number_and_a_topic_without_messages(tmp_path):
    kinds, sent = foreign.kinds(TYPES, []), list(flight())
    kinds["/heli/baro"] = foreign.ours({"": topics.BY_NAME[topics.BARO].type})[""]
    bag = foreign.write_bag(tmp_path / "bag", kinds, sent, "mcap")
    (bag / "bag_0.mcap").rename(bag / "renamed by hand.mcap")
    about = foreign.metadata(9, "mcap", ["renamed by hand.mcap"], kinds, sent)
    foreign.write_metadata(bag, about)
    info = bag_info(bag)
    assert {row.topic: row.messages for row in info.topics}["/heli/baro"] == 0
    assert info.missing == [] and {s.stamp_ns.size for s in read_bag(bag).streams.values()} == {
        TICKS
    }


def test_messages_of_no_topic_are_counted(tmp_path):
    bag = foreign.write_bag(tmp_path / "bag", foreign.ours(TYPES), list(flight()), "sqlite3")
    import sqlite3

    with sqlite3.connect(bag / "bag_0.db3") as database:
        database.execute("UPDATE messages SET topic_id = 9 WHERE id % 20 = 0")
        database.execute("UPDATE messages SET data = 'text' WHERE id % 20 = 1")
    database.close()
    short = []
    (tmp_path / "csv").mkdir()
    rows = write_csv(bag, tmp_path / "csv", shortfall=short)
    assert sum(rows.values()) == 2 * TICKS - 20
    assert any(": 10 messages" in line and line.startswith("no topic") for line in short)
    assert any("the files list" in line for line in short)


def test_a_repair_keeps_foreign_topics_as_they_are(bags, tmp_path):
    """Of a bag that lost its list: every message in the form in which it was."""
    _, mixed, count = bags
    folder = tmp_path / "lost"
    folder.mkdir()
    (file,) = (path for path in mixed.iterdir() if path.suffix != ".yaml")
    (folder / file.name).write_bytes(file.read_bytes())
    done = repair(folder, tmp_path / "new")
    assert done is not None and done.messages == count
    before, after = bag_info(mixed), bag_info(tmp_path / "new")
    assert [(t.topic, t.type, t.messages, t.unreadable) for t in before.topics] == [
        (t.topic, t.type, t.messages, t.unreadable) for t in after.topics
    ]
    with opened(mixed) as one, opened(tmp_path / "new") as other:
        contents = [
            sorted((c.topic, stamp, bytes(raw)) for c, stamp, raw in reader.messages())
            for reader in (one, other)
        ]
    assert contents[0] == contents[1]
    if file.suffix == ".mcap":
        schemas = []
        for path in (file, *(tmp_path / "new").glob("*.mcap")):
            with path.open("rb") as stream:
                summary = make_reader(stream, validate_crcs=True).get_summary()
                found = {}
                for channel in summary.channels.values() if summary else ():
                    schema = summary.schemas.get(channel.schema_id)
                    # Without schema, and with one of no kind, is the same.
                    named = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
                    found[channel.topic] = channel.message_encoding, named
                schemas.append(found)
        assert schemas[0] == schemas[1] or not schemas[0]
