# SPDX-License-Identifier: Apache-2.0
"""`heli report` on bags: whole ones, poor ones, and what is none."""

import json
import math
import re
import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import heli
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import NAV
from heli_core.ticks import TICK_NS
from heli_flight.cli import app as cli
from heli_flight.flight_file import write_parameters
from heli_flight.graph.bag_record import TRUTH_SUMS, flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.signatures import checksum

DURATION_S = 8.0
START_NS = 1_000_000_000
BARE = (topics.ODOM, topics.ACTUATORS, topics.ATTITUDE_SETPOINT, topics.ROTOR_STATE)
COMPARED = (
    "nav_pos_ned_m",
    "nav_vel_ned_mps",
    "truth_pos_ned_m",
    "truth_vel_ned_mps",
    "truth_rotor",
    "wind_ned_mps",
    "u",
    "nav_sigma_pos_m",
    "nav_sigma_vel_mps",
    "nav_sigma_att_rad",
)
FULL = (*BARE, topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.TRUTH_ROTOR)


@pytest.fixture(scope="module")
def record():
    return simulate(resolve(duration_s=DURATION_S)).record


def rows(record):
    """What each topic would carry, per tick."""
    n = len(record)
    nav, truth = np.zeros((n, NAV.size)), np.zeros((n, 13))
    nav[:, 0:3], nav[:, 3:6], nav[:, 6:10] = (
        record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb,
    )  # fmt: skip
    nav[:, 10:13] = record.nav_rate_body_radps
    nav[:, 22:25], nav[:, 25:28] = record.nav_sigma_pos_m, record.nav_sigma_vel_mps
    nav[:, 28:31] = record.nav_sigma_att_rad
    truth[:, 0:3], truth[:, 6:10] = record.truth_pos_ned_m, record.truth_q_nb
    truth[:, 10:13] = record.truth_rate_body_radps
    for row, velocity in zip(truth, record.truth_vel_ned_mps, strict=True):
        row[3:6] = quat_to_R_nb(row[6:10]).T @ velocity
    rotor = np.hstack([record.truth_rotor, np.zeros((n, 4))])
    return {
        topics.ODOM: nav, topics.TRUTH_ODOM: truth, topics.ACTUATORS: record.u,
        topics.ATTITUDE_SETPOINT: record.setpoint, topics.ROTOR_STATE: record.nav_rotor,
        topics.TRUTH_WIND: record.wind_ned_mps, topics.TRUTH_ROTOR: rotor,
    }  # fmt: skip


def write_bag(folder, record, names, prefix="/heli/", other=None, held=lambda name, time_s: True):
    """A bag of the graph in a namespace, as `ros2 bag record` would write it, and another topic.

    Of each topic what was held of it, by its name and the flight time.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    streams = rows(record)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name in names:
            kind = topics.BY_NAME[name].type
            connection = writer.add_connection(prefix + name, kind, typestore=store)
            encoder = Encoder(name)
            for tick, row in enumerate(streams[name]):
                stamp = START_NS + tick * TICK_NS
                if held(name, tick / 100.0):
                    raw = encoder.encode(np.ascontiguousarray(row), stamp)
                    writer.write(connection, stamp, raw)
        if other:
            connection = writer.add_connection(other, "std_msgs/msg/Empty", typestore=store)
            writer.write(connection, START_NS, b"\x00\x01\x00\x00\x00")
    return folder


@pytest.fixture(scope="module")
def full(tmp_path_factory, record):
    folder = tmp_path_factory.mktemp("full") / "rosbag2_flight"
    return write_bag(folder, record, FULL, other="/camera/shutter")


@pytest.fixture(scope="module")
def bare(tmp_path_factory, record):
    return write_bag(tmp_path_factory.mktemp("bare") / "rosbag2_flight", record, BARE)


def run(capsys, *words):
    code = cli.main(["report", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def refused(capsys, *words):
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1, err
    return err


def test_a_bag_gives_the_record_back(full, record):
    back = flight_from_bag(full, resolve(duration_s=DURATION_S)).record
    for name in COMPARED:
        np.testing.assert_allclose(getattr(back, name), getattr(record, name), atol=1e-9)


def test_foreign_bag_gets_a_report_that_says_what_was_assumed(capsys, full):
    code, out, _ = run(capsys, full, "--figures")
    page = full.with_name("rosbag2_flight_report") / "report.html"
    assert code == 0
    assert out == f"written: {page}\n"
    text = page.read_text(encoding="utf-8")
    assert "No params.yaml " in text
    assert " no reference" in text
    assert "assumed, not " in text
    assert ": /camera/shutter." in text
    assert " no ground" not in text
    assert (page.parent / "figures" / "estimate_position.png").is_file()
    assert re.search(r"Attitude: [^;]*; (9\d|100)\.\d % ", text)


@pytest.mark.slow
def test_bag_without_truth_reports_what_can_be(capsys, bare, tmp_path):
    code, _, _ = run(capsys, bare, "--out", tmp_path / "out", "--seed", 4, "--figures")
    assert code == 0
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert " no ground" in text
    assert " no wind" in text
    assert "/camera/shutter" not in text
    figures = {path.stem for path in (tmp_path / "out" / "figures").iterdir()}
    assert {"fig6_v_x", "fig9_track", "actuators", "rotor"} <= figures
    assert not {"wind", "estimate_position", "estimate_velocity", "estimate_attitude"} & figures
    assert not math.isnan(flight_from_bag(bare, resolve(), truth_needed=False).record.u[0, 0])


def test_what_is_no_bag_is_refused(capsys, tmp_path):
    text = tmp_path / "note.txt"
    text.write_text("no bag")
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "nowhere", text, tmp_path / "empty"):
        assert str(path) in refused(capsys, path)


def test_cut_off_bag_is_refused(capsys, full, tmp_path):
    cut = tmp_path / "cut"
    shutil.copytree(full, cut)
    (file,) = cut.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert str(cut) in refused(capsys, cut)


def test_bag_with_foreign_topics_only_is_refused(capsys, tmp_path, record):
    bag = write_bag(tmp_path / "foreign", record, (topics.ACTUATORS,), other="/lidar")
    expected = "holds neither ground_truth/odom nor odom: no flight; of other kinds: /lidar"
    assert expected in refused(capsys, bag)


def sums_of(record):
    """What the plant would have written of its ground truth."""
    encoder, truth = Encoder(topics.TRUTH_ODOM), rows(record)[topics.TRUTH_ODOM]
    stamps = (START_NS + tick * TICK_NS for tick in range(len(truth)))
    return [
        checksum(encoder.encode(np.ascontiguousarray(row), stamp))
        for row, stamp in zip(truth, stamps, strict=True)
    ]


def flight_folder(folder, record, held=lambda name, time_s: True):
    """A flight's folder with what the plant sent."""
    folder.mkdir()
    write_bag(folder / "bag", record, FULL, held=held)
    write_parameters(resolve(duration_s=DURATION_S), folder / "params.yaml")
    (folder / "result.json").write_text('{"mode": "lockstep"}')
    (folder / TRUTH_SUMS).write_bytes(b"".join(sums_of(record)))
    return folder


@pytest.fixture
def flown(tmp_path, record):
    """A flight's folder with what the plant sent."""
    return flight_folder(tmp_path / "flight", record)


def verdicts(folder):
    text = (folder / "report.html").read_text(encoding="utf-8")
    return [" ".join(v.split()) for v in re.findall(r'class="verdict (.*?)</p>', text, re.DOTALL)]


def test_ground_truth_that_the_plant_sent_is_taken(capsys, flown):
    code, out, _ = run(capsys, flown)
    assert (code, out) == (0, f"written: {flown / 'report.html'}\n")
    assert len(verdicts(flown)) == 1
    text = (flown / "report.html").read_text(encoding="utf-8")
    assert "plant sent" not in text and TRUTH_SUMS not in text


def test_ground_truth_of_somebody_else_is_said_and_is_exit_code_1(capsys, flown, record):
    sums = sums_of(record)
    sums[200] = sums[199]
    (flown / TRUTH_SUMS).write_bytes(b"".join(sums))
    verdict = (
        f"ground_truth/odom in the bag is not what the plant sent: 1 of {len(record)} messages, "
        "the first at 2.00 s; somebody else sends on it"
    )
    code, out, _ = run(capsys, flown)
    assert (code, out) == (1, f"FORGED: {verdict}\nwritten: {flown / 'report.html'}\n")
    (shown,) = verdicts(flown)
    assert shown.startswith('bad"') and f"Forged: {verdict}" in shown
    code, out, _ = run(capsys, flown, "--json")
    assert (code, json.loads(out)["forged"]) == (1, verdict)
    flight = heli.load(flown)
    assert (flight.verdict, flight.exit_code) == (verdict, 1)
    again = shutil.copytree(flown, flown.with_name("again"))
    assert cli.main(["diff", str(flown), str(again), "--out", str(flown / "d.html")]) == 1
    assert f"forged: {verdict}" in capsys.readouterr().out


LACKING = {
    # As the bag of a disk that is full.
    "the end": (lambda name, t: t < 6.0, (6.0, 8.0), 1.0 / 3.0),
    "the beginning": (lambda name, t: t >= 5.5, (5.0, 5.5), 2.5 / 3.0),
    "the middle": (lambda name, t: not 6.0 <= t < 6.5, (6.0, 6.5), 2.5 / 3.0),
    "navigation alone": (lambda n, t: n != topics.ODOM or not 6.0 <= t < 6.5, (6.0, 6.5), 2.5 / 3),
    "all navigation": (lambda name, t: name != topics.ODOM, (5.0, 8.0), 0.0),
}


@pytest.mark.parametrize(
    "lacking",
    [pytest.param(one, marks=() if one == "the middle" else pytest.mark.slow) for one in LACKING],
)
def test_a_flight_of_which_a_part_was_recorded_is_partial(capsys, flown, record, lacking):
    """Over what is not there nothing is judged: report, diff and script say how much is there."""
    held, gap_s, share = LACKING[lacking]
    folder = flight_folder(flown.with_name("poor"), record, held)
    code, out, _ = run(capsys, folder, "--json")
    content = json.loads(out)
    assert (code, content["verdict"]) == (1, "partial")
    assert content["coverage"]["first_gap_s"] == pytest.approx(gap_s)
    assert content["coverage"]["share"] == pytest.approx(share)
    code, out, _ = run(capsys, folder)
    assert code == 1 and f"PARTIAL: {content['partial']}\n" in out
    (shown,) = verdicts(folder)
    assert shown.startswith('bad"') and content["partial"] in shown
    flight = heli.load(folder)
    assert (flight.exit_code, flight.verdict) == (1, content["partial"])
    assert flight.coverage == pytest.approx(share)
    words = ["diff", str(flown), str(folder), "--out", str(folder / "d.html"), "--json"]
    assert cli.main(words) == 1
    whole, poor = json.loads(capsys.readouterr().out)["flights"]
    assert (whole["verdict"], whole["coverage"]["share"]) == ("inside", 1.0)
    assert (poor["verdict"], poor["coverage"]) == ("partial", content["coverage"])
    assert content["partial"] in (folder / "d.html").read_text(encoding="utf-8")
    assert heli.diff(flown, folder).partial == {"poor": content["partial"]}


def test_a_few_messages_that_are_missing_are_no_gap(capsys, flown, record):
    folder = flight_folder(flown.with_name("good"), record, lambda name, t: not 6.0 <= t < 6.045)
    code, out, _ = run(capsys, folder, "--json")
    content = json.loads(out)
    assert (code, content["verdict"], content["coverage"]["share"]) == (0, "inside", 1.0)


def test_sums_that_are_missing_are_said(capsys, flown):
    (flown / TRUTH_SUMS).unlink()
    (flown / "graph.yaml").write_text("")
    assert run(capsys, flown)[0] == 0
    text = (flown / "report.html").read_text(encoding="utf-8")
    assert f"{TRUTH_SUMS} " in text and "plant sent" in text


def test_a_plant_that_was_killed_has_not_written_its_last_sums(capsys, flown, record):
    """That is no forgery, but where the flight ended in order it is one."""
    (flown / TRUTH_SUMS).write_bytes(b"".join(sums_of(record)[:-50]))
    assert run(capsys, flown)[0] == 1
    (flown / "result.json").unlink()
    assert run(capsys, flown)[0] == 0
    text = (flown / "report.html").read_text(encoding="utf-8")
    assert "last 50 messages" in text and "plant sent" in text and TRUTH_SUMS not in text


def test_unknown_scenario_is_refused(capsys, full):
    assert "--scenario loop" in refused(capsys, full, "--scenario", "loop")
