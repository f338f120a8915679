# SPDX-License-Identifier: Apache-2.0
"""Nose into the wind: turn until nothing pushes from the side. No ROS.

What pushes forward says little of the wind: a helicopter's front is small, its side eight times as
large, so the estimated disturbance does not point with the wind. But where it vanishes from the
side the wind comes from ahead (from behind it vanishes, too, and the least turn away from there
goes on). What it leaves is the side force at which the aircraft is trimmed wrongly, over that of
the wind per angle. How much the push changes per angle is seen in the turns themselves (secant).
"""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_modes.table import Phase
from heli_outer_pd.disturbance import flyable
from heli_outer_pd.goto import WIND, Goto
from heli_outer_pd.outer_state import MEMORY, OuterKernel
from heli_outer_pd.phase_ways import PhaseNumbers
from heli_outer_pd.sight import well_known

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


class Flight(Protocol):
    """What is asked of the phases of a flight."""

    phase: Phase
    way: Trajectory | None
    goto: Goto
    kernel: OuterKernel
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
            Stamp of a step of the law, ns.
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
        self, flight: Flight, now_ns: int, nav: Array, state: Array, ground_down_m: float
    ) -> Trajectory | None:
        """The way that is followed, with a turn in it if it is time for one.

        Parameters
        ----------
        flight : Flight
            Its nose turns where it hovers, if a goto's heading is the wind; in a landing, if that
            one's is, above half of the height at which its last part begins. Not where its
            position is about to be lost: the lean of a heading is learnt before.
        now_ns : int
            Stamp of the law's last step, ns.
        nav, state : arrays
            Navigation row and state of the law.
        ground_down_m : float
            Where the ground is, as far as it is known, NED.
        """
        phase, way, n = flight.phase, flight.way, flight.numbers
        fresh = phase not in (self._phase, Phase.DESCENDING)
        self._phase = phase
        wanted = phase == Phase.HOVER and flight.goto.heading == WIND
        if phase in (Phase.HALTING, Phase.DESCENDING):
            high = ground_down_m - nav[NAV.pos][2] > 0.5 * n.slow_below_m
            wanted = n.land_heading == WIND and high
        known = flyable(nav) and well_known(nav, flight.kernel, state)
        if fresh or not wanted or way is None or not known:
            self.rest(now_ns)
            return way
        angle = self.turn(now_ns, push_right(state[MEMORY.disturbance], nav))
        if angle == 0.0:
            return way
        way, done_ns = flight.goto.turn(way, now_ns, angle)
        self.rest(done_ns)
        return way
