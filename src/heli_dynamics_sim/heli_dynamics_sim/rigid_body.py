# SPDX-License-Identifier: Apache-2.0
"""Rigid body: kinematics with a quaternion, Newton and Euler in body axes.

Eq. (1)-(5) of the paper, corrected: eq. (1)-(2) print the NED -> body matrix, its transpose moves
the position; eq. (3)-(4) are singular at theta = +-90 deg, so the attitude is a quaternion; eq. (5)
needs the body rates where the Euler angles are printed. J is diagonal.
"""

from typing import NamedTuple

from heli_dynamics_sim.state import attitude_of, rates_of, velocity_of
from heli_math.jit import njit
from heli_math.rows import PLANT


class BodyKernel(NamedTuple):
    """Mass properties."""

    mass: float  # kg
    j_xx: float  # kg m2
    j_yy: float
    j_zz: float
    gravity: float  # m/s2


@njit
def to_body(attitude, n, e, d):
    """Body components of the NED vector (n, e, d); attitude is the quaternion, 4 floats."""
    w, x, y, z = attitude
    b0 = (1.0 - 2.0 * (y * y + z * z)) * n + 2.0 * (x * y + w * z) * e + 2.0 * (x * z - w * y) * d
    b1 = 2.0 * (x * y - w * z) * n + (1.0 - 2.0 * (x * x + z * z)) * e + 2.0 * (y * z + w * x) * d
    b2 = 2.0 * (x * z + w * y) * n + 2.0 * (y * z - w * x) * e + (1.0 - 2.0 * (x * x + y * y)) * d
    return b0, b1, b2


@njit
def to_ned(attitude, b0, b1, b2):
    """NED components of the body vector (b0, b1, b2); attitude is the quaternion, 4 floats."""
    w, x, y, z = attitude
    n = (1.0 - 2.0 * (y * y + z * z)) * b0 + 2.0 * (x * y - w * z) * b1 + 2.0 * (x * z + w * y) * b2
    e = 2.0 * (x * y + w * z) * b0 + (1.0 - 2.0 * (x * x + z * z)) * b1 + 2.0 * (y * z - w * x) * b2
    d = 2.0 * (x * z - w * y) * b0 + 2.0 * (y * z + w * x) * b1 + (1.0 - 2.0 * (x * x + y * y)) * b2
    return n, e, d


@njit
def rigid_body_rates(x, force, moment, k, out):
    """Derivatives of position, velocity, quaternion and rates.

    Parameters
    ----------
    x : (>= 13,) array
        State, places of `PLANT`.
    force : 3 floats
        Force without gravity, body, N.
    moment : 3 floats
        About the c.g., body, N m.
    k : BodyKernel
    out : (>= 13,) array
        Filled in its first 13 places.
    """
    u, v, w = velocity_of(x)
    attitude = attitude_of(x)
    qw, qx, qy, qz = attitude
    p, q, r = rates_of(x)
    out[PLANT.north], out[PLANT.east], out[PLANT.down] = to_ned(attitude, u, v, w)
    gx, gy, gz = to_body(attitude, 0.0, 0.0, k.gravity)
    out[PLANT.u] = force[0] / k.mass + gx + r * v - q * w
    out[PLANT.v] = force[1] / k.mass + gy + p * w - r * u
    out[PLANT.w] = force[2] / k.mass + gz + q * u - p * v
    out[PLANT.qw] = -0.5 * (p * qx + q * qy + r * qz)
    out[PLANT.qx] = 0.5 * (p * qw + r * qy - q * qz)
    out[PLANT.qy] = 0.5 * (q * qw - r * qx + p * qz)
    out[PLANT.qz] = 0.5 * (r * qw + q * qx - p * qy)
    out[PLANT.p] = (moment[0] + (k.j_yy - k.j_zz) * q * r) / k.j_xx
    out[PLANT.q] = (moment[1] + (k.j_zz - k.j_xx) * r * p) / k.j_yy
    out[PLANT.r] = (moment[2] + (k.j_xx - k.j_yy) * p * q) / k.j_zz
