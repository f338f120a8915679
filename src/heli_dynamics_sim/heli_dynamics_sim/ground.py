# SPDX-License-Identifier: Apache-2.0
"""Ground contact: a plane, level or sloped, holds skids, tail and rotor hub.

Each contact point is a spring and damper that can only push. Friction of the skids sticks: a
tangential spring and damper as stiff as the normal ones, whose force is cut at Coulomb's cone and
whose stretch (the bristle, a state) is cut with it after every step (Cundall, Strack, "A discrete
numerical model for granular assemblies", Geotechnique 29(1), 1979: elastic, then perfectly
plastic). So what stands does not creep, which friction that is smooth in the slip would: 3.6 mm/s
on 5 deg. What is cut off is lost, so friction never gives energy. Tail and hub, whose touch ends a
flight, keep friction that is smooth below `SLIP_SPEED_MPS`. The stiffness of the default gear keeps
RK4 stable at 2 ms.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.jit import by_reference, njit
from heli_core.rows import PLANT
from heli_dynamics_sim.airframe import attitude_of, rates_of, to_body, to_ned, velocity_of

SLIP_SPEED_MPS = 0.02
N_SKID_POINTS = 4


@by_reference
class GroundParams(NamedTuple):
    """Contact points, their law and the plane."""

    points: np.ndarray  # (6, 3) body, m: four skid ends, tail, rotor hub
    reach: float  # largest distance of a point from the c.g., m
    stiffness: float  # N/m per point, normal and, of a skid, tangential
    damping: float  # N s/m per point, likewise
    friction: float  # Coulomb coefficient
    hard_impact: float  # speed into the ground that breaks the gear, m/s
    origin: np.ndarray  # (2,) north and east where the plane is at altitude 0, m
    plane: np.ndarray  # (3, 3) NED unit vectors as rows: into the ground, two along it


def plane_of(slope: ArrayLike) -> NDArray[np.float64]:
    """Rows of `GroundParams.plane` for a slope (2,): rise per metre to north and east."""
    north, east = np.asarray(slope, dtype=np.float64)
    into = np.array([north, east, 1.0]) / math.sqrt(1.0 + north * north + east * east)
    along = np.array([1.0, 0.0, -north]) / math.sqrt(1.0 + north * north)
    return np.array([into, along, np.cross(into, along)])


@njit
def depth_of_cg(x, k):
    """How deep the c.g. is in the ground (m, negative above it), across the plane."""
    into = k.plane[0]
    return (
        into[0] * (x[PLANT.north] - k.origin[0])
        + into[1] * (x[PLANT.east] - k.origin[1])
        + into[2] * x[PLANT.down]
    )


@njit
def _along(axis, v):
    """Component of v (3 floats) along axis (3,)."""
    return axis[0] * v[0] + axis[1] * v[1] + axis[2] * v[2]


@njit
def _point_velocity_ned(x, px, py, pz):
    """NED velocity (m/s) of a body-fixed point."""
    u, v, w = velocity_of(x)
    p, q, r = rates_of(x)
    return to_ned(attitude_of(x), u + q * pz - r * py, v + r * px - p * pz, w + p * py - q * px)


@njit
def _touch(x, i, cg_depth, k):
    """(normal force in N, velocity along the plane's two directions in m/s) of a point; 0 in the
    air."""
    px, py, pz = k.points[i, 0], k.points[i, 1], k.points[i, 2]
    depth = cg_depth + _along(k.plane[0], to_ned(attitude_of(x), px, py, pz))
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    v = _point_velocity_ned(x, px, py, pz)
    normal = max(0.0, k.stiffness * depth + k.damping * _along(k.plane[0], v))
    return normal, _along(k.plane[1], v), _along(k.plane[2], v)


@njit
def _friction(x, i, normal, v1, v2, k):
    """Friction (N) on a point along the two directions of the plane."""
    largest = k.friction * normal
    if i >= N_SKID_POINTS:
        drag = largest / math.sqrt(v1 * v1 + v2 * v2 + SLIP_SPEED_MPS**2)
        return -drag * v1, -drag * v2
    bristle = x[PLANT.stick]
    f1 = -k.stiffness * bristle[2 * i] - k.damping * v1
    f2 = -k.stiffness * bristle[2 * i + 1] - k.damping * v2
    size = math.sqrt(f1 * f1 + f2 * f2)
    if size > largest:
        f1, f2 = f1 * largest / size, f2 * largest / size
    return f1, f2


@njit
def ground_loads(x, k):
    """Force (N) and moment (N m) of the ground on the aircraft, body axes, as two 3-tuples."""
    fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    cg_depth = depth_of_cg(x, k)
    if cg_depth + k.reach <= 0.0:
        return (fx, fy, fz), (mx, my, mz)
    attitude = attitude_of(x)
    into, first, second = k.plane[0], k.plane[1], k.plane[2]
    for i in range(k.points.shape[0]):
        normal, v1, v2 = _touch(x, i, cg_depth, k)
        if normal == 0.0:
            continue
        f1, f2 = _friction(x, i, normal, v1, v2, k)
        bx, by, bz = to_body(
            attitude,
            f1 * first[0] + f2 * second[0] - normal * into[0],
            f1 * first[1] + f2 * second[1] - normal * into[1],
            f1 * first[2] + f2 * second[2] - normal * into[2],
        )
        px, py, pz = k.points[i, 0], k.points[i, 1], k.points[i, 2]
        fx += bx
        fy += by
        fz += bz
        mx += py * bz - pz * by
        my += pz * bx - px * bz
        mz += px * by - py * bx
    return (fx, fy, fz), (mx, my, mz)


@njit
def stick_rates(x, k, out):
    """Fill the bristles' places of a plant derivative: a skid that presses takes its bristle along.

    Zero before: `derivative_kernel` has cleared the states of terms.
    """
    cg_depth = depth_of_cg(x, k)
    if cg_depth + k.reach <= 0.0:
        return
    rate = out[PLANT.stick]
    for i in range(N_SKID_POINTS):
        normal, v1, v2 = _touch(x, i, cg_depth, k)
        if normal > 0.0:
            rate[2 * i], rate[2 * i + 1] = v1, v2


@njit
def apply_slip(x, k):
    """Cut the bristles of a plant state at Coulomb's cone, in place; in the air they rest."""
    bristle = x[PLANT.stick]
    cg_depth = depth_of_cg(x, k)
    if cg_depth + k.reach <= 0.0:
        for i in range(bristle.shape[0]):
            bristle[i] = 0.0
        return
    for i in range(N_SKID_POINTS):
        normal, _, _ = _touch(x, i, cg_depth, k)
        largest = k.friction * normal / k.stiffness
        stretch = math.sqrt(bristle[2 * i] ** 2 + bristle[2 * i + 1] ** 2)
        if stretch > largest:
            bristle[2 * i] *= largest / stretch
            bristle[2 * i + 1] *= largest / stretch


@njit
def ground_contact(x, k):
    """(fastest touching point's speed into the ground in m/s, skids touch, structure touches).

    The speed is 0 where nothing touches; it is what a hard impact is judged by.
    """
    speed, skids, structure = 0.0, False, False
    cg_depth = depth_of_cg(x, k)
    if cg_depth + k.reach <= 0.0:
        return speed, skids, structure
    for i in range(k.points.shape[0]):
        px, py, pz = k.points[i, 0], k.points[i, 1], k.points[i, 2]
        if cg_depth + _along(k.plane[0], to_ned(attitude_of(x), px, py, pz)) <= 0.0:
            continue
        speed = max(speed, _along(k.plane[0], _point_velocity_ned(x, px, py, pz)))
        if i < N_SKID_POINTS:
            skids = True
        else:
            structure = True
    return speed, skids, structure
