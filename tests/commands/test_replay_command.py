# SPDX-License-Identifier: Apache-2.0
"""`heli replay`: whole and cut-off bags, records of one process, and what is no flight."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.cli import app as cli
from heli_flight.loop import simulate
from heli_flight.record import read_record, write_record
from heli_flight.replay import ended, of_ground, replay_of
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from support.record_bag import cut_off, flown_folder

DURATION_S = 8.0
FAULT = "{what: gps, kind: loss, start_s: 3.0, duration_s: 2.0}"


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    over = {"plant": {"faults": [FAULT]}}
    settings = resolve(duration_s=DURATION_S, overrides=over)
    folder = flown_folder(tmp_path_factory.mktemp("flown") / "flight", settings)
    result = {"flown_s": 8.0, "lost": "", "notes": ["observer: complained"], "verdicts": {
        "windows": {"stretch": "scored windows", "when": "5 to 8 s", "inside": False,
                    "outside": ["v_z (navigation)"], "decides": True}},
        "random_gusts": [{"start_s": 2.5, "duration_s": 1.0, "peak_ned_mps": [3.0, 4.0, 0.0]}],
    }  # fmt: skip
    (folder / "result.json").write_text(json.dumps(result))
    (folder / "report.html").write_text("<h1>report</h1>")
    return folder


def refused(capsys, *words):
    """The one line of a refusal; a busy machine may have told of its progress before."""
    code = cli.main(["replay", *map(str, words)])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    err = re.sub(r"^replay: \d+ of \d+\n", "", err, flags=re.M)
    assert len(err.splitlines()) == 1 and err.startswith("heli: "), err
    return err.removeprefix("heli: ").strip()


def test_a_flights_folder_is_shown_with_what_lies_beside_it(flight):
    replay, beside = replay_of(flight)
    hello = json.loads(replay.hello())
    assert hello["flight"] == {"scenario": "hover", "seed": 1, "duration_s": 8.0, "realtime": False}
    assert hello["replay"]["report"] == "report.html"
    assert beside == {"report.html": flight / "report.html"}
    for fact in (" 8.00 s", "(5 to 8 s)", "v_z (navigation)"):
        assert fact in hello["replay"]["ended"]
    assert hello["replay"]["notes"] == ["observer: complained"]
    texts = {(event["t"], event["kind"]): event["text"] for event in hello["events"]}
    for at_s, kind, fact in (
        (2.5, "gust", " 5.0 m/s begins"), (3.0, "fault", "gps loss begins"),
        (5.0, "fault", "gps loss ends"), (7.99, "end", " 8 s"),
    ):  # fmt: skip
        assert texts[at_s, kind].endswith(fact)


@pytest.mark.parametrize("form", ["flight", "bag", "file", "one_process"])
def test_every_form_gives_the_records_own_values(flight, tmp_path, form):
    """At each of some ticks the row that the bag, or the record, has there."""
    stream = read_bag(flight / "bag").streams[topics.TRUTH_ODOM]
    path = {"flight": flight, "bag": flight / "bag",
            "file": next((flight / "bag").glob("*.mcap"))}.get(form, tmp_path)  # fmt: skip
    if form == "one_process":
        shutil.copy(flight / "params.yaml", tmp_path)
        write_record(simulate(resolve(params=[flight / "params.yaml"])).record, tmp_path)
        record = read_record(tmp_path / "record.npz")
        np.testing.assert_allclose(record.truth_pos_ned_m, stream.rows[:, :3], atol=1e-9)
    replay, _ = replay_of(path)
    r = replay.recording
    for i in (0, 1, 333, 500, len(stream.stamp_ns) - 1):
        row = replay.state(r.start_ns + i * 10_000_000)
        north, east, down = stream.rows[i, :3]
        assert row["t"] == pytest.approx(i / 100)
        assert row["truth"]["p"] == pytest.approx([east, north, -down], abs=5e-5)
    last = replay.state(r.last_ns)
    assert last["end"]["kind"] == "over"
    # The reference at the last tick is on its way as before.
    assert last["largest"] is None or last["truth"]["error"] is None or (
        abs(last["truth"]["error"]["v_z_mps"]) < 1.0
    )  # fmt: skip


@pytest.mark.parametrize("share", [0.9, 0.4])
def test_a_bag_that_was_cut_off_is_shown_as_far_as_it_goes(flight, tmp_path, share):
    folder = tmp_path / "cut"
    shutil.copytree(flight, folder)
    cut_off(folder / "bag", share)
    before = sorted((p.name, p.read_bytes()) for p in (folder / "bag").iterdir())
    replay, _ = replay_of(folder)
    r = replay.recording
    length_s = r.seconds(r.last_ns)
    assert 1.0 < length_s < 8.0
    assert any("not whole" in note and "restored" in note for note in replay.notes)
    assert replay.state(r.last_ns)["end"] is None
    assert sorted((p.name, p.read_bytes()) for p in (folder / "bag").iterdir()) == before


def test_a_bag_that_is_damaged_inside_is_shown_where_it_is_not(flight, tmp_path):
    folder = tmp_path / "spoilt"
    shutil.copytree(flight, folder)
    (file,) = (folder / "bag").glob("*.mcap")
    content = bytearray(file.read_bytes())
    end = len(content)
    content[end // 2 :] = bytes(end - end // 2 - 60) + content[end - 60 :]
    file.write_bytes(content)
    replay, _ = replay_of(folder)
    assert any("not whole" in note for note in replay.notes)
    assert file.read_bytes() == content


def make(folder, kind, flight):
    """What is no flight."""
    path = folder / "x"
    if kind == "missing":
        return path
    if kind == "text":
        path.write_text("no flight")
        return path
    path.mkdir()
    if kind == "several":
        for name in ("heli1", "heli2"):
            shutil.copytree(flight / "bag", path / name / "bag")
    elif kind == "garbage":
        (path / "bag").mkdir()
        (path / "bag/bag_0.mcap").write_bytes(b"not an mcap file, and long enough to be read")
    elif kind == "cut to nothing":
        shutil.copytree(flight / "bag", path / "bag")
        cut_off(path / "bag", 0.0)
    elif kind == "record":
        (path / "record.npz").write_bytes(b"nothing")
    elif kind == "parameters":
        shutil.copytree(flight / "bag", path / "bag")
        (path / "params.yaml").write_text("/**/plant: {ros__parameters: {no_such: 1}}\n")
    return path


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("missing", "there is no such flight"),
        ("text", "not a flight: neither a bag's file"),
        ("empty", "not a flight: it holds neither a bag nor record.npz"),
        ("several", r"holds several flights: name one \(heli1, heli2\)"),
        ("garbage", "not an MCAP file"),
        ("cut to nothing", "not an MCAP file|holds no message"),
        ("record", "holds no record of a flight"),
        ("parameters", "no_such"),
    ],
)
def test_what_is_no_flight_is_refused_in_one_line(capsys, tmp_path, flight, kind, sentence):
    path = make(tmp_path, kind, flight)
    stderr = refused(capsys, path)
    assert str(tmp_path) in stderr and re.search(sentence, stderr), stderr


def test_a_bag_of_something_else_is_refused(capsys, tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    with Writer(tmp_path / "lidar", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind, store = "std_msgs/msg/Empty", get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection("/lidar", kind, typestore=store)
        writer.write(connection, 1, b"\x00\x01\x00\x00\x00")
    sentence = refused(capsys, tmp_path / "lidar")
    assert str(tmp_path / "lidar") in sentence and ": /lidar" in sentence


def test_bad_options_are_refused(capsys, flight):
    assert "--port" in refused(capsys, flight, "--port", 99999)
    assert "no_such.yaml" in refused(capsys, flight, "--params", "no_such.yaml")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        sentence = refused(capsys, flight, "--port", port)
    assert sentence.startswith(f"--port: port {port} on 127.0.0.1 ")
    assert "--live-port" not in sentence and sentence.count("--port") == 2


def start(flight, *words):
    """The command with a free port, and the page's address; Python's output is buffered."""
    env = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    process = subprocess.Popen(
        [sys.executable, "-m", "heli_flight.start", "heli", "replay", str(flight), "--port", "0",
         *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env,
    )  # fmt: skip
    for line in process.stdout:
        if url := re.search(r"http://127\.0\.0\.1:\d+/", line):
            return process, url.group()
    pytest.fail(process.communicate()[1])


def test_it_serves_until_ctrl_c_with_the_rules_of_the_live_page(flight):
    process, url = start(flight)
    try:
        with urllib.request.urlopen(url) as page:
            assert b"heli-hover" in page.read()
        with urllib.request.urlopen(f"{url}report.html") as page:
            assert page.read() == b"<h1>report</h1>"
        request = urllib.request.Request(url, headers={"Host": "elsewhere.example"})
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(request)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "interrupted" and "Traceback" not in err


def test_lift_off_and_touch_down_are_found():
    """Of a flight from the ground to the ground, once each, where the gear first carries."""
    settings = resolve("takeoff_land")
    record = simulate(settings).record
    from heli_flight.replay import stamps_of, streams_of

    truth = streams_of(record, stamps_of(record, 0))[topics.TRUTH_ODOM]
    lift, touch = of_ground(truth, settings.scenario.gear.ground, 0)
    assert lift.text == "lift-off" and re.fullmatch(r"touch-down at 0\.\d\d m/s", touch.text)
    height = -record.truth_pos_ned_m[:, 2]
    i, j = (round(100 * event.time_s) for event in (lift, touch))
    assert 0 < i < j < len(record)
    assert height[i : i + 300].max() - height[0] > 1.0 > height[i] - height[0] > -0.05
    assert height[j] - height[-1] < 0.05 < height[j - 300] - height[-1]


@pytest.mark.parametrize(
    ("result", "sentence"),
    [
        ({}, ""),
        ({"verdicts": 3}, ""),
        ({"lost": "hit the ground", "flown_s": 12.345}, "Lost after 12.35 s: hit the ground"),
        ({"forged": "two truths"}, "Forged: two truths"),
        ({"verdicts": {"w": {"decides": True, "stretch": "scored windows", "when": "5 to 6 s",
                             "inside": None}}},
         "Flown to its end. Scored windows (5 to 6 s): not scored."),
    ],
)  # fmt: skip
def test_how_it_ended_is_said_by_what_the_result_holds(result, sentence):
    assert ended(result, "the goals") == sentence


def test_help_names_the_keys(capsys):
    assert cli.main(["replay", "--help"]) == 0
    help_text = " ".join(capsys.readouterr().out.split())
    for part in (
        "space plays and pauses",
        "0.25 to 16",
        "#t=12.5",
        "cut off",
        "130 ended by Ctrl-C",
    ):
        assert part in help_text


def test_a_result_that_is_damaged_costs_only_what_it_says(flight, tmp_path):
    folder = tmp_path / "f"
    shutil.copytree(flight, folder)
    for text in ("[1, 2]", "{", '{"random_gusts": [3, {"start_s": "x"}], "notes": 5, "lost": ""}'):
        Path(folder / "result.json").write_text(text)
        replay, _ = replay_of(folder)
        assert "gust" not in {event.kind for event in replay.events}
