# SPDX-License-Identifier: Apache-2.0
"""A reference whose speed steps: hover, climb, hover, as nobody can fly it."""

import numpy as np
from numpy.typing import ArrayLike

from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory


def step_climb(
    pos_ned_m: ArrayLike, psi_rad: float, start_s: float, end_s: float, climb_mps: float
) -> Trajectory:
    """Hover at pos_ned_m (3,), climb from start_s to end_s, hover higher up."""
    low = np.asarray(pos_ned_m, float)
    points = np.zeros((3, REFERENCE.size))
    points[:, REFERENCE.pos] = low
    points[2, REFERENCE.pos.start + 2] -= climb_mps * (end_s - start_s)
    points[1, REFERENCE.down_vel] = -climb_mps
    points[:, REFERENCE.psi] = psi_rad
    times = np.round(np.array([0.0, start_s, end_s]) * NS_PER_S).astype(np.int64)
    return Trajectory(0, times, points)
