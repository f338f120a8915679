# SPDX-License-Identifier: Apache-2.0
"""Rotations between body (FRD) and navigation (NED) axes.

Quaternions are (w, x, y, z), Hamilton, unit, and rotate body components into NED components.
Euler angles are 3-2-1: psi (yaw), theta (pitch), phi (roll), rad; eq. (2)-(4) of the paper,
corrected: its printed matrix carries typing errors (row 1 is [c_th c_ps, c_th s_ps, -s_th] for
NED -> body).
"""

import math

import numpy as np

from heli_core.jit import njit, njit_counted


@njit
def wrap_pi(angle):
    """Wrap an angle (rad, float) to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@njit
def fill_R_nb(q, R):
    """Rotation matrix, body -> NED, of the unit quaternion q (4,), into R (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@njit_counted
def quat_to_R_nb(q):
    """Rotation matrix (3, 3), body -> NED, of the unit quaternion q (4,)."""
    R = np.empty((3, 3))
    fill_R_nb(q, R)
    return R


@njit
def fill_product(a, b, out):
    """Hamilton product a b, rotation b first, then a, into out (4,), which is neither."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


@njit_counted
def quat_multiply(a, b):
    """Hamilton product a b (4,): rotation b first, then a."""
    out = np.empty(4)
    fill_product(a, b, out)
    return out


@njit
def normalize(q):
    """Scale q (4,) to unit norm, in place."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] /= n


@njit
def fill_from_rotvec(v, out):
    """Unit quaternion of the rotation vector v (3,), rad, into out (4,), exact; series near 0."""
    angle_sq = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    if angle_sq < 1e-8:
        # sin(a/2)/a and cos(a/2) to the term whose neglect is below 1e-17
        s = 0.5 - angle_sq / 48.0
        out[0] = 1.0 - angle_sq / 8.0 + angle_sq * angle_sq / 384.0
    else:
        angle = math.sqrt(angle_sq)
        s = math.sin(0.5 * angle) / angle
        out[0] = math.cos(0.5 * angle)
    out[1] = s * v[0]
    out[2] = s * v[1]
    out[3] = s * v[2]


@njit
def fill_from_euler(phi, theta, psi, out):
    """Unit quaternion of the 3-2-1 Euler angles (rad) into out (4,)."""
    cr, sr = math.cos(0.5 * phi), math.sin(0.5 * phi)
    cp, sp = math.cos(0.5 * theta), math.sin(0.5 * theta)
    cy, sy = math.cos(0.5 * psi), math.sin(0.5 * psi)
    out[0] = cr * cp * cy + sr * sp * sy
    out[1] = sr * cp * cy - cr * sp * sy
    out[2] = cr * sp * cy + sr * cp * sy
    out[3] = cr * cp * sy - sr * sp * cy


@njit_counted
def quat_from_euler(phi, theta, psi):
    """Unit quaternion (4,) of the 3-2-1 Euler angles (rad)."""
    out = np.empty(4)
    fill_from_euler(phi, theta, psi, out)
    return out


@njit
def euler_from_quat(q):
    """3-2-1 Euler angles (phi, theta, psi), rad, of the unit quaternion q (4,).

    phi and psi in [-pi, pi], theta in [-pi/2, pi/2]. At theta = +-pi/2 only psi -+ phi is defined:
    phi is then reported as 0.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2.0 * (w * y - z * x)
    if s > 1.0 - 1e-14:
        return 0.0, 0.5 * math.pi, -2.0 * math.atan2(x, w)
    if s < -1.0 + 1e-14:
        return 0.0, -0.5 * math.pi, 2.0 * math.atan2(x, w)
    phi = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    theta = math.asin(s)
    psi = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return phi, theta, psi


def euler_angles(q_nb: np.ndarray) -> np.ndarray:
    """3-2-1 Euler angles (N, 3) phi, theta, psi, rad, of quaternions (N, 4) body -> NED."""
    w, x, y, z = np.asarray(q_nb).T
    return np.column_stack(
        (
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        )
    )


def rotation_between(q_from: np.ndarray, q_to: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3), rad, NED axes, that turn attitudes q_from (N, 4) into q_to (N, 4).

    Quaternions body -> NED; at most half a turn.
    """
    w0, x0, y0, z0 = np.asarray(q_from).T
    w1, x1, y1, z1 = np.asarray(q_to).T
    w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0
    x = -w1 * x0 + x1 * w0 - y1 * z0 + z1 * y0
    y = -w1 * y0 + x1 * z0 + y1 * w0 - z1 * x0
    z = -w1 * z0 - x1 * y0 + y1 * x0 + z1 * w0
    vector = np.column_stack((x, y, z)) * np.where(w < 0.0, -1.0, 1.0)[:, None]
    sine = np.linalg.norm(vector, axis=1)
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(sine > 1e-12, angle / sine, 2.0)
    return vector * scale[:, None]
