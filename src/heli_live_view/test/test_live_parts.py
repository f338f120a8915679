# SPDX-License-Identifier: Apache-2.0
"""Parts of the live view without ROS: token, scene, plans of commands, Foxglove's layout."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_live_view import access, commands, scene
from heli_live_view.access import Access
from heli_live_view.state import LiveState, body_row
from heli_msgs_bridge import topics
from heli_msgs_bridge import topics as frame_ids

S = 1_000_000_000
CONFIG = Path(__file__).resolve().parents[1] / "config"
LIMITS = commands.CommandLimits(2.0, 100.0, 100.0, 2.0, 1.0, 10.0, 10.0, 20.0)


class TestToken:
    def test_view_only_without_a_token(self):
        assert Access("").refusal("", "a", 0.0) == access.VIEW_ONLY

    def test_first_browser_claims_it(self):
        token = access.new_token()
        gate = Access(token)
        assert len(token) >= 32 and token != access.new_token()
        assert gate.refusal("guess", "b", 0.0) == access.WRONG
        assert gate.refusal(token, "a", 0.0) == ""
        assert gate.refusal(token, "b", 0.0) == access.TAKEN
        assert gate.refusal(token, "a", 9.0) == ""

    @pytest.mark.parametrize("wrong", [None, 7, [], {}, "", "\N{SNOWMAN}", "\ud800"])
    def test_whatever_is_not_the_token_is_wrong(self, wrong):
        assert Access("token").refusal(wrong, "a", 0.0) == access.WRONG

    def test_guessing_is_slowed_down_but_not_the_owner(self):
        gate = Access("token")
        assert gate.refusal("token", "owner", 0.0) == ""
        for _ in range(5):
            assert gate.refusal("guess", "b", 1.0) == access.WRONG
        assert gate.refusal("token", "b", 2.0) == access.SLOW_DOWN
        assert gate.refusal("token", "owner", 2.0) == ""
        assert gate.refusal("guess", "b", 32.0) == access.WRONG

    def test_who_guesses_keeps_nobody_out_who_knows_it(self):
        gate = Access("token")
        for _ in range(100):
            gate.refusal("guess", "b", 1.0)
        assert gate.refusal("guess", "b", 1.0) == access.SLOW_DOWN
        assert gate.refusal("token", "owner", 1.0) == ""


def normal(q_wxyz):
    return quat_to_R_nb(np.asarray(q_wxyz)) @ [0.0, 0.0, 1.0]


class TestScene:
    BODY = body_row(
        np.array([3.0, 4.0, -10.0]), np.zeros(3), quat_from_euler(0.0, 0.0, 0.0), np.zeros(3)
    )

    def test_disc_tilts_with_the_thrust(self):
        """The plant's thrust along body x, y (FRD) is (-T sin a_s, T sin b_s): FLU (-a_s, -b_s)."""
        np.testing.assert_allclose(
            normal(scene.disc_tilt(0.1, 0.0)), [-0.0998, 0, 0.995], atol=1e-3
        )
        np.testing.assert_allclose(
            normal(scene.disc_tilt(0.0, 0.1)), [0, -0.0998, 0.995], atol=1e-3
        )

    def test_helicopter_stands_over_its_shadow_and_its_tail_behind(self):
        shapes = {s.name: s for s in scene.vehicle(self.BODY, None, 0.0, 0.7)}
        assert shapes["rotor_disc"].position == pytest.approx((4.0, 3.0, 10.0 + 0.48 * 0.7))
        assert shapes["tail_boom"].position[1] < 3.0  # the nose points north
        assert scene.shadow(self.BODY, 0.7).position[:2] == (4.0, 3.0)

    def test_blades_turn(self):
        one, two = (
            next(s for s in scene.vehicle(self.BODY, None, t, 0.7) if s.name == "blades")
            for t in (0.0, 0.1)
        )
        assert one.quaternion != two.quaternion and one.position == two.position

    def test_wind_arrow_points_where_the_air_goes(self):
        arrow = scene.wind_arrow(self.BODY, [1.0, -2.0, 0.5], 0.7)
        assert arrow.points[1] == pytest.approx((0.4, -0.8, 0.2))

    def test_heading_of_the_reference_is_clockwise_from_north(self):
        arrow = scene.reference({"p": [0.0, 0.0, 10.0], "yaw_deg": 90.0})[1]
        assert arrow.points[1] == pytest.approx((0.8, 0.0, 0.0))

    def test_trail_is_bounded_and_begins_anew(self):
        trail = scene.Trail()
        assert trail.shape() is None
        for i in range(10_000):
            trail.add(i / 30.0, [float(i), 0.0, 0.0])
        assert len(trail.shape().points) == 600
        trail.add(0.0, [0.0, 0.0, 0.0])
        assert trail.shape() is None

    def test_names_are_unique_and_empty_rows_draw_nothing(self):
        assert scene.moving(LiveState(S, 1.0).row(0.0), 0.7) == []
        names = [s.name for s in scene.vehicle(self.BODY, None, 0.0, 1.0) + scene.ground(self.BODY)]
        assert len(names) == len(set(names))


class TestPlan:
    def test_gust_from_the_east_blows_west(self):
        assert commands.Gust(5.0, 90.0, 2.0).amplitude_ned_mps() == pytest.approx([0.0, -5.0, 0.0])
        assert commands.Gust(5.0, 0.0, 2.0).amplitude_ned_mps() == pytest.approx([-5.0, 0.0, 0.0])

    PRESENT = {
        "wind.gust.start_s": [0.0, 9.0, 5.0],
        "wind.gust.duration_s": [1.0, 4.0, 99.0],
        "wind.gust.amplitude_mps": [9.0, 9.0, 9.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0],
        "wind.gust.frame": "ned",
    }

    def test_a_gust_joins_those_that_blow(self):
        values, start_s = commands.with_gust(self.PRESENT, commands.Gust(5.0, 180.0, 2.0), 10.0)
        assert values["wind.gust.start_s"] == [9.0, start_s] and 10.0 < start_s < 10.5
        assert values["wind.gust.duration_s"] == [4.0, 2.0]
        assert values["wind.gust.amplitude_mps"] == pytest.approx([1.0, 2.0, 3.0, 5.0, 0.0, 0.0])

    def test_no_mixture_of_axes(self):
        body = {**self.PRESENT, "wind.gust.frame": "body"}
        with pytest.raises(commands.CommandError, match="13.0 s"):
            commands.with_gust(body, commands.Gust(5.0, 180.0, 2.0), 10.0)
        assert (
            commands.with_gust(body, commands.Gust(5.0, 0.0, 2.0), 14.0)[0]["wind.gust.frame"]
            == "ned"
        )

    @pytest.mark.parametrize(
        ("args", "named"),
        [
            ({"amplitude_mps": 11, "from_deg": 0, "duration_s": 2}, "amplitude_mps: 11 .* 0 to 10"),
            ({"amplitude_mps": "5", "from_deg": 0, "duration_s": 2}, "amplitude_mps: '5'"),
            ({"amplitude_mps": True, "from_deg": 0, "duration_s": 2}, "amplitude_mps: True"),
            ({"amplitude_mps": 5, "from_deg": float("nan"), "duration_s": 2}, "from_deg: nan"),
            ({"amplitude_mps": 5, "from_deg": 0}, "duration_s: None"),
            ({"amplitude_mps": 10**400, "from_deg": 0, "duration_s": 2}, "amplitude_mps: 1000"),
        ],
    )
    def test_gusts_are_judged(self, args, named):
        with pytest.raises(commands.CommandError, match=named):
            commands.judge_gust(args, LIMITS)

    @pytest.mark.parametrize(
        ("p", "yaw", "named"),
        [
            ([0, 0, 1.9], 0, "altitude: 1.9 .* 2 to 100 m"),
            ([0, 0, 101], 0, "altitude: 101"),
            ([80, 80, 10], 0, "113 m from where the flight began; allowed: at most 100 m"),
            ([0, 0], 0, "p: "),
            ("here", 0, "p: 'here'"),
            ([0, float("inf"), 10], 0, "north: inf"),
            ([0, 0, 10], None, "yaw_deg: None"),
        ],
    )
    def test_references_are_judged(self, p, yaw, named):
        with pytest.raises(commands.CommandError, match=named):
            commands.judge_reference({"p": p, "yaw_deg": yaw}, LIMITS, np.zeros(3))

    def test_modes_are_judged(self):
        assert commands.judge_mode({"mode": "hover"}) == "hover"
        with pytest.raises(commands.CommandError, match="'fast' is not allowed; allowed: hover or"):
            commands.judge_mode({"mode": "fast"})

    def test_a_move_is_straight_slow_and_without_a_jump(self):
        """From within an earlier move: the past stays, position and heading are continuous."""
        begin = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0, np.radians(170.0)])
        first = commands.judge_reference({"p": [0, 20, 10], "yaw_deg": 170}, LIMITS, np.zeros(3))
        before, _ = commands.move(None, begin, first, 100 * S, LIMITS)
        now_ns = 105 * S
        start = before.at(now_ns)
        target = commands.judge_reference({"p": [6, 10, 16], "yaw_deg": -170}, LIMITS, np.zeros(3))
        points, length_s = commands.move(before, start, target, now_ns, LIMITS)
        for back_s in (4.9, 2.0, 0.01):
            stamp_ns = now_ns - round(back_s * S)
            np.testing.assert_allclose(points.at(stamp_ns)[:3], before.at(stamp_ns)[:3], atol=1e-9)
        stamps = now_ns + np.arange(0, round((length_s + 1.0) * 100)) * (S // 100)
        rows = np.array([points.at(int(stamp)) for stamp in stamps])
        speed = np.diff(rows[:, :3], axis=0) * 100.0
        assert np.hypot(speed[:, 0], speed[:, 1]).max() <= LIMITS.speed_mps + 1e-6
        assert np.abs(speed[:, 2]).max() <= LIMITS.climb_mps + 1e-6
        moving = rows[:-1, 3:6].any(axis=1)
        np.testing.assert_allclose(rows[:-1, 3:6][moving], speed[moving], atol=1e-5)
        turn = np.degrees(np.unwrap(rows[:, 6]))
        assert turn[-1] - turn[0] == pytest.approx(20.0, abs=1e-6)  # the short way, over south
        assert np.abs(np.diff(turn)).max() <= 1.0 + 1e-6
        np.testing.assert_allclose(rows[-1], target, atol=1e-9)


def test_foxglove_layout_shows_topics_that_exist():
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text())
    panels = layout["configById"]

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)
    known = {f"/{topic.name.lstrip('/')}" for topic in topics.TABLE}
    ref = dict.fromkeys(("p", "v", "yaw_deg"))
    row = LiveState(S, 1.0).row(0.0) | {"truth": TestScene.BODY, "nav": TestScene.BODY, "ref": ref}
    for name, panel in panels.items():
        for path in panel.get("paths", []):
            topic, *fields = re.split(r"\.", path["value"])
            if topic == "/live_state":
                part = row
                for key in (field.split("[")[0] for field in fields):
                    assert key in part, path
                    part = part[key]
            else:
                assert topic in known, path
        if name.startswith("3D"):
            assert list(panel["topics"]) == [f"/{topics.SCENE}"]
        assert panel.get("topicToRender", "/diagnostics") in known


def test_rviz_shows_topics_and_frames_that_exist_as_they_are_sent():
    """Names, and a durability and reliability with which the two meet."""
    manager = yaml.safe_load((CONFIG / "flight.rviz").read_text())["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == frame_ids.MAP
    assert manager["Views"]["Current"]["Target Frame"] == frame_ids.BASE
    shown = [d.get("Topic") or d.get("Description Topic") for d in manager["Displays"]]
    names = {topic["Value"].strip("/") for topic in shown if topic}
    assert names == {topics.SCENE, topics.ODOM, topics.ROBOT_DESCRIPTION}
    for topic in filter(None, shown):
        latched = topics.qos(topic["Value"].strip("/")).durability.name == "TRANSIENT_LOCAL"
        wanted = "Transient Local" if latched else "Volatile"
        assert topic["Durability Policy"] == wanted, topic
