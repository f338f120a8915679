# SPDX-License-Identifier: Apache-2.0
"""Flight by sticks or an attitude, from one law to the next: who leads, what is seen and follows.

`phases` asks it in the modes `attitude` and `manual`. No ROS.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import NAV, SETPOINT, STICKS
from heli_math.trajectory import Trajectory
from heli_modes.machine import Refusal
from heli_modes.table import Command, Fact, Guard, Phase
from heli_outer_pd.anchor import GLIMPSE_NS, Flown, anchored, flown_now, glimpse, led_now
from heli_outer_pd.contact import TouchDown
from heli_outer_pd.disturbance import flyable, hover_share
from heli_outer_pd.outer_state import BY_HAND, LOST, LOW_BY_HAND, MEMORY, STEERED, OuterKernel
from heli_outer_pd.reference_limits import ReferenceLimits
from heli_outer_pd.steering import Steering, StickNumbers

Array = NDArray[np.float64]

RISES_MPS = 0.3
"""Climbing so fast the skids have left the ground."""
_LIFTS = 0.5
"""With more of hover's thrust it is about to lift, or has flown."""
_NEARLY = 1e-3
_LOWERED = -0.9
"""The collective stick is at its lower end below this."""
_PILOT_HAS_IT = "the pilot's sticks fly the attitude"
_ONCE = ("once another mode is flown, or no sticks are heard",)
_CODES = {Phase.ATTITUDE: STEERED, Phase.MANUAL: LOW_BY_HAND}


@dataclass(frozen=True)
class Now:
    """A moment of the flight: stamps of it and of flight time 0, ns; navigation row, law."""

    ns: int
    start_ns: int
    nav: Array
    k: OuterKernel


class StickFlight:
    """What is known while the sticks fly, or might.

    Parameters
    ----------
    state : array
        State of the law, changed in place.

    Attributes
    ----------
    steering : Steering
    aground : bool
        By hand: it stands, as far as is known.
    """

    def __init__(self, state: Array) -> None:
        self.steering, self.aground = Steering(), False
        self._state, self._lifted, self._contact = state, False, TouchDown()
        self._told_ns: int | None = None
        self._steered_ns: int | None = None

    def fails(self, now_ns: int, n: StickNumbers) -> set[Guard]:
        """Guards of the sticks that do not hold now."""
        fails = set()
        if self.steering.is_silent(now_ns, n):
            fails.add(Guard.STICKS)
            if self.steering.asked.is_silent(now_ns, n):
                fails.add(Guard.HEARD)
        if self.steering.sticks[STICKS.climb] > _LOWERED:
            fails.add(Guard.LOWERED)
        return fails

    def ask(self, phase: Phase, attitude_rad: Array, now: Now, n: StickNumbers) -> Refusal | None:
        """Take an attitude (3,) that is commanded; ReferenceRefused if it is tilted too much."""
        steering = self.steering
        sticks_lead = phase == Phase.ATTITUDE and not steering.asked.leads
        if sticks_lead and not steering.is_silent(now.ns, n):
            return Refusal(Command.ATTITUDE.value, _PILOT_HAS_IT, _ONCE)
        steering.ask(attitude_rad, now.ns, n, now.k)
        return None

    def climb(self, phase: Phase, climb_mps: float, now_ns: int) -> Refusal | None:
        """Take the climb of it."""
        if phase != Phase.ATTITUDE or not self.steering.asked.leads:
            return Refusal("climb", "no commanded attitude is flown", ("beside command_attitude",))
        self.steering.climb(climb_mps, now_ns)
        return None

    def fact(
        self, phase: Phase, now: Now, n: StickNumbers, idle_collective: float, col: float
    ) -> Fact | None:
        """Whether nobody is at the sticks, or the pilot has put it back and let go.

        Parameters
        ----------
        phase : Phase
            ATTITUDE or MANUAL.
        now : Now
            Its navigation row is finite.
        n : StickNumbers
        idle_collective, col : float
            Collective on the ground, and as flown.
        """
        silent = self.steering.is_silent(now.ns, n)
        if phase == Phase.ATTITUDE:
            asked = self.steering.asked
            silent = asked.is_silent(now.ns, n) if asked.leads else silent
            return Fact.SILENT if silent else None
        share, v_down = float(hover_share(col, now.k)), float(now.nav[NAV.down_vel])
        touched = self._contact.found(share, v_down, now.k.g, now.k.dt_s)
        if not self.aground:
            self.aground = touched
            return Fact.SILENT if silent and not touched else None
        self._lifted |= share > _LIFTS
        if self._lifted and -v_down > RISES_MPS:
            self.aground, self._contact = False, TouchDown(share, v_down)
        idle = abs(col - idle_collective) <= _NEARLY
        return Fact.IDLE if idle and (self._lifted or silent) else None

    def take(
        self, before: Phase, phase: Phase, way: Trajectory | None, now: Now, n: StickNumbers
    ) -> bool:
        """The sticks take over in a phase, from how the aircraft, or its reference, moves.

        False if they have it already. Without sticks an attitude that is heard leads.
        """
        if phase == before:
            return False
        if phase == Phase.ATTITUDE:
            assert way is not None  # a guard has seen to it
            if self.steering.is_silent(now.ns, n):
                self.steering.lead_by_messages()
            by_hand = before == Phase.MANUAL
            moves = self.flown(before, now) if by_hand else led_now(way, now.ns, now.k)
            self.steering.start(moves.ned[:, 2], moves.psi)
        else:
            share = float(hover_share(self._state[MEMORY.command][SETPOINT.col], now.k))
            self._contact = TouchDown(share, float(now.nav[NAV.down_vel]))
            self.aground = before == Phase.STANDING
            self._lifted = not self.aground
        self._told_ns = self._steered_ns = None
        self.hand_over(_CODES[phase])
        return True

    def hand_over(self, code: float) -> None:
        """Another law flies from its next step on, and goes on from the last command."""
        if code != STEERED:
            self.steering.lead_by_sticks()
        self._state[MEMORY.ground], self._state[MEMORY.takes_over] = code, 1.0

    def flown(self, phase: Phase, now: Now) -> Flown:
        """How it moves: vertical and heading as steered in mode attitude, else as measured.

        While the position is lost it counts as at rest: what is not known is not braked.
        """
        flown = flown_now(now.nav, now.k, self._state)
        if self._state[MEMORY.sight] == LOST:
            flown.ned[1:, :2] = 0.0
        if phase == Phase.ATTITUDE:
            down, psi = self.steering.down, self.steering.psi
            flown.ned[:, 2] = down.pos[0], down.vel[0], down.acc[0]
            flown.psi = np.array([psi.pos[0], psi.vel[0], psi.acc[0]])
        return flown

    def leave(self, phase: Phase, now: Now) -> Trajectory:
        """A reference that moves as it is flown, to go on from."""
        return anchored(self.flown(phase, now), now.ns, now.start_ns, now.k)

    def tells(self, now_ns: int) -> bool:
        """Whether it is time to tell where it goes: at first, and once a second."""
        due = self._told_ns is None or now_ns - self._told_ns >= GLIMPSE_NS
        if due:
            self._told_ns = now_ns
        return due

    def glimpse(self, phase: Phase, now: Now) -> Trajectory:
        """Where it seems to go."""
        return glimpse(self.flown(phase, now), now.ns, now.start_ns)

    def steer(
        self,
        phase: Phase,
        now: Now,
        n: StickNumbers,
        idle_collective: float,
        fence: ReferenceLimits,
        low: bool,
    ) -> None:
        """What the law's next step gets of the sticks, once; `low`: the ground may carry a part."""
        if now.ns == self._steered_ns:
            return
        self._steered_ns = now.ns
        if phase == Phase.ATTITUDE:
            self.steering.steer(n, now.k, fence, now.ns, self._state)
            return
        if flyable(now.nav):
            self._state[MEMORY.ground] = LOW_BY_HAND if low else BY_HAND
        let_go = self.aground and self.steering.is_silent(now.ns, n)
        self.steering.by_hand(n, now.k, idle_collective, self.aground, let_go, self._state)
