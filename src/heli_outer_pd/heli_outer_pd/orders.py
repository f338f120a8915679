# SPDX-License-Identifier: Apache-2.0
"""What is ordered before a flight, done when it is due; what is refused is remarked. No ROS."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import REFERENCE
from heli_math.trajectory import Trajectory
from heli_modes.machine import Refusal
from heli_modes.table import STEERED as BY_STICKS
from heli_modes.table import Command, Phase
from heli_outer_pd.outer_state import OuterKernel
from heli_outer_pd.phase_ways import PhaseNumbers
from heli_outer_pd.reference_limits import ReferenceRefused
from heli_outer_pd.script import HeldAttitude, Scripted
from heli_outer_pd.scripted_hand import ScriptedHand
from heli_outer_pd.stick_flight import StickFlight

Array = NDArray[np.float64]
Goal = tuple[Array, float]


class Flight(Protocol):
    """What is asked of the phases of a flight; `Phases` says what each is."""

    phase: Phase
    way: Trajectory | None
    kernel: OuterKernel
    numbers: PhaseNumbers
    cruise_ns: int
    sticks: StickFlight

    @property
    def stands(self) -> bool:
        """On the ground."""

    @property
    def ground_down_m(self) -> float:
        """Where that is, NED."""

    def steer(self, sticks: Array, now_ns: int) -> None:
        """Take sticks."""

    def attitude(self, attitude_rad: Array, now_ns: int, nav: Array) -> Refusal | None:
        """Fly an attitude, or not."""

    def command(
        self, command: Command, now_ns: int, nav: Array, goal: Goal | None
    ) -> Refusal | None:
        """Do what is commanded, or not."""


class Orders:
    """The script of a flight.

    Parameters
    ----------
    script : sequence of Scripted
    start_ns : int
        Stamp of flight time 0.

    Attributes
    ----------
    hand : ScriptedHand
    remarks : list of str
        Orders that were refused.
    """

    def __init__(self, script: Sequence[Scripted], start_ns: int) -> None:
        self.hand, self.remarks = ScriptedHand(), list[str]()
        self._script, self._start_ns = deque(script), start_ns

    def next_ns(self) -> int | None:
        """Stamp at which the next one is due; None for nothing."""
        return self._start_ns + self._script[0].at_ns if self._script else None

    def renew(self, flight: Flight, now_ns: int, nav: Array) -> None:
        """What the hand does not let go."""
        if flight.phase in BY_STICKS:
            sticks = self.hand.moves(nav, flight.ground_down_m, flight.phase, flight.kernel)
            if sticks is not None:
                flight.steer(sticks, now_ns)
            if self.hand.attitude is not None and flight.sticks.steering.asked.leads:
                self._ask(flight, self.hand.attitude, now_ns, nav)
        elif flight.phase == Phase.VELOCITY and self.hand.is_due(now_ns - flight.cruise_ns):
            self._try(flight, Command.VELOCITY, now_ns, nav, (np.asarray(self.hand.cruise), 0.0))

    def obey(self, flight: Flight, now_ns: int, nav: Array) -> None:
        """Do what is due."""
        while self._script and self._start_ns + self._script[0].at_ns <= now_ns:
            due = self._script.popleft()
            order = self.hand.take(due, flight.numbers.sticks, flight.stands)
            if isinstance(due, HeldAttitude):
                self._ask(flight, due, now_ns, nav)
            if order is None:
                continue
            if self.hand.holds_sticks:
                flight.steer(self.hand.rest(flight.stands), now_ns)
            goal: Goal | None = None
            if order.goal_ned_m is not None and flight.way is not None:
                goal = order.goal_ned_m, float(flight.way.points[-1, REFERENCE.psi])
            elif self.hand.cruise is not None:
                goal = self.hand.cruise, 0.0
            self._try(flight, order.command, now_ns, nav, goal)

    def _ask(self, flight: Flight, asked: HeldAttitude, now_ns: int, nav: Array) -> None:
        """As messages do: an attitude, and a climb beside it."""
        done = partial(flight.attitude, asked.attitude_rad, now_ns, nav)
        if self._remarked(Command.ATTITUDE, done):
            flight.sticks.climb(flight.phase, asked.climb_mps, now_ns)

    def _try(
        self, flight: Flight, command: Command, now_ns: int, nav: Array, goal: Goal | None
    ) -> None:
        self._remarked(command, partial(flight.command, command, now_ns, nav, goal))

    def _remarked(self, command: Command, do: Callable[[], Refusal | None]) -> bool:
        """True if it is done; else it is remarked why not."""
        try:
            refused = do()
        except ReferenceRefused as error:
            self.remarks.append(f"{command}: {error}")
        else:
            if refused is None:
                return True
            self.remarks.append(refused.sentence)
        return False
