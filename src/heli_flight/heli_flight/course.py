# SPDX-License-Identifier: Apache-2.0
"""What a flight in this process follows from one step of the position controller to the next.

Compiled ticks fly a way until they are through, or until something may follow; then `Course.after`
asks the flight's phases. So a flight of one stretch and one of single steps are the same.
"""

import copy
from typing import Any

import numpy as np

from heli_core.inbox import NOTHING
from heli_core.rows import REFERENCE
from heli_core.trajectory import Trajectory
from heli_flight.settings import Settings
from heli_outer_pd import outer_loop
from heli_outer_pd.failsafes import Action
from heli_outer_pd.goto import Goto, PhaseNumbers
from heli_outer_pd.modes import LANDING
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_health import answer
from heli_outer_pd.reference import ReferenceLimits
from heli_outer_pd.script import script_of
from heli_outer_pd.state import OuterParams

MOST_TICKS = 6000
"""So many are flown at most without a look at what follows."""


class Course:
    """The way of a flight, and its phases.

    Parameters
    ----------
    k : OuterParams
    state : OuterLoopState
    settings : Settings
    period_ticks : int
        Of the position controller.

    Attributes
    ----------
    times_ns, points : arrays
        What is followed; the points are moved in place where the controller engages, if they are to
        be.
    phases : Phases
    scripted : bool
        Whether there are any phases but that it follows its reference throughout.
    acted : list of int and Action
        Tick from which on the position controller did each by itself.
    """

    def __init__(
        self,
        k: OuterParams,
        state: outer_loop.OuterLoopState,
        settings: Settings,
        period_ticks: int,
    ) -> None:
        reference = settings.scenario.reference
        self.times_ns, self.points = reference.times_ns, reference.points.copy()
        self._k, self._state = k, state
        self._rate, self._period = settings.rate, period_ticks
        p = settings.nodes["outer_loop"]
        numbers, orders = PhaseNumbers.from_parameters(p), script_of(p)
        fence, goto = ReferenceLimits.from_parameters(p), Goto.from_parameters(p)
        self.phases = Phases(numbers, goto, k, state.law, fence, orders)
        if not numbers.on_ground:
            self.phases.follow(Trajectory(0, self.times_ns, self.points), 0)
            self.phases.home_ned_m = reference.points[0, REFERENCE.pos].copy()
        self.scripted = numbers.on_ground or bool(orders)
        self.acted = [(0, Action.NONE)]
        self._asked = False

    @property
    def _looks(self) -> bool:
        return bool(self.scripted or self.phases.lost or self.phases.gone)

    def unasked(self, tick: int) -> int:
        """Ticks from this one on that may be flown before `after` is to be called."""
        self._asked = self._looks
        return self._to_next_step(tick) if self._asked else MOST_TICKS

    def _to_next_step(self, tick: int) -> int:
        """Ticks to the controller's next step, that with it, after which something may follow."""
        phases, due = self.phases, tick
        if not phases.is_watched():
            order_ns = phases.next_order_ns()
            if order_ns is None:
                return MOST_TICKS
            due = max(tick, -(-order_ns // self._rate.tick_ns))
        step = -(-due // self._period) * self._period
        return min(step + 1 - tick, MOST_TICKS)

    def after(self, last: int, setpoint: np.ndarray, flies: bool) -> None:
        """Look at what the ticks up to the last one have seen and done.

        Parameters
        ----------
        last : int
            Tick flown last.
        setpoint : (4,) array
            What the controller commanded.
        flies : bool
            Whether the flight goes on.
        """
        if flies and last % self._period == 0 and (self._asked or self._looks):
            if self.phases.after(last * self._rate.tick_ns, self._state.nav, setpoint):
                self.take()
            self.scripted = self.scripted or self.phases.phase in LANDING
        action = answer(self.phases.phase, self._state.law)
        self.acted += [(last, action)] if action != self.acted[-1][1] else []

    def take(self) -> None:
        """Follow the way of the phases, if they have one."""
        way = self.phases.trajectory
        if way is not None:
            self.times_ns, self.points = way.times_ns, way.points

    def copied(
        self, k: OuterParams | None = None, state: outer_loop.OuterLoopState | None = None
    ) -> "Course":
        """A copy that goes on from here, over the same numbers and state or those that are given.

        Ways are shared from the controller's first step on, which alone moves one.
        """
        k, state, phases = k or self._k, state or self._state, self.phases
        kept: list[tuple[Any, Any]] = [
            (self._k, k), (self._state, state), (self._state.law, state.law), (self._rate,) * 2,
            *((same, same) for same in (phases.numbers, phases.goto, phases.fence)),
        ]  # fmt: skip
        if self._state.engagement[outer_loop.ENGAGEMENT.tick] != NOTHING:
            ways = self.times_ns, self.points, phases.trajectory
            kept += [(same, same) for same in ways]
        return copy.deepcopy(self, {id(own): other for own, other in kept})

    def modes(self, n: int) -> np.ndarray | None:
        """Mode (n,) at each tick; None where it was never another than to follow."""
        if not self.scripted:
            return None
        modes = np.empty(n, "U10")
        for began_ns, phase in self.phases.history:
            modes[began_ns // self._rate.tick_ns :] = phase.mode
        return modes

    def actions(self, n: int) -> np.ndarray | None:
        """What the position loop did by itself (n,); None for nothing throughout."""
        if len(self.acted) == 1:
            return None
        actions = np.empty(n, "U14")
        for tick, action in self.acted:
            actions[tick:] = action.name
        return actions
