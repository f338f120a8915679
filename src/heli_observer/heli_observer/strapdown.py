# SPDX-License-Identifier: Apache-2.0
"""Strapdown navigation: specific force and rate of one tick into position, velocity, attitude."""

from heli_math.arrays import copy_part, scratch, scratch_matrix
from heli_math.jit import njit
from heli_math.rotations import fill_from_rotvec, fill_product, fill_R_nb, normalize
from heli_math.rows import IMU
from heli_observer.layout import X_ACCEL_BIAS, X_GYRO_BIAS, X_POS, X_QUAT, X_VEL


@njit
def glide(x, dt_s):
    """Propagate the nominal state x (21,) over a tick of unaccelerated flight, in place."""
    for i in range(3):
        x[X_POS + i] += dt_s * x[X_VEL + i]


@njit
def strapdown(x, imu0, imu1, gravity_mps2, dt_s, a_ned, R_mid):
    """Propagate the nominal state x (21,) over one tick, in place.

    Parameters
    ----------
    x : ndarray (21,)
        Nominal state, indices X_*.
    imu0, imu1 : ndarray (6,)
        Rows `IMU` at the beginning and the end of the tick. The rate is taken to vary linearly
        between (with the coning term dt^2/12 w0 x w1), and so is the acceleration in NED axes.
    gravity_mps2, dt_s : float
    a_ned : ndarray (3,)
        Out: mean specific force in NED axes (m/s2), for the covariance.
    R_mid : ndarray (3, 3)
        Out: R_nb, mean of both ends, for the covariance.
    """
    w0, w1, bias = imu0[IMU.rate], imu1[IMU.rate], x[X_GYRO_BIAS : X_GYRO_BIAS + 3]
    w0x, w0y, w0z = w0[0] - bias[0], w0[1] - bias[1], w0[2] - bias[2]
    w1x, w1y, w1z = w1[0] - bias[0], w1[1] - bias[1], w1[2] - bias[2]
    coning = dt_s * dt_s / 12.0
    rotvec, turn, q1 = scratch(3), scratch(4), scratch(4)
    R0, R1 = scratch_matrix(3, 3), scratch_matrix(3, 3)
    rotvec[0] = 0.5 * dt_s * (w0x + w1x) + coning * (w0y * w1z - w0z * w1y)
    rotvec[1] = 0.5 * dt_s * (w0y + w1y) + coning * (w0z * w1x - w0x * w1z)
    rotvec[2] = 0.5 * dt_s * (w0z + w1z) + coning * (w0x * w1y - w0y * w1x)
    q0 = x[X_QUAT : X_QUAT + 4]
    fill_R_nb(q0, R0)
    fill_from_rotvec(rotvec, turn)
    fill_product(q0, turn, q1)
    normalize(q1)
    fill_R_nb(q1, R1)
    f0, f1, bias = imu0[IMU.force], imu1[IMU.force], x[X_ACCEL_BIAS : X_ACCEL_BIAS + 3]
    for i in range(3):
        a0 = 0.0
        a1 = 0.0
        for j in range(3):
            a0 += R0[i, j] * (f0[j] - bias[j])
            a1 += R1[i, j] * (f1[j] - bias[j])
        g = gravity_mps2 if i == 2 else 0.0
        a_ned[i] = 0.5 * (a0 + a1)
        x[X_POS + i] += dt_s * x[X_VEL + i] + dt_s * dt_s * (a0 / 3.0 + a1 / 6.0 + 0.5 * g)
        x[X_VEL + i] += dt_s * (a_ned[i] + g)
    copy_part(x, X_QUAT, q1, 0, 4)
    for i in range(3):
        for j in range(3):
            R_mid[i, j] = 0.5 * (R0[i, j] + R1[i, j])
