# SPDX-License-Identifier: Apache-2.0
"""The phases of a flight, flown: what is measured, what follows from it, which way is followed.

`heli_modes` says what may follow what. Here its facts are found in the navigation and in the law's
own commands, and its phases are entered: collective on the ground, way in the air. It is asked once
after each step of the law, so that the graph and the one-process loop do the same. No ROS.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, REFERENCE, SETPOINT
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_modes.machine import Refusal, decide
from heli_modes.table import Command, Fact, Guard, Phase
from heli_outer_pd.goto import Goto
from heli_outer_pd.phase_ways import PhaseNumbers, way_down, way_up
from heli_outer_pd.position_law import (
    FLIES,
    LEAVES,
    MEMORY,
    STANDS,
    OuterKernel,
    flyable,
    hover_share,
)
from heli_outer_pd.reference_limits import ReferenceLimits, ReferenceRefused
from heli_outer_pd.script import Order

Array = NDArray[np.float64]

_RISES_MPS = 0.3
"""Climbing so fast the skids have left the ground."""
_STUCK_S = 4.0
"""So long after hover's thrust it should climb."""
_UNLOADED = 0.75
"""Of the thrust that carried it: with less it would fall, unless something else carries it."""
_MISSING_MPS, _FALLEN = 2.0, 0.3
"""Thrust that is missing would have made it fall by so much; it has fallen by less than so much of
it: touched down. Differences of the speed alone, so that an error of the navigation's is none."""
_USUAL_S = 1.0
"""Time constant of the thrust that carries it."""
_AT_LIMIT = 1e-3


class Phases:
    """Where a flight is between the ground and the ground.

    Parameters
    ----------
    numbers : PhaseNumbers
    goto : Goto
        How a goto and a halt are flown.
    kernel : OuterKernel
    state : array
        State of the law, changed in place.
    fence : ReferenceLimits
        What a goto may ask for.
    orders : sequence of Order, optional
        Commands at times of the flight.
    start_ns : int, optional
        Stamp of flight time 0.

    Attributes
    ----------
    phase : Phase
    way : Trajectory or None
        What is followed; None until there is something.
    home_ned_m : (3,) array
        From where the distance of a goto is counted: where it stood at first, or as it is set.
    history : list of int and Phase
        Stamp, ns, from which on each phase was flown.
    remarks : list of str
        Orders that were refused.
    """

    def __init__(
        self,
        numbers: PhaseNumbers,
        goto: Goto,
        kernel: OuterKernel,
        state: Array,
        fence: ReferenceLimits,
        orders: Sequence[Order] = (),
        start_ns: int = 0,
    ) -> None:
        self.numbers, self.goto, self.kernel, self.fence = numbers, goto, kernel, fence
        self.way: Trajectory | None = None
        self.home_ned_m, self._ground_down_m = np.zeros(3), 0.0
        self.phase = Phase.STANDING if numbers.on_ground else Phase.HOVER
        self.history = [(start_ns, self.phase)]
        self.remarks: list[str] = []
        self._state, self._start_ns, self._orders = state, start_ns, deque(orders)
        self._since_ns, self._stance = start_ns, np.zeros(2)
        self._usual, self._missing_mps, self._began_mps = 1.0, 0.0, 0.0
        if numbers.on_ground:
            state[MEMORY.command][SETPOINT.col] = numbers.idle_collective
            self._stand(numbers.idle_collective, 1.0)

    @property
    def leaving(self) -> bool:
        """True from hover's thrust on until it climbs."""
        return bool(self._state[MEMORY.ground] == LEAVES)

    def is_watched(self) -> bool:
        """True where something may follow after any step, without a command."""
        return self.phase not in (Phase.STANDING, Phase.HOVER) or self.way is None

    def next_order_ns(self) -> int | None:
        """Stamp at which something is due that was ordered before the flight; None for nothing."""
        return self._start_ns + self._orders[0].at_ns if self._orders else None

    def adopt(
        self, numbers: PhaseNumbers, goto: Goto, kernel: OuterKernel, fence: ReferenceLimits
    ) -> None:
        """Other numbers for what is to come."""
        self.numbers, self.goto, self.kernel, self.fence = numbers, goto, kernel, fence

    def follow(self, way: Trajectory, now_ns: int) -> None:
        """A reference is followed from now on, where the table has let it."""
        self.way = way
        self._now(Phase.TRAJECTORY, now_ns)

    def command(
        self, command: Command, now_ns: int, nav: Array, goal: tuple[Array, float] | None = None
    ) -> Refusal | None:
        """Do what a pilot asks; or refuse it, and go on as before.

        Parameters
        ----------
        command : Command
        now_ns : int
            Stamp of the law's last step.
        nav : array
            Navigation row of it.
        goal : (3,) array and float, optional
            Of a goto: position, NED, m, and heading, rad.

        Raises
        ------
        ReferenceRefused
            No way within the limits; nothing has changed.
        """
        found = decide(self.phase, command, self._fails(nav))
        if isinstance(found, Refusal):
            return found
        assert found is not None  # each command stands in the table
        self._enter(found, command, now_ns, nav, goal)
        return None

    def after(self, now_ns: int, nav: Array, out: Array) -> bool:
        """Look at what a step of the law has seen and done; True if another way is followed.

        Parameters
        ----------
        now_ns : int
            Its stamp.
        nav : array
            Navigation row.
        out : (4,) array
            Its command, a `SetpointRow`.
        """
        before = self.way
        if self.way is None and flyable(nav):
            self._begin(nav)
        fact = self._fact(now_ns, nav, out)
        if fact is not None:
            found = decide(self.phase, fact)
            if isinstance(found, Phase):
                self._enter(found, fact, now_ns, nav)
        while self._orders and self._start_ns + self._orders[0].at_ns <= now_ns:
            self._obey(self._orders.popleft(), now_ns, nav)
        return self.way is not before

    def _obey(self, order: Order, now_ns: int, nav: Array) -> None:
        """Do what was ordered for now; what is refused is remarked."""
        goal = None
        if order.goal_ned_m is not None and self.way is not None:
            goal = order.goal_ned_m, float(self.way.points[-1, REFERENCE.psi])
        try:
            refused = self.command(order.command, now_ns, nav, goal)
        except ReferenceRefused as error:
            self.remarks.append(f"{order.command}: {error}")
        else:
            if refused is not None:
                self.remarks.append(refused.sentence)

    def _begin(self, nav: Array) -> None:
        """The first position: where it stands, or what it holds."""
        psi = euler_from_quat(nav[NAV.quat])[2]
        self.way = replace(Trajectory.hover(nav[NAV.pos].copy(), psi), start_ns=self._start_ns)
        self.home_ned_m, self._ground_down_m = nav[NAV.pos].copy(), float(nav[NAV.pos][2])

    # --- facts and guards ------------------------------------------------------------------------

    def _fails(self, nav: Array) -> set[Guard]:
        if not flyable(nav) or self.way is None:
            return {Guard.NAVIGATION}
        k, fails = self.kernel, set()
        if np.abs(self._lean(nav)).max() > self.numbers.lean_max_rad:
            fails.add(Guard.UPRIGHT)
        if self._ground_down_m - nav[NAV.pos][2] < self.numbers.clear_m:
            fails.add(Guard.CLEAR)
        share = hover_share(self._state[MEMORY.command][SETPOINT.col], k)
        low, high = k.thrust_limits
        if not low + _AT_LIMIT < share < high - _AT_LIMIT:
            fails.add(Guard.UNSATURATED)
        return fails

    def _lean(self, nav: Array) -> Array:
        """Roll and pitch (2,), rad, off those of hover."""
        phi, theta, _ = euler_from_quat(nav[NAV.quat])
        return np.array([phi, theta]) - self.kernel.trim[: SETPOINT.psi]

    def _tips(self, nav: Array) -> bool:
        """Leans further off hover's attitude than it stood, either way."""
        beyond = np.abs(self._lean(nav)) - np.abs(self._stance)
        return bool(beyond.max() > self.numbers.tip_rad)

    def _fact(self, now_ns: int, nav: Array, out: Array) -> Fact | None:
        """What is so now of what the present phase waits for."""
        if not flyable(nav):
            return Fact.BLIND
        match self.phase:
            case Phase.SPOOLING:
                spooled = now_ns - self._since_ns >= self.numbers.spool_up_ns
                return Fact.SPOOLED_UP if spooled else None
            case Phase.LIFTING:
                if self._tips(nav):
                    return Fact.TIPPING
                return (
                    Fact.LIGHT if self._above(out, self.kernel.trim[SETPOINT.col]) >= 0.0 else None
                )
            case Phase.CLIMBING:
                return self._climbing(now_ns, nav)
            case Phase.HALTING | Phase.TRAJECTORY:
                return Fact.ARRIVED if self._is_over(now_ns) else None
            case Phase.DESCENDING:
                return self._descending(nav, out)
            case Phase.SETTLING:
                return Fact.IDLE if self._above(out, self.numbers.idle_collective) <= 0.0 else None
        return None

    def _above(self, out: Array, col: float) -> float:
        """How far the collective is above another, in the direction that lifts."""
        up = self.kernel.trim[SETPOINT.col] - self.numbers.idle_collective
        return float(np.copysign(out[SETPOINT.col] - col, up * (out[SETPOINT.col] - col)))

    def _is_over(self, now_ns: int) -> bool:
        """The way ends, and with it what the law averages of it."""
        assert self.way is not None
        end_ns = self.way.start_ns + int(self.way.times_ns[-1])
        return now_ns >= end_ns + self.goto.shaping_ns

    def _climbing(self, now_ns: int, nav: Array) -> Fact | None:
        if self.leaving:
            if self._tips(nav):
                return Fact.TIPPING
            if now_ns - self._since_ns > _STUCK_S * NS_PER_S:
                return Fact.STUCK
            if -nav[NAV.down_vel] > _RISES_MPS:
                self._state[MEMORY.ground] = FLIES
            return None
        return Fact.ARRIVED if self._is_over(now_ns) else None

    def _descending(self, nav: Array, out: Array) -> Fact | None:
        """Touched down: it has not fallen, though the thrust no longer carries it."""
        k, v_down = self.kernel, float(nav[NAV.down_vel])
        share = hover_share(out[SETPOINT.col], k)
        if share > _UNLOADED * self._usual:
            self._usual += (share - self._usual) * k.dt_s / _USUAL_S
            self._missing_mps, self._began_mps = 0.0, v_down
            return None
        self._missing_mps += (self._usual - share) * k.g * k.dt_s
        fallen = v_down - self._began_mps
        sure = self._missing_mps > _MISSING_MPS and fallen < _FALLEN * self._missing_mps
        return Fact.TOUCHED_DOWN if sure else None

    # --- phases ----------------------------------------------------------------------------------

    def _enter(
        self,
        phase: Phase,
        event: Command | Fact,
        now_ns: int,
        nav: Array,
        goal: tuple[Array, float] | None = None,
    ) -> None:
        """Begin a phase; a way that cannot be planned raises before anything has changed."""
        n = self.numbers
        assert self.way is not None  # a guard, or the phases before, have seen to it
        ramp = abs(n.idle_collective - self.kernel.trim[SETPOINT.col])
        match phase:
            case Phase.LIFTING:
                self._stance = self._lean(nav)
                self._stand(self.kernel.trim[SETPOINT.col], ramp / n.up_ramp_s)
            case Phase.CLIMBING:
                self.way = way_up(n, nav, now_ns, self._start_ns)
                self._state[MEMORY.ground] = LEAVES
            case Phase.HALTING | Phase.HOVER if isinstance(event, Command):
                self.way = self.goto.halt(self.way, now_ns)
            case Phase.DESCENDING:
                self.way = way_down(n, self.way, self._ground_down_m, now_ns, self._start_ns)
                self._usual, self._missing_mps = self._carried(), 0.0
                self._began_mps = float(nav[NAV.down_vel])
            case Phase.SETTLING:
                self._stand(n.idle_collective, ramp / n.down_ramp_s)
                if flyable(nav):
                    psi = euler_from_quat(nav[NAV.quat])[2]
                    here = Trajectory.hover(nav[NAV.pos].copy(), psi)
                    self.way = replace(here, start_ns=self._start_ns)
            case Phase.TRAJECTORY if goal is not None:
                self.way = self.goto.judged(self.way, now_ns, *goal, self.fence, self.home_ned_m)
        self._now(phase, now_ns)

    def _now(self, phase: Phase, now_ns: int) -> None:
        self.phase, self._since_ns = phase, now_ns
        self.history.append((now_ns, phase))

    def _stand(self, col_goal: float, col_rate: float) -> None:
        self._state[MEMORY.ground] = STANDS
        self._state[MEMORY.col_goal], self._state[MEMORY.col_rate] = col_goal, col_rate

    def _carried(self) -> float:
        """Thrust of the last command, a share of hover's."""
        return float(hover_share(self._state[MEMORY.command][SETPOINT.col], self.kernel))
