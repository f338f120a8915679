# SPDX-License-Identifier: Apache-2.0
"""An attitude that does not follow: when it counts, what soft flight asks for, what is told."""

import math

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, SETPOINT, SHAPED
from heli_outer_pd import Phase, parameters, position_law
from heli_outer_pd.disturbance import AS_IT_IS, K_P_SHARE, SOFT_TILT_RAD, watch_attitude
from heli_outer_pd.failsafes import Action
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.position_health import answer, flown_in_words
from heli_outer_pd.state import LEAVES, MACHINE, MEMORY, SERVO_DEGRADED, SERVO_NOMINAL, SERVO_STUCK

PITCH, ROLL = 8.0, 5.5
VALUES = OuterLoopNode.SPEC.resolve() | {"failsafe.unfollowed_deg": [PITCH, ROLL]}
AXES = [(0, PITCH), (1, ROLL)]


class Watched:
    """What the attitude explains beside a command of nothing, step by step."""

    def __init__(self, **changes):
        self.k = parameters.outer_params(VALUES | changes)
        self.state = position_law.initial_state(self.k)

    def see(self, axis, off_deg, seconds, psi=0.0, turns=0.0):
        """off_deg(t) is what the attitude is off by; returns when it changed, s, and to what."""
        before, changes = self.state.machine[MACHINE.servo], []
        for i in range(round(seconds / self.k.dt_s)):
            flown = np.zeros(2)
            flown[axis] = self.k.g * math.tan(math.radians(off_deg(i * self.k.dt_s)))
            watch_attitude(flown, psi, np.array([0.0, 0.0, turns]), self.k, self.state)
            if self.state.machine[MACHINE.servo] != before:
                before = self.state.machine[MACHINE.servo]
                changes.append((i * self.k.dt_s, before))
        return changes


def swing(amplitude_deg, period_s=1.5):
    return lambda t: amplitude_deg * math.sin(2.0 * math.pi * t / period_s)


@pytest.mark.parametrize(("axis", "limit"), AXES)
def test_a_swing_over_the_limit_is_flown_softly_and_one_below_it_is_not(axis, limit):
    """Of a sine the standard deviation is its amplitude by the root of two."""
    assert Watched().see(axis, swing(0.85 * math.sqrt(2.0) * limit), 60.0) == []
    ((at_s, now), *_) = Watched().see(axis, swing(3.0 * limit, 3.0), 60.0)
    assert now == SERVO_DEGRADED and at_s < 3.0


@pytest.mark.parametrize(("axis", "limit"), AXES)
def test_what_hangs_to_one_side_is_no_swing_and_of_itself_changes_nothing(axis, limit):
    """A steady error grows as slowly as wind turns; that is for the disturbance's estimate."""
    assert Watched().see(axis, lambda t: min(t, 8.0) / 8.0 * 1.5 * limit, 60.0) == []


@pytest.mark.parametrize(("axis", "limit"), AXES)
def test_a_swing_that_ends_to_one_side_is_a_servo_that_is_stuck(axis, limit):
    watched = Watched()
    assert [now for _, now in watched.see(axis, swing(3.0 * limit, 3.0), 1.6)] == [SERVO_DEGRADED]
    ((at_s, now),) = watched.see(axis, lambda t: limit, 20.0)
    assert now == SERVO_STUCK and 2.0 < at_s < 8.0
    assert watched.see(axis, swing(3.0 * limit), 5.0) == []


@pytest.mark.parametrize(("axis", "limit"), AXES)
def test_what_is_calm_again_has_its_gains_again_each_time_later(axis, limit):
    watched, after_s = Watched(), []
    for _ in range(3):
        assert [now for _, now in watched.see(axis, swing(3.0 * limit), 2.0)] == [SERVO_DEGRADED]
        assert watched.state.x[MEMORY.takes_over] == 0.0
        ((at_s, now),) = watched.see(axis, lambda t: 0.0, 60.0)
        assert now == SERVO_NOMINAL and watched.state.x[MEMORY.takes_over] == 1.0, "without a step"
        watched.state.x[MEMORY.takes_over] = 0.0
        after_s.append(at_s)
    assert np.diff(after_s) == pytest.approx([5.0, 10.0], abs=0.1)


@pytest.mark.parametrize(("axis", "limit"), AXES)
def test_a_swing_that_has_grown_quickly_to_and_fro_is_no_servo(axis, limit):
    """Commands that are 0.1 s late make it swing each 1.2 s, a little more each time."""
    watched = Watched()
    grows = lambda t: min(0.25 * t, 3.0) * swing(limit, 1.2)(t)  # noqa: E731
    assert [now for _, now in watched.see(axis, grows, 12.0)] == [SERVO_STUCK]
    assert [now for _, now in watched.see(axis, lambda t: 0.0, 20.0)] == [SERVO_NOMINAL]
    assert [now for _, now in watched.see(axis, grows, 12.0)] == [SERVO_STUCK]


def test_late_navigation_says_nothing_of_servos():
    watched = Watched()
    watched.state.x[MEMORY.is_late] = 1.0
    watched.see(1, lambda t: 0.0, 2.0)
    assert watched.see(1, swing(3.0 * ROLL), 20.0) == []


def test_a_landing_is_soft_once_it_has_been():
    watched = Watched()
    watched.see(1, swing(3.0 * ROLL), 2.0)
    watched.see(1, lambda t: 0.0, 10.0)
    assert watched.state.machine[MACHINE.servo] == SERVO_NOMINAL
    watched.state.x[MEMORY.lands] = 1.0
    assert watched.see(1, lambda t: 0.0, 60.0) == [(0.0, SERVO_DEGRADED)]
    sound = Watched()
    sound.state.x[MEMORY.lands] = 1.0
    assert sound.see(1, lambda t: 0.0, 60.0) == []


def test_a_nose_that_turns_away_says_nothing_of_roll_and_pitch():
    for turned in ({"psi": 0.6}, {"turns": -1.6}):
        assert Watched().see(1, swing(3.0 * ROLL), 20.0, **turned) == []
        watched = Watched()
        watched.see(1, swing(3.0 * ROLL), 3.0)
        assert [now for _, now in watched.see(1, swing(3.0 * ROLL), 9.0, **turned)] == [SERVO_STUCK]


def test_on_the_ground_and_without_an_estimate_it_is_forgotten():
    watched = Watched()
    watched.see(1, swing(3.0 * ROLL), 5.0)
    watched.state.machine[MACHINE.guidance] = LEAVES
    assert [now for _, now in watched.see(1, swing(3.0 * ROLL), 5.0)] == [SERVO_NOMINAL]
    assert not watched.state.x[MEMORY.off_square].any()
    for off in ({"wind_compensation": False}, {"horizontal": "level"}):
        assert Watched(**off).see(1, swing(3.0 * ROLL), 5.0) == []


def test_180_deg_is_never():
    never = {"failsafe.unfollowed_deg": [180.0, 180.0]}
    assert Watched(**never).see(1, swing(80.0), 20.0) == []


def command(soft, pos_ned_m, roll_rad=0.0):
    """phi and theta off trim, rad, of a law at rest that is off by a way."""
    k = parameters.outer_params(VALUES | {"attitude_lead.lead_s": [0.0, 0.0]})
    state, nav, out = position_law.initial_state(k), np.zeros(NAV.size), np.zeros(SETPOINT.size)
    nav[NAV.pos] = pos_ned_m
    phi, theta = k.trim[SETPOINT.phi] + roll_rad, k.trim[SETPOINT.theta]
    nav[NAV.quat] = quat_from_euler(phi, theta, 0.0)
    state.x[MEMORY.engaged], state.machine[MACHINE.servo], state.x[MEMORY.calm_wanted_s] = (
        1.0,
        soft,
        9.0,
    )
    assert position_law.position_law(nav, np.zeros(SHAPED.size), k, state, out) == 0
    return k, out[SETPOINT.phi] - k.trim[SETPOINT.phi], out[SETPOINT.theta] - k.trim[SETPOINT.theta]


def test_soft_flight_asks_for_a_part_of_the_gain_and_of_the_attitude():
    off = np.array([0.0, -0.5, 0.0])
    k, full, _ = command(SERVO_NOMINAL, off)
    _, soft, _ = command(SERVO_DEGRADED, off)
    assert math.tan(full) == pytest.approx(k.K_P[1] * 0.5 / k.g)
    eased = soft / (1.0 - AS_IT_IS)
    assert math.tan(eased) == pytest.approx(K_P_SHARE * k.K_P[1] * 0.5 / k.g)
    # What is rolled already stays commanded, but for a quarter of it.
    _, rolled, _ = command(SERVO_DEGRADED, off, roll_rad=0.02)
    assert rolled - soft == pytest.approx(AS_IT_IS * 0.02, abs=1e-4)
    assert command(SERVO_STUCK, off)[1] == full


def test_soft_flight_cuts_the_tilt():
    for off in ([-500.0, 0.0, 0.0], [0.0, 500.0, 0.0]):
        k, phi, theta = command(SERVO_DEGRADED, np.array(off))
        assert max(abs(phi), abs(theta)) <= (1.0 - AS_IT_IS) * SOFT_TILT_RAD * (1.0 + 1e-9)
        _, phi, theta = command(SERVO_NOMINAL, np.array(off))
        assert max(abs(phi), abs(theta)) > 2.0 * SOFT_TILT_RAD


def test_it_is_told_and_counts_among_the_failsafes():
    state = position_law.initial_state(parameters.outer_params(VALUES))
    assert flown_in_words(Phase.HOVER, state, "held") == "held"
    assert answer(Phase.HOVER, state) is Action.NONE
    state.machine[MACHINE.servo] = SERVO_DEGRADED
    assert "softly" in flown_in_words(Phase.HOVER, state, "held")
    assert answer(Phase.HOVER, state) is Action.SOFT
    state.machine[MACHINE.servo] = SERVO_STUCK
    assert "stuck" in flown_in_words(Phase.HOVER, state, "held")
    assert answer(Phase.HOVER, state) is Action.NOTE
