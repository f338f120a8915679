# SPDX-License-Identifier: Apache-2.0
"""Goto in flight: the reference never jumps, stays within its limits, and is refused in words."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger

from heli_core.errors import PathCause
from heli_core.rows import NAV, REFERENCE, SHAPED
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference, key_of
from heli_msgs_bridge.diagnostics import FACT_WAYS, Level
from heli_msgs_bridge.layouts import CHANNELS
from heli_outer_pd.commands import Commands
from heli_outer_pd.goto import Goto
from heli_outer_pd.modes import RefusalCause
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused, shaped_reference_at
from support.step_climb import step_climb

VALUES = OuterLoopNode.SPEC.resolve()
GOTO = Goto.from_parameters(VALUES)
STEP_NS = VALUES["period_ticks"] * TICK_NS
DT_S = STEP_NS / NS_PER_S
START = np.array([0.0, 0.0, -10.0])
HELD = Trajectory.hover(START, math.radians(170.0))
CLIMB = step_climb(START, 0.3, 8.0, 12.0, 2.5)
AT_NS = 10 * NS_PER_S
FIRST = np.array([20.0, 5.0, -14.0]), math.radians(-170.0)
SECOND = np.array([-3.0, 15.0, -12.0]), math.radians(40.0)


def shaped(trajectory, times_ns):
    rows = np.empty((times_ns.size, SHAPED.size))
    for row, time_ns in zip(rows, times_ns, strict=True):
        shaped_reference_at(
            time_ns - trajectory.start_ns, GOTO.shaping_ns, VALUES["heading_lead_s"],
            trajectory.times_ns, trajectory.points, row,
        )  # fmt: skip
    return rows


def flown(trajectories):
    """What the law follows if each (stamp ns, trajectory known from then on) is heard."""
    times_ns = np.arange(int(6.0 * NS_PER_S), int(60.0 * NS_PER_S), STEP_NS)
    rows = shaped(trajectories[0][1], times_ns)
    for known_ns, trajectory in trajectories[1:]:
        later = times_ns > known_ns
        rows[later] = shaped(trajectory, times_ns[later])
    return times_ns, rows


def steps(rows, part):
    return np.linalg.norm(np.diff(rows[:, part], axis=0), axis=1)


class TestWay:
    @pytest.mark.parametrize("after_s", [0.0, 0.3, 1.01, 3.21, 4.64, 7.5, 20.0])
    def test_a_second_goto_in_the_middle_of_the_first_is_no_jump(self, after_s):
        first = GOTO.plan(HELD, AT_NS, *FIRST)
        again_ns = AT_NS + int(after_s * NS_PER_S)
        second = GOTO.plan(first, again_ns, *SECOND)
        times_ns, rows = flown([(0, HELD), (AT_NS, first), (again_ns, second)])
        # Per period: no more than speed, acceleration and the window's average allow.
        # Axes along and across a way have their own limits.
        assert steps(rows, SHAPED.pos).max() < DT_S * math.sqrt(2.0) * 3.0
        assert steps(rows, SHAPED.vel).max() < DT_S * math.sqrt(3.0) * 1.5
        # The average of a path with corners each 0.04 s has steps of the acceleration.
        assert steps(rows, SHAPED.acc).max() < 0.04 * math.sqrt(3.0) * 1.5 / 0.8 + 1e-3
        turned = np.abs(np.angle(np.exp(1j * np.diff(rows[:, SHAPED.psi]))))
        lead_s = VALUES["heading_lead_s"]
        assert turned.max() < DT_S * math.radians(45.0 + lead_s * 60.0) + math.radians(2.0)
        # What was looked at before is as it was, to the bit.
        until = times_ns[times_ns <= again_ns]
        np.testing.assert_array_equal(
            shaped(first, until)[-2 * NS_PER_S // STEP_NS :],
            shaped(second, until)[-2 * NS_PER_S // STEP_NS :],
        )
        end = rows[-1]
        np.testing.assert_allclose(end[SHAPED.pos], SECOND[0], atol=1e-9)
        assert end[SHAPED.psi] == pytest.approx(SECOND[1])
        assert not end[SHAPED.vel].any() and not end[SHAPED.acc].any()

    def test_limits_are_held_and_the_way_is_straight(self):
        trajectory = GOTO.plan(HELD, AT_NS, *FIRST)
        moving = trajectory.points[trajectory.times_ns > AT_NS]
        vel, h = moving[:-1, REFERENCE.vel], 0.04
        level = np.hypot(*vel[:, :2].T)
        assert level.max() == pytest.approx(3.0, abs=0.02) or vel[:, 2].min() < -1.48
        assert level.max() <= 3.0 + 1e-9 and np.abs(vel[:, 2]).max() <= 1.5 + 1e-9
        acc = np.diff(vel[:-1], axis=0) / h
        assert np.linalg.norm(acc, axis=1).max() <= 1.5 + 1e-6
        jerk = np.diff(acc, axis=0) / h
        assert np.linalg.norm(jerk, axis=1).max() <= 1.5 * 1.01
        along = (FIRST[0] - START) / np.linalg.norm(FIRST[0] - START)
        np.testing.assert_allclose(np.cross(moving[:, REFERENCE.pos] - START, along), 0, atol=1e-9)

    def test_it_turns_the_short_way_over_south(self):
        psi = GOTO.plan(HELD, AT_NS, *FIRST).points[:, REFERENCE.psi]
        assert np.abs(np.degrees(psi)).min() >= 170.0 - 1e-9

    def test_a_climb_is_left_at_its_speed(self):
        trajectory = GOTO.plan(CLIMB, AT_NS, *SECOND)
        _, rows = flown([(0, CLIMB), (AT_NS, trajectory)])
        assert steps(rows, SHAPED.vel).max() < DT_S * (2.5 / 0.8 + math.sqrt(3.0) * 1.5)

    def test_headings(self):
        towards = Goto(GOTO.limits, "towards", GOTO.shaping_ns).plan(HELD, AT_NS, *SECOND)
        psi = towards.points[:, REFERENCE.psi]
        to_goal = math.atan2(15.0, -3.0)
        level = np.hypot(*towards.points[:, REFERENCE.vel][:, :2].T)
        fast = level > 2.9
        np.testing.assert_allclose(psi[fast], to_goal, atol=2e-3)
        assert psi[-1] == pytest.approx(SECOND[1])
        fixed = Goto(GOTO.limits, "fixed", GOTO.shaping_ns).plan(HELD, AT_NS, *SECOND)
        np.testing.assert_allclose(fixed.points[:, REFERENCE.psi], math.radians(170.0))

    def test_a_way_that_leaves_the_fence_though_its_goal_is_inside_is_refused(self):
        fence = ReferenceLimits(2.0, 100.0, 24.0)
        out = GOTO.plan(HELD, AT_NS, np.array([23.0, 0.0, -10.0]), 0.0)
        # At full speed 3 m before the end of a longer way it cannot stop at once.
        far = GOTO.plan(HELD, AT_NS, np.array([60.0, 0.0, -10.0]), 0.0)
        late = next(
            t for t, p in zip(far.times_ns, far.points, strict=True) if p[REFERENCE.pos][0] > 22.5
        )
        with pytest.raises(ReferenceRefused) as caught:
            GOTO.judged(far, int(late), np.array([23.0, 0.0, -10.0]), 0.0, fence, START)
        assert caught.value.cause == RefusalCause.DISTANCE
        assert GOTO.judged(out, AT_NS + 1, np.array([23.0, 0.0, -10.0]), 0.0, fence, START)

    def test_too_long_a_way_is_refused(self):
        slow = Goto.from_parameters(VALUES | {"goto.speed_mps": 0.1})
        with pytest.raises(ReferenceRefused) as caught:
            slow.plan(HELD, AT_NS, np.array([50.0, 0.0, -10.0]), 0.0)
        assert caught.value.cause == PathCause.TOO_LONG


# --- the node ------------------------------------------------------------------------------------


def nav_at(position):
    nav = np.zeros(CHANNELS[topics.ODOM].size)
    nav[NAV.pos], nav[NAV.quat] = position, [1.0, 0.0, 0.0, 0.0]
    return nav


def fly_ticks(outer, ticks, position=START):
    for tick in ticks:
        if tick % 2 == 0:
            outer.send(topics.ROTOR_SPEED, tick, np.array([193.73]))
        outer.send(topics.ODOM, tick, nav_at(position))


def pose(outer, enu=(5.0, 20.0, 14.0), xyzw=(0.0, 0.0, 0.0, 1.0), frame="map", late_s=0.0):
    """A goal stamped with the node's tick; unturned the nose is to the east."""
    message = PoseStamped()
    message.header.frame_id = frame
    stamp_ns = outer.node.stamp_ns(outer.node.tick) + round(late_s * NS_PER_S)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = enu
    q.x, q.y, q.z, q.w = xyzw
    return message


@pytest.fixture
def hovering(bench):
    """The node, flying for 6 s without a reference."""
    outer = bench(OuterLoopNode)
    outer.fly()
    fly_ticks(outer, range(601))
    return outer


def test_a_goto_is_flown_from_what_is_held_and_told_as_a_reference(hovering, monkeypatch):
    sent = []
    monkeypatch.setattr(hovering.node.core, "send_trajectory", sent.append)
    held = hovering.node.run.held
    hovering.receive(topics.GOTO, pose(hovering))
    trajectory = hovering.node.run.diverted
    np.testing.assert_allclose(trajectory.points[-1, REFERENCE.pos], [20.0, 5.0, -14.0], atol=1e-12)
    assert trajectory.points[-1, REFERENCE.psi] == pytest.approx(math.pi / 2.0)
    now_ns = hovering.node.stamp_ns(600)
    np.testing.assert_array_equal(trajectory.at(now_ns), held.at(now_ns))
    before = len(hovering.sent[topics.ATTITUDE_SETPOINT])
    fly_ticks(hovering, range(601, 801))
    attitudes = np.array(hovering.sent[topics.ATTITUDE_SETPOINT])[before:]
    assert attitudes[-1, 1] < attitudes[0, 1] - 0.02, "the goal is north: nose down"
    assert hovering.node.health.facts["reference"] == "goto"
    # Its own reference, heard back, changes nothing; another one takes over.
    (message,) = sent
    since = [[hovering.node.stamp_ns(601), key_of(message)]]
    assert hovering.node.health.facts[FACT_WAYS] == since
    hovering.receive(topics.REFERENCE, message)
    assert hovering.node.run.diverted is trajectory and hovering.node.core.reference is None
    assert not hovering.node.core.unheard_keys
    hovering.receive(topics.REFERENCE, encode_reference(Trajectory.hover(START, 0.0)))
    assert hovering.node.run.diverted is None and hovering.node.core.reference is not None


def test_who_listens_finds_its_sender_before_the_flight(bench):
    """Made by the first goto it was found too late: that goto was missing in the bag."""
    outer = bench(OuterLoopNode)
    outer.node.trigger_configure()
    (sender,) = (p for p in outer.node.publishers if p.topic_name == f"/{topics.REFERENCE}")
    assert sender.qos_profile.depth == topics.BY_NAME[topics.REFERENCE].kept


def test_it_is_over_with_the_activation(hovering):
    hovering.receive(topics.GOTO, pose(hovering))
    hovering.again()
    fly_ticks(hovering, range(700, 705), (3.0, 0.0, -10.0))
    assert hovering.node.run.diverted is None
    held = hovering.node.run.held.points[0, REFERENCE.pos]
    np.testing.assert_array_equal(held, [3.0, 0.0, -10.0])


def hold(outer):
    (service,) = [s for s in outer.node.services if s.service_name == "/hold"]
    return service.callback(Trigger.Request(), Trigger.Response())


def test_hold_stops_along_the_way_and_stays(hovering):
    hovering.receive(topics.GOTO, pose(hovering, enu=(0.0, 60.0, 10.0)))
    fly_ticks(hovering, range(601, 1201))
    trajectory = hovering.node.run.diverted
    answer = hold(hovering)
    halt = hovering.node.run.diverted
    leave_ns = hovering.node.stamp_ns(1200) + NS_PER_S // 2
    speed = trajectory.at(leave_ns)[REFERENCE.vel][0]
    assert speed == pytest.approx(3.0)
    stopped = halt.points[-1, REFERENCE.pos]
    # On half of v times v / a + a / j beyond where the way is left.
    left = trajectory.at(leave_ns)[REFERENCE.pos][0]
    assert stopped[0] == pytest.approx(left + 0.5 * 3.0 * (3.0 / 1.5 + 1.0), abs=0.3)
    assert stopped[1] == pytest.approx(0.0, abs=1e-9)
    assert answer.success
    assert re.findall(r"[\d.]+ m", answer.message) == ["0.00 m", f"{stopped[0]:.2f} m", "10.00 m"]


def test_hold_is_refused_where_nothing_is_held(bench):
    outer = bench(OuterLoopNode)
    assert outer.node.trigger_configure()
    answer = hold(outer)
    assert not answer.success
    assert answer.message == f"hold: {RefusalCause.INACTIVE.value}"
    assert outer.node.trigger_activate()
    assert hold(outer).message == f"hold: {RefusalCause.NO_NAVIGATION_YET.value}"
    fly_ticks(outer, range(8))
    assert hold(outer).success
    np.testing.assert_allclose(outer.node.run.diverted.points[-1, REFERENCE.pos], START)


def publisher(name, number):
    return SimpleNamespace(node_namespace="/", node_name=name, endpoint_gid=[number])


def test_two_pilots_are_followed_and_named(hovering, monkeypatch):
    pilots = {"/goto": [publisher("one", 1), publisher("two", 2), publisher("outer_loop", 3)]}
    look = "get_publishers_info_by_topic"
    monkeypatch.setattr(hovering.node, look, lambda topic: pilots.get(topic, []))
    hovering.receive(topics.GOTO, pose(hovering))
    fly_ticks(hovering, range(601, 701))
    expected = "goto: sent by /one, /two; each goto is followed as it comes"
    assert hovering.node.health.facts["senders.goto"] == expected
    assert "senders.reference" not in hovering.node.health.facts


S = math.sqrt(0.5)


def refused(name, pos_ned_m):
    """The sentence about a place that is refused."""
    with pytest.raises(ReferenceRefused) as caught:
        ReferenceLimits.from_parameters(VALUES).judge_place(name, np.array(pos_ned_m), START)
    return str(caught.value)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"enu": (0.0, 0.0, 1.9)}, refused("the goal", (0.0, 0.0, -1.9))),
        ({"enu": (80.0, 80.0, 10.0)}, refused("the goal", (80.0, 80.0, -10.0))),
        (
            {"enu": (math.nan, 0.0, 10.0)},
            "position [nan, 0.0, 10.0], orientation [0.0, 0.0, 0.0, 1.0]; allowed: finite numbers",
        ),
        ({"frame": ""}, "frame ''; allowed: 'map' (east, north, up)"),
        ({"frame": "map_ned"}, "frame 'map_ned'; allowed: 'map' (east, north, up)"),
        ({"xyzw": (0.0, 0.0, 0.0, 0.0)}, "a quaternion of length 0; allowed: 1"),
        (
            {"xyzw": (S, 0.0, 0.0, S)},
            "an orientation tilted by 90 deg; allowed: level, within 1 deg",
        ),
        (
            {"late_s": -6.0},
            "stamped 1.00 s, behind this node's clock, 7.00 s; allowed: 5 s before it to 0.04 s "
            "after it",
        ),
        (
            {"late_s": 1.0},
            "stamped 8.00 s, ahead of this node's clock, 7.00 s; allowed: 5 s before it to "
            "0.04 s after it",
        ),
    ],
    ids=["low", "far", "nan", "no frame", "ned", "no quaternion", "tilted", "stale", "future"],
)
def test_what_is_refused_is_named_and_leaves_the_flight_as_it_was(hovering, change, sentence):
    hovering.receive(topics.GOTO, pose(hovering, enu=(2.0, 1.0, 10.0)))
    trajectory = hovering.node.run.diverted
    hovering.receive(topics.GOTO, pose(hovering, **change))
    assert hovering.node.run.diverted is trajectory
    health = hovering.node.health
    assert health.level == Level.WARN and health.message.endswith(f": goto: {sentence}")


@pytest.mark.parametrize("topic", [topics.GOTO, topics.COMMAND_POSE])
def test_a_stamp_of_zero_is_now(hovering, topic):
    """As `ros2 topic pub --once` sends it, whose time is not the flight's."""
    message = pose(hovering)
    hovering.receive(topic, message)
    stamped = hovering.node.run.diverted
    hovering.node.run.phases.command("hold", hovering.node.stamp_ns(600), hovering.node.core.nav)
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    hovering.receive(topic, message)
    assert topic not in hovering.node.core.refused
    again = hovering.node.run.diverted
    np.testing.assert_allclose(again.points[-1], stamped.points[-1], atol=1e-12)
    assert again is not stamped


def test_before_the_position_loop_holds_anything_it_is_refused(bench):
    outer = bench(OuterLoopNode)
    assert outer.node.trigger_configure()

    def why():
        outer.receive(topics.GOTO, pose(outer))
        return outer.node.core.refused[topics.GOTO]

    assert why() == f"goto: {RefusalCause.INACTIVE.value}"
    assert outer.node.trigger_activate()
    waits = f"goto: {RefusalCause.NO_NAVIGATION_YET.value}"
    assert why() == waits
    fly_ticks(outer, range(8), np.full(3, np.nan))
    assert why() == waits
    fly_ticks(outer, range(8, 16))
    outer.receive(topics.GOTO, pose(outer))
    assert outer.node.run.diverted is not None


def test_in_the_attitude_test_there_is_no_position_to_go_to(bench):
    outer = bench(OuterLoopNode, horizontal="level")
    outer.fly()
    fly_ticks(outer, range(8))
    with pytest.raises(ReferenceRefused) as caught:
        Commands(outer.node)._goal_of(pose(outer), topics.GOTO)
    assert caught.value.cause is RefusalCause.NO_POSITION_LOOP
    outer.receive(topics.GOTO, pose(outer))
    assert outer.node.core.refused[topics.GOTO] == f"goto: {caught.value}"


def test_in_real_time_a_late_estimate_makes_no_command_early(bench, monkeypatch):
    """The observer cannot run for half a second; who commands has the time of /clock."""
    outer = bench(OuterLoopNode, lockstep=False)
    outer.fly()
    wall_s = [0.0]
    monkeypatch.setattr(outer.node.core.pace, "_now_s", lambda: wall_s[0])
    monkeypatch.setattr(outer.node.core.pace._clock, "_now_s", lambda: wall_s[0])
    for tick in range(200):
        wall_s[0] = tick / 100
        fly_ticks(outer, [tick])
    wall_s[0] += 0.5
    outer.receive(topics.GOTO, pose(outer, late_s=0.5))
    assert topics.GOTO not in outer.node.core.refused
    assert outer.node.run.diverted is not None
    outer.receive(topics.GOTO, pose(outer, late_s=1.0))
    assert "ahead of" in outer.node.core.refused[topics.GOTO]
