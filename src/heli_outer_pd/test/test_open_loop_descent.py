# SPDX-License-Identifier: Apache-2.0
"""Down by thrust alone: a rotor in heave, a navigation whose vertical speed drifts, the ground."""

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, SETPOINT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_outer_pd import Command, Phase, parameters, position_law
from heli_outer_pd.disturbance import kept, trim_thrust
from heli_outer_pd.failsafes import Action
from heli_outer_pd.goto import Goto, PhaseNumbers
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_health import answer, flown_in_words
from heli_outer_pd.position_law import follow
from heli_outer_pd.reference import ReferenceLimits
from heli_outer_pd.state import (
    ALTITUDE_LOST,
    ALTITUDE_VALID,
    MACHINE,
    thrust_for_collective,
)

VALUES = OuterLoopNode.SPEC.resolve()
STEP_NS = VALUES["period_ticks"] * TICK_NS
RATE = NS_PER_S // STEP_NS  # steps of the law in a second
SURE, UNSURE = 0.03, 0.3


class Heave:
    """An aircraft that only climbs and sinks, 10 m up; the ground holds it at height 0.

    Its thrust follows the collective behind the lag that the controller knows of. Its rotor gives
    `strength` of its map; the navigation's velocity is off by `drift` times the time since it knew
    it.
    """

    def __init__(self, strength=1.0, drift_mps2=0.0):
        self.k = parameters.outer_params(VALUES)
        self.state = position_law.initial_state(self.k)
        goto, fence = Goto.from_parameters(VALUES), ReferenceLimits.from_parameters(VALUES)
        numbers = PhaseNumbers.from_parameters(VALUES)
        self.phases = Phases(numbers, goto, self.k, self.state, fence)
        self.phases.follow(Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.0), 0)
        self.now_ns, self.out, self.nav = 0, self.k.trim.copy(), np.zeros(NAV.size)
        self.nav[NAV.quat] = quat_from_euler(*self.k.trim[: SETPOINT.psi], 0.0)
        self.strength, self.drift, self.error = strength, drift_mps2, np.zeros(2)
        self.down, self.speed, self.touched = -10.0, 0.0, None
        self.col = self.out[SETPOINT.col]

    def step(self, sigma):
        self.nav[NAV.sigma_vel] = 0.02, 0.02, sigma
        if sigma > SURE:
            self.error += self.k.dt_s * np.array([self.error[1], self.drift])
        self.nav[NAV.pos][2], self.nav[NAV.down_vel] = (
            self.down + self.error[0],
            self.speed + self.error[1],
        )
        way, before = self.phases.trajectory, self.out.copy()
        assert follow(self.nav, self.now_ns - way.start_ns, way.times_ns, way.points, self.k,
                      self.state, self.out) == 0  # fmt: skip
        self.phases.after(self.now_ns, self.nav, self.out)
        self.now_ns += STEP_NS
        self.col += (1.0 - kept(self.k.dt_s, self.k.collective_lag_s)) * (
            self.out[SETPOINT.col] - self.col
        )
        thrust = self.strength * thrust_for_collective(
            self.col, self.speed, trim_thrust(self.k), self.k.trim[SETPOINT.col],
            self.k.rotor,
        )  # fmt: skip
        self.speed += self.k.dt_s * (self.k.g - thrust * np.cos(self.k.trim[0]) / self.k.mass)
        self.down += self.k.dt_s * self.speed
        if self.down >= 0.0:
            self.touched = self.speed if self.touched is None else self.touched
            self.down, self.speed = 0.0, min(self.speed, 0.0)
        return before, self.out


def settled(**changes):
    craft = Heave(**changes)
    for _ in range(40 * RATE):
        craft.step(SURE)
    assert craft.down == pytest.approx(-10.0, abs=0.05)
    return craft


@pytest.mark.parametrize("strength", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("drift", [-0.03, 0.0, 0.03])
def test_it_lands_softly_whatever_the_navigation_drifts_to(strength, drift):
    """Without a word of a pilot; a climb of the navigation or a sinking of it leads nowhere."""
    craft = settled(strength=strength, drift_mps2=drift)
    highest, seconds = craft.down, 0
    while craft.phases.phase != Phase.STANDING:
        craft.step(UNSURE)
        highest = min(highest, craft.down)
        seconds += craft.k.dt_s
        assert seconds < 60.0
    assert highest > -11.0 and craft.touched < 0.95 and craft.down == 0.0


def test_a_doubt_of_a_moment_is_none():
    """An IMU that stops for 0.2 s leaves one that the next fixes take."""
    craft = settled()
    for _ in range(3):
        for _ in range(round(0.96 * RATE)):
            craft.step(UNSURE)
        assert craft.state.machine[MACHINE.altitude] == ALTITUDE_VALID and not craft.phases.gone
        craft.step(SURE)


def test_it_is_told_and_no_pilot_is_needed():
    craft = settled()
    while craft.state.machine[MACHINE.altitude] != ALTITUDE_LOST:
        before, after = craft.step(UNSURE)
    np.testing.assert_allclose(after, before, atol=0.01)
    assert craft.state.machine[MACHINE.altitude] == ALTITUDE_LOST and craft.phases.gone
    assert flown_in_words(craft.phases.phase, craft.state, "").startswith("altitude lost: ")
    assert answer(craft.phases.phase, craft.state) == Action.LAND_BY_THRUST
    craft.step(UNSURE)
    assert craft.phases.phase == Phase.HALTING


def test_in_the_air_feeling_for_the_ground_is_no_fall():
    craft = settled()
    fastest = 0.0
    for _ in range(12 * RATE):
        craft.step(UNSURE)
        fastest = max(fastest, craft.speed)
    assert craft.phases.phase == Phase.DESCENDING and craft.down < -1.0
    assert 0.6 < fastest < 1.3


def test_what_comes_back_is_flown_from_where_it_is():
    """The barometer says 3 m lower than dead reckoning: no step, and back at a limited speed."""
    craft = settled()
    for _ in range(6 * RATE):
        craft.step(UNSURE)
    craft.error[0] = 3.0
    before, after = craft.step(SURE)
    assert craft.state.machine[MACHINE.altitude] == ALTITUDE_VALID
    np.testing.assert_allclose(after, before, atol=1e-9)
    for _ in range(6 * RATE):
        craft.step(SURE)
        assert craft.speed > -0.6


def test_a_sound_landing_does_not_look_at_it():
    craft = settled()
    assert craft.phases.command(Command.LAND, craft.now_ns, craft.nav) is None
    for _ in range(40 * RATE):
        craft.step(0.08)
        assert craft.state.machine[MACHINE.altitude] == ALTITUDE_VALID
    assert craft.phases.phase == Phase.STANDING
