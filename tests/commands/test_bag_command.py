# SPDX-License-Identifier: Apache-2.0
"""`heli bag info | echo | csv | repair` on bags; playing and listening are tested on a graph."""

import csv
import json
import re
import shutil

import numpy as np
import pytest
import yaml

from heli_bags.writer import BagRecorder
from heli_core.ticks import TICK_NS
from heli_flight.cli import app as cli
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder

NAMES = (topics.ACTUATORS, topics.BARO, topics.TRUTH_WIND)
TICKS = 200
CHAT = "chat:std_msgs/msg/Float64MultiArray"
# Layout without dimensions, then a sequence of one or of two numbers.
ONE = bytes.fromhex("00010000 00000000 00000000 01000000 00000000 0000000000000840")
TWO = bytes.fromhex("00010000 00000000 00000000 02000000 00000000") + bytes(16)


def heli(capsys, *words):
    code = cli.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def done(capsys, *words, code=0):
    ended, out, err = heli(capsys, *words)
    assert ended == code, err
    return out


def refused(capsys, *words):
    code, out, err = heli(capsys, *words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1, err
    return err


def values(name, tick):
    return np.arange(CHANNELS[name].size) + tick


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A flight's folder with its bag."""
    folder = tmp_path_factory.mktemp("flight")
    recorder = BagRecorder(folder / "bag", [*NAMES, CHAT])
    encoders = {name: Encoder(name) for name in NAMES}
    for tick in range(TICKS):
        stamp_ns = 10**9 + tick * TICK_NS
        for name in NAMES:
            if topics.due(name, tick):
                row = np.ascontiguousarray(values(name, tick), dtype=float)
                recorder.write(name, encoders[name].encode(row, stamp_ns))
    for raw in (ONE, TWO):
        recorder.write("chat", raw)
    recorder.close()
    return folder


@pytest.mark.parametrize("command", ["info", "play", "echo", "csv", "repair"])
def test_help_has_an_example(capsys, command):
    out = done(capsys, "bag", command, "--help")
    assert f"heli bag {command} " in out.split("example")[1]


@pytest.mark.parametrize("command", ["echo", "topics"])
def test_help_of_the_graph_commands_has_an_example(capsys, command):
    assert f"heli {command} " in done(capsys, command, "--help").split("example")[1]


def test_info(capsys, flight):
    text = done(capsys, "bag", "info", flight)
    assert "| /baro " in text and "sensor_msgs/msg/FluidPressure" in text
    for fact in (f"{2 * TICKS + TICKS // 5 + 2} messages ", " 1.99 s ", " 1.00 s", " 1 mcap "):
        assert fact in text
    info = json.loads(done(capsys, "bag", "info", flight / "bag", "--json"))
    rows = {row["topic"]: row for row in info["topics"]}
    assert rows["/actuators"]["messages"] == TICKS
    assert rows["/actuators"]["rate_hz"] == pytest.approx(100.0)
    assert rows["/baro"]["hash"].startswith("RIHS01_")
    assert info["size_bytes"] == (flight / "bag" / "bag_0.mcap").stat().st_size


def test_echo_is_yaml_and_json(capsys, flight):
    texts = done(capsys, "bag", "echo", flight, "actuators", "--count", 2).split("---\n")
    assert texts[2] == ""
    message = yaml.safe_load(texts[1])
    assert message["header"]["stamp"] == {"sec": 1, "nanosec": TICK_NS}
    assert message["position"] == [1.0, 2.0, 3.0, 4.0]
    lines = done(capsys, "bag", "echo", flight, "/actuators", "--json").splitlines()
    assert len(lines) == TICKS
    last = json.loads(lines[-1])
    assert last["stamp_ns"] // TICK_NS == 100 + TICKS - 1
    assert last["position"] == [TICKS - 1.0, TICKS, TICKS + 1.0, TICKS + 2.0]


def test_csv_holds_every_field(capsys, flight, tmp_path):
    out = done(capsys, "bag", "csv", flight, "--out", tmp_path / "tables")
    assert out.startswith(f"written: {tmp_path / 'tables'} (4 tables, ")
    with open(tmp_path / "tables" / "ground_truth__wind.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == TICKS
    assert int(rows[7]["stamp_ns"]) // TICK_NS == 100 + 7
    # North, east, down in the core; east, north, up on the topic.
    assert [float(rows[7][f"vector.{axis}"]) for axis in "xyz"] == [8.0, 7.0, -9.0]
    with open(tmp_path / "tables" / "chat.csv", newline="") as stream:
        header, first, second = csv.reader(stream)
    assert header[-2:] == ["data[0]", "data[1]"]
    assert first[-2:] == ["3.0", ""] and second[-2:] == ["0.0", "0.0"]
    only = json.loads(
        done(capsys, "bag", "csv", flight, "--topic", "baro", "--out", tmp_path / "one", "--json")
    )
    assert only == {str(tmp_path / "one" / "baro.csv"): TICKS // 5}


def test_repair_says_what_was_restored_and_what_was_lost(capsys, flight, tmp_path):
    assert not json.loads(done(capsys, "bag", "repair", flight, "--json"))["repaired"]
    bag = tmp_path / "bag"
    shutil.copytree(flight / "bag", bag)
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    for command in (["info"], ["echo"], ["csv"], ["play"]):
        more = {"echo": ["baro"], "csv": ["--out", tmp_path / "csv"]}.get(command[0], [])
        sentence = refused(capsys, "bag", *command, bag, *more)
        assert "bag_0.mcap" in sentence and f"bag repair {bag}'" in sentence
    assert not (tmp_path / "csv").exists()
    text = done(capsys, "bag", "repair", bag, code=1)
    assert text.startswith(f"{bag}: bag_0.mcap ")
    assert re.search(rf"^written: {bag}_repaired; .* {bag}$", text, re.MULTILINE)
    info = json.loads(done(capsys, "bag", "info", f"{bag}_repaired", "--json"))
    assert re.search(rf"^restored: {info['messages']} .* 3 topics\b", text, re.MULTILINE)
    assert 100 < info["messages"] < 2 * TICKS
    again = done(capsys, "bag", "repair", bag, "--out", tmp_path / "new", "--json", code=1)
    again = json.loads(again)
    assert again["repaired"] and again["messages"] == info["messages"]
    # Of what metadata.yaml counts, each that is not restored is lost.
    listed = json.loads(done(capsys, "bag", "info", flight, "--json"))["messages"]
    lost = sum(again["missing"].values())
    assert not again["whole"] and lost == listed - info["messages"] > 0
    assert re.search(rf"^lost: {lost} messages\b", text, re.MULTILINE)


def test_what_only_was_not_closed_is_restored_whole(capsys, flight, tmp_path):
    bag = tmp_path / "bag"
    shutil.copytree(flight / "bag", bag)
    (bag / "metadata.yaml").unlink()
    restored = json.loads(done(capsys, "bag", "repair", bag, "--json"))
    assert restored["whole"] and not restored["missing"]


def test_bad_input_is_one_line(capsys, flight, tmp_path):
    note = tmp_path / "note.txt"
    note.write_text("no bag")
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "nowhere", note, tmp_path / "empty"):
        for command in ("info", "repair", "play"):
            assert str(path) in refused(capsys, "bag", command, path)
    sentence = refused(capsys, "bag", "echo", flight, "odom")
    assert "odom; " in sentence and "/actuators, /baro, /chat, /ground_truth/wind" in sentence
    assert "exists already" in refused(capsys, "bag", "csv", flight, "--out", tmp_path)
    assert "topic x" in refused(
        capsys, "bag", "csv", flight, "--topic", "x", "--out", tmp_path / "new"
    )
    assert not (tmp_path / "new").exists()
    assert "--rate" in refused(capsys, "bag", "play", flight, "--rate", "0")
