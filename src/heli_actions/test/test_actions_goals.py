# SPDX-License-Identifier: Apache-2.0
"""Goals looked after without ROS: an outer loop in a few lines, whose answers are made by hand."""

import numpy as np
import pytest

from heli_actions.goals import (
    NOT_KNOWN,
    Code,
    FlightStatus,
    GoalLimits,
    GoalManager,
    GoalRequest,
    GoalStatus,
    Kind,
)
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge.diagnostics import FACT_GOALS, GoalAnswer, GoalState, goals_text

LIMITS = GoalLimits(
    answer_s=5.0, silence_s=5.0, wall_silence_s=10.0, patience_s=20.0, tolerance_m=1.0
)
GOAL = np.array([8.0, 6.0, -10.0])
ABORTED, CANCELED, SUCCEEDED = GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.SUCCEEDED


class Bench:
    """A goal manager, what it has done, and a flight that goes on as it is told."""

    def __init__(self):
        self.done, self.ended = [], {}
        self.flight, self.now_s, self.mode, self.answers = FlightStatus(), 1.0, "hover", {}
        self.manager = GoalManager(self, self.flight, LIMITS)
        self.pos = np.array([0.0, 0.0, -10.0])
        self.fly(1.0)

    def send(self, command, goal_id, argument):
        self.done.append((command, goal_id, argument))

    @property
    def asked(self):
        """What was sent, each once, however often."""
        return list(dict.fromkeys((command, goal_id) for command, goal_id, _ in self.done))

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
                self.manager.odom(now_ns, self.pos, np.array([1.0, 0.0, 0.0, 0.0]), wall)
            if outer_loop:
                facts = {"mode": self.mode, FACT_GOALS: goals_text(self.answers.values())}
                self.flight.diagnostics(now_ns, f"flies {self.mode}", facts, wall)
            self.flight.now_ns = now_ns
            self.manager.update(wall)

    def answer(self, goal_id, state, sentence="", end=None, lasts_s=None):
        """The outer loop answers, or tells something else of a goal."""
        end_ns = None if lasts_s is None else round((self.now_s + lasts_s) * NS_PER_S)
        self.answers[goal_id] = GoalAnswer(goal_id, "", state, sentence, end, end_ns)
        self.fly(0.1)

    def take(self, kind, key="a", end=GOAL):
        way = kind in (Kind.GOTO, Kind.FOLLOW)
        self.manager.accept(key, GoalRequest(kind, end if way else None, f"message of {key}"))

    def flying(self, kind, key="a"):
        """A goal that is granted."""
        self.take(kind, key)
        if kind in (Kind.GOTO, Kind.FOLLOW):
            self.mode = "trajectory"
            self.answer(key, GoalState.ACTIVE, "will be done", GOAL.tolist(), 6.0)
        else:
            self.mode = kind.value
            self.answer(key, GoalState.ACTIVE, "will be done")
        assert self.manager.feedback()[0] == key
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
    assert bench.done == [("takeoff", "a", "message of a")] and bench.manager.feedback() is None
    bench.fly(0.9)  # the outer loop has not answered yet
    assert bench.manager.feedback() is None
    bench.mode = "takeoff"
    bench.answer("a", GoalState.ACTIVE)
    assert bench.manager.feedback()[2].left_m == NOT_KNOWN == bench.manager.feedback()[2].left_s
    bench.answer("a", GoalState.ACTIVE, "", [0.0, 0.0, -10.0], 12.0)
    bench.fly(3.9, "takeoff", [0.0, 0.0, -3.0])
    feedback = bench.manager.feedback()[2]
    assert (feedback.mode, feedback.left_m, feedback.left_s) == ("takeoff", 7.0, pytest.approx(8.0))
    bench.mode, bench.pos = "hover", np.array([0.0, 0.0, -9.8])
    bench.answer("a", GoalState.SUCCEEDED, "", [0.0, 0.0, -10.0])
    assert bench.ended == {"a": (SUCCEEDED, Code.DONE, "takeoff: done, mode hover")}


def test_a_takeoff_that_somebody_holds_on_the_way_is_not_done(bench):
    bench.flying(Kind.TAKEOFF)
    bench.mode, bench.pos = "hover", np.array([0.0, 0.0, -13.0])
    bench.answer("a", GoalState.SUCCEEDED, "", [0.0, 0.0, -20.0])
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
    bench.flying(kind).mode = mode
    if mode == "inactive":
        bench.fly(0.1)  # it goes on telling what it has told last
    else:
        bench.answer("a", GoalState.LEFT)
    sentence = f"{kind}: left for mode {mode} (flies {mode})"
    assert bench.ended == {"a": (ABORTED, Code.MODE_LEFT, sentence)}


@pytest.mark.parametrize("kind", Kind)
def test_a_refusal_is_the_goals_sentence(bench, kind):
    """That of another goal is none of this one's."""
    bench.take(kind)
    bench.answer("b", GoalState.REFUSED, "another one")
    assert not bench.ended
    bench.answer("a", GoalState.REFUSED, "why not; allowed: what")
    assert bench.ended == {"a": (ABORTED, Code.REFUSED, "why not; allowed: what")}


def test_a_goto_is_there_when_its_way_is_over_and_it_is_near(bench):
    bench.flying(Kind.GOTO)
    assert bench.done == [("goto", "a", "message of a")]
    feedback = bench.manager.feedback()[2]
    assert feedback.left_m == pytest.approx(10.0) and 5.0 < feedback.left_s < 6.0
    bench.fly(4.2, to=[7.9, 6.0, -10.0])
    assert not bench.ended  # its way is not over
    bench.fly(2.0)
    assert bench.ended == {"a": (SUCCEEDED, Code.DONE, "goto: there, 0.10 m off")}


def test_a_goto_that_does_not_get_there_is_given_up(bench):
    bench.flying(Kind.GOTO).fly(25.0, to=[5.0, 2.0, -10.0])
    assert not bench.ended
    bench.fly(3.0)
    outcome, code, sentence = bench.ended["a"]
    assert (outcome, code) == (ABORTED, Code.NOT_REACHED)
    assert sentence == "goto: 5.00 m off 20 s after the end of its way; allowed: 1 m"


@pytest.mark.parametrize("kind", [Kind.GOTO, Kind.FOLLOW])
def test_another_way_ends_it_a_later_end_does_not(bench, kind):
    bench.flying(kind)
    bench.answer("a", GoalState.ACTIVE, "", GOAL.tolist(), 9.0)  # turned into the wind on the way
    assert not bench.ended and bench.manager.feedback()[2].left_s > 8.0
    bench.answer("a", GoalState.REPLACED, "", [1.0, 2.0, -30.0])
    sentence = f"{kind}: another way is flown, to 2.00 m east, 1.00 m north, 30.00 m high"
    assert bench.ended == {"a": (ABORTED, Code.REPLACED, sentence)}


def test_a_goal_of_another_server_takes_its_place(bench):
    bench.flying(Kind.GOTO).answer("a", GoalState.PREEMPTED)
    assert bench.ended == {"a": (ABORTED, Code.PREEMPTED, "goto: another goal took its place")}


def test_a_landing_is_done_when_it_stands(bench):
    bench.fly(0.2, "standing", [0.0, 0.0, -2.0])
    bench.fly(0.1, "hover")
    bench.fly(0.1, to=[0.0, 0.0, -10.0])
    bench.flying(Kind.LAND)
    assert bench.manager.feedback()[2].left_m == pytest.approx(8.0)
    bench.mode = "standing"
    bench.answer("a", GoalState.SUCCEEDED)
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


@pytest.mark.parametrize("kind", Kind)
def test_a_cancelled_goal_holds(bench, kind):
    bench.flying(kind)
    bench.manager.cancel("a")
    assert bench.done[-1] == ("hold", "a/hold", None) and not bench.ended
    bench.mode = "hover"
    bench.answer("a", GoalState.PREEMPTED)  # what hold does is not taken for another's doing
    assert not bench.ended
    bench.answer("a/hold", GoalState.SUCCEEDED, "hold: to 0 m")
    assert bench.ended == {"a": (CANCELED, Code.CANCELED, "hold: to 0 m")}


def test_a_takeoff_cancelled_on_the_ground_is_broken_off(bench):
    bench.flying(Kind.TAKEOFF)
    bench.manager.cancel("a")
    bench.answer("a/hold", GoalState.REFUSED, "hold: the aircraft is on the ground")
    assert bench.done[-1] == ("land", "a/land", None)
    bench.answer("a/land", GoalState.SUCCEEDED, "land: take-off broken off")
    assert bench.ended == {"a": (CANCELED, Code.CANCELED, "land: take-off broken off")}


def test_a_landing_near_the_ground_is_not_cancelled_and_says_so(bench):
    bench.flying(Kind.LAND)
    bench.manager.cancel("a")
    bench.answer("a/hold", GoalState.REFUSED, "hold: the ground is too near")
    bench.manager.cancel("a")  # once is enough
    bench.fly(1.0)
    assert bench.asked == [("land", "a"), ("hold", "a/hold")]
    bench.mode = "standing"
    bench.answer("a", GoalState.SUCCEEDED)
    assert bench.ended["a"] == (
        SUCCEEDED, Code.DONE,
        "land: done, mode standing; not cancelled: hold: the ground is too near",
    )  # fmt: skip


@pytest.mark.parametrize(("granted", "asked"), [(True, ["takeoff", "hold"]), (False, ["takeoff"])])
def test_cancelled_before_the_answer(bench, granted, asked):
    bench.take(Kind.TAKEOFF)
    bench.manager.cancel("a")
    assert bench.asked == [("takeoff", "a")] and not bench.ended
    bench.answer("a", GoalState.ACTIVE if granted else GoalState.REFUSED, "the answer")
    assert [command for command, _ in bench.asked] == asked
    assert bench.ended == ({} if granted else {"a": (CANCELED, Code.CANCELED, "the answer")})


def test_a_granted_goal_takes_the_place_of_the_one_that_is_flown(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.LAND, "b")
    bench.answers["a"].state, bench.mode = GoalState.PREEMPTED, "land"
    bench.answer("b", GoalState.ACTIVE, "land: comes to rest")
    assert bench.ended == {"a": (ABORTED, Code.PREEMPTED, "goto: land took its place")}
    assert bench.manager.feedback()[0] == "b"


def test_a_refused_goal_leaves_the_one_that_is_flown(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.TAKEOFF, "b")
    bench.answer("b", GoalState.REFUSED, "takeoff: in the air already")
    assert bench.outcome("b") == (ABORTED, Code.REFUSED)
    bench.fly(7.0, to=GOAL)
    assert bench.outcome() == (SUCCEEDED, Code.DONE)


def test_of_the_goals_that_wait_the_newest_stays_and_is_asked_for_in_its_turn(bench):
    bench.take(Kind.TAKEOFF, "a")
    bench.take(Kind.GOTO, "b")
    bench.take(Kind.LAND, "c")
    assert bench.asked == [("takeoff", "a")]
    assert set(bench.ended) == {"b"} and bench.outcome("b") == (ABORTED, Code.PREEMPTED)
    bench.answer("a", GoalState.REFUSED, "no")
    assert bench.asked[1:] == [("land", "c")]
    bench.take(Kind.GOTO, "d")
    bench.manager.cancel("d")
    assert bench.ended["d"] == (CANCELED, Code.CANCELED, "goto: cancelled")


@pytest.mark.parametrize("kind", [Kind.TAKEOFF, Kind.GOTO, Kind.FOLLOW])
def test_no_answer(bench, kind):
    bench.take(kind)
    bench.fly(4.8)
    assert not bench.ended
    bench.fly(0.5)
    sentence = f"{kind}: no answer of the outer loop in 5 s"
    assert bench.ended == {"a": (ABORTED, Code.NO_ANSWER, sentence)}


def test_a_command_is_sent_again_until_it_is_answered(bench):
    """With the same id: the outer loop may not have listened yet."""
    bench.take(Kind.GOTO)
    bench.fly(1.5)
    sent = len(bench.done)
    assert sent >= 3 and len(set(bench.done)) == 1
    bench.answer("a", GoalState.ACTIVE, "", GOAL.tolist(), 6.0)
    bench.fly(1.5)
    assert len(bench.done) == sent


def test_a_hold_that_is_not_answered(bench):
    bench.flying(Kind.GOTO)
    bench.manager.cancel("a")
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
        # said again, of the same time
        bench.flight.odom_wall_s = bench.flight.outer_loop_wall_s = wall_s
        bench.manager.update(wall_s)
    assert bench.outcome() == (ABORTED, Code.NO_ANSWER)  # the flight's minute was over before
    paused = Bench()
    paused.take(Kind.TAKEOFF)
    for wall_s in paused.now_s + np.arange(0.0, 60.0):
        paused.flight.odom_wall_s = paused.flight.outer_loop_wall_s = wall_s
        paused.manager.update(wall_s)
    assert not paused.ended


@pytest.mark.parametrize(
    ("silent", "named"), [("navigation", "navigation"), ("outer_loop", "outer_loop")]
)
def test_silence_of_one_is_named(bench, silent, named):
    bench.flying(Kind.GOTO).fly(4.5, **{silent: False})
    assert not bench.ended
    bench.fly(1.0, **{silent: False})
    sentence = f"goto: nothing is heard of {named} for 5 s"
    assert bench.ended == {"a": (ABORTED, Code.SILENT, sentence)}


def test_silence_of_all_counts_by_the_wall(bench):
    bench.flying(Kind.LAND)
    bench.manager.update(bench.now_s + 9.0)
    assert not bench.ended
    bench.manager.update(bench.now_s + 10.5)
    sentence = "land: nothing of the flight is heard for 10 s of wall time"
    assert bench.ended == {"a": (ABORTED, Code.SILENT, sentence)}


def test_a_goal_that_came_before_the_flight_waits_for_it(bench):
    fresh = Bench.__new__(Bench)
    fresh.done, fresh.ended, fresh.answers = [], {}, {}
    fresh.flight, fresh.now_s, fresh.mode = FlightStatus(odom_wall_s=999.0), 1000.0, "standing"
    fresh.manager, fresh.pos = GoalManager(fresh, fresh.flight, LIMITS), np.zeros(3)
    fresh.take(Kind.TAKEOFF)
    fresh.manager.update(1000.0)
    fresh.fly(4.0)
    assert not fresh.ended
    fresh.fly(2.0)
    assert fresh.outcome() == (ABORTED, Code.NO_ANSWER)


def test_another_flight_ends_what_was_flown(bench):
    bench.flying(Kind.GOTO)
    bench.now_s = 0.5
    bench.fly(0.1)
    assert bench.ended == {"a": (ABORTED, Code.SILENT, "goto: another flight has begun")}
    assert bench.flight.now_ns < 2 * NS_PER_S


def test_a_closed_manager_lets_go(bench):
    bench.flying(Kind.GOTO)
    bench.take(Kind.LAND, "b")
    bench.manager.close()
    assert {code for _, code, _ in bench.ended.values()} == {Code.CLOSED}
    assert bench.manager.goals == () and len(bench.ended) == 2
    bench.answer("b", GoalState.ACTIVE, "too late")
    assert bench.manager.feedback() is None
