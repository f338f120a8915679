# SPDX-License-Identifier: Apache-2.0
"""`heli score` on bags: ours, others', and what cannot be scored."""

import json
import math
import re
import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy import signal
from scipy.optimize import brentq

from heli_bags.opening import opened
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.ticks import NS_PER_S
from heli_flight.cli import app as cli
from heli_flight.flight_file import write_parameters
from heli_flight.graph.bag_record import TRUTH_SUMS
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.signatures import checksum
from support.handling_flights import vertical
from support.record_bag import flown_folder

EVERY_S = 0.02
START_NS = 1_700_000_000_000_000_000
HEADING = 0.7


def motion(drift_m):
    """Position NED of a hover of 40 s that drifts north and back; heading 0.7 rad."""
    t = np.arange(0.0, 40.0, EVERY_S)
    north = drift_m * np.sin(np.pi * t / 40.0) ** 8
    return t, np.column_stack([north, 0.0 * t, 0.0 * t - 10.0])


def write_bag(folder, names, drift_m=0.5, flown=None, start_ns=START_NS):
    """A bag with the hover, or another motion (times, positions), on each of the topics."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kind = topics.BY_NAME[topics.TRUTH_ODOM].type
    t, pos = motion(drift_m) if flown is None else flown
    vel = np.gradient(pos, EVERY_S, axis=0)
    quat = quat_from_euler(0.02, -0.01, HEADING)
    encoder = Encoder(topics.TRUTH_ODOM)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        lines = [writer.add_connection(name, kind, typestore=store) for name in names]
        string = writer.add_connection("/words", "std_msgs/msg/String", typestore=store)
        words = store.serialize_cdr(
            store.types["std_msgs/msg/String"]("hello"), "std_msgs/msg/String"
        )
        writer.write(string, START_NS, words)
        for k in range(t.size):
            body = quat_to_R_nb(quat).T @ vel[k]
            row = np.concatenate([pos[k], body, quat, np.zeros(3)])
            stamp = start_ns + round(t[k] * 1e9)
            for line in lines:
                writer.write(line, stamp, encoder.encode(row, stamp))
    return folder


OMEGA, DAMPING = 6.0, 0.7


def write_sweep(folder, held=lambda name, time_s: True, start_ns=START_NS):
    """A sweep of the roll setpoint through a second-order lag; negated, as a vector's x.

    Of each topic what was held of it, by its name and the time.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    t = np.arange(0.0, 80.0, EVERY_S)
    swept = 0.1 * signal.chirp(t, 0.1, t[-1], 4.0, method="logarithmic", phi=-90.0)
    lag = signal.lti([OMEGA**2], [1.0, 2.0 * DAMPING * OMEGA, OMEGA**2])
    _, roll, _ = signal.lsim(lag, swept, t)
    names = (topics.TRUTH_ODOM, topics.ATTITUDE_SETPOINT, topics.TRUTH_WIND)
    encoders = [Encoder(name) for name in names]
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        lines = [
            writer.add_connection(f"/{name}", topics.BY_NAME[name].type, typestore=store)
            for name in names
        ]
        for k, stamp in enumerate((start_ns + np.round(1e9 * t)).astype(int).tolist()):
            still = np.zeros(6)
            rows = (
                np.concatenate([still, quat_from_euler(roll[k], 0.0, 0.0), np.zeros(3)]),
                np.array([swept[k], 0.0, 0.0]),
                np.array([0.0, -swept[k], 0.0]),  # NED: its x in ENU
            )
            for name, line, encoder, row in zip(names, lines, encoders, rows, strict=True):
                if held(name, t[k]):
                    writer.write(line, stamp, encoder.encode(row, stamp))
    return folder


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    climbs = {"whole": vertical(), "hasty": vertical(stay_s=0.5)}
    return {
        **{
            name: write_bag(folder / name, ["/odom"], flown=(climb.time_s, climb.pos_ned_m))
            for name, climb in climbs.items()
        },
        "ours": write_bag(folder / "ours", ["/heli/ground_truth/odom", "/heli/odom"]),
        "other": write_bag(folder / "other", ["/vicon/odometry"], drift_m=1.2),
        "two": write_bag(folder / "two", ["/a", "/b"]),
        "sweep": write_sweep(folder / "sweep"),
        "none": write_bag(folder / "none", []),
    }


def run(capsys, *words):
    """Exit code, stdout, stderr."""
    code = cli.main(["score", *map(str, words)])
    return code, *capsys.readouterr()


def test_ours_by_ground_truth_with_a_picture(bags, capsys, tmp_path):
    picture = tmp_path / "hover.png"
    code, out, _ = run(capsys, bags["ours"], "--mte", "hover", "--plot", picture)
    # A hold within the bounds, but no approach before it.
    assert code == 1
    assert re.search(r"\bdesired, .*\bdefined", out) and "/heli/ground_truth/odom" in out
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("drift_bag", "target", "level", "worst_m"),
    [("ours", (0, 0, 10), "desired", 0.5), ("other", (0, 0, 10), "adequate", 1.2)],
)
def test_the_drift_in_the_bag_is_the_one_measured(bags, capsys, drift_bag, target, level, worst_m):
    code, out, _ = run(capsys, bags[drift_bag], "--mte", "hover", "--target", *target, "--json")
    content = json.loads(out)
    assert (code, content["level"], content["schema"]) == (1, level, 1)
    assert not content["complete"]
    assert content["start_ns"] == START_NS
    position = content["criteria"][1]
    # The larger of the components along the nose and to its right.
    assert position["value"] == pytest.approx(worst_m * math.cos(HEADING), rel=0.01)
    assert position["worst_at_s"] == pytest.approx(20.0, abs=0.1)


def test_exit_code_0_is_for_a_manoeuvre_as_it_is_defined(bags, capsys):
    """Without its stay at the top a flight may be as good, but it is not the manoeuvre."""
    code, out, _ = run(capsys, bags["whole"], "--mte", "vertical", "--json")
    content = json.loads(out)
    assert (code, content["level"], content["complete"]) == (0, "desired", True)
    code, out, _ = run(capsys, bags["hasty"], "--mte", "vertical", "--json")
    content = json.loads(out)
    assert (code, content["level"], content["complete"]) == (1, "desired", False)


def test_a_flight_of_ours_is_scored_by_where_it_was_to_be_flown(bags, capsys, tmp_path):
    """Its own params.yaml says where and when; options come first."""
    overrides = {"scenario": {"path.scale": "full", "path.start_s": 5.0, "duration_s": 60.0}}
    write_parameters(resolve("mte_vertical", overrides=overrides), tmp_path / "params.yaml")
    shutil.copytree(bags["whole"], tmp_path / "bag")

    def position(*words):
        _, out, _ = run(capsys, tmp_path, "--mte", "vertical", *words, "--json")
        content = json.loads(out)
        (criterion,) = (c for c in content["criteria"] if c["name"] == "position")
        remarks = [r for r in content["remarks"] if "params.yaml" in r]
        return criterion["value"], content["phases"][0]["start_s"], remarks

    start = resolve("mte_vertical").scenario.reference.points[-1]
    north, east = start[:2]
    as_flown, begins_s, remarks = position()
    (remark,) = remarks
    assert f"{east:.2f} {north:.2f} {-start[2]:.2f}" in remark and " 2 s " in remark
    assert begins_s >= 2.0
    assert as_flown == position("--target", east, north, -start[2], "--start", 2)[0]
    moved, _, remarks = position("--target", 1, 0, 10)
    assert moved != as_flown and not remarks
    assert not position("--scale", "froude")[2]  # not the manoeuvre that was to be flown


def test_neither_is_exit_code_1(bags, capsys):
    code, out, _ = run(capsys, bags["ours"], "--mte", "hover", "--scale", "froude",
                       "--target", 3, 0, 10, "--json")  # fmt: skip
    content = json.loads(out)
    assert (code, content["level"]) == (1, "neither")
    assert content["scale"]["length_ratio"] == pytest.approx(1.41 / 16.36)
    assert any("packaged aircraft" in remark for remark in content["remarks"])


def test_a_sweep_of_the_setpoint_gives_the_bandwidth(bags, capsys, tmp_path):
    picture = tmp_path / "bode.png"
    code, out, _ = run(capsys, bags["sweep"], "--response", "--json", "--plot", picture)
    content = json.loads(out)
    assert (code, content["schema"], content["response"]) == (0, 1, "roll")
    measures = {m["name"]: m for m in content["measures"]}
    # At -135 deg the lag's tangent is 1: w^2 - 2 d W w - W^2 = 0.
    expected = OMEGA * (DAMPING + math.sqrt(DAMPING**2 + 1.0))
    assert measures["bandwidth"]["value"] == pytest.approx(expected, rel=0.05)
    assert measures["neutral"]["value"] is None
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_a_disturbance_gives_its_rejection(bags, capsys):
    """S = 1 - lag: the lag answers the setpoint, the disturbance is the same, negated."""
    topic = "/ground_truth/wind:vector.x"
    code, out, _ = run(capsys, bags["sweep"], "--response", "--disturbance", topic, "--json")
    measures = {m["name"]: m for m in json.loads(out)["measures"]}

    def gain_db(omega):
        s = 1j * omega
        lag = OMEGA**2 / (s**2 + 2.0 * DAMPING * OMEGA * s + OMEGA**2)
        return 20.0 * math.log10(abs(1.0 - lag))

    expected = brentq(lambda omega: gain_db(omega) + 3.0, 0.5, 6.0)
    assert measures["drb"]["value"] == pytest.approx(expected, rel=0.05)
    assert (code, measures["drb"]["level"], measures["drp"]["level"]) == (0, "Level 1", "Level 1")
    code, out, _ = run(capsys, bags["sweep"], "--response", "--disturbance", topic,
                       "--scale", "froude", "--rotor-diameter", "0.4")  # fmt: skip
    assert code == 1 and "below" in out


def test_ground_truth_that_the_plant_did_not_send_is_exit_code_1(bags, capsys, tmp_path):
    """A manoeuvre as it is defined, but somebody else has sent one of its messages."""
    climb = vertical()
    motion = climb.time_s, climb.pos_ned_m
    write_bag(tmp_path / "bag", ["/ground_truth/odom"], flown=motion, start_ns=NS_PER_S)
    ordered = resolve(duration_s=climb.time_s.size * EVERY_S)
    write_parameters(ordered, tmp_path / "params.yaml")
    (tmp_path / "result.json").write_text("{}")
    with opened(tmp_path / "bag") as reader:
        lines = [line for line in reader.connections if line.topic == "/ground_truth/odom"]
        raw = [message for _, _, message in reader.messages(lines)]
    # A message every other tick: the sums between them are of messages that were lost.
    sums = [b"".join((checksum(message), bytes(8))) for message in raw]
    (tmp_path / TRUTH_SUMS).write_bytes(b"".join(sums))
    words = (tmp_path, "--mte", "vertical", "--target", 0, 0, 10)
    code, out, _ = run(capsys, *words, "--json")
    assert (code, json.loads(out)["forged"]) == (0, "")
    sums[7] = bytes(16)
    (tmp_path / TRUTH_SUMS).write_bytes(b"".join(sums))
    code, out, _ = run(capsys, *words)
    assert code == 1 and "FORGED: ground_truth/odom " in out
    assert f" 1 of {len(raw)} " in out and " 0.14 s" in out


def cut(track, begin_s, end_s):
    """Times and positions of a track without what is between two times."""
    kept = (track.time_s < begin_s) | (track.time_s >= end_s)
    return track.time_s[kept], track.pos_ned_m[kept]


def scored(capsys, bag, *words):
    """Exit code, JSON and text of a score."""
    code, out, _ = run(capsys, bag, *words, "--json")
    told = run(capsys, bag, *words)
    assert told[0] == code
    return code, json.loads(out), told[1]


@pytest.mark.parametrize("missing_s", [(12.0, 14.0), (0.3, 0.6)])
def test_a_manoeuvre_with_a_gap_is_partial(capsys, tmp_path, missing_s):
    """What was flown in the gap nobody knows."""
    bag = write_bag(tmp_path / "gap", ["/odom"], flown=cut(vertical(), *missing_s))
    code, content, text = scored(capsys, bag, "--mte", "vertical")
    assert code == 1
    assert content["coverage"]["first_gap_s"] == pytest.approx(missing_s, abs=EVERY_S)
    assert content["coverage"]["share"] < 1.0
    assert f"PARTIAL: {content['partial']}" in text


def test_a_manoeuvre_is_asked_for_as_long_as_its_flight_was_ordered(capsys, tmp_path):
    """A disk that was full before the end; the same bag alone is of a flight that ended there."""
    climb = vertical()
    last_s = float(climb.time_s[-1])
    motion = climb.time_s, climb.pos_ned_m
    write_bag(tmp_path / "bag", ["/ground_truth/odom"], flown=motion, start_ns=NS_PER_S)
    assert scored(capsys, tmp_path, "--mte", "vertical")[0] == 0
    write_parameters(resolve(duration_s=last_s + 5.0), tmp_path / "params.yaml")
    code, content, _ = scored(capsys, tmp_path, "--mte", "vertical")
    assert code == 1
    assert content["coverage"]["first_gap_s"] == pytest.approx([last_s, last_s + 5.0], abs=0.1)
    # What is asked for by its times is judged by these.
    code, content, _ = scored(capsys, tmp_path, "--mte", "vertical", "--end", last_s)
    assert (code, content["partial"]) == (0, "")


def test_a_flight_that_was_recorded_late_is_scored_at_its_own_times(capsys, tmp_path):
    climb = vertical()
    motion = cut(climb, 0.0, 1.0)
    write_bag(tmp_path / "bag", ["/ground_truth/odom"], flown=motion, start_ns=NS_PER_S)
    write_parameters(resolve(duration_s=float(climb.time_s[-1])), tmp_path / "params.yaml")
    _, content, _ = scored(capsys, tmp_path, "--mte", "vertical")
    assert content["coverage"]["first_gap_s"] == pytest.approx([-1.0, 0.0])


@pytest.mark.parametrize("silent", [topics.TRUTH_ODOM, topics.ATTITUDE_SETPOINT])
def test_a_response_with_a_gap_is_partial(capsys, tmp_path, silent):
    """Straight lines over the gap are no answer of the aircraft, nor what was swept."""
    bag = write_sweep(tmp_path / "gap", lambda name, t: name != silent or not 30.0 <= t < 31.0)
    code, content, text = scored(capsys, bag, "--response")
    assert code == 1
    assert content["coverage"]["first_gap_s"] == pytest.approx([30.0, 31.0], abs=EVERY_S)
    assert f"PARTIAL: {content['partial']}" in text


@pytest.mark.parametrize("silent", [topics.TRUTH_ODOM, topics.ATTITUDE_SETPOINT])
def test_a_response_is_asked_for_as_long_as_its_flight_was_ordered(capsys, tmp_path, silent):
    write_sweep(tmp_path / "bag", lambda name, t: name != silent or t < 60.0, NS_PER_S)
    assert scored(capsys, tmp_path, "--response")[0] == 0
    write_parameters(resolve(duration_s=80.0), tmp_path / "params.yaml")
    code, content, _ = scored(capsys, tmp_path, "--response")
    assert code == 1
    assert content["coverage"]["first_gap_s"] == pytest.approx([60.0, 80.0], abs=EVERY_S)
    assert content["coverage"]["share"] == pytest.approx(0.75, abs=0.01)


@pytest.mark.parametrize(
    ("bag", "options", "words"),
    [
        ("ours", ["--mte", "howver"], "--mte howver: is none of hover, vertical"),
        ("ours", [], "name one of --mte NAME and --response"),
        ("ours", ["--mte", "hover", "--response"], "name one of --mte NAME and --response"),
        ("ours", ["--response"], "holds no topic attitude_setpoint"),
        ("ours", ["--response", "--axis", "up"], "axis 'up' is none of roll, pitch, yaw"),
        ("ours", ["--response", "--input", "/words"], "name a field, /words:FIELD"),
        ("ours", ["--response", "--input", "/words:data"], "/words has no number data"),
        ("sweep", ["--response", "--axis", "yaw"], "the input does not move"),
        ("ours", ["--mte", "hover", "--scale", "half"], "--scale half: is none of full, froude"),
        ("ours", ["--mte", "hover", "--odom", "/gone"], "holds no topic /gone"),
        ("ours", ["--mte", "hover", "--odom", "/words"], "/words is std_msgs/msg/String"),
        ("ours", ["--mte", "hover", "--end", "20"], "the hold alone 30.0 s"),
        ("ours", ["--mte", "hover", "--start", "70"], "the flight is from 0.00 to 39.98 s"),
        ("ours", ["--mte", "vertical"], "vertical: the flight rises 0.00 m"),
        ("ours", ["--mte", "hover", "--plot", "hover.gif"], "ends in none of .png, .svg, .pdf"),
        ("ours", ["--mte", "hover", "--plot", "gone/a.png"], "its folder does not exist"),
        ("ours", ["--mte", "hover", "--scale", "froude", "--rotor-diameter", "0"], "0.05 to 50 m"),
        ("two", ["--mte", "hover"], "name the odometry by --odom TOPIC; it holds /a, /b"),
        ("none", ["--mte", "hover"], "it holds no nav_msgs/msg/Odometry"),
        ("gone", ["--mte", "hover"], "does not exist"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(bags, capsys, tmp_path, bag, options, words):
    code, out, error = run(capsys, bags.get(bag, tmp_path / "gone"), *options)
    assert (code, out, error.count("\n")) == (2, "", 1)
    assert error.startswith("heli: ") and words in error


def test_our_own_manoeuvre_is_scored_at_the_scale_that_was_flown(tmp_path, capsys):
    """Without --scale: what params.yaml says; the other scale is not what was flown."""
    folder = flown_folder(tmp_path / "flight", resolve("mte_hover"))
    flown = resolve("mte_hover").scenario_parameters["path.scale"]
    answers = {}
    for words in ((), ("--scale", "full"), ("--scale", "froude")):
        _, out, err = run(capsys, folder, "--mte", "hover", *words, "--json")
        assert not err
        answers[words] = json.loads(out)
    content, other = answers[()], answers["--scale", "full" if flown == "froude" else "froude"]
    assert content["complete"] and any("params.yaml" in remark for remark in content["remarks"])
    assert content["scale"] == answers["--scale", flown]["scale"] != other["scale"]
    assert content["level"] == answers["--scale", flown]["level"]
