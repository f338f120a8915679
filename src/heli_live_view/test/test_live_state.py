# SPDX-License-Identifier: Apache-2.0
"""The live view's state rows: frames by cardinal cases, what is missing or stale, modes, alarms."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatFix

from heli_core.command_line import config_folder
from heli_core.metrics import BY_KEY, hover_errors
from heli_core.parameters import load, with_common
from heli_core.rotations import quat_from_euler
from heli_core.trajectory import Trajectory
from heli_live_view.node import LiveViewNode
from heli_live_view.parameters import BOUNDS, NODE_NAME, TABLE
from heli_live_view.state import History, LiveState, body_row, bounds
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_OFFSET
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.messages import Encoder

S = 1_000_000_000
START_NS = S


def attitude(phi=0.0, theta=0.0, psi=0.0):
    return quat_from_euler(*(math.radians(angle) for angle in (phi, theta, psi)))


def rotated(q_xyzw, v):
    """v turned by a quaternion x, y, z, w, by the textbook's q v q*."""
    u, w = np.array(q_xyzw[:3]), q_xyzw[3]
    v = np.array(v, float)
    return v + 2.0 * np.cross(u, np.cross(u, v) + w * v)


@pytest.mark.parametrize(
    ("psi", "nose_enu", "left_enu"),
    [(0.0, [0, 1, 0], [-1, 0, 0]), (90.0, [1, 0, 0], [0, 1, 0]), (180.0, [0, -1, 0], [1, 0, 0])],
)
def test_nose_and_left_side_point_where_the_heading_says(psi, nose_enu, left_enu):
    row = body_row(np.zeros(3), np.zeros(3), attitude(psi=psi), np.zeros(3))
    np.testing.assert_allclose(rotated(row["q"], [1, 0, 0]), nose_enu, atol=1e-5)
    np.testing.assert_allclose(rotated(row["q"], [0, 1, 0]), left_enu, atol=1e-5)
    np.testing.assert_allclose(rotated(row["q"], [0, 0, 1]), [0, 0, 1], atol=1e-5)
    assert row["euler_deg"][2] % 360.0 == pytest.approx(psi, abs=1e-3)


def test_world_and_body_vectors():
    """At (north 1, east 2, 3 m high), heading east, moving east and climbing."""
    rates = np.radians([1.0, 2.0, 3.0])
    row = body_row(np.array([1.0, 2.0, -3.0]), np.array([0.0, 4.0, -5.0]), attitude(psi=90), rates)
    assert row["p"] == [2.0, 1.0, 3.0]
    assert row["v_enu"] == [4.0, 0.0, 5.0]
    assert row["v_body"] == [4.0, 0.0, 5.0]
    assert row["rates_dps"] == [1.0, 2.0, 3.0]
    sideways = body_row(np.zeros(3), np.array([1.0, 0.0, 0.0]), attitude(psi=90), rates)
    assert sideways["v_body"] == [0.0, 1.0, 0.0]  # north is to the left of a nose to the east


def test_errors_are_the_papers_seen_from_the_reference():
    """A reference to the east: right is south. Upwards is positive on the page."""
    reference = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0, math.radians(90.0)])
    pos, vel = np.array([-0.2, 0.3, -10.1]), np.array([0.22, 0.11, 0.15])
    row = body_row(pos, vel, attitude(), np.zeros(3), reference)
    assert row["error"] == {
        "altitude_m": 0.1, "v_z_mps": -0.15, "v_x_mps": 0.11, "v_y_mps": -0.22, "lateral_m": 0.2,
        "longitudinal_m": 0.3,
    }  # fmt: skip
    scored = hover_errors(pos[None], vel[None], reference[None])
    for name, error in row["error"].items():
        assert abs(error) == pytest.approx(abs(scored[BOUNDS[name]][0]), abs=1e-4)
    assert body_row(pos, vel, attitude(), np.zeros(3))["error"] is None


def test_bounds_are_the_papers_unless_given():
    """The packaged parameters name none: the numbers stand in one place."""
    packaged = config_folder("heli_live_view") / "live_view.yaml"
    common = config_folder("heli_core") / "common.yaml"
    values = load(with_common(TABLE), [common, packaged], NODE_NAME)
    shown = bounds(values)
    assert shown == {name: BY_KEY[key].paper for name, key in BOUNDS.items()}
    assert {f"bounds.{name}" for name in shown} == {n for n in values if n.startswith("bounds.")}
    assert bounds(values | {"bounds.lateral_m": 0.5}) == shown | {"lateral_m": 0.5}


def test_rolled_right_and_nose_up():
    right = body_row(np.zeros(3), np.zeros(3), attitude(phi=30), np.zeros(3))
    assert rotated(right["q"], [0, 1, 0])[2] == pytest.approx(0.5, abs=1e-5)  # left side up
    up = body_row(np.zeros(3), np.zeros(3), attitude(theta=30), np.zeros(3))
    assert rotated(up["q"], [1, 0, 0])[2] == pytest.approx(0.5, abs=1e-5)
    assert right["euler_deg"] == [30.0, 0.0, 0.0] and up["euler_deg"] == [0.0, 30.0, 0.0]


@pytest.fixture
def state():
    return LiveState(START_NS, stale_s=1.0)


def fly(state, wall_s, time_s):
    """All of the graph's topics at a flight time."""
    state.take_clock(START_NS + round(time_s * S), wall_s)
    state.take_arrival(topics.CLOCK, 0, wall_s)
    truth = np.zeros(13)
    truth[2], truth[6] = -10.0, 1.0
    nav = np.zeros(28)
    nav[2], nav[6], nav[22:25] = -10.1, 1.0, [0.1, 0.2, 0.3]
    state.take(topics.TRUTH_ODOM, truth, wall_s)
    state.take(topics.ODOM, nav, wall_s)
    state.take(topics.ATTITUDE_SETPOINT, np.radians([1.0, 2.0, 3.0]), wall_s)
    state.take(topics.ACTUATORS, np.array([0.1, -0.2, 0.3, -0.4]), wall_s)
    state.take(topics.TRUTH_ROTOR, np.radians([1.0, 2.0, 0.0, 0, 0, 0, 0]), wall_s)
    state.take(topics.TRUTH_WIND, np.array([1.0, 2.0, -3.0]), wall_s)
    state.take_arrival(topics.GPS_FIX, START_NS + round(time_s * S) - S // 5, wall_s)
    state.take_arrival(topics.IMU, 0, wall_s)


def test_nothing_has_come(state):
    row = state.row(0.0)
    assert json.loads(json.dumps(row, allow_nan=False)) == row
    for key in ("t", "truth", "nav", "ref", "setpoint_deg", "u", "rotor", "wind_enu", "gps"):
        assert row[key] is None
    assert row["mode"] == "idle" and row["alarms"] == []
    assert {node["state"] for node in row["nodes"].values()} == {"absent"}


def test_a_whole_row(state):
    fly(state, 100.0, 4.0)
    state.take_presence(["plant", "observer", "inner_loop", "outer_loop"], True, 100.0)
    row = state.row(100.1)
    assert row["t"] == 4.0 and row["mode"] == "hover"
    assert row["truth"]["p"] == [0.0, 0.0, 10.0] and row["nav"]["p"] == [0.0, 0.0, 10.1]
    assert row["sigma_p"] == [0.2, 0.1, 0.3]  # east, north, up
    assert row["setpoint_deg"] == [1.0, 2.0, 3.0] and row["u"] == [0.1, -0.2, 0.3, -0.4]
    assert row["rotor_truth"]["a_s_deg"] == 1.0 and row["rotor_truth"]["b_s_deg"] == 2.0
    assert row["wind_enu"] == [2.0, 1.0, 3.0] and row["gps"] == {"age_s": 0.2}
    assert {node["state"] for node in row["nodes"].values()} == {"active"}


def test_the_reference_is_shown_where_it_is_followed(state):
    """The outer loop may have moved it to where the aircraft was when hover engaged."""
    state.take_reference(Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.0))
    fly(state, 100.0, 4.0)
    state.take_status("outer_loop", 0, "position is held", {FACT_OFFSET: "[]"})
    assert state.row(100.1)["ref"]["p"] == [0.0, 0.0, 10.0]
    state.take_status("outer_loop", 0, "position is held", {FACT_OFFSET: "[1.5, -0.5, 0.25]"})
    assert state.row(100.1)["ref"]["p"] == [-0.5, 1.5, 9.75]  # east, north, up


def test_what_is_stale_is_blanked_and_silence_is_named(state):
    fly(state, 100.0, 4.0)
    state.take_presence(["plant", "inner_loop", "outer_loop"], True, 100.0)
    row = state.row(101.5)
    assert row["truth"] is None and row["u"] is None and row["mode"] == "idle"
    assert row["nodes"]["plant"]["state"] == "inactive"
    state.take_presence(["plant"], True, 101.5)
    lost = state.row(101.5)["nodes"]["inner_loop"]
    assert lost["state"] == "lost" and lost["level"] == 3
    sources = {alarm["source"] for alarm in state.row(101.5)["alarms"]}
    assert {"inner_loop", "outer_loop"} <= sources


def test_without_setpoints_attitude_is_held(state):
    fly(state, 100.0, 4.0)
    state.forget(topics.ATTITUDE_SETPOINT)
    assert state.row(100.1)["mode"] == "attitude"
    texts = [event.text for event in state.take_events()]
    assert "mode: attitude" in texts


def test_the_end_stays_on_show(state):
    fly(state, 100.0, 4.0)
    message = "flight over after 4 s"
    state.take_status("plant", 0, message, {"over": "true"})
    row = state.row(200.0)
    assert row["mode"] == "over" and row["truth"] is not None
    assert row["nodes"]["plant"] == {"state": "ended", "level": 0, "message": message}
    assert row["alarms"] == [] and row["end"] == {"kind": "over", "text": message}


CAUSE = "The aircraft hit the ground."


def test_a_loss_is_told_with_its_cause(state):
    fly(state, 100.0, 4.0)
    state.row(100.0)
    state.take_status("plant", 2, CAUSE, {"over": "true"})
    row = state.row(100.1)
    assert row["end"] == {"kind": "lost", "text": CAUSE}
    assert row["mode"] == "over"
    assert {"level": 2, "source": "plant", "text": CAUSE} in row["alarms"]


def test_a_loss_after_the_hold_was_given_up_says_so(state):
    fly(state, 100.0, 4.0)
    state.row(100.0)
    state.forget(topics.ATTITUDE_SETPOINT)
    row = state.row(100.1)
    assert row["mode"] == "attitude" and row["end"] is None
    assert [(a["level"], a["source"]) for a in row["alarms"]] == [(1, "mode")]
    state.take_clock(START_NS + 23 * S, 119.0)
    state.take_status("plant", 2, CAUSE, {"over": "true"})
    ending = state.row(119.1)["end"]["text"]
    assert ending.endswith("Nothing had held position and altitude for 19 s.")
    events = {event.text: event.level for event in state.take_events()}
    assert events["mode: attitude"] == 1 and events[CAUSE] == 2


def test_who_is_stopped_before_the_end_says_interrupted(state):
    state.interrupt()
    assert state.row(0.0)["end"] is None  # nothing had begun
    fly(state, 100.0, 4.0)
    state.interrupt()
    row = state.row(100.1)
    assert row["end"]["kind"] == "interrupted" and row["truth"] is not None


def test_who_is_stopped_after_the_end_leaves_it_as_it_was(state):
    fly(state, 100.0, 4.0)
    state.take_status("plant", 2, "The aircraft rolled over.", {"over": "true"})
    state.interrupt()
    assert state.row(100.1)["end"]["kind"] == "lost"


def test_a_plant_that_left_without_a_word_has_ended_the_flight(state):
    fly(state, 100.0, 4.0)
    state.take_presence(["plant", "observer"], True, 100.0)
    state.take_presence(["observer"], True, 100.5)
    assert state.row(100.5)["mode"] != "over"  # it may only be late to be seen again
    state.take_presence(["observer"], True, 101.5)
    row = state.row(101.5)
    assert row["mode"] == "over" and row["truth"] is not None
    assert row["end"]["kind"] == "silent" and "without a word" in row["end"]["text"]
    assert [event.level for event in state.take_events() if event.source == "plant"] == [2]


@pytest.mark.parametrize(("truth_is_sent", "over"), [(True, False), (False, True)])
def test_a_flight_that_is_over_before_its_names_have_come_has_an_end(state, truth_is_sent, over):
    """Without names: not known yet, or gone already? Who sends the truth tells."""
    fly(state, 100.0, 4.0)
    state.take_presence([], truth_is_sent, 101.5)
    assert (state.row(101.5)["mode"] == "over") == over


def test_another_flight_begins_anew(state):
    fly(state, 100.0, 40.0)
    state.take_status("plant", 0, "flight over", {"over": "true"})
    assert state.take_clock(START_NS, 150.0)
    row = state.row(150.0)
    assert row["end"] is None and row["truth"] is None
    assert not state.take_clock(START_NS + S // 100, 150.01)


def test_warnings_become_alarms_and_events(state):
    state.take_status("observer", 1, "no GPS", {})
    state.take_status("observer", 1, "no GPS", {})
    alarm = {"level": 1, "source": "observer", "text": "no GPS"}
    assert state.row(0.0)["alarms"] == [alarm]
    assert [event.message() for event in state.take_events()] == [
        {"type": "event", "t": None, **alarm}
    ]


def test_real_time_factor(state):
    for i in range(100):
        state.take_clock(START_NS + round(i * 0.02 * S), i * 0.04)
    assert state.real_time_factor() == pytest.approx(0.5, rel=1e-6)


def test_reference_between_way_points():
    points = np.zeros((2, 7))
    points[1, 2], points[0, 5], points[:, 6] = -10.0, -1.0, 0.5
    trajectory = Trajectory(2 * S, np.array([0, 10 * S]), points)
    np.testing.assert_allclose(trajectory.at(6 * S), [0, 0, -4, 0, 0, -1, 0.5])
    np.testing.assert_allclose(trajectory.at(S), [0, 0, 0, 0, 0, 0, 0.5])
    np.testing.assert_allclose(trajectory.at(99 * S), [0, 0, -10, 0, 0, 0, 0.5])


def test_history_is_thin_and_bounded_and_whole():
    history = History(limit=100)
    for i in range(30_000):  # a thousand seconds at 30 Hz
        if history.wants(i / 30.0):
            history.add(i / 30.0, str(i))
    times = np.array([int(row) for row in history.rows]) / 30.0
    assert len(times) <= 100
    assert times[0] == 0.0 and times[-1] > 970.0
    assert np.diff(times).min() >= 0.1
    short = History()
    for i in range(300):
        if short.wants(i / 30.0):
            short.add(i / 30.0, "")
    assert len(short.rows) == 100


def test_a_message_without_a_fix_is_none(state):
    """What a receiver says in an outage keeps the age of the last fix growing."""
    place = datum(1.0, 2.0, 3.0)
    encode = Encoder(topics.GPS_FIX, datum=place).encode
    node = SimpleNamespace(
        core=SimpleNamespace(newest={}, decoders={}, screen=SimpleNamespace(live=state)),
        _deserialize=lambda name, raw: deserialize_message(raw, NavSatFix),
        _count_every=lambda: None,
    )
    ages = []
    for time_s, position in ((0.0, 0.0), (0.2, np.nan), (0.4, np.nan), (0.6, 0.0)):
        stamp_ns = START_NS + round(time_s * S)
        state.take_clock(stamp_ns, time_s)
        node.core.newest[topics.GPS_FIX] = encode(np.full(3, position), stamp_ns)
        LiveViewNode._take_newest(node, time_s)
        ages.append(state.row(time_s)["gps"]["age_s"])
    assert ages == pytest.approx([0.0, 0.2, 0.4, 0.0], abs=1e-3)
