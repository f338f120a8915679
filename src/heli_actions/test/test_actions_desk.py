# SPDX-License-Identifier: Apache-2.0
"""Goals looked after without ROS: an outer loop in a few lines, told and answered by hand."""

import numpy as np
import pytest

from heli_actions.node import (
    NOT_KNOWN,
    Code,
    FlightStatus,
    GoalLimits,
    GoalManager,
    GoalRequest,
    GoalStatus,
    Kind,
    Way,
)
from heli_core.ticks import NS_PER_S

LIMITS = GoalLimits(
    answer_s=5.0, silence_s=5.0, wall_silence_s=10.0, patience_s=20.0, tolerance_m=1.0
)
GOAL = np.array([8.0, 6.0, -10.0])
ABORTED, CANCELED, SUCCEEDED = GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.SUCCEEDED


class Bench:
    """A desk, what it has done, and a flight that goes on as it is told."""

    def __init__(self):
        self.done, self.ended = [], {}
        self.seen, self.now_s, self.mode, self.facts = FlightStatus(), 1.0, "hover", {}
        self.desk = GoalManager(self, self.seen, LIMITS)
        self.pos = np.array([0.0, 0.0, -10.0])
        self.fly(1.0)

    def ask(self, key, service):
        self.done.append((key, service))

    def send(self, topic, message):
        self.done.append((topic, message))

    def finish(self, key, outcome, code, sentence):
        assert key not in self.ended
        self.ended[key] = outcome, code, sentence

    def fly(self, length_s, mode=None, to=None, wall_s=None, navigation=True, outer_loop=True):
        """A tenth of a second of both clocks after the other."""
        self.mode, self.pos = mode or self.mode, self.pos if to is None else np.array(to, float)
        for _ in range(round(length_s * 10)):
            self.now_s += 0.1
            now_ns, wall = round(self.now_s * NS_PER_S), self.now_s if wall_s is None else wall_s
            if navigation:
                self.desk.odom(now_ns, self.pos, np.array([1.0, 0.0, 0.0, 0.0]), wall)
            if outer_loop:
                facts = {"mode": self.mode, "reference": "goto", **self.facts}
                self.seen.told(now_ns, f"flies {self.mode}", facts, wall)
            self.seen.now_ns = now_ns
            self.desk.look(wall)

    def hear_way(self, end=GOAL, lasts_s=6.0):
        now_ns = round(self.now_s * NS_PER_S)
        end_ns = now_ns + round(lasts_s * NS_PER_S)
        self.desk.hear(Way(now_ns, end_ns, np.array(end, float)))

    def take(self, kind, key="a", end=GOAL):
        if kind == Kind.FOLLOW:
            end_ns = round((self.now_s + 6.0) * NS_PER_S)
            order = GoalRequest(kind, end, end_ns, f"message of {key}")
        else:
            order = GoalRequest(
                kind, end if kind == Kind.GOTO else None, message=f"message of {key}"
            )
        self.desk.take(key, order)

    def flying(self, kind, key="a"):
        """A goal that is granted."""
        self.take(kind, key)
        if kind == Kind.GOTO:
            self.hear_way()
            self.fly(0.3, "trajectory")
        elif kind == Kind.FOLLOW:
            self.facts["reference"] = "given"
            self.fly(1.5, "trajectory")
        else:
            self.desk.answered(key, True, f"{kind}: will be done")
            self.fly(0.3, kind.value)
        assert self.desk.feedback()[0] == key
        return self

    def outcome(self, key="a"):
        return self.ended[key][:2]


@pytest.fixture
def bench():
    return Bench()


def test_a_takeoff_is_done_when_it_hovers_where_its_climb_ends(bench):
    bench.pos[2] = 0.0
    bench.fly(2.0, "standing")
    bench.take(Kind.TAKEOFF)
    assert bench.done == [("a", "takeoff")] and bench.desk.feedback() is None
    bench.desk.answered("a", True, "takeoff: collective in 2 s")
    bench.fly(0.9)  # the outer loop has not said yet that it does
    bench.fly(1.0, "takeoff")
    assert bench.desk.feedback()[2].left_m == NOT_KNOWN == bench.desk.feedback()[2].left_s
    bench.hear_way([0.0, 0.0, -10.0], 12.0)
    bench.fly(4.0, "takeoff", [0.0, 0.0, -3.0])
    told = bench.desk.feedback()[2]
    assert (told.mode, told.left_m, told.left_s) == ("takeoff", 7.0, pytest.approx(8.0))
    bench.fly(0.1, "hover", [0.0, 0.0, -9.8])
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


def test_a_takeoff_that_somebody_holds_on_the_way_is_not_done(bench):
    bench.flying(Kind.TAKEOFF)
    bench.hear_way([0.0, 0.0, -20.0])
    bench.hear_way([0.0, 0.0, -13.0])
    bench.fly(1.2, "hover", [0.0, 0.0, -13.0])
    assert bench.ended["a"] == (
        ABORTED, Code.NOT_REACHED, "takeoff: hovers, with 7.0 m left to climb"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "mode"),
    [
        (Kind.TAKEOFF, "land"), (Kind.TAKEOFF, "manual"), (Kind.GOTO, "velocity"),
        (Kind.GOTO, "land"), (Kind.GOTO, "inactive"), (Kind.FOLLOW, "attitude"),
        (Kind.LAND, "manual"), (Kind.LAND, "hover"),
    ],
)  # fmt: skip
def test_a_mode_that_is_left_ends_the_goal_and_is_named(bench, kind, mode):
    bench.flying(kind).fly(1.5, mode)
    said = f"{kind}: left for mode {mode} (flies {mode})"
    assert bench.ended == {"a": (ABORTED, Code.MODE_LEFT, said)}


@pytest.mark.parametrize("kind", [Kind.TAKEOFF, Kind.LAND])
def test_a_refused_service_is_the_goals_sentence(bench, kind):
    bench.take(kind)
    bench.desk.answered("a", False, "why not; allowed: what")
    assert bench.ended == {"a": (ABORTED, Code.REFUSED, "why not; allowed: what")}


def test_a_goto_is_there_when_its_way_is_over_and_it_is_near(bench):
    bench.flying(Kind.GOTO)
    assert bench.done == [("goto", "message of a")]
    told = bench.desk.feedback()[2]
    assert told.left_m == pytest.approx(10.0) and 5.0 < told.left_s < 6.0
    bench.fly(4.0, to=[7.9, 6.0, -10.0])
    assert not bench.ended  # its way is not over
    bench.fly(2.0)
    assert bench.ended == {"a": (SUCCEEDED, Code.DONE, "goto: there, 0.10 m off")}


def test_a_goto_that_does_not_get_there_is_given_up(bench):
    bench.flying(Kind.GOTO).fly(24.0, to=[5.0, 2.0, -10.0])
    assert not bench.ended
    bench.fly(3.0)
    outcome, code, said = bench.ended["a"]
    assert (outcome, code) == (ABORTED, Code.NOT_REACHED)
    assert said == "goto: 5.00 m off 20 s after the end of its way; allowed: 1 m"


@pytest.mark.parametrize(
    ("kind", "topic"), [(Kind.GOTO, "goto"), (Kind.FOLLOW, "reference")]
)  # fmt: skip
def test_a_refused_message_is_known_by_its_count(bench, kind, topic):
    """An older refusal of the same topic is none of this goal's."""
    bench.facts[f"refused.{topic}"] = "3; an older one"
    bench.fly(0.2)
    bench.take(kind)
    bench.fly(0.5)
    assert not bench.ended
    bench.facts[f"refused.{topic}"] = f"4; {topic}: too high; allowed: 2 to 100 m"
    bench.fly(0.1)
    assert bench.ended == {"a": (ABORTED, Code.REFUSED, f"{topic}: too high; allowed: 2 to 100 m")}


def test_a_trajectory_that_is_refused_late_is_refused(bench):
    bench.facts["reference"] = "given"
    bench.fly(1.5, "trajectory")  # another one is under way
    bench.flying(Kind.FOLLOW).facts["refused.reference"] = "1; reference: leaves the fence"
    bench.fly(0.1)
    assert bench.outcome() == (ABORTED, Code.REFUSED)


def test_a_trajectory_is_followed_to_its_end(bench):
    bench.flying(Kind.FOLLOW).fly(4.0, to=GOAL)
    assert not bench.ended
    bench.fly(1.0)
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


@pytest.mark.parametrize("kind", [Kind.GOTO, Kind.FOLLOW])
def test_another_way_ends_it_the_same_place_told_again_does_not(bench, kind):
    bench.flying(kind)
    if kind == Kind.GOTO:
        bench.hear_way(lasts_s=9.0)  # turned into the wind on the way
        bench.fly(0.2)
        assert not bench.ended and bench.desk.feedback()[2].left_s > 8.0
    bench.hear_way([1.0, 2.0, -30.0])
    bench.fly(0.1)
    said = f"{kind}: another way is flown, to 2.00 m east, 1.00 m north, 30.00 m high"
    assert bench.ended == {"a": (ABORTED, Code.REPLACED, said)}


def test_a_landing_is_done_when_it_stands(bench):
    bench.fly(0.2, "standing", [0.0, 0.0, -2.0])
    bench.fly(0.1, "hover")
    bench.fly(0.1, to=[0.0, 0.0, -10.0])
    bench.flying(Kind.LAND)
    assert bench.desk.feedback()[2].left_m == pytest.approx(8.0)
    bench.fly(0.2, "standing")
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


@pytest.mark.parametrize("kind", Kind)
def test_a_cancelled_goal_holds(bench, kind):
    bench.flying(kind)
    bench.desk.cancel("a")
    assert bench.done[-1] == ("a", "hold") and not bench.ended
    bench.fly(1.5, "hover")  # what hold does is not taken for a mode that was left
    bench.hear_way([0.0, 0.0, -10.0])
    bench.fly(0.1)
    assert not bench.ended
    bench.desk.answered("a", True, "hold: to 0 m")
    assert bench.ended == {"a": (CANCELED, Code.CANCELED, "hold: to 0 m")}


def test_a_takeoff_cancelled_on_the_ground_is_broken_off(bench):
    bench.flying(Kind.TAKEOFF)
    bench.desk.cancel("a")
    bench.desk.answered("a", False, "hold: the aircraft is on the ground")
    assert bench.done[-1] == ("a", "land")
    bench.desk.answered("a", True, "land: take-off broken off")
    assert bench.ended == {"a": (CANCELED, Code.CANCELED, "land: take-off broken off")}


def test_a_landing_near_the_ground_is_not_cancelled_and_says_so(bench):
    bench.flying(Kind.LAND)
    bench.desk.cancel("a")
    bench.desk.answered("a", False, "hold: the ground is too near")
    assert bench.done[-1] == ("a", "hold")
    bench.desk.cancel("a")  # once is enough
    assert len(bench.done) == 2
    bench.fly(1.0)
    bench.fly(0.1, "standing")
    assert bench.ended["a"] == (
        SUCCEEDED, Code.DONE,
        "land: done, mode standing; not cancelled: hold: the ground is too near",
    )  # fmt: skip


@pytest.mark.parametrize(("granted", "asked"), [(True, ["takeoff", "hold"]), (False, ["takeoff"])])
def test_cancelled_before_the_answer(bench, granted, asked):
    bench.take(Kind.TAKEOFF)
    bench.desk.cancel("a")
    assert bench.done == [("a", "takeoff")] and not bench.ended
    bench.desk.answered("a", granted, "the answer")
    assert [service for _, service in bench.done] == asked
    assert bench.ended == ({} if granted else {"a": (CANCELED, Code.CANCELED, "the answer")})


def test_a_granted_goal_takes_the_place_of_the_one_that_is_flown(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.LAND, "b")
    bench.hear_way([0.0, 0.0, -10.0])
    bench.fly(2.0, "land")  # seen before the answer
    assert not bench.ended
    bench.desk.answered("b", True, "land: comes to rest")
    assert bench.ended == {"a": (ABORTED, Code.PREEMPTED, "goto: land took its place")}
    assert bench.desk.feedback()[0] == "b"


def test_a_refused_goal_leaves_the_one_that_is_flown(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.TAKEOFF, "b")
    bench.desk.answered("b", False, "takeoff: in the air already")
    assert bench.outcome("b") == (ABORTED, Code.REFUSED)
    bench.fly(7.0, to=GOAL)
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


def test_of_the_goals_that_wait_the_newest_stays_and_is_asked_for_in_its_turn(bench):
    bench.take(Kind.TAKEOFF, "a")
    bench.take(Kind.GOTO, "b")
    bench.take(Kind.LAND, "c")
    assert bench.done == [("a", "takeoff")]
    assert bench.ended == {"b": (ABORTED, Code.PREEMPTED, "goto: land took its place")}
    bench.desk.answered("a", False, "no")
    assert bench.done[1:] == [("c", "land")]
    bench.take(Kind.GOTO, "d")
    bench.desk.cancel("d")
    assert bench.ended["d"] == (CANCELED, Code.CANCELED, "goto: cancelled")


@pytest.mark.parametrize("kind", [Kind.TAKEOFF, Kind.GOTO, Kind.FOLLOW])
def test_no_answer(bench, kind):
    bench.take(kind)
    bench.fly(4.8)
    assert not bench.ended
    bench.fly(0.5)
    said = f"{kind}: no answer of the outer loop in 5 s"
    assert bench.ended == {"a": (ABORTED, Code.NO_ANSWER, said)}


def test_a_hold_that_is_not_answered(bench):
    bench.flying(Kind.GOTO)
    bench.desk.cancel("a")
    bench.fly(5.5)
    assert bench.outcome() == (ABORTED, Code.NO_ANSWER)


def test_an_answer_has_both_clocks_time(bench):
    """A flight in lockstep is faster than a service call; a pause stops the flight alone."""
    bench.take(Kind.TAKEOFF)
    bench.fly(60.0, wall_s=bench.now_s + 1.0)
    assert not bench.ended
    bench.now_s += 1.0
    now_s = bench.now_s
    for wall_s in now_s + np.arange(0.0, 60.0):
        bench.seen.odom_wall_s = bench.seen.told_wall_s = wall_s  # said again, of the same time
        bench.desk.look(wall_s)
    assert bench.outcome() == (ABORTED, Code.NO_ANSWER)  # the flight's minute was over before
    paused = Bench()
    paused.take(Kind.TAKEOFF)
    for wall_s in paused.now_s + np.arange(0.0, 60.0):
        paused.seen.odom_wall_s = paused.seen.told_wall_s = wall_s
        paused.desk.look(wall_s)
    assert not paused.ended


@pytest.mark.parametrize(
    ("silent", "named"), [("navigation", "navigation"), ("outer_loop", "outer_loop")]
)
def test_silence_of_one_is_named(bench, silent, named):
    bench.flying(Kind.GOTO).fly(4.5, **{silent: False})
    assert not bench.ended
    bench.fly(1.0, **{silent: False})
    said = f"goto: nothing is heard of {named} for 5 s"
    assert bench.ended == {"a": (ABORTED, Code.SILENT, said)}


def test_silence_of_all_counts_by_the_wall(bench):
    bench.flying(Kind.LAND)
    bench.desk.look(bench.now_s + 9.0)
    assert not bench.ended
    bench.desk.look(bench.now_s + 10.5)
    said = "land: nothing of the flight is heard for 10 s of wall time"
    assert bench.ended == {"a": (ABORTED, Code.SILENT, said)}


def test_a_goal_that_came_before_the_flight_waits_for_it(bench):
    fresh = Bench.__new__(Bench)
    fresh.done, fresh.ended, fresh.facts = [], {}, {}
    fresh.seen, fresh.now_s, fresh.mode = FlightStatus(odom_wall_s=999.0), 1000.0, "standing"
    fresh.desk, fresh.pos = GoalManager(fresh, fresh.seen, LIMITS), np.zeros(3)
    fresh.take(Kind.TAKEOFF)
    fresh.desk.look(1000.0)
    fresh.fly(4.0)
    assert not fresh.ended
    fresh.fly(2.0)
    assert fresh.outcome() == (ABORTED, Code.NO_ANSWER)


def test_another_flight_ends_what_was_flown(bench):
    bench.flying(Kind.GOTO)
    bench.now_s = 1.0
    bench.fly(0.1)
    assert bench.ended == {"a": (ABORTED, Code.SILENT, "goto: another flight has begun")}
    assert bench.seen.trajectories == 0 and bench.seen.now_ns < 2 * NS_PER_S


def test_a_closed_desk_lets_go(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.LAND, "b")
    bench.desk.close()
    assert {code for _, code, _ in bench.ended.values()} == {Code.CLOSED}
    assert bench.desk.goals == () and len(bench.ended) == 2
    bench.desk.answered("b", True, "too late")
    assert bench.desk.feedback() is None
