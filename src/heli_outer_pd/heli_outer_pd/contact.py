# SPDX-License-Identifier: Apache-2.0
"""How an aircraft stands, and whether it does: it leans, or it does not fall though it should.

By what is measured on any aircraft. No ROS.
"""

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, SETPOINT
from heli_modes.table import Guard
from heli_outer_pd.disturbance import hover_share
from heli_outer_pd.outer_state import OuterKernel

Array = NDArray[np.float64]

_UNLOADED = 0.75
"""Of the thrust that carried it: with less it would fall, unless something else carries it."""
_MISSING_MPS, _FALLEN = 2.0, 0.3
"""Thrust that is missing would have made it fall by so much; it has fallen by less than so much of
it: touched down. Differences of the speed alone, so that an error of the navigation's is none."""
_USUAL_S = 1.0
"""Time constant of the thrust that carries it."""
_AT_LIMIT = 1e-3


def lean(nav: Array, k: OuterKernel) -> Array:
    """Roll and pitch (2,), rad, off those of hover."""
    phi, theta, _ = euler_from_quat(nav[NAV.quat])
    return np.array([phi, theta]) - k.trim[: SETPOINT.psi]


def leans_beyond(nav: Array, k: OuterKernel, stance: Array) -> float:
    """How much further than it stood (2,) it leans off hover's attitude, either way, rad."""
    return float((np.abs(lean(nav, k)) - np.abs(stance)).max())


def lifts_more(d_col: float, than: float, idle: float, k: OuterKernel) -> float:
    """How far a collective is above another in the direction that lifts; negative below."""
    up = k.trim[SETPOINT.col] - idle
    return float(np.copysign(d_col - than, up * (d_col - than)))


class TouchDown:
    """What carries the aircraft: its rotor, or by now the ground.

    Parameters
    ----------
    share : float
        Thrust that carries it now, a share of hover's.
    v_down_mps : float
    """

    def __init__(self, share: float = 1.0, v_down_mps: float = 0.0) -> None:
        self._usual, self._missing_mps, self._began_mps = share, 0.0, v_down_mps

    def found(self, share: float, v_down_mps: float, g: float, dt_s: float) -> bool:
        """Look at a step of the law: its thrust, a share of hover's, and the speed downwards."""
        if share > _UNLOADED * self._usual:
            self._usual += (share - self._usual) * dt_s / _USUAL_S
            self._missing_mps, self._began_mps = 0.0, v_down_mps
            return False
        self._missing_mps += (self._usual - share) * g * dt_s
        fallen = v_down_mps - self._began_mps
        return self._missing_mps > _MISSING_MPS and fallen < _FALLEN * self._missing_mps


def not_flown(nav: Array, col: float, lean_max_rad: float, k: OuterKernel) -> set[Guard]:
    """Guards of tilt and thrust that do not hold.

    Parameters
    ----------
    nav : array
        Navigation row.
    col : float
        Collective as commanded.
    lean_max_rad : float
        Off hover's attitude, for a take-off.
    k : OuterKernel
    """
    fails: set[Guard] = set()
    tilt = float(np.abs(lean(nav, k)).max())
    if tilt > lean_max_rad:
        fails.add(Guard.UPRIGHT)
    if tilt > k.tilt_limit:
        fails.add(Guard.ENVELOPE)
    low, high = k.thrust_limits
    if not low + _AT_LIMIT < hover_share(col, k) < high - _AT_LIMIT:
        fails.add(Guard.UNSATURATED)
    return fails
