# SPDX-License-Identifier: Apache-2.0
"""Ground contact: the plane at altitude 0 holds skids, tail and rotor hub.

Each contact point is a spring and damper that can only push, with Coulomb friction that is smooth
below `SLIP_SPEED_MPS`. The stiffness of the default gear keeps RK4 stable at 2 ms.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.rigid_body import to_body, to_ned
from heli_dynamics_sim.state import attitude_of, rates_of, velocity_of
from heli_math.jit import njit
from heli_math.rows import PLANT

SLIP_SPEED_MPS = 0.02
N_SKID_POINTS = 4


class GroundKernel(NamedTuple):
    """Contact points and their law."""

    points: np.ndarray  # (6, 3) body, m: four skid ends, tail, rotor hub
    reach: float  # largest distance of a point from the c.g., m
    stiffness: float  # N/m per point
    damping: float  # N s/m per point
    friction: float  # Coulomb coefficient
    hard_impact: float  # vertical speed that breaks the gear, m/s


@njit
def _point_velocity_ned(x, px, py, pz):
    """NED velocity (m/s) of a body-fixed point."""
    u, v, w = velocity_of(x)
    p, q, r = rates_of(x)
    return to_ned(attitude_of(x), u + q * pz - r * py, v + r * px - p * pz, w + p * py - q * px)


@njit
def ground_loads(x, k):
    """Force (N) and moment (N m) of the ground on the aircraft, body axes, as two 3-tuples."""
    fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if x[PLANT.down] + k.reach <= 0.0:
        return (fx, fy, fz), (mx, my, mz)
    attitude = attitude_of(x)
    for i in range(k.points.shape[0]):
        px, py, pz = k.points[i, 0], k.points[i, 1], k.points[i, 2]
        depth = x[PLANT.down] + to_ned(attitude, px, py, pz)[2]
        if depth <= 0.0:
            continue
        vn, ve, vd = _point_velocity_ned(x, px, py, pz)
        normal = max(0.0, k.stiffness * depth + k.damping * vd)
        drag = k.friction * normal / math.sqrt(vn * vn + ve * ve + SLIP_SPEED_MPS**2)
        bx, by, bz = to_body(attitude, -drag * vn, -drag * ve, -normal)
        fx += bx
        fy += by
        fz += bz
        mx += py * bz - pz * by
        my += pz * bx - px * bz
        mz += px * by - py * bx
    return (fx, fy, fz), (mx, my, mz)


@njit
def ground_contact(x, k):
    """(deepest point's sinking speed in m/s, skids touch, structure touches).

    The speed is 0 where nothing touches; it is what a hard impact is judged by.
    """
    speed, skids, structure = 0.0, False, False
    if x[PLANT.down] + k.reach <= 0.0:
        return speed, skids, structure
    for i in range(k.points.shape[0]):
        px, py, pz = k.points[i, 0], k.points[i, 1], k.points[i, 2]
        if x[PLANT.down] + to_ned(attitude_of(x), px, py, pz)[2] <= 0.0:
            continue
        speed = max(speed, _point_velocity_ned(x, px, py, pz)[2])
        if i < N_SKID_POINTS:
            skids = True
        else:
            structure = True
    return speed, skids, structure
