# SPDX-License-Identifier: Apache-2.0
"""The plant's state at rest, and in parts as its kernels take them; places: `heli_math.rows.PLANT`.

Inside: NED and FRD, SI units, rad.
"""

import numpy as np
from numpy.typing import NDArray

from heli_math.jit import njit
from heli_math.rotations import quat_from_euler
from heli_math.rows import PLANT

STEP_S = 0.002
"""Integration step, s: of a tick of 10 ms; the longest of any other."""


def make_state(
    pos_ned_m: NDArray[np.float64] | tuple[float, float, float] = (0.0, 0.0, 0.0),
    phi: float = 0.0,
    theta: float = 0.0,
    psi: float = 0.0,
) -> NDArray[np.float64]:
    """Plant state (42,) at rest at a position (NED, m) and attitude (rad), all else zero."""
    x = np.zeros(PLANT.size)
    x[PLANT.pos] = pos_ned_m
    x[PLANT.quat] = quat_from_euler(phi, theta, psi)
    return x


@njit
def velocity_of(x):
    """Inertial velocity (u, v, w), body axes, m/s, of a plant state."""
    return x[PLANT.u], x[PLANT.v], x[PLANT.w]


@njit
def attitude_of(x):
    """Quaternion (w, x, y, z), body -> NED, of a plant state."""
    return x[PLANT.qw], x[PLANT.qx], x[PLANT.qy], x[PLANT.qz]


@njit
def rates_of(x):
    """Body rates (p, q, r), rad/s, of a plant state."""
    return x[PLANT.p], x[PLANT.q], x[PLANT.r]
