# SPDX-License-Identifier: Apache-2.0
"""A clock that goes back in a bag: two flights, of which the last is read, or the one named."""

import json

import numpy as np
import pytest

from heli_bags.opening import opened, restarts
from heli_bags.reader import read_bag
from heli_bags.repair import repair
from heli_bags.tools import bag_info, bag_messages, write_csv
from heli_bags.writer import BagCause, BagError, BagRecorder, Format
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.cli import app as cli
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import ClockEncoder, Encoder
from support import foreign_bags as foreign
from support.foreign_bags import Sent
from support.fuzz_messages import good_row

NAMES = (topics.CLOCK, topics.IMU, topics.ACTUATORS)
STREAMS = NAMES[1:]
FIRST, SECOND = 300, 200
WALL_NS = 1_795_000_000 * NS_PER_S
FORMS = {
    "mcap": ("mcap", {}),
    "mcap without chunks": ("mcap", {"chunk_bytes": 0}),
    "mcap in one chunk": ("mcap", {"chunk_bytes": 1 << 24}),
    "mcap without summary": ("mcap", {"summary": False}),
    "sqlite3 2": ("sqlite3", {"version": 2}),
    "sqlite3 4": ("sqlite3", {"version": 4}),
}


def spoken(first_tick, ticks, value):
    """Name, stamp and bytes, tick by tick; each stream's last number is the value."""
    encoders, clock = {name: Encoder(name) for name in STREAMS}, ClockEncoder()
    for tick in range(first_tick, first_tick + ticks):
        stamp_ns = NS_PER_S + tick * TICK_NS
        yield topics.CLOCK, stamp_ns, bytes(clock.encode(stamp_ns))
        for name in STREAMS:
            row = good_row(name)
            row[-1] = value
            yield name, stamp_ns, bytes(encoders[name].encode(row, stamp_ns))


def two_flights():
    yield from spoken(0, FIRST, 0.125)
    yield from spoken(0, SECOND, 0.25)


def full(name):
    return name if name.startswith("/") else f"/heli/{name}"


TYPES = {full(name): topics.BY_NAME[name].type for name in NAMES}


def foreign_bag(folder, storage, how, wall=False, names=NAMES):
    """As another recorder leaves it: in time of the simulation, or the wall's."""
    sent = [
        Sent(full(name), WALL_NS + number * NS_PER_S // 500 if wall else stamp_ns, raw)
        for number, (name, stamp_ns, raw) in enumerate(two_flights())
        if name in names
    ]
    types = {full(name): TYPES[full(name)] for name in names}
    return foreign.write_bag(folder, foreign.ours(types), sent, storage, **how)


def judge(bag):
    """The last is read, and said; the first by its number; nothing of one is in the other."""
    last, first = read_bag(bag), read_bag(bag, flight=1)
    assert last.flights == 2 and "2 flights" in last.notes[0]
    for read, ticks, value in ((last, SECOND, 0.25), (first, FIRST, 0.125)):
        for name in STREAMS:
            stream = read.streams[name]
            assert stream.stamp_ns.tolist() == [NS_PER_S + k * TICK_NS for k in range(ticks)]
            np.testing.assert_allclose(stream.rows[:, -1], value)
    with pytest.raises(BagError) as caught:
        read_bag(bag, flight=3)
    assert caught.value.cause == BagCause.OPTION


@pytest.mark.parametrize("wall", [False, True], ids=["simulated", "wall"])
@pytest.mark.parametrize("form", FORMS)
def test_two_flights_of_another_recorder(tmp_path, form, wall):
    judge(foreign_bag(tmp_path / "bag", *FORMS[form], wall=wall))


@pytest.mark.parametrize("names", [STREAMS, (topics.IMU, topics.ACTUATORS)], ids=["both", "imu"])
def test_without_clock_a_stream_tells_the_time(tmp_path, names):
    judge(foreign_bag(tmp_path / "bag", "mcap", {}, names=names))


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("split_ns", [0, NS_PER_S], ids=["whole", "split"])
def test_two_flights_of_our_recorder(tmp_path, storage, split_ns):
    """A plant that is cleaned up and configured again, while the recorder goes on."""
    form = Format(storage, split_ns=split_ns)
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/heli", form, NS_PER_S)
    for number, (name, _, raw) in enumerate(two_flights()):
        recorder.write(name, raw)
        if number % 50 == 0:
            recorder.flush()
    recorder.close()
    judge(tmp_path / "bag")


def test_queues_that_are_emptied_one_after_the_other(tmp_path):
    """After a pause of the recorder the end of one topic comes behind the begin of another."""
    recorder = BagRecorder(tmp_path / "bag", NAMES, "/heli", start_ns=NS_PER_S)
    said = list(two_flights())
    begin, end = 3 * (FIRST - 5), 3 * (FIRST + 5)
    for name, _, raw in said[:begin]:
        recorder.write(name, raw)
    for queue in NAMES:
        for name, _, raw in said[begin:end]:
            if name == queue:
                recorder.write(name, raw)
    for name, _, raw in said[end:]:
        recorder.write(name, raw)
    recorder.close()
    judge(tmp_path / "bag")


@pytest.mark.parametrize("form", ["mcap", "mcap without chunks", "sqlite3 2", "sqlite3 4"])
def test_a_repair_keeps_the_flights_apart(tmp_path, form):
    bag = foreign_bag(tmp_path / "bag", *FORMS[form])
    (bag / "metadata.yaml").unlink()
    assert repair(bag, tmp_path / "new") is not None
    judge(tmp_path / "new")


@pytest.fixture
def bag(tmp_path):
    return foreign_bag(tmp_path / "bag", "mcap", {})


def test_every_tool_reads_the_last_or_the_one_named(bag, tmp_path):
    info = bag_info(bag)
    assert info.messages == 3 * (FIRST + SECOND)
    assert info.flights == [(1.0, pytest.approx(3.99)), (1.0, pytest.approx(2.99))]
    for number, ticks in ((None, SECOND), (1, FIRST), (2, SECOND)):
        short, folder = [], tmp_path / str(number)
        folder.mkdir()
        rows = write_csv(bag, folder, flight=number, shortfall=short)
        assert set(rows.values()) == {ticks} and len(short) == (number is None)
        stamps = [stamp for _, _, stamp, _ in bag_messages(bag, ["/clock"], flight=number)]
        assert stamps == [NS_PER_S + k * TICK_NS for k in range(ticks)]


def test_the_commands_say_which_and_exit_with_1_where_nobody_asked(bag, tmp_path, capsys):
    assert cli.main(["bag", "info", str(bag)]) == 0
    assert "2 flights" in capsys.readouterr().out
    for number, code in ((None, 1), (1, 0), (3, 2)):
        asked = [] if number is None else ["--flight", str(number)]
        words = ["bag", "csv", str(bag), "--out", str(tmp_path / f"csv{number}"), *asked]
        assert cli.main(words) == code
        # On a loaded machine progress is told, too.
        err = capsys.readouterr().err.splitlines()
        said = [line for line in err if not line.startswith("messages: ")]
        assert len(said) == (code != 0), err
        assert cli.main(["bag", "echo", str(bag), "clock", "--json", *asked]) == code
        lines = capsys.readouterr().out.splitlines()
        assert len(lines) == {None: SECOND, 1: FIRST, 3: 0}[number]
        assert all(json.loads(line)["stamp_ns"] >= NS_PER_S for line in lines)


def test_a_part_of_the_time_is_of_the_flight_that_is_read(bag):
    with opened(bag, 1) as reader:
        stamps = [stamp for _, stamp, _ in reader.messages(stop=NS_PER_S + 10 * TICK_NS)]
    assert len(stamps) == 30


def test_one_message_of_another_time_is_no_flight():
    ticks = np.arange(100, dtype=np.int64) * TICK_NS + NS_PER_S
    assert restarts(ticks, 0) == []
    for place in (0, 1, 50, 98, 99):
        for odd_ns in (0, 900 * NS_PER_S):
            odd = ticks.copy()
            odd[place] = odd_ns
            assert restarts(odd, NS_PER_S // 10) == []
    doubled = np.repeat(ticks, 2)
    assert restarts(doubled, NS_PER_S // 10) == []
    two_senders = np.stack([ticks, ticks + 5 * NS_PER_S]).T.reshape(-1)
    assert restarts(two_senders, NS_PER_S // 10) == []
    assert restarts(np.concatenate([ticks, ticks, ticks]), NS_PER_S // 10) == [100, 200]
