# SPDX-License-Identifier: Apache-2.0
"""A scripted pilot: flies the sticks by what a human sees, as late as a human does. No ROS.

Roll, pitch and heading, height, and how it drifts and climbs, 0.2 s ago; that is the effective
delay of a pilot of McRuer's crossover model (McRuer, Krendel, "Mathematical models of human pilot
behavior", AGARDograph 188, 1974: 0.1 to 0.4 s). Each loop's crossover leaves it a phase margin.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_from_quat, wrap_pi
from heli_math.rows import NAV, SETPOINT, STICKS
from heli_modes.table import Phase
from heli_outer_pd.outer_state import OuterKernel
from heli_outer_pd.steering import StickNumbers

Array = NDArray[np.float64]

_SEES_S = 0.2
_ROLL_RADPS = 2.59
"""Steady rate of roll or pitch, rad/s, per cyclic; per pedal 3.85 (`inner_loop.yaml`, model.B)."""
_YAW_RADPS = 3.85
_ATTITUDE, _HEADING = 1.8, 1.2
"""Crossovers of the attitude and of the heading, rad/s."""
_DRIFT, _PLACE = 0.6, 0.12
"""Acceleration against a drift, 1/s, and back to the place, 1/s2."""
_LEAN_RAD = 0.15
_CLIMB, _TRIM = 0.2, 0.08
"""Collective stick per speed of the climb that is missing, s/m, and per metre of it."""
_HEIGHT, _FAST_MPS, _SETS_DOWN_MPS = 0.5, 1.0, 0.3
_RAISES, _LOWERS, _LIGHT = 0.5, 1.0, -0.3
"""The collective stick is raised, and lowered, on the ground by so much a second; cyclic is moved
above the third."""
_NEAR_M, _TOUCHES_M = 3.0, 0.6
"""Slowly below the first; where it stood, less the receiver's error, below the second."""
_STILL_MPS, _STILL_S, _SURE_S = 0.12, 0.4, 1.6
"""It is down when it sinks no more for so long, the longer the higher it seems."""


class Pilot:
    """A pilot at the sticks.

    Parameters
    ----------
    k : OuterKernel
        Trim attitude; period of the looks.
    n : StickNumbers
        What the sticks do.
    standing : bool
        Begin with the collective stick at its lower end.
    """

    def __init__(self, k: OuterKernel, n: StickNumbers, standing: bool) -> None:
        self._k, self._n = k, n
        self._seen: deque[Array] = deque(maxlen=1 + round(_SEES_S / k.dt_s))
        self._stands = standing
        self._trim, self._stick, self._still_s = 0.0, -1.0 if standing else 0.0, 0.0
        self._place: Array | None = None
        self._psi = 0.0

    def fly(self, nav: Array, height_m: float, ground_down_m: float, phase: Phase) -> Array:
        """The sticks (4,) at a look; to a height above the ground, m, 0: set down.

        Parameters
        ----------
        nav : array
            Navigation row.
        height_m, ground_down_m : float
        phase : Phase
            MANUAL or ATTITUDE: what the sticks mean.
        """
        self._seen.append(nav.copy())
        seen = self._seen[0]
        phi, theta, psi = euler_from_quat(seen[NAV.quat])
        if self._place is None:
            self._place, self._psi = seen[NAV.pos].copy(), psi
        sticks = np.zeros(STICKS.size)
        sticks[STICKS.climb] = self._collective(seen, height_m, ground_down_m, phase)
        if self._stands and sticks[STICKS.climb] < _LIGHT:
            self._place, self._psi = seen[NAV.pos].copy(), psi
            return sticks
        lean = self._lean(seen, psi)
        if phase == Phase.ATTITUDE:
            sticks[:2] = lean / self._n.tilt_max_rad
            return np.clip(sticks, -1.0, 1.0)
        trim, hand = self._k.trim, self._n.hand
        off = lean + trim[: SETPOINT.psi] - (phi, theta)
        sticks[:2] = _ATTITUDE * off / (_ROLL_RADPS * np.abs(hand[:2]))
        turn = _HEADING * wrap_pi(self._psi - psi)
        sticks[STICKS.yaw] = turn / (_YAW_RADPS * abs(hand[2]))
        return np.clip(sticks, -1.0, 1.0)

    def _lean(self, seen: Array, psi: float) -> Array:
        """Roll and pitch (2,), rad off trim, against the drift and back to the place."""
        assert self._place is not None
        back = -_DRIFT * seen[NAV.vel][:2] + _PLACE * (self._place - seen[NAV.pos])[:2]
        c, s = math.cos(psi), math.sin(psi)
        forward, right = c * back[0] + s * back[1], -s * back[0] + c * back[1]
        return np.clip(np.array([right, -forward]) / self._k.g, -_LEAN_RAD, _LEAN_RAD)

    def _collective(self, seen: Array, height_m: float, ground_m: float, phase: Phase) -> float:
        """The collective stick."""
        up, climbs, dt = ground_m - seen[NAV.pos][2], -seen[NAV.down_vel], self._k.dt_s
        if self._stands:
            goal = 0.0 if height_m > 0.0 else -1.0
            self._stick += min(max(goal - self._stick, -_LOWERS * dt), _RAISES * dt)
            if climbs > 0.2 or self._stick == goal == 0.0:
                self._stands, self._trim = False, self._stick
            return self._stick
        wanted = min(max(_HEIGHT * (height_m - up), -_FAST_MPS), _FAST_MPS)
        if height_m == 0.0:
            wanted = -_SETS_DOWN_MPS if up < _NEAR_M else min(wanted, -_SETS_DOWN_MPS)
        if phase == Phase.ATTITUDE:
            return wanted / self._n.climb_mps
        missing = wanted - climbs
        self._trim = min(max(self._trim + _TRIM * missing * dt, -0.5), 0.5)
        self._stick = min(max(self._trim + _CLIMB * missing, -0.6), 0.6)
        near = height_m == 0.0 and up < _NEAR_M and abs(climbs) < _STILL_MPS
        self._still_s = self._still_s + dt if near else 0.0
        self._stands = self._still_s > (_STILL_S if up < _TOUCHES_M else _SURE_S)
        return self._stick
