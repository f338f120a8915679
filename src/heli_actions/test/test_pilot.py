# SPDX-License-Identifier: Apache-2.0
"""The pilot beside an outer loop of a few lines: done, refused, cancelled, awaited, closed."""

import asyncio
import queue
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import heli_actions.pilot as pilot_module
from heli_actions import (
    FlightNotHeard,
    GoalCanceled,
    GoalClosed,
    GoalRefused,
    GoalReplaced,
    Pilot,
    PilotError,
)
from heli_actions.errors import ERRORS, goal_error
from heli_actions.goals import Code
from heli_core.trajectory import Trajectory
from heli_msgs_bridge.command_messages import decode_goto, encode_reference
from heli_msgs_bridge.diagnostics import GoalState

LIMIT_S = 120.0


@pytest.fixture
def pilot(ros_context, outer_loop):
    with Pilot(context=ros_context, actions=False, wait_s=LIMIT_S) as one:
        yield one


@pytest.fixture
def beside():
    """Runs what waits in another thread."""
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit


def test_from_the_ground_to_the_ground(pilot, outer_loop, beside):
    flown = beside(pilot.takeoff, 6.5)
    assert outer_loop.fly("takeoff", "hover", (0.0, 0.0, 6.5)).argument == 6.5
    assert flown.result(LIMIT_S) == "takeoff: done, mode hover"
    flown = beside(pilot.goto, 10.0, 2.0, 5.0, 90.0)
    goal = decode_goto(outer_loop.fly("goto", "hover", (10.0, 2.0, 5.0)).argument)
    np.testing.assert_allclose(goal.pos_ned_m, [2.0, 10.0, -5.0])
    assert goal.psi_rad == pytest.approx(np.pi / 2.0)
    assert flown.result(LIMIT_S).startswith("goto: there, ")
    np.testing.assert_allclose(pilot.pos_enu_m, [10.0, 2.0, 5.0])
    flown = beside(pilot.land)
    outer_loop.fly("land", "standing", (10.0, 2.0, 0.0))
    assert flown.result(LIMIT_S) == "land: done, mode standing"
    assert pilot.status.mode == "standing" and not pilot.over_actions


def test_without_a_heading_the_nose_stays_as_it_is(pilot, outer_loop, beside):
    """The double's points to the north."""
    flown = beside(pilot.goto, 1.0, 0.0, 5.0)
    assert decode_goto(outer_loop.fly("goto", "hover", (1.0, 0.0, 5.0)).argument).psi_rad == 0.0
    flown.result(LIMIT_S)


def test_a_trajectory_is_followed(pilot, outer_loop, beside):
    points = np.zeros((2, 7))
    points[:, 2], points[1, 0] = -5.0, 8.0
    way = encode_reference(Trajectory(0, np.array([0, 4_000_000_000]), points))
    flown = beside(pilot.follow, way)
    goal = outer_loop.fly("follow", "hover", (0.0, 8.0, 5.0))
    assert goal.argument.header.stamp.sec >= 1
    assert flown.result(LIMIT_S).startswith("follow: there, ")


def test_a_refusal_has_its_cause(pilot, outer_loop, beside):
    flown = beside(pilot.goto, 900.0, 0.0, 5.0)
    goal = outer_loop.next_goal()
    outer_loop.answer(goal, GoalState.REFUSED, "goto: it is too far", "DISTANCE")
    with pytest.raises(GoalRefused, match="it is too far") as caught:
        flown.result(LIMIT_S)
    assert (caught.value.code, caught.value.cause) == (Code.REFUSED, "DISTANCE")


def test_a_place_that_is_none_is_refused_before_it_is_sent(pilot, outer_loop):
    with pytest.raises(GoalRefused) as caught:
        pilot.goto(float("nan"), 0.0, 5.0)
    assert caught.value.cause == "NOT_FINITE" and outer_loop.goals.empty()


def test_without_waiting_it_tells_where_it_is_and_can_be_cancelled(pilot, outer_loop):
    told = queue.Queue()
    goal = pilot.goto(30.0, 0.0, 5.0, wait=False, on_feedback=told.put)
    asked = outer_loop.next_goal()
    outer_loop.mode = "trajectory"
    outer_loop.answer(asked, GoalState.ACTIVE, "on its way", end=[0.0, 30.0, -5.0], lasts_s=1e6)
    feedback = told.get(timeout=LIMIT_S)
    while feedback.left_s is None or feedback.mode != "trajectory":
        feedback = told.get(timeout=LIMIT_S)
    assert feedback.left_m == pytest.approx(np.hypot(30.0, 5.0))
    assert feedback.heading_deg == pytest.approx(0.0, abs=1e-6) and feedback.left_s > 1e5
    assert not goal.done and goal.feedback.mode == "trajectory"
    with pytest.raises(TimeoutError):
        goal.result(0.01)
    goal.cancel()
    hold = outer_loop.next_goal()
    assert (hold.command, hold.goal_id) == ("hold", f"{asked.goal_id}/hold")
    outer_loop.answer(hold, GoalState.SUCCEEDED, "hold: to here")
    with pytest.raises(GoalCanceled):
        goal.result(LIMIT_S)


def test_another_way_ends_a_goal(pilot, outer_loop):
    goal = pilot.goto(30.0, 0.0, 5.0, wait=False)
    asked = outer_loop.next_goal()
    outer_loop.answer(asked, GoalState.ACTIVE, end=[0.0, 30.0, -5.0], lasts_s=1e6)
    while goal.feedback is None or goal.feedback.left_s is None:
        assert not goal.done
    outer_loop.answer(asked, GoalState.REPLACED, end=[1.0, 2.0, -3.0])
    with pytest.raises(GoalReplaced):
        goal.result(LIMIT_S)


def test_ctrl_c_in_a_call_that_waits_cancels_it(pilot, outer_loop, beside, monkeypatch):
    real = pilot_module.PilotGoal.result
    interrupted_once = threading.Event()

    def interrupted(goal, timeout_s=None):
        if interrupted_once.is_set():
            return real(goal, timeout_s)
        outer_loop.answer(outer_loop.next_goal(), GoalState.ACTIVE, end=[0.0, 0.0, 0.0])
        interrupted_once.set()
        raise KeyboardInterrupt

    monkeypatch.setattr(pilot_module.PilotGoal, "result", interrupted)
    monkeypatch.setattr(pilot_module, "_CANCEL_S", LIMIT_S)
    flown = beside(pilot.land)
    assert interrupted_once.wait(LIMIT_S)  # until then the goal is the other thread's to take
    hold = outer_loop.next_goal()
    outer_loop.answer(hold, GoalState.SUCCEEDED, "hold: to here")
    assert hold.command == "hold"
    with pytest.raises(KeyboardInterrupt):
        flown.result(LIMIT_S)


def test_what_is_known_of_the_aircraft_has_its_types(pilot, outer_loop):
    assert pilot.status.ready and pilot.status.home_enu_m == (2.0, 1.0, 0.0)
    assert pilot.status.armed and pilot.status.landed and pilot.status.failsafe == "NONE"
    assert pilot.status.stamp_ns > 0 and pilot.status.sentence == "as told"


def test_a_place_on_earth_is_flown_to(pilot, outer_loop, beside):
    """A thousandth of a degree of latitude is 110.8 m there (WGS-84), of longitude 98.2 m."""
    flown = beside(pilot.goto_gps, 28.171, 112.931, 60.0, 0.0)
    goal = decode_goto(outer_loop.fly("goto", "hover", (98.2, 110.8, 10.0)).argument)
    np.testing.assert_allclose(goal.pos_ned_m, [110.8, 98.2, -10.0], atol=0.1)
    assert flown.result(LIMIT_S).startswith("goto: there, ")
    assert pilot.origin == (28.17, 112.93, 50.0)
    with pytest.raises(GoalRefused) as caught:
        pilot.goto_gps(99.0, 0.0, 60.0)
    assert caught.value.cause == "OUT_OF_RANGE"


def test_in_asyncio_it_is_awaited(pilot, outer_loop, beside):
    async def fly():
        goal = pilot.takeoff(wait=False)
        waiter = asyncio.ensure_future(_wait_for(goal))
        await asyncio.sleep(0)
        waiter.cancel()  # who waits goes; the goal does not
        return await goal

    async def _wait_for(goal):
        return await goal

    flown = beside(asyncio.run, fly())
    assert outer_loop.fly("takeoff", "hover", (0.0, 0.0, 10.0)).argument is None
    assert flown.result(LIMIT_S) == "takeoff: done, mode hover"


def test_modes_are_obeyed_or_refused(pilot, outer_loop, beside):
    flown = beside(pilot.hold)
    outer_loop.fly("hold", "hover")
    assert flown.result(LIMIT_S) == "hold: done"
    flown = beside(pilot.mode, "manual")
    goal = outer_loop.next_goal()
    assert goal.command == "manual"
    outer_loop.answer(goal, GoalState.REFUSED, "manual: no sticks are heard", "STICKS")
    with pytest.raises(GoalRefused, match="no sticks") as caught:
        flown.result(LIMIT_S)
    assert caught.value.cause == "STICKS"
    for name in ("goto", "trajectory", "loop"):
        with pytest.raises(GoalRefused, match=f"mode '{name}'"):
            pilot.mode(name)


def test_arming_is_answered(pilot, outer_loop):
    assert pilot.arm(False) == "arm: as asked" and outer_loop.armed is False
    outer_loop.mode = "hover"
    with pytest.raises(GoalRefused, match="not in hover"):
        pilot.arm(False)


def test_a_pilot_that_is_closed_lets_go(ros_context, outer_loop):
    pilot = Pilot(context=ros_context, actions=False, wait_s=LIMIT_S)
    goal = pilot.land(wait=False)
    outer_loop.next_goal()
    pilot.close()
    with pytest.raises(GoalClosed, match="the flight goes on"):
        goal.result(LIMIT_S)
    with pytest.raises(PilotError, match="closed"):
        pilot.land()
    pilot.close()


def test_no_call_waits_in_a_callback(pilot, outer_loop):
    caught = queue.Queue()

    def tell(_):
        try:
            pilot.land()
        except PilotError as error:
            caught.put(str(error))

    pilot.goto(30.0, 0.0, 5.0, wait=False, on_feedback=tell)
    outer_loop.answer(outer_loop.next_goal(), GoalState.ACTIVE, end=[0, 30.0, -5.0], lasts_s=1e6)
    assert "wait=False" in caught.get(timeout=LIMIT_S)


def test_without_a_flight_it_says_so(ros_context):
    with pytest.raises(FlightNotHeard, match="no flight is heard"):
        Pilot(context=ros_context, actions=False, wait_s=0.2)


def test_a_flight_that_is_not_ready_is_waited_for(ros_context, outer_loop):
    outer_loop.ready = False
    # As long as one that is ready takes to be heard.
    outer_loop.name = "outer_loop"
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(Pilot, context=ros_context, actions=False, wait_s=LIMIT_S)
        outer_loop.ready = True
        made.result(LIMIT_S).close()


def test_every_code_but_done_has_its_exception():
    assert set(ERRORS) == set(Code) - {Code.DONE}
    assert len(set(ERRORS.values())) == len(ERRORS)
    for code, kind in ERRORS.items():
        error = goal_error(code, "why", "CAUSE")
        assert type(error) is kind and (error.code, str(error)) == (code, "why")
