# SPDX-License-Identifier: Apache-2.0
"""The fence: who leaves it, by sticks or by wind, is brought back and hovers inside."""

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, SETPOINT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_outer_pd import Command, Guard, Phase, parameters, position_law
from heli_outer_pd.goto import Fence, Goto, PhaseNumbers, left, outside
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_law import follow
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused, shaped_reference_at
from heli_outer_pd.state import FLIES, MACHINE, POSITION_LOST

VALUES = OuterLoopNode.SPEC.resolve()
SMALL = {"fence.radius_m": 30.0, "fence.ceiling_m": 40.0, "fence.margin_m": 5.0}
STEP_NS = VALUES["period_ticks"] * TICK_NS
DT_S = STEP_NS / NS_PER_S
RATE = NS_PER_S // STEP_NS  # steps of the law in a second
NEUTRAL = np.zeros(4)


class Craft:
    """A law whose aircraft is where the reference is; under the sticks it goes on as it did."""

    def __init__(self, pos=(0.0, 0.0, -20.0), vel=(0.0, 0.0, 0.0), **changes):
        values = VALUES | SMALL | changes
        self.k = parameters.outer_params(values)
        self.state = position_law.initial_state(self.k)
        self.limits = ReferenceLimits.from_parameters(values)
        self.phases = Phases(
            PhaseNumbers.from_parameters(values), Goto.from_parameters(values), self.k, self.state,
            self.limits,
        )  # fmt: skip
        self.now_ns, self.out, self.nav = 10 * NS_PER_S, self.k.trim.copy(), np.zeros(NAV.size)
        self.nav[NAV.pos], self.nav[NAV.vel], self.vel = pos, vel, np.array(vel)
        trim = self.k.trim
        self.nav[NAV.quat] = quat_from_euler(trim[SETPOINT.phi], trim[SETPOINT.theta], 0.3)
        self.phases.follow(Trajectory.hover(np.array(pos), 0.3), 0)
        self.phases.command(Command.HOLD, self.now_ns, self.nav)

    def step(self, steered=False, blown=(0.0, 0.0, 0.0)):
        if steered:
            self.phases.steer(NEUTRAL, self.now_ns)
        way = self.phases.trajectory
        if self.state.machine[MACHINE.guidance] == FLIES:
            row = np.empty(10)
            shaped_reference_at(
                self.now_ns - way.start_ns, self.k.shaping_ns, 0.0, way.times_ns, way.points, row
            )
            self.nav[NAV.pos], self.nav[NAV.vel] = row[:3] + blown, row[3:6]
        else:
            self.nav[NAV.vel] = self.vel
            self.nav[NAV.pos] += self.vel * DT_S
        follow(self.nav, self.now_ns - way.start_ns, way.times_ns, way.points, self.k, self.state,
               self.out)  # fmt: skip
        self.phases.after(self.now_ns, self.nav, self.out)
        self.now_ns += STEP_NS

    def ask(self, command, goal=None):
        return self.phases.command(command, self.now_ns, self.nav, goal)

    @property
    def away(self):
        return float(np.hypot(*self.nav[NAV.pos][:2]))


def steered_out(command, **start):
    """By sticks until they are taken away; returns the craft and the last position by them."""
    craft = Craft(**start)
    craft.phases.steer(NEUTRAL, craft.now_ns)
    assert craft.ask(command) is None
    for _ in range(16 * RATE):
        craft.step(steered=True)
        if craft.phases.phase == Phase.HOVER:
            return craft
    raise AssertionError("the sticks lead on")


@pytest.mark.parametrize("command", [Command.ATTITUDE, Command.MANUAL])
def test_the_sticks_are_taken_away_at_the_fence_and_it_hovers_inside(command):
    craft = steered_out(command, vel=(0.0, 5.0, 0.0))
    assert craft.away == pytest.approx(30.0, abs=0.25), "at the first step beyond it"
    (remark,) = craft.phases.remarks
    assert remark == left(command.value, craft.phases.fence_distance_m)
    assert craft.ask(command).cause == Guard.FENCE, "not while it is outside"
    farthest = 0.0
    for _ in range(32 * RATE):
        craft.step(steered=True)
        farthest = max(farthest, craft.away)
    # Braked from 5 m/s with 1.5 m/s2 and its jerk.
    assert farthest < 30.0 + 5.0**2 / (2 * 1.5) + 5.0
    assert craft.away == pytest.approx(25.0, abs=1e-6) and craft.phases.fence_distance_m == 0.0
    assert craft.phases.phase == Phase.HOVER
    assert craft.ask(command) is None, "the pilot has it again, inside"


def test_the_ceiling_counts_from_the_ground():
    craft = steered_out(Command.MANUAL, vel=(0.0, 0.0, -3.0))
    assert -craft.nav[NAV.pos][2] == pytest.approx(40.0, abs=0.15)
    for _ in range(24 * RATE):
        craft.step(steered=True)
    assert -craft.nav[NAV.pos][2] == pytest.approx(35.0, abs=1e-6)


def test_what_is_asked_for_beyond_the_fence_is_refused():
    craft = Craft()
    with pytest.raises(ReferenceRefused, match=" 30 m"):
        craft.ask(Command.GOTO, (np.array([0.0, 31.0, -20.0]), 0.0))
    with pytest.raises(ReferenceRefused, match="2 to 40 m"):
        craft.ask(Command.GOTO, (np.array([0.0, 0.0, -41.0]), 0.0))
    assert Craft(**{"fence.radius_m": 500.0}).limits.distance_m == 100.0


def test_a_way_is_given_up_where_the_wind_takes_it_out():
    craft = Craft()
    assert craft.ask(Command.GOTO, (np.array([0.0, 29.0, -20.0]), 0.0)) is None
    while craft.phases.phase == Phase.TRAJECTORY:
        craft.step(blown=(0.0, 4.0, 0.0))
    assert craft.phases.remarks == [left("trajectory", craft.phases.fence_distance_m)]
    assert craft.ask(Command.GOTO, (np.array([0.0, 0.0, -20.0]), 0.0)) is not None
    for _ in range(16 * RATE):
        craft.step()
    assert craft.away <= 30.0 and craft.phases.phase == Phase.HOVER


def test_a_hold_outside_leads_inside():
    craft = Craft(pos=(0.0, 50.0, -60.0))
    for _ in range(60 * RATE):
        craft.step()
    np.testing.assert_allclose(craft.nav[NAV.pos], (0.0, 25.0, -35.0), atol=1e-6)


def test_without_a_position_there_is_no_fence():
    craft = Craft(vel=(0.0, 5.0, 0.0), pos=(0.0, 35.0, -20.0))
    craft.state.machine[MACHINE.position] = POSITION_LOST
    craft.nav[NAV.sigma_vel] = 9.0
    craft.phases.steer(NEUTRAL, craft.now_ns)
    assert craft.ask(Command.MANUAL) is None
    for _ in range(round(0.4 * RATE)):
        craft.step(steered=True)
    assert craft.phases.phase == Phase.MANUAL and craft.phases.fence_distance_m == 0.0


def test_where_no_position_is_held_nothing_is_fenced_in():
    """The attitude test drifts off with the wind, as it should."""
    craft = Craft(pos=(0.0, 35.0, -20.0), horizontal="level")
    craft.step()
    assert craft.phases.fence_distance_m == 0.0


def test_the_nearest_place_inside():
    fence, home = Fence(30.0, 40.0, 5.0), np.array([10.0, 0.0, 0.0])
    np.testing.assert_allclose(fence.inside(np.array([10.0, 60.0, -9.0]), home, 0.0), (10, 25, -9))
    np.testing.assert_allclose(fence.inside(np.array([10.0, 0.0, -90.0]), home, 2.0), (10, 0, -33))
    assert fence.fence_distance_m(np.array([10.0, -31.5, -9.0]), home, 0.0) == pytest.approx(1.5)
    assert fence.fence_distance_m(np.full(3, np.nan), home, 0.0) == 0.0
    assert outside(0.0, "held") == "held"
    assert outside(1.5, "").startswith("1.5 m ")
