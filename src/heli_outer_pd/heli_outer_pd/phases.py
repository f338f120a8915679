# SPDX-License-Identifier: Apache-2.0
"""The phases of a flight, flown: what is measured, what follows from it, which way is followed.

`heli_outer_pd.modes` says what may follow what. Here its facts are found in the navigation and in
the controller's own commands, and its phases are entered: collective on the ground, way in the air.
It is asked once after each step of the controller, so that the graph and the one-process loop do
the same. No ROS.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE, SETPOINT
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.disturbance import flyable, hover_share, sinking_share
from heli_outer_pd.goto import (
    WIND,
    Goto,
    PhaseNumbers,
    judge_height,
    left,
    trajectory_down,
    trajectory_here,
    trajectory_quickly_down,
    trajectory_up,
)
from heli_outer_pd.manual import (
    RISES_MPS,
    SINKS_MPS,
    FlightMoment,
    StickFlight,
    TouchDown,
    lean,
    leans_beyond,
    lifts_more,
    not_flown,
)
from heli_outer_pd.modes import STEERED as BY_STICKS
from heli_outer_pd.modes import Command, Fact, Guard, Phase, Refusal, decide
from heli_outer_pd.position_health import ground_begun_m, health_fact, well_known
from heli_outer_pd.reference import ReferenceLimits
from heli_outer_pd.script import Scripted, ScriptRunner
from heli_outer_pd.state import (
    ALTITUDE_VALID,
    FLIES,
    LEAVES,
    MACHINE,
    MEMORY,
    POSITION_VALID,
    ROTOR_DRIVEN,
    STANDS,
    OuterParams,
    OuterState,
)

# -------------------------------------------------------------------------------------------------
# Nose into the wind: turn until nothing pushes from the side. No ROS.
#
# What pushes forward says little of the wind: a helicopter's front is small, its side eight times
# as
# large, so the estimated disturbance does not point with the wind. But where it vanishes from the
# side the wind comes from ahead (from behind it vanishes, too, and the least turn away from there
# goes on). What it leaves is the side force at which the aircraft is trimmed wrongly, over that of
# the wind per angle. How much the push changes per angle is seen in the turns themselves (secant).
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_SETTLES_NS = round(1.5 * NS_PER_S)
"""After a turn the estimate of the disturbance takes so long."""
_LEAST_NS, _MOST_NS = round(2.5 * NS_PER_S), 30 * NS_PER_S
"""Averaged over so long before a turn, and no longer: the wind may shift."""
_DEAD_MPS2, _GUSTS_MPS = 0.15, 0.45
"""A push that is not turned from: what trim leaves, and what gusts leave of a mean over 1 s."""
_FIRST, _SLOPES = 1.3, (0.6, 6.0)
"""Push per angle, m/s2 per rad, before a turn has shown it (wind of 5 m/s on the default aircraft),
and between which it is believed."""
_MOST_RAD = math.radians(60.0)


class TurningFlight(Protocol):
    """What is asked of the phases of a flight."""

    phase: Phase
    trajectory: Trajectory | None
    goto: Goto
    params: OuterParams
    numbers: PhaseNumbers


def push_right(disturbance_ned: Array, nav: Array) -> float:
    """Part of a disturbance (3,), NED, m/s2, to the right of the nose of a navigation row."""
    psi = euler_from_quat(nav[NAV.quat])[2]
    return float(-math.sin(psi) * disturbance_ned[0] + math.cos(psi) * disturbance_ned[1])


class IntoWind:
    """Turns of the nose, one after the other, each from what the last one has shown."""

    def __init__(self) -> None:
        self._slope = _FIRST
        self._last: tuple[float, float] | None = None
        self._phase: Phase | None = None
        self.rest(0)

    def rest(self, until_ns: int) -> None:
        """Begin a new mean, `_SETTLES_NS` after a stamp, ns."""
        self._from_ns, self._sum, self._count = until_ns + _SETTLES_NS, 0.0, 0

    def turn(self, now_ns: int, push_right_mps2: float) -> float:
        """Angle (rad, to the right) by which to turn now; 0.0 for none yet.

        Parameters
        ----------
        now_ns : int
            Stamp of a step of the controller, ns.
        push_right_mps2 : float
            By how much the air accelerates the aircraft to its right, as estimated.
        """
        if now_ns < self._from_ns:
            return 0.0
        self._sum += push_right_mps2
        self._count += 1
        lasts_ns = now_ns - self._from_ns
        if lasts_ns < _LEAST_NS:
            return 0.0
        push = self._sum / self._count
        if abs(push) < _DEAD_MPS2 + _GUSTS_MPS * NS_PER_S / lasts_ns:
            if lasts_ns > _MOST_NS:
                self.rest(now_ns - _SETTLES_NS)
            return 0.0
        if self._last is not None:
            slope = (push - self._last[0]) / self._last[1]
            self._slope = min(max(slope, _SLOPES[0]), _SLOPES[1]) if slope > 0.0 else _FIRST
        angle = min(max(-push / self._slope, -_MOST_RAD), _MOST_RAD)
        self._last = push, angle
        return angle

    def turned(
        self,
        flight: TurningFlight,
        now_ns: int,
        nav: Array,
        state: OuterState,
        ground_down_m: float,
    ) -> Trajectory | None:
        """The way that is followed, with a turn in it if it is time for one.

        Parameters
        ----------
        flight : TurningFlight
            Its nose turns where it hovers, if a goto's heading is the wind; in a landing, if that
            one's is, above half of the height at which its last part begins. Not where its
            position is about to be lost: the lean of a heading is learnt before.
        now_ns : int
            Stamp of the controller's last step, ns.
        nav, state : arrays
            Navigation row and state of the controller.
        ground_down_m : float
            Where the ground is, as far as it is known, NED.
        """
        phase, planned, n = flight.phase, flight.trajectory, flight.numbers
        fresh = phase not in (self._phase, Phase.DESCENDING)
        self._phase = phase
        wanted = phase == Phase.HOVER and flight.goto.heading == WIND
        if phase in (Phase.HALTING, Phase.DESCENDING):
            high = ground_down_m - nav[NAV.pos][2] > 0.5 * n.slow_below_m
            wanted = n.land_heading == WIND and high
        known = flyable(nav) and well_known(nav, flight.params, state)
        known = known and state.x[MEMORY.gone] < 0.5
        if fresh or not wanted or planned is None or not known:
            self.rest(now_ns)
            return planned
        angle = self.turn(now_ns, push_right(state.x[MEMORY.disturbance], nav))
        if angle == 0.0:
            return planned
        planned, done_ns = flight.goto.turn(planned, now_ns, angle)
        self.rest(done_ns)
        return planned


# -------------------------------------------------------------------------------------------------
# Phases.
# -------------------------------------------------------------------------------------------------

_STUCK_S = 4.0  # so long after hover's thrust it should climb
_RENEWED = (Phase.VELOCITY, Phase.ATTITUDE)  # commanded many times a second


class Phases:
    """Where a flight is between the ground and the ground.

    Parameters
    ----------
    numbers : PhaseNumbers
    goto : Goto
        How a goto and a halt are flown.
    params : OuterParams
    state : array
        State of the controller, changed in place.
    fence : ReferenceLimits
        What a goto may ask for.
    orders : sequence of Scripted, optional
        Commands and hands at times of the flight.
    start_ns : int, optional
        Stamp of flight time 0.

    Attributes
    ----------
    phase : Phase
    trajectory : Trajectory or None
        What is followed; None until there is something.
    home_ned_m : (3,) array
        From where the distance of a goto is counted: where it stood at first, or as it is set.
    event : Command or Fact or None
        What has led to the present phase; None before the first.
    history : list of int and Phase
        Stamp, ns, from which on each phase was flown.
    cruise_ns : int
        Stamp of the newest velocity.
    ground_down_m : float
        Where the ground is, as far as it is known, NED.
    fence_distance_m : float
        So far the aircraft is outside the fence.
    sticks : StickFlight
        Who leads in the modes `attitude` and `manual`.
    own_climb_m : float or None
        Height of the newest take-off above where it stood, if it had one of its own.
    remarks : list of str
        Orders that were refused.
    """

    def __init__(
        self,
        numbers: PhaseNumbers,
        goto: Goto,
        kernel: OuterParams,
        state: OuterState,
        fence: ReferenceLimits,
        orders: Sequence[Scripted] = (),
        start_ns: int = 0,
    ) -> None:
        self.numbers, self.goto, self.params, self.fence = numbers, goto, kernel, fence
        self.trajectory: Trajectory | None = None
        self.others: Trajectory | None = None  # a reference that is not the loop's own
        self.home_ned_m, self.ground_down_m, self.fence_distance_m = np.zeros(3), 0.0, 0.0
        self.phase = Phase.STANDING if numbers.on_ground else Phase.HOVER
        self.event: Command | Fact | None = None
        self.history, self._orders = [(start_ns, self.phase)], ScriptRunner(orders, start_ns)
        self._state, self._start_ns, self.remarks = state, start_ns, self._orders.remarks
        self._since_ns, self._stance, self._into_wind = start_ns, np.zeros(2), IntoWind()
        self._contact, self.cruise_ns, self.sticks = TouchDown(), start_ns, StickFlight(state)
        self.own_climb_m: float | None = None
        if numbers.on_ground:
            state.x[MEMORY.command][SETPOINT.col] = numbers.idle_collective
            self._stand(numbers.idle_collective, 1.0)

    @property
    def climb_m(self) -> float:
        """Height to which a take-off climbs, above where it stood, m."""
        return self.numbers.height_m if self.own_climb_m is None else self.own_climb_m

    @property
    def leaving(self) -> bool:
        """True from hover's thrust on until it climbs."""
        return bool(self._state.machine[MACHINE.guidance] == LEAVES)

    @property
    def lost(self) -> bool:
        """True while the horizontal position is not known, or not yet flown by again."""
        return bool(self._state.machine[MACHINE.position] != POSITION_VALID)

    @property
    def gone(self) -> bool:
        """True while it should land: no position, no vertical speed, or the rotor is slow."""
        return bool(
            self._state.x[MEMORY.gone] > 0.5 or self._state.machine[MACHINE.rotor] != ROTOR_DRIVEN
        )

    def is_watched(self) -> bool:
        """True where something may follow after any step, without a command."""
        rests = self.phase in (Phase.STANDING, Phase.HOVER) and self.goto.heading != WIND
        return not rests or self.trajectory is None or self.lost or self.gone

    def next_order_ns(self) -> int | None:
        """Stamp at which something is due that was ordered before the flight; None for nothing."""
        return self._orders.next_ns()

    def adopt(
        self, numbers: PhaseNumbers, goto: Goto, kernel: OuterParams, fence: ReferenceLimits
    ) -> None:
        """Other numbers for what is to come."""
        self.numbers, self.goto, self.params, self.fence = numbers, goto, kernel, fence

    def follow(self, planned: Trajectory, now_ns: int) -> None:
        """A reference is followed from now on, where the table has let it."""
        self.trajectory = self.others = planned
        self._state.x[MEMORY.unforeseen] = 1.0
        if self.phase in BY_STICKS:
            self.sticks.hand_over(FLIES)
        self._now(Phase.TRAJECTORY, Command.FOLLOW, now_ns)

    def steer(self, sticks: Array, now_ns: int) -> None:
        """Take a pilot's newest sticks (4,), a `StickRow`; ReferenceRefused if they are none."""
        self.sticks.steering.hear(sticks, now_ns)

    def attitude(self, attitude_rad: Array, now_ns: int, nav: Array) -> Refusal | None:
        """Fly an attitude (3,), roll, pitch, heading, until it is not renewed.

        A refused one, and ReferenceRefused where it is tilted too much, change nothing.
        """
        steering, n = self.sticks.steering, self.numbers.sticks
        before = steering.asked
        refused = self.sticks.ask(self.phase, attitude_rad, self._at(now_ns, nav), n)
        if refused is None:
            refused = self.command(Command.ATTITUDE, now_ns, nav)
            if refused is not None:
                steering.asked = before
        return refused

    def velocity(
        self, vel_ned_mps: Array, yaw_rate_radps: float, now_ns: int, nav: Array
    ) -> Refusal | None:
        """Fly at a velocity (3,), NED, m/s, and a rate of turn until it is not renewed.

        A refused one, and ReferenceRefused where the fence is in the way, change nothing.
        """
        refused = self.command(
            Command.VELOCITY, now_ns, nav, (np.asarray(vel_ned_mps, float), yaw_rate_radps)
        )
        if refused is None:
            self._orders.sticks.cruise = None
        return refused

    def resume(self, now_ns: int, nav: Array) -> None:
        """Others have flown until now: halt from how the aircraft moves; one that stands stays."""
        if not flyable(nav) or self.trajectory is None:
            return
        if self.phase.on_ground and self._is_low(nav):
            return
        before, ground = self.sticks.leave(Phase.MANUAL, self._at(now_ns, nav)), self.ground_down_m
        if self.lost:
            self.trajectory = self.goto.halt(before, now_ns)
        else:
            halt = self.numbers.fence.halt
            self.trajectory = halt(self.goto, before, now_ns, self.home_ned_m, ground)
        self.sticks.hand_over(FLIES)
        self._now(Phase.HOVER, Command.HOLD, now_ns)

    def take_off(self, height_m: float, now_ns: int, nav: Array) -> Refusal | None:
        """Take off to a height of its own above where it stands, m.

        A refused one, and ReferenceRefused where the height is not allowed, change nothing.
        """
        decision = decide(self.phase, Command.TAKEOFF, self.fails(now_ns, nav))
        if isinstance(decision, Refusal):
            return decision
        judge_height(height_m)
        end_ned_m = nav[NAV.pos] - [0.0, 0.0, height_m]
        self.fence.judge_place("the end of the climb", end_ned_m, self.home_ned_m)
        self.command(Command.TAKEOFF, now_ns, nav)
        self.own_climb_m = height_m
        return None

    def command(
        self, command: Command, now_ns: int, nav: Array, goal: tuple[Array, float] | None = None
    ) -> Refusal | None:
        """Do what a pilot asks; or refuse it, and go on as before.

        Parameters
        ----------
        command : Command
        now_ns : int
            Stamp of the controller's last step.
        nav : array
            Navigation row of it.
        goal : (3,) array and float, optional
            Of a goto: position, NED, m, and heading, rad; of a velocity: m/s, rad/s.

        Raises
        ------
        ReferenceRefused
            No way within the limits; nothing has changed.
        """
        decision = decide(self.phase, command, self.fails(now_ns, nav))
        if isinstance(decision, Refusal):
            return decision
        assert decision is not None  # each command stands in the table
        self._enter(decision, command, now_ns, nav, goal)
        return None

    def after(self, now_ns: int, nav: Array, out: Array) -> bool:
        """Look at what a step of the controller has seen and done; True if another way is followed.

        Parameters
        ----------
        now_ns : int
            Its stamp.
        nav : array
            Navigation row.
        out : (4,) array
            Its command, a `SetpointRow`.
        """
        before = self.trajectory
        if self.trajectory is None and flyable(nav):
            # The first position: where it stands, or what it holds.
            self.trajectory = trajectory_here(nav, self._start_ns)
            self.home_ned_m, self.ground_down_m = nav[NAV.pos].copy(), float(nav[NAV.pos][2])
            self._state.x[MEMORY.ground_m] = self.ground_down_m
            self._state.x[MEMORY.ground_known] = float(self.phase.on_ground)
        fenced = flyable(nav) and not self.lost and self.params.hold_horizontal > 0.5
        place = nav[NAV.pos], self.home_ned_m, self.ground_down_m
        self.fence_distance_m = self.numbers.fence.fence_distance_m(*place) if fenced else 0.0
        self._orders.renew(self, now_ns, nav)
        if (fact := self._fact(now_ns, nav, out)) is not None:
            decision = decide(self.phase, fact)
            if fact == Fact.FENCED:
                self.remarks.append(left(self.phase.mode, self.fence_distance_m))
            if isinstance(decision, Phase):
                self._enter(decision, fact, now_ns, nav)
        self._orders.obey(self, now_ns, nav)
        if self.phase in BY_STICKS:
            self._steer(now_ns, nav)
            if flyable(nav) and self.sticks.tells(now_ns):
                self.trajectory = self.sticks.preview(self.phase, self._at(now_ns, nav))
        self.trajectory = self._into_wind.turned(self, now_ns, nav, self._state, self.ground_down_m)
        self._state.x[MEMORY.unforeseen] = float(self.trajectory is self.others)
        return self.trajectory is not before

    def fails(self, now_ns: int, nav: Array) -> set[Guard]:
        """Guards that do not hold at a stamp and navigation row."""
        k, fails = self.params, self.sticks.fails(now_ns, self.numbers.sticks)
        if not flyable(nav) or self.trajectory is None:
            return fails | {Guard.NAVIGATION, Guard.LEVEL}
        fails |= {Guard.NAVIGATION} if self.lost else set()
        fails |= {Guard.FENCE} if self.fence_distance_m > 0.0 else set()
        at_limit_s = float(self._state.x[MEMORY.at_limit_s])
        fails |= not_flown(nav, at_limit_s, self.numbers.lean_max_rad, k)
        fails |= {Guard.CLEAR} if self._is_low(nav) else set()
        return fails

    def _is_low(self, nav: Array) -> bool:
        """By hand on the ground, or too near to it."""
        return self.stands or bool(self.ground_down_m - nav[NAV.pos][2] < self.numbers.clear_m)

    @property
    def stands(self) -> bool:
        """By hand, too."""
        flown_manually = self.phase == Phase.MANUAL and self.sticks.aground
        return flown_manually or self.phase == Phase.STANDING

    def _tips(self, nav: Array) -> bool:
        return leans_beyond(nav, self.params, self._stance) > self.numbers.tip_rad

    def _fact(self, now_ns: int, nav: Array, out: Array) -> Fact | None:
        """What is so now of what the present phase waits for."""
        if not flyable(nav):
            return Fact.BLIND if self.phase.on_ground else None
        if (fact := health_fact(self.phase, self._state, self._is_low(nav))) is not None:
            return fact
        if self.fence_distance_m > 0.0 and decide(self.phase, Fact.FENCED) is not None:
            return Fact.FENCED
        match self.phase:
            case Phase.SPOOLING:
                spooled = now_ns - self._since_ns >= self.numbers.spool_up_ns
                return Fact.SPOOLED_UP if spooled else None
            case Phase.LIFTING:
                if self._tips(nav):
                    return Fact.TIPPING
                light = self._above(out, self.params.trim[SETPOINT.col]) >= 0.0
                return Fact.LIGHT if light else None
            case Phase.CLIMBING:
                return self._climbing(now_ns, nav)
            case Phase.HALTING | Phase.TRAJECTORY:
                return Fact.ARRIVED if self._is_over(now_ns) else None
            case Phase.DESCENDING:
                return Fact.TOUCHED_DOWN if self._touched_down(now_ns, nav, out) else None
            case Phase.VELOCITY:
                silent = now_ns - self.cruise_ns > self.numbers.sticks.timeout_ns
                return Fact.SILENT if silent else None
            case Phase.ATTITUDE | Phase.MANUAL:
                n, now = self.numbers, self._at(now_ns, nav)
                col = float(out[SETPOINT.col])
                return self.sticks.fact(self.phase, now, n.sticks, n.idle_collective, col)
            case Phase.SETTLING:
                return Fact.IDLE if self._above(out, self.numbers.idle_collective) <= 0.0 else None
        return None

    def _above(self, out: Array, col: float) -> float:
        return lifts_more(out[SETPOINT.col], col, self.numbers.idle_collective, self.params)

    def _is_over(self, now_ns: int) -> bool:
        """The way ends, and with it what the controller averages of it."""
        assert self.trajectory is not None
        return (
            now_ns
            >= self.trajectory.start_ns + int(self.trajectory.times_ns[-1]) + self.goto.shaping_ns
        )

    def _climbing(self, now_ns: int, nav: Array) -> Fact | None:
        if self.leaving:
            if self._tips(nav):
                return Fact.TIPPING
            if now_ns - self._since_ns > _STUCK_S * NS_PER_S:
                return Fact.STUCK
            if -nav[NAV.down_vel] > RISES_MPS:
                self._state.machine[MACHINE.guidance] = FLIES
            return None
        return Fact.ARRIVED if self._is_over(now_ns) else None

    def _touched_down(self, now_ns: int, nav: Array, out: Array) -> bool:
        """It has not fallen, though the thrust no longer carries it, and it no longer sinks.

        A gust from ahead carries it, too, for some seconds: then it goes on sinking.
        """
        k, quick_mps = self.params, 0.0
        if self._reckons and self.trajectory is not None:
            # Fast, it needs less collective for the same thrust: nothing else carries it.
            quick_mps = float(self.trajectory.at(now_ns)[REFERENCE.down_vel])
        share = float(sinking_share(out[SETPOINT.col], quick_mps, k))
        v_down_mps = float(nav[NAV.down_vel])
        unloaded = self._contact.detects(share, v_down_mps, k.g, k.dt_s)
        altitude_valid = self._state.machine[MACHINE.altitude] == ALTITUDE_VALID
        return unloaded and not (altitude_valid and v_down_mps > SINKS_MPS)

    def _at(self, now_ns: int, nav: Array) -> FlightMoment:
        return FlightMoment(now_ns, self._start_ns, nav, self.params)

    def _enter(
        self,
        phase: Phase,
        event: Command | Fact,
        now_ns: int,
        nav: Array,
        goal: tuple[Array, float] | None = None,
    ) -> None:
        """Begin a phase; a way that cannot be planned raises before anything has changed."""
        n, steered = self.numbers, self.phase in BY_STICKS
        if phase in BY_STICKS:
            if not steered:
                self._orders.sticks.begins()
            anew = self.sticks.take(
                self.phase, phase, self.trajectory, self._at(now_ns, nav), n.sticks
            )
            self._now(phase, event, now_ns)
            if anew:
                # The very next step of the controller is by the sticks.
                self._steer(now_ns, nav)
            return
        assert self.trajectory is not None  # a guard, or the phases before, have seen to it
        before, reacquired = self.trajectory, event == Fact.FOUND
        if event == Fact.ROTOR_BACK:
            before = trajectory_here(nav, self._start_ns)
        elif reacquired or (steered and not self.stands):
            before = self.sticks.leave(self.phase, self._at(now_ns, nav))
        begins = steered or event != Fact.ARRIVED
        ramp = abs(n.idle_collective - self.params.trim[SETPOINT.col])
        match phase:
            case Phase.SPOOLING:
                self.own_climb_m = None
            case Phase.LIFTING:
                self._stance = lean(nav, self.params)
                self._stand(self.params.trim[SETPOINT.col], ramp / n.up_ramp_s)
            case Phase.CLIMBING:
                up = replace(n, height_m=self.climb_m)
                self.trajectory = trajectory_up(up, nav, now_ns, self._start_ns)
                self._state.machine[MACHINE.guidance] = LEAVES
            case Phase.HOVER if begins and not self.lost:
                ground = self.ground_down_m
                self.trajectory = n.fence.halt(self.goto, before, now_ns, self.home_ned_m, ground)
            case Phase.HALTING | Phase.HOVER | Phase.AUTOROTATING if begins:
                self.trajectory = self.goto.halt(before, now_ns)
            case Phase.VELOCITY:
                vel, rate = goal or (np.zeros(3), 0.0)
                self.trajectory = self.goto.cruise(
                    before, now_ns, vel, rate, n.sticks.timeout_ns / NS_PER_S, self.fence,
                    self.home_ned_m,
                )  # fmt: skip
                self.cruise_ns = now_ns
            case Phase.DESCENDING:
                self.trajectory = self._trajectory_down(self.trajectory, now_ns)
                self._state.x[MEMORY.ground_m] = self.ground_down_m
                carried = float(
                    hover_share(self._state.x[MEMORY.command][SETPOINT.col], self.params)
                )
                self._contact = TouchDown(carried, float(nav[NAV.down_vel]))
            case Phase.SETTLING:
                self._stand(n.idle_collective, ramp / n.down_ramp_s)
                if flyable(nav):
                    self.trajectory = trajectory_here(nav, self._start_ns)
            case Phase.TRAJECTORY if goal is not None:
                self.trajectory = self.goto.judged(
                    before, now_ns, *goal, self.fence, self.home_ned_m
                )
            case Phase.STANDING if steered:
                self._stand(n.idle_collective, ramp / n.down_ramp_s)
        if reacquired or (steered and phase != Phase.STANDING):
            self.sticks.hand_over(FLIES)
        if reacquired:
            self._state.machine[MACHINE.position] = POSITION_VALID
        self._now(phase, event, now_ns)
        if event == Fact.BLIND_LONG and self._reckons and self._rests(before, now_ns):
            # Nothing to halt, and each second of dead reckoning counts.
            self._enter(Phase.DESCENDING, Fact.ARRIVED, now_ns, nav)

    @property
    def _reckons(self) -> bool:
        """Whether it should land while dead reckoning still holds its place."""
        machine = self._state.machine
        return bool(
            self._state.x[MEMORY.gone] > 0.5
            and machine[MACHINE.altitude] == ALTITUDE_VALID
            and machine[MACHINE.rotor] == ROTOR_DRIVEN
            and not self.lost
        )

    def _rests(self, way: Trajectory, now_ns: int) -> bool:
        """Whether a way stands still for as long as the controller averages it about now."""
        around = np.linspace(-1.0, 1.0, 9) * self.goto.shaping_ns
        rows = np.array([way.at(now_ns + round(offset)) for offset in around])
        return not bool(np.ptp(rows, axis=0).any())

    def _trajectory_down(self, hover: Trajectory, now_ns: int) -> Trajectory:
        """From where a way ends down; quickly where the place is held by dead reckoning."""
        n, ground = self.numbers, self.ground_down_m
        if self._reckons:
            k, known = self.params, self._state.x[MEMORY.ground_known] > 0.5
            begun = float(ground_begun_m(self._state))
            return trajectory_quickly_down(n, hover, begun, k, now_ns, self._start_ns, known)
        return trajectory_down(n, hover, ground, now_ns, self._start_ns, self.gone)

    def _now(self, phase: Phase, event: Command | Fact, now_ns: int) -> None:
        if phase != self.phase or phase not in _RENEWED:
            self.history.append((now_ns, phase))
        self.phase, self.event, self._since_ns = phase, event, now_ns
        self._state.x[MEMORY.lands] = float(phase in (Phase.HALTING, Phase.DESCENDING))

    def _steer(self, now_ns: int, nav: Array) -> None:
        """What the controller's next step gets of the sticks."""
        n, low = self.numbers, flyable(nav) and self._is_low(nav)
        now = self._at(now_ns, nav)
        self.sticks.steer(self.phase, now, n.sticks, n.idle_collective, self.fence, low)

    def _stand(self, col_goal: float, col_rate: float) -> None:
        self._state.machine[MACHINE.guidance] = STANDS
        self._state.x[MEMORY.col_goal], self._state.x[MEMORY.col_rate] = col_goal, col_rate


# -------------------------------------------------------------------------------------------------
# What the outer loop has while it is active. No ROS.
# -------------------------------------------------------------------------------------------------


@dataclass
class ActiveOuterLoop:
    """What the outer loop has while it is active.

    Attributes
    ----------
    begun_s : float
        Wall time of the activation.
    awaits_reference : bool
        In lockstep: no step is made before a reference has come.
    held : Trajectory or None
        The position of activation, held while there is no reference.
    engaged : bool
        True once the controller has followed; before that its command is the trim.
    phases : Phases
        What the flight does, from the ground to the ground.
    diverted : Trajectory or None
        The way of the last command, followed until a reference comes.
    """

    begun_s: float
    awaits_reference: bool
    phases: Phases
    held: Trajectory | None = None
    engaged: bool = False
    diverted: Trajectory | None = None

    def take(self, known: Mapping[str, Any]) -> None:
        """Go on from the fields that a predecessor had."""
        for name, value in known.items():
            setattr(self, name, value)
