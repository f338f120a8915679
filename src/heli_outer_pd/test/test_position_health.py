# SPDX-License-Identifier: Apache-2.0
"""Position lost and found again: what is commanded, what is learnt before, what is refused."""

import math

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, REFERENCE, SETPOINT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_outer_pd import Command, Fact, Guard, Phase, Refusal, parameters, position_law
from heli_outer_pd.failsafes import Action
from heli_outer_pd.goto import Goto, PhaseNumbers, trajectory_quickly_down
from heli_outer_pd.guidance.paths import FlightPath
from heli_outer_pd.modes import LANDING
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_health import (
    answer,
    flown_in_words,
    health_fact,
    plight,
    sigma_of_speed,
    time_down_s,
)
from heli_outer_pd.position_law import follow
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused
from heli_outer_pd.state import (
    MACHINE,
    MEMORY,
    POSITION_LOST,
    POSITION_REACQUIRED,
    POSITION_VALID,
    STEERED,
)

VALUES = OuterLoopNode.SPEC.resolve()
LIMIT = VALUES["land.blind_sigma_mps"]
STEP_NS = VALUES["period_ticks"] * TICK_NS
RATE = NS_PER_S // STEP_NS  # steps of the law in a second
NEVER = {"failsafe.land_astray_m": 1e4}
WIND_NED = np.array([0.3, -1.2, 0.0])  # what pushes, m/s2


class Flight:
    """The law and its phases, of an aircraft that hovers at rest, leaning against the wind.

    Its altitude is that of the reference, and `off_m` below.
    """

    def __init__(self, way=None, psi=0.4, **changes):
        values = VALUES | changes
        self.k = parameters.outer_params(values)
        self.state = position_law.initial_state(self.k)
        self.phases = Phases(
            PhaseNumbers.from_parameters(values),
            Goto.from_parameters(values),
            self.k,
            self.state,
            ReferenceLimits.from_parameters(values),
        )
        self.phases.follow(way or Trajectory.hover(np.array([0.0, 0.0, -10.0]), psi), 0)
        self.now_ns, self.out, self.nav = 0, self.k.trim.copy(), np.zeros(NAV.size)
        self.off_m, self.psi = 0.0, psi
        c, s = math.cos(psi), math.sin(psi)
        forward, right = c * WIND_NED[0] + s * WIND_NED[1], -s * WIND_NED[0] + c * WIND_NED[1]
        self.lean = np.array(
            [
                self.k.trim[SETPOINT.phi] + math.atan(-right / self.k.g),
                self.k.trim[SETPOINT.theta] - math.atan(-forward / self.k.g),
            ]
        )
        self.nav[NAV.quat] = quat_from_euler(*self.lean, psi)

    def step(self, sigma=0.02):
        """One step of the law; its command before and after."""
        self.nav[NAV.sigma_vel] = sigma, 0.5 * sigma, 0.01
        before, way = self.out.copy(), self.phases.trajectory
        row = way.at(self.now_ns)
        self.nav[NAV.pos][2], self.nav[NAV.down_vel] = row[2] + self.off_m, row[REFERENCE.down_vel]
        code = follow(self.nav, self.now_ns - way.start_ns, way.times_ns, way.points, self.k,
                      self.state, self.out)  # fmt: skip
        assert code == 0
        self.phases.after(self.now_ns, self.nav, self.out)
        self.now_ns += STEP_NS
        return before, self.out.copy()

    def ask(self, command, goal=None):
        return self.phases.command(command, self.now_ns, self.nav, goal)


def hovering(**changes):
    flight = Flight(**changes)
    for _ in range(15 * RATE):
        flight.step()
    return flight


def test_the_lean_that_the_wind_took_is_learnt_at_rest():
    flight = hovering()
    np.testing.assert_allclose(flight.state.x[MEMORY.rest], WIND_NED[:2], atol=1e-6)
    flight.nav[NAV.vel] = 1.5, 0.0, 0.0
    flight.step()
    before = flight.state.x[MEMORY.rest].copy()
    flight.step()
    np.testing.assert_array_equal(flight.state.x[MEMORY.rest], before)


def test_another_heading_learns_anew():
    """What pushed the side pushes the front: the mean begins with what is pushed now."""
    flight = hovering()
    flight.nav[NAV.quat] = quat_from_euler(*flight.k.trim[: SETPOINT.psi], flight.psi + 1.0)
    flight.state.x[MEMORY.disturbance] = 0.0
    flight.step()
    assert flight.state.x[MEMORY.rested_s] == pytest.approx(flight.k.dt_s)
    assert np.abs(flight.state.x[MEMORY.rest]).max() < 0.2


def test_it_goes_blind_without_a_step_and_holds_lean_heading_and_altitude():
    """Wherever the navigation drifts to; the vertical is flown as before."""
    flight = hovering()
    # Just before, it answers an error of 1 m and 0.4 m/s.
    flight.nav[NAV.pos][:2], flight.nav[NAV.vel][:2] = (1.0, -0.5), (0.4, 0.2)
    for _ in range(3):
        flight.step()
    assert np.degrees(np.abs(flight.out[:2] - flight.lean)).max() > 5.0
    before, after = flight.step(1.01 * LIMIT)
    assert flight.state.machine[MACHINE.position] == POSITION_LOST and flight.phases.lost
    np.testing.assert_allclose(after, before, atol=1e-9)
    for second in range(5):
        flight.nav[NAV.pos][:2] += (4.0, -3.0)
        flight.nav[NAV.vel][:2] = 0.5 * second, -second
        for _ in range(RATE):
            _, after = flight.step(1.5 * LIMIT)
    np.testing.assert_allclose(after[:2], flight.lean, atol=1e-3)
    assert after[SETPOINT.psi] == pytest.approx(flight.psi)
    flight.off_m = 0.5
    before, after = flight.step(1.5 * LIMIT)
    assert hover_more(flight, before, after)


def hover_more(flight, before, after):
    return position_law.hover_share(after[SETPOINT.col], flight.k) > 1.05 * (
        position_law.hover_share(before[SETPOINT.col], flight.k)
    )


def test_a_way_that_is_flown_is_braked_by_what_the_reference_decelerates():
    """From 3 m/s: the sum of what is commanded beyond the lean takes it to rest."""
    path = FlightPath(np.array([0.0, 0.0, -10.0]), 0.0, Goto.from_parameters(VALUES).limits)
    way = path.go_to(np.array([60.0, 0.0, -10.0])).trajectory()
    flight, at_ns = Flight(way=way, psi=0.0, **NEVER), 10 * NS_PER_S
    while flight.now_ns < at_ns:
        row = way.at(flight.now_ns)
        flight.nav[NAV.pos], flight.nav[NAV.vel] = row[:3], row[3:6]
        flight.step()
    flight.state.x[MEMORY.rest] = WIND_NED[:2]  # its nav has not leaned as it got faster
    speed = float(flight.nav[NAV.vel][0])
    assert speed == pytest.approx(3.0, abs=0.1)
    for _ in range(8 * RATE):
        _, out = flight.step(2.0 * LIMIT)
        forward = flight.k.g * math.tan(-(out[SETPOINT.theta] - flight.k.trim[SETPOINT.theta]))
        speed += (forward + WIND_NED[0]) * flight.k.dt_s
    assert flight.phases.phase == Phase.HOVER
    assert abs(speed) < 0.5


def test_commands_that_need_a_position_are_refused_and_a_landing_is_not():
    flight = hovering()
    flight.step(2.0 * LIMIT)
    for command, goal in (
        (Command.HOLD, None),
        (Command.GOTO, (np.array([5.0, 0.0, -10.0]), 0.0)),
        (Command.VELOCITY, (np.array([1.0, 0.0, 0.0]), 0.0)),
    ):
        refused = flight.ask(command, goal)
        assert isinstance(refused, Refusal)
        assert refused.cause == Guard.NAVIGATION
    assert flight.ask(Command.LAND) is None
    for _ in range(5 * RATE):
        flight.step(2.0 * LIMIT)
    assert flight.phases.phase == Phase.DESCENDING
    assert flight.ask(Command.HOLD).cause == Guard.NAVIGATION
    assert plight(Phase.HALTING) == plight(Phase.DESCENDING) != plight(Phase.HOVER)
    assert "barometer" in plight(Phase.HALTING) and "sticks" in plight(Phase.HOVER)
    assert plight(Phase.ATTITUDE).endswith(": attitude")
    with pytest.raises(ReferenceRefused):
        flight.phases.steer(np.full(4, np.nan), 0)


@pytest.mark.parametrize(("phase", "command"), [(Phase.HOVER, None), (Phase.HALTING, Command.LAND)])
def test_what_is_found_again_is_flown_from_where_it_is_without_a_step(phase, command):
    """The fix moves position, altitude and velocity at once."""
    flight = hovering(**NEVER)
    for _ in range(2 * RATE):
        flight.step(2.0 * LIMIT)
    if command is not None:
        assert flight.ask(command) is None
        for _ in range(round(2.4 * RATE)):
            flight.step(2.0 * LIMIT)
        assert flight.phases.phase == Phase.DESCENDING
    flight.off_m = 0.6
    flight.nav[NAV.pos][:2] += (12.0, -9.0)
    flight.nav[NAV.vel][:2] += (1.0, 0.5)
    before, after = flight.step(0.04 * LIMIT)
    np.testing.assert_array_equal(before, after)
    assert flight.phases.phase == phase and not flight.phases.lost
    way = flight.phases.trajectory.at(flight.now_ns - STEP_NS)
    np.testing.assert_allclose(way[:2], flight.nav[NAV.pos][:2], atol=0.05)
    assert way[2] == pytest.approx(flight.nav[NAV.pos][2], abs=0.05)
    flight.off_m = 0.0
    before, after = flight.step(0.04 * LIMIT)
    np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.parametrize("lost_s", [0.5, 1.5])
def test_what_is_lost_for_long_is_landed_without_being_told(lost_s):
    """Counted from the loss; a position that comes back in time ends the count."""
    flight = hovering(**{"failsafe.land_after_s": 1.0})
    for _ in range(round(lost_s * RATE)):
        flight.step(2.0 * LIMIT)
    assert (flight.phases.phase in LANDING) == (lost_s > 1.0)
    if lost_s < 1.0:
        for _ in range(round(0.4 * RATE)):
            flight.step(0.04 * LIMIT)
        assert flight.state.x[MEMORY.lost_s] == 0.0
        for _ in range(round(0.6 * RATE)):
            flight.step(2.0 * LIMIT)
        assert flight.phases.phase == Phase.HOVER


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("fix", [False, True])
def test_what_dead_reckoning_leads_astray_lands(fix, known):
    """Long before the position counts as lost, and so early that it is down before it is too far;
    a fix in time ends the count."""
    flight, sigma = hovering(), 0.16 * LIMIT
    flight.state.x[MEMORY.ground_known] = known
    left_m = flight.k.land_astray_m - sigma * time_down_s(10.0, known, flight.k)
    steps = round(left_m / sigma / flight.k.dt_s)
    assert steps * flight.k.dt_s > 10.0
    for step in range(steps + 5):
        flight.step(0.5 * sigma if fix and step == steps // 2 else sigma)
        assert not flight.phases.lost
        assert step > steps - 5 or flight.phases.phase not in LANDING
    # It stands still: there is nothing to halt.
    assert (flight.phases.phase == Phase.DESCENDING) != fix
    sentence = flown_in_words(flight.phases.phase, flight.state, "")
    assert sentence.startswith("position astray") != fix
    assert answer(flight.phases.phase, flight.state) == (Action.NONE if fix else Action.LAND)


def test_a_sigma_that_grows_lands_earlier_and_a_gap_of_a_second_does_not():
    began_s = []
    for grows in (0.0, 0.02):
        flight, steps = hovering(), 0
        while flight.phases.phase not in LANDING:
            flight.step(0.16 * LIMIT + grows * steps * flight.k.dt_s)
            steps += 1
        began_s.append(steps * flight.k.dt_s)
    assert began_s[1] < 0.5 * began_s[0]
    flight = hovering()
    for _ in range(round(flight.k.land_silent_s / flight.k.dt_s) - 1):
        flight.step(0.9 * LIMIT)
    assert flight.phases.phase not in LANDING and flight.state.x[MEMORY.astray_m] > 0.5


def test_what_vibration_does_to_sigma_is_no_fix():
    flight = hovering()
    steps = round(1.6 * RATE)
    for step in range(steps):
        shaken = 25 * step // RATE % 4 == 2  # for 0.04 s of 0.16 s
        flight.step(0.16 * LIMIT * (1.08 if shaken else 1.0))
    assert flight.state.x[MEMORY.silent_s] == pytest.approx(steps * flight.k.dt_s)
    flight.step(0.16 * LIMIT * 0.9)
    assert flight.state.x[MEMORY.silent_s] == 0.0


def quick(height_m, known):
    """The way down by dead reckoning, from now on."""
    k, hover = hovering().k, Trajectory.hover(np.array([1.0, 2.0, -height_m]), 0.3)
    return trajectory_quickly_down(PhaseNumbers.from_parameters(VALUES), hover, 0.0, k, 0, 0, known)


@pytest.mark.parametrize("height_m", [1.0, 10.0, 400.0])
@pytest.mark.parametrize("known", [False, True])
def test_the_quick_way_down_is_slow_where_the_ground_may_be(known, height_m):
    way, k = quick(height_m, known), hovering().k
    down_s = np.interp(0.0, way.points[:, 2], way.times_ns) / NS_PER_S
    foreseen_s = time_down_s(height_m, known, k) - time_down_s(0.0, known, k)
    assert foreseen_s == pytest.approx(down_s, abs=0.8)
    speed, heights = way.points[:-1, REFERENCE.down_vel], -way.points[:-1, 2]
    fast, touch, feel = k.quick_mps
    assert speed.max() <= (fast if known else feel) + 1e-9
    late = speed[heights <= 1e-9]
    np.testing.assert_allclose(late, touch if known else feel)
    if known:
        assert (speed <= touch + np.maximum(heights, 0.0) / k.flare_s + 1e-9).all()


def test_the_quick_way_down_can_be_halted_anywhere():
    """A stop that lasts a whole number of steps but for rounding had two way points at one time."""
    goto, way = Goto.from_parameters(VALUES), quick(10.0, True)
    for now_ns in range(0, 8 * NS_PER_S, STEP_NS):
        halted = goto.halt(way, now_ns)
        assert not halted.points[-1, REFERENCE.vel].any()


def test_a_fix_after_a_gap_is_flown_back_to_without_a_step():
    """The navigation jumps by 5 m and 0.5 m/s: the command goes on, then returns slowly."""
    flight = hovering()
    for _ in range(round(1.2 * RATE)):  # less than a second is no gap
        flight.step(0.8 * LIMIT)
    flight.nav[NAV.pos][:2] += (3.0, -4.0)
    flight.nav[NAV.vel][:2] += (0.3, -0.4)
    before, after = flight.step(0.1 * LIMIT)
    np.testing.assert_allclose(after, before, atol=1e-9)
    assert flight.phases.phase in (Phase.TRAJECTORY, Phase.HOVER)
    assert math.hypot(*flight.state.x[MEMORY.shift][:2]) == pytest.approx(5.0, abs=0.1)
    for _ in range(round(12 / flight.k.dt_s)):
        shift = flight.state.x[MEMORY.shift].copy()
        flight.step(0.1 * LIMIT)
        assert np.linalg.norm(flight.state.x[MEMORY.shift] - shift) <= 1.001 * flight.k.dt_s
    np.testing.assert_allclose(flight.state.x[MEMORY.shift], 0.0, atol=0.1)


@pytest.mark.parametrize(
    ("silent_s", "moved"), [(0.4, False), (0.9, False), (1.1, True), (1.5, True)]
)
def test_fixes_that_are_lost_within_a_second_are_no_gap(silent_s, moved):
    """Sigma rises and falls by more than half: only after a gap is the reference moved."""
    flight = hovering(**NEVER)
    for sigma in np.linspace(0.1, 0.4, round(silent_s * RATE)):
        flight.step(sigma * LIMIT)
    assert flight.state.x[MEMORY.silent_s] == pytest.approx(silent_s, abs=1.5 * flight.k.dt_s)
    flight.nav[NAV.pos][:2] += (0.3, -0.4)
    flight.nav[NAV.vel][:2] += (0.1, -0.2)
    flight.step(0.12 * LIMIT)
    shift = flight.state.x[MEMORY.shift]
    assert math.hypot(*shift[:2]) == pytest.approx(0.5 if moved else 0.0, abs=0.01)
    if not moved:
        for sigma in np.linspace(0.12, 0.1, 2 * RATE):
            flight.step(sigma * LIMIT)
            assert not shift.any()


def test_near_the_ground_it_stays_blind():
    flight = hovering()
    flight.step(2.0 * LIMIT)
    assert flight.ask(Command.LAND) is None
    for _ in range(round(2.4 * RATE)):
        flight.step(2.0 * LIMIT)
    flight.off_m = -1.0 - flight.nav[NAV.pos][2]
    before, after = flight.step(0.04 * LIMIT)
    np.testing.assert_array_equal(before, after)
    assert flight.state.machine[MACHINE.position] == POSITION_REACQUIRED and flight.phases.lost
    flight.nav[NAV.vel][:2] = 2.0, 2.0
    for _ in range(2 * RATE):
        _, after = flight.step(0.04 * LIMIT)
    np.testing.assert_allclose(after[:2], flight.lean, atol=1e-3)
    assert health_fact(Phase.DESCENDING, flight.state, low=True) is None
    assert health_fact(Phase.DESCENDING, flight.state, low=False) == Fact.FOUND
    assert health_fact(Phase.SETTLING, flight.state, low=False) is None


def test_a_landing_that_has_nearly_lost_it_begins_anew_and_a_hover_does_not():
    for command in (None, Command.LAND):
        flight = hovering(**NEVER)
        if command is not None:
            flight.ask(command)
        for _ in range(round(2.4 * RATE)):
            flight.step(0.8 * LIMIT)
        assert not flight.phases.lost
        before, after = flight.step(0.04 * LIMIT)
        assert (command is None) == (flight.phases.phase == Phase.HOVER)
        if command is not None:
            np.testing.assert_array_equal(before, after)
            assert flight.phases.phase == Phase.HALTING


def test_by_the_sticks_nothing_waits_for_a_reference():
    flight = hovering()
    flight.state.machine[MACHINE.guidance] = STEERED
    flight.step(2.0 * LIMIT)
    assert flight.state.machine[MACHINE.position] == POSITION_LOST
    flight.step(0.04 * LIMIT)
    assert flight.state.machine[MACHINE.position] == POSITION_VALID


def test_a_navigation_that_says_nothing_is_believed():
    k = parameters.outer_params(VALUES)
    assert sigma_of_speed(np.zeros(NAV.size)) == 0.0
    assert sigma_of_speed(np.zeros(10)) == 0.0
    nav = np.zeros(NAV.size)
    nav[NAV.sigma_vel] = np.nan
    assert sigma_of_speed(nav) == 0.0
    assert k.blind_sigma == LIMIT
