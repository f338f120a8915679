# SPDX-License-Identifier: Apache-2.0
"""A mode flown from outside beside an outer loop of a few lines: taken over, ended, refused."""

import math

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TwistStamped

from heli_actions import (
    ForeignMode,
    GoalCanceled,
    GoalRefused,
    ModeLeft,
    Pilot,
    Requirement,
    Velocity,
)
from heli_actions.foreign_mode import FAILED, NOT_FINITE, OTHER_NODE, UNMET
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_FAILSAFE, FACT_REFUSED, refusal_text

LIMIT_S = 120.0


class East(ForeignMode):
    """Eastward, until it is told otherwise."""

    name = "east"

    def __init__(self):
        self.says, self.why, self.seen = Velocity(1.5, 0.0, 0.25, 10.0), "", []

    def update(self, now):
        self.seen.append(now)
        if isinstance(self.says, Exception):
            raise self.says
        return self.says

    def refuses(self, now):
        return self.why


@pytest.fixture
def pilot(ros_context, outer_loop):
    outer_loop.mode, outer_loop.enu_m = "hover", (3.0, 2.0, 10.0)
    with Pilot(context=ros_context, actions=False, wait_s=LIMIT_S) as one:
        while one.status.landed:
            assert not one.status.sentence == ""
        yield one


@pytest.fixture
def flown(pilot, outer_loop):
    """A mode that has been taken over, and its goal."""
    mode = East()
    goal = pilot.fly(mode, wait=False)
    outer_loop.velocities.get(timeout=LIMIT_S)
    while pilot.status.mode != "velocity":
        assert not goal.done
    seen = len(mode.seen)
    while len(mode.seen) < seen + 2:
        assert not goal.done
    return mode, goal


def held(outer_loop):
    """The aircraft is told to hold."""
    return outer_loop.next_goal().command == "hold"


def test_it_says_what_is_flown_until_it_is_done(flown, outer_loop):
    mode, goal = flown
    message = outer_loop.velocities.get(timeout=LIMIT_S)
    v, w = message.twist.linear, message.twist.angular
    assert (v.x, v.y, v.z, w.z) == (1.5, 0.0, 0.25, -math.radians(10.0))
    stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
    assert message.header.frame_id == "map" and stamp_ns > 0
    assert goal.feedback.mode in ("hover", "velocity")
    now = mode.seen[-1]
    np.testing.assert_allclose(now.pos_enu_m, [3.0, 2.0, 10.0])
    assert now.heading_deg == pytest.approx(0.0, abs=1e-6) and now.status.mode == "velocity"
    mode.says = None
    assert goal.result(LIMIT_S) == "east: done"
    assert held(outer_loop)


def test_what_it_requires_is_checked_before(pilot, outer_loop):
    outer_loop.mode = "standing"
    while not pilot.status.landed:
        assert pilot.status.mode
    with pytest.raises(GoalRefused, match="stands on the ground") as caught:
        pilot.fly(East())
    assert caught.value.cause == Requirement.AIRBORNE.name and outer_loop.velocities.empty()


def test_what_it_requires_is_checked_at_each_step(flown, outer_loop):
    _, goal = flown
    outer_loop.facts = {FACT_FAILSAFE: "LAND"}
    with pytest.raises(ModeLeft) as caught:
        goal.result(LIMIT_S)
    assert caught.value.cause == Requirement.NO_FAILSAFE.name and held(outer_loop)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"says": Velocity(math.nan, 0.0)}, NOT_FINITE),
        ({"says": ValueError("no idea")}, FAILED),
        ({"why": "the wind is too strong"}, UNMET),
    ],
)
def test_what_fails_ends_it_in_a_hover(flown, outer_loop, change, cause):
    mode, goal = flown
    vars(mode).update(change)
    with pytest.raises(ModeLeft) as caught:
        goal.result(LIMIT_S)
    assert caught.value.cause == cause and held(outer_loop)
    while not outer_loop.velocities.empty():
        assert math.isfinite(outer_loop.velocities.get().twist.linear.x)


def test_where_another_node_sends_it_is_refused(pilot, outer_loop, ros_context):
    other = rclpy.create_node("rival", context=ros_context)
    other.create_publisher(TwistStamped, topics.COMMAND_VELOCITY, 10)
    while outer_loop.node.count_publishers(topics.COMMAND_VELOCITY) < 1:
        assert pilot.status.ready
    with pytest.raises(GoalRefused, match="/rival sends command_velocity") as caught:
        pilot.fly(East())
    other.destroy_node()
    assert caught.value.cause == OTHER_NODE and outer_loop.velocities.empty()


def test_what_the_outer_loop_refuses_is_told(pilot, outer_loop):
    outer_loop.takes_over = False
    goal = pilot.fly(East(), wait=False)
    outer_loop.velocities.get(timeout=LIMIT_S)
    refused = refusal_text(1, "velocity: outside the fence")
    outer_loop.facts = {f"{FACT_REFUSED}{topics.COMMAND_VELOCITY}": refused}
    with pytest.raises(GoalRefused, match="outside the fence"):
        goal.result(LIMIT_S)
    assert outer_loop.goals.empty()  # it has flown nothing, so nothing is to be held


def test_another_mode_ends_it_and_is_left_alone(flown, outer_loop):
    _, goal = flown
    outer_loop.mode = "manual"
    with pytest.raises(ModeLeft, match="left for mode manual"):
        goal.result(LIMIT_S)
    assert outer_loop.goals.empty()


def test_it_is_cancelled(flown, outer_loop, pilot):
    _, goal = flown
    with pytest.raises(GoalRefused, match="flies a mode already"):
        pilot.fly(East())
    goal.cancel()
    with pytest.raises(GoalCanceled):
        goal.result(LIMIT_S)
    assert held(outer_loop)
