# SPDX-License-Identifier: Apache-2.0
"""Rigid body: kinematics with a quaternion, Newton and Euler in body axes.

Eq. (1)-(5) of the paper, corrected: eq. (1)-(2) print the NED -> body matrix, its transpose moves
the position; eq. (3)-(4) are singular at theta = +-90 deg, so the attitude is a quaternion; eq. (5)
needs the body rates where the Euler angles are printed. J is diagonal.
"""

from typing import NamedTuple

from heli_math.jit import njit


class BodyKernel(NamedTuple):
    """Mass properties."""

    mass: float  # kg
    j_xx: float  # kg m2
    j_yy: float
    j_zz: float
    gravity: float  # m/s2


@njit
def to_body(w, x, y, z, n, e, d):
    """Body components of the NED vector (n, e, d); (w, x, y, z) is the attitude quaternion."""
    b0 = (1.0 - 2.0 * (y * y + z * z)) * n + 2.0 * (x * y + w * z) * e + 2.0 * (x * z - w * y) * d
    b1 = 2.0 * (x * y - w * z) * n + (1.0 - 2.0 * (x * x + z * z)) * e + 2.0 * (y * z + w * x) * d
    b2 = 2.0 * (x * z + w * y) * n + 2.0 * (y * z - w * x) * e + (1.0 - 2.0 * (x * x + y * y)) * d
    return b0, b1, b2


@njit
def to_ned(w, x, y, z, b0, b1, b2):
    """NED components of the body vector (b0, b1, b2); (w, x, y, z) is the attitude quaternion."""
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
        State, layout of `state`.
    force : 3 floats
        Force without gravity, body, N.
    moment : 3 floats
        About the c.g., body, N m.
    k : BodyKernel
    out : (>= 13,) array
        Filled in its first 13 places.
    """
    u, v, w = x[3], x[4], x[5]
    qw, qx, qy, qz = x[6], x[7], x[8], x[9]
    p, q, r = x[10], x[11], x[12]
    out[0], out[1], out[2] = to_ned(qw, qx, qy, qz, u, v, w)
    gx, gy, gz = to_body(qw, qx, qy, qz, 0.0, 0.0, k.gravity)
    out[3] = force[0] / k.mass + gx + r * v - q * w
    out[4] = force[1] / k.mass + gy + p * w - r * u
    out[5] = force[2] / k.mass + gz + q * u - p * v
    out[6] = -0.5 * (p * qx + q * qy + r * qz)
    out[7] = 0.5 * (p * qw + r * qy - q * qz)
    out[8] = 0.5 * (q * qw - r * qx + p * qz)
    out[9] = 0.5 * (r * qw + q * qx - p * qy)
    out[10] = (moment[0] + (k.j_yy - k.j_zz) * q * r) / k.j_xx
    out[11] = (moment[1] + (k.j_zz - k.j_xx) * r * p) / k.j_yy
    out[12] = (moment[2] + (k.j_xx - k.j_yy) * p * q) / k.j_zz
