# SPDX-License-Identifier: Apache-2.0
"""Commands with an id: answered once, by it, and told of until they have ended."""

import pickle
import re
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped, TwistStamped
from sensor_msgs.msg import NavSatFix
from std_srvs.srv import Trigger

from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_goal, encode_reference, key_of
from heli_msgs_bridge.diagnostics import FACT_GOALS, FACT_WAYS, GoalState, goals_of
from heli_msgs_bridge.layouts import CHANNELS, MessageCause
from heli_msgs_bridge.status import AircraftStatus
from heli_outer_pd.goals import Goals
from heli_outer_pd.modes import Command, Fact, Guard, Phase, RefusalCause
from heli_outer_pd.node import OuterLoopNode

HOVER = np.array([0.0, 0.0, -10.0])
GOAL_ENU = (5.0, 20.0, 14.0)
GOAL_NED = [20.0, 5.0, -14.0]


class Sender:
    """Who sends goals to a node on a bench, and the answers."""

    def __init__(self, outer, position=HOVER):
        self.outer, self.node, self.position, self.tick = outer, outer.node, position, 0
        self.answers = []
        publish = self.node._reporter.publish

        def kept(stamp_ns, tick, level, message, values, *rest):
            self.answers.append(dict(values))
            publish(stamp_ns, tick, level, message, values, *rest)

        self.node._reporter.publish = kept

    def fly(self, ticks):
        for _ in range(ticks):
            nav = np.zeros(CHANNELS[topics.ODOM].size)
            nav[NAV.pos], nav[NAV.quat] = self.position, [1.0, 0.0, 0.0, 0.0]
            if self.tick % 2 == 0:
                self.outer.send(topics.ROTOR_SPEED, self.tick, np.array([193.73]))
            self.outer.send(topics.ODOM, self.tick, nav)
            self.tick += 1
        return self

    def stamped(self, message, late_s=0.0):
        stamp_ns = self.node.stamp_ns(self.node.tick) + round(late_s * NS_PER_S)
        message.header.frame_id = "map"
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        return message

    def pose(self, enu=GOAL_ENU, late_s=0.0):
        message = self.stamped(PoseStamped(), late_s)
        p = message.pose.position
        p.x, p.y, p.z = enu
        message.pose.orientation.w = 1.0
        return message

    def trajectory(self, up_m=14.0, names=()):
        times = np.array([0, 4]) * NS_PER_S
        points = np.zeros((2, 7))
        points[:, 2], points[1, 0] = -10.0, 8.0
        points[1, 2] = -up_m
        message = encode_reference(Trajectory(self.node.stamp_ns(self.node.tick), times, points))
        message.joint_names = list(names)
        return message

    def goal(self, command, goal_id="a", argument=None):
        """Send it; its answer, which is sent at once."""
        sent = len(self.answers)
        self.outer.receive(topics.GOAL, encode_goal(command, goal_id, argument))
        assert self.node.crash is None
        if len(self.answers) == sent:
            return None
        return self.answer(goal_id)

    def answer(self, goal_id="a"):
        answers = goals_of({k: str(v) for k, v in self.answers[-1].items()})
        (answer,) = [answer for answer in answers if answer.goal_id == goal_id]
        return answer

    def ask(self, name):
        (service,) = [s for s in self.node.services if s.service_name == f"/{name}"]
        return service.callback(Trigger.Request(), Trigger.Response())


@pytest.fixture
def hovering(bench):
    outer = bench(OuterLoopNode)
    outer.fly()
    return Sender(outer).fly(9)


@pytest.fixture
def standing(bench):
    outer = bench(OuterLoopNode, start__on_ground=True)
    outer.fly()
    return Sender(outer, np.zeros(3)).fly(9)


def test_without_goals_nothing_is_told_of_them(hovering):
    hovering.fly(101)
    assert hovering.answers and all(FACT_GOALS not in facts for facts in hovering.answers)


def test_a_goto_is_answered_by_its_id_with_where_and_when_it_ends(hovering):
    answer = hovering.goal("goto", "a", hovering.pose())
    assert (answer.command, answer.state) == ("goto", GoalState.ACTIVE)
    assert re.findall(r"[\d.]+ m", answer.sentence) == ["5.00 m", "20.00 m", "14.00 m"]
    np.testing.assert_allclose(answer.end_ned_m, GOAL_NED)
    trajectory = hovering.node.run.diverted
    assert answer.end_ns == trajectory.start_ns + trajectory.times_ns[-1]
    assert hovering.answers[-1]["mode"] == "trajectory"


def test_it_is_obeyed_once_however_often_it_is_sent(hovering):
    message = hovering.pose()
    hovering.goal("goto", "a", message)
    trajectory = hovering.node.run.diverted
    hovering.fly(4)
    assert hovering.goal("goto", "a", message) is None
    assert hovering.node.run.diverted is trajectory


def test_what_is_refused_is_answered_in_the_words_of_the_topic(hovering):
    """And leaves the flight, and the goal that is under way, as they were."""
    hovering.goal("goto", "a", hovering.pose())
    trajectory = hovering.node.run.diverted
    low = hovering.goal("goto", "low", hovering.pose((0.0, 0.0, 1.9)))
    assert low.state == GoalState.REFUSED and " 1.9 m " in low.sentence
    assert low.cause == RefusalCause.ALTITUDE.name
    assert hovering.node.health.facts["refused.goto"] == f"1; {low.sentence}"
    up = hovering.goal("takeoff", "up")
    assert up.state == GoalState.REFUSED
    assert up.sentence.startswith(f"takeoff: {RefusalCause.AIRBORNE.value}; allowed: ")
    assert up.cause == RefusalCause.AIRBORNE.name
    assert hovering.node.run.diverted is trajectory and hovering.answer().state == GoalState.ACTIVE


def test_a_trajectory_is_followed_and_told_as_a_reference(hovering, monkeypatch):
    sent = []
    monkeypatch.setattr(hovering.node.core, "send_trajectory", sent.append)
    answer = hovering.goal("follow", "a", hovering.trajectory())
    assert answer.state == GoalState.ACTIVE
    np.testing.assert_allclose(answer.end_ned_m, [8.0, 0.0, -14.0])
    (message,) = sent
    hovering.fly(101)
    assert hovering.node.health.facts["reference"] == "given"
    assert [key for _, key in hovering.node.health.facts[FACT_WAYS]] == [key_of(message)]
    reference = hovering.node.core.reference
    hovering.outer.receive(topics.REFERENCE, message)  # heard back
    assert hovering.node.core.reference is reference and hovering.answer().state == GoalState.ACTIVE


@pytest.mark.parametrize(
    ("change", "beginning", "cause"),
    [
        ({"up_m": 500.0}, "reference: ", RefusalCause.ALTITUDE),
        (
            {"names": ["other/base_link"]},
            "reference: for 'other/base_link'; allowed: ",
            MessageCause.AIRCRAFT,
        ),
    ],
)
def test_a_trajectory_that_is_refused(hovering, change, beginning, cause):
    answer = hovering.goal("follow", "a", hovering.trajectory(**change))
    assert answer.state == GoalState.REFUSED and answer.sentence.startswith(beginning)
    assert answer.cause == cause.name
    assert hovering.node.core.reference is None


def test_on_the_ground_a_trajectory_is_refused_though_it_is_the_first(standing):
    answer = standing.goal("follow", "a", standing.trajectory())
    assert answer.state == GoalState.REFUSED
    assert answer.sentence.startswith(f"follow: {RefusalCause.GROUNDED.value}; ")


@pytest.mark.parametrize("command", ["takeoff", "goto", "follow", "land", "hold"])
def test_what_is_not_active_answers_too(bench, command):
    outer = bench(OuterLoopNode)
    assert outer.node.trigger_configure()
    sender = Sender(outer)
    argument = {"goto": sender.pose, "follow": sender.trajectory}.get(command, lambda: None)()
    answer = sender.goal(command, "a", argument)
    assert answer.state == GoalState.REFUSED
    assert answer.sentence.endswith(f": {RefusalCause.INACTIVE.value}")
    assert answer.cause == RefusalCause.INACTIVE.name


def test_a_goto_without_a_stamp_is_of_now(hovering):
    """As `ros2 topic pub --once` sends it."""
    message = hovering.pose()
    message.header.stamp.sec, message.header.stamp.nanosec = 0, 0
    assert hovering.goal("goto", "a", message).state == GoalState.ACTIVE
    stale = hovering.goal("goto", "b", hovering.pose(late_s=-3600.0))
    assert stale.state == GoalState.REFUSED


def test_a_takeoff_has_a_height_of_its_own_once(standing):
    packaged_m = standing.node.values["takeoff.height_m"]
    answer = standing.goal("takeoff", "a", 6.5)
    assert answer.state == GoalState.ACTIVE and " 6.5 m " in answer.sentence
    assert standing.node.run.phases.climb_m == 6.5
    assert standing.goal("land", "b").state == GoalState.SUCCEEDED
    assert standing.goal("takeoff", "c").state == GoalState.ACTIVE
    assert standing.node.run.phases.climb_m == packaged_m


def test_a_place_on_earth_is_flown_to_as_the_nose_points(hovering):
    origin = hovering.node.core.origin
    fix = NavSatFix(latitude=origin.lat_deg, longitude=origin.lon_deg, altitude=origin.alt_m + 14.0)
    fix.latitude += 20.0 / 110_800.0
    hovering.outer.receive(topics.GOTO_GPS, fix)
    end = hovering.node.run.diverted.points[-1]
    np.testing.assert_allclose(end[REFERENCE.pos], [20.0, 0.0, -14.0], atol=0.05)
    assert end[REFERENCE.psi] == 0.0


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"latitude": float("nan")}, "goto_gps: latitude, longitude, height [nan, "),
        ({"longitude": 300.0}, "goto_gps: latitude 28.17 deg, longitude 300 deg, height 64 m; all"),
        (
            {"altitude": 1e308},
            "goto_gps: latitude 28.17 deg, longitude 112.93 deg, height 1e+308 m",
        ),
        ({"latitude": 28.3}, "goto_gps: the goal is "),
    ],
)
def test_a_place_on_earth_that_is_none_is_refused(hovering, change, why):
    origin = hovering.node.core.origin
    place = {"latitude": origin.lat_deg, "longitude": origin.lon_deg, "altitude": 64.0}
    hovering.outer.receive(topics.GOTO_GPS, NavSatFix(**(place | change)))
    assert hovering.node.core.refused[topics.GOTO_GPS].startswith(why)
    assert hovering.node.run.diverted is None


def test_the_origin_is_asked_for(hovering):
    values = hovering.node.values
    told = hovering.ask("origin")
    assert told.success
    assert yaml.safe_load(told.message) == {
        name: values[f"origin.{name}"] for name in ("latitude_deg", "longitude_deg", "altitude_m")
    }


def test_where_it_stands_and_began_is_told_at_once(standing):
    standing.fly(4)
    status = AircraftStatus.of_facts(1, "", {k: str(v) for k, v in standing.answers[-1].items()})
    assert status.landed and status.armed and status.ready and status.mode == "standing"
    assert status.home_enu_m == (0.0, 0.0, 0.0) and status.failsafe == "NONE"
    assert standing.goal("takeoff").state == GoalState.ACTIVE
    standing.fly(4)
    status = AircraftStatus.of_facts(1, "", {k: str(v) for k, v in standing.answers[-1].items()})
    assert not status.landed and status.mode == "takeoff"


@pytest.mark.parametrize("height_m", [0.5, -3.0, 500.0])
def test_a_height_that_no_takeoff_may_have(standing, height_m):
    answer = standing.goal("takeoff", "a", height_m)
    assert (answer.state, answer.cause) == (GoalState.REFUSED, RefusalCause.ALTITUDE.name)
    assert standing.node.run.phases.phase == Phase.STANDING


def test_a_height_that_is_no_number_is_refused_aloud(standing):
    standing.outer.receive(topics.GOAL, encode_goal("takeoff", "a", float("nan")))
    assert "goal: takeoff to a height of nan m" in standing.node.core.refused[topics.GOAL]


@pytest.mark.parametrize("command", ["velocity", "hold"])
def test_modes_are_goals_that_are_done_when_they_are_obeyed(hovering, command):
    assert hovering.goal(command).state == GoalState.SUCCEEDED


@pytest.mark.parametrize(
    ("command", "guard"), [("manual", Guard.STICKS), ("attitude", Guard.HEARD)]
)
def test_a_guard_that_fails_is_the_cause(hovering, command, guard):
    answer = hovering.goal(command)
    assert (answer.state, answer.cause) == (GoalState.REFUSED, guard.name)


def test_a_hold_is_done_when_it_is_obeyed_and_takes_a_goals_place(hovering):
    hovering.goal("goto", "a", hovering.pose())
    hold = hovering.goal("hold", "a/hold")
    assert hold.state == GoalState.SUCCEEDED and hold.sentence.startswith("hold: to ")
    assert hovering.answer().state == GoalState.PREEMPTED


def test_another_goal_takes_its_place(hovering):
    hovering.goal("goto", "a", hovering.pose())
    assert hovering.goal("land", "b").state == GoalState.ACTIVE
    assert hovering.answer("a").state == GoalState.PREEMPTED


def test_who_commands_without_an_id_replaces_it_and_is_told_at_once(hovering):
    hovering.goal("goto", "a", hovering.pose())
    hovering.fly(40)
    hovering.outer.receive(topics.GOTO, hovering.pose((1.0, 2.0, 30.0)))
    hovering.fly(4)
    answer = hovering.answer()
    assert answer.state == GoalState.REPLACED
    np.testing.assert_allclose(answer.end_ned_m, [2.0, 1.0, -30.0])


def test_a_mode_that_is_left_ends_it(hovering):
    hovering.goal("goto", "a", hovering.pose())
    message = hovering.stamped(TwistStamped())
    message.twist.linear.x = 1.0
    hovering.outer.receive(topics.COMMAND_VELOCITY, message)
    hovering.fly(8)
    assert hovering.answer().state == GoalState.LEFT
    assert hovering.answers[-1]["mode"] == "velocity"


def test_a_takeoff_that_is_broken_off_is_left(standing):
    assert standing.goal("takeoff").state == GoalState.ACTIVE
    assert standing.answer().end_ns is None
    assert standing.ask("land").success
    standing.fly(4)
    assert standing.answer().state == GoalState.LEFT


def test_a_takeoff_cancelled_on_the_ground_by_goals(standing):
    standing.goal("takeoff")
    assert standing.goal("hold", "a/hold").state == GoalState.REFUSED
    assert standing.answer().state == GoalState.ACTIVE
    assert standing.goal("land", "a/land").state == GoalState.SUCCEEDED


def test_what_is_no_goal_is_refused_aloud(hovering):
    hovering.outer.receive(topics.GOAL, encode_goal("dance", "a"))
    assert hovering.node.core.refused[topics.GOAL].startswith("goal: joint_names 'dance', 'a'; ")
    hovering.outer.receive(topics.GOAL, encode_goal("goto", "a"))
    assert "without a pose" in hovering.node.core.refused[topics.GOAL]


def test_a_successor_goes_on_with_them(hovering):
    hovering.goal("goto", "a", hovering.pose())
    content = pickle.loads(pickle.dumps(hovering.node.save_state()))
    hovering.node.core.goals = Goals()
    hovering.node.restore_state(content, False)
    assert hovering.goal("goto", "a", hovering.pose()) is None  # it is known
    hovering.ask("hold")
    hovering.fly(4)
    assert hovering.answer().state == GoalState.REPLACED


def test_another_activation_ends_it(hovering):
    hovering.goal("goto", "a", hovering.pose())
    hovering.outer.again()
    hovering.fly(104)
    assert hovering.answer().state == GoalState.LEFT


class Flown:
    """Phases that are entered by hand."""

    def __init__(self, phase):
        self.phase, self.event, self.history = phase, None, []
        self.trajectory = Trajectory.hover(HOVER, 0.0)

    def enter(self, phase, event, goals):
        self.phase, self.event = phase, event
        self.history.append((0, phase))
        return goals.look(self)


@pytest.mark.parametrize(
    ("command", "phases", "state"),
    [
        (Command.TAKEOFF, [Phase.LIFTING, Phase.CLIMBING], GoalState.ACTIVE),
        (Command.TAKEOFF, [Phase.LIFTING, Phase.CLIMBING, Phase.HOVER], GoalState.SUCCEEDED),
        (Command.TAKEOFF, [Phase.LIFTING, Phase.SETTLING], GoalState.LEFT),
        (Command.LAND, [Phase.DESCENDING, Phase.SETTLING], GoalState.ACTIVE),
        (Command.LAND, [Phase.DESCENDING, Phase.SETTLING, Phase.STANDING], GoalState.SUCCEEDED),
        (Command.LAND, [Phase.HOVER], GoalState.LEFT),
        (Command.GOTO, [Phase.HOVER], GoalState.ACTIVE),
        (Command.GOTO, [Phase.HOVER, Phase.MANUAL], GoalState.LEFT),
    ],
)
def test_what_the_phases_make_of_a_goal(command, phases, state):
    begun = {Command.TAKEOFF: Phase.SPOOLING, Command.LAND: Phase.HALTING}
    goals, flown = Goals(), Flown(begun.get(command, Phase.TRAJECTORY))
    goals.begin("a", command, "done", flown)
    for phase in phases:
        flown.enter(phase, Fact.ARRIVED, goals)
    (answer,) = goals_of({FACT_GOALS: goals.as_text()})
    assert (answer.state, answer.sentence) == (state, "done")


@pytest.mark.parametrize("event", [Command.HOLD, Fact.FENCED, Fact.BLIND])
def test_a_hover_before_the_end_is_another_way(event):
    goals, flown = Goals(), Flown(Phase.TRAJECTORY)
    goals.begin("a", Command.GOTO, "", flown)
    assert not goals.look(flown)
    assert flown.enter(Phase.HOVER, event, goals)
    (answer,) = goals_of({FACT_GOALS: goals.as_text()})
    assert answer.state == GoalState.REPLACED


def test_a_way_that_is_changed_on_the_way_is_told():
    """Turned into the wind: the same place, later."""
    goals, flown = Goals(), Flown(Phase.TRAJECTORY)
    goals.begin("a", Command.GOTO, "", flown)
    flown.trajectory = SimpleNamespace(
        points=flown.trajectory.points, start_ns=7, times_ns=np.array([0, 5])
    )
    assert goals.look(flown) and not goals.look(flown)
    (answer,) = goals_of({FACT_GOALS: goals.as_text()})
    assert (answer.state, answer.end_ns) == (GoalState.ACTIVE, 12)


def test_old_answers_go_but_that_of_the_goal_under_way_stays():
    goals, flown = Goals(), Flown(Phase.TRAJECTORY)
    goals.begin("a", Command.GOTO, "", flown)
    for number in range(40):
        goals.refuse(f"r{number}", Command.TAKEOFF, "no", "AIRBORNE")
    kept = [answer.goal_id for answer in goals_of({FACT_GOALS: goals.as_text()})]
    assert len(kept) == 16 and "a" in kept and "r39" in kept and not goals.knows("r0")
