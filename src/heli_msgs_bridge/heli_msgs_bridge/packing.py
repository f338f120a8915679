# SPDX-License-Identifier: Apache-2.0
"""Between the cores' arrays (NED, FRD) and the double blocks of messages (ENU, FLU), compiled.

`pack_*(array, block)` fills a message's doubles, `unpack_*(block, array)` reads them and returns 0
or the code of what is wrong (`REASONS`). Block layouts follow the message definitions field by
field.
"""

import math

import numpy as np

from heli_math.jit import njit
from heli_math.rotations import euler_from_quat, quat_from_euler, quat_to_R_nb
from heli_msgs_bridge.frames import (
    Datum,
    enu_to_ned,
    flu_to_frd,
    frd_to_flu,
    geodetic_to_ned,
    ned_to_enu,
    ned_to_geodetic,
    quat_enu_flu_to_ned_frd,
    quat_ned_frd_to_enu_flu,
)

OK, NOT_FINITE, NOT_UNIT, OUT_OF_RANGE, NO_FIX = 0, 1, 2, 3, 4
REASONS = {
    NOT_FINITE: "holds a value that is not finite",
    NOT_UNIT: "holds a quaternion that is not of unit length",
    OUT_OF_RANGE: "holds a value outside of its range",
    NO_FIX: "says that there is no fix",
}
N_NAV = 31
N_TRUTH = 13
# nav_msgs/Odometry: position 3, quaternion 4, covariance 36, linear 3, angular 3, covariance 36
ODOM_BLOCK = 85
_POSE_COV, _LINEAR, _ANGULAR, _TWIST_COV = 7, 43, 46, 49
_ROTATION_COV = _POSE_COV + 3 * 6 + 3  # lower right 3x3 of the pose's 6x6
# sensor_msgs/Imu: quaternion 4, covariance 9, rate 3, covariance 9, acceleration 3, covariance 9
IMU_BLOCK = 37
_IMU_RATE, _IMU_ACCEL = 13, 25
_UNIT_TOLERANCE = 1e-3


@njit
def _finite(values):
    """True if all of a 1-D array is finite."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def _unit(q):
    """True if a quaternion (4,) is of unit length."""
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return abs(norm - 1.0) <= _UNIT_TOLERANCE


@njit
def _diagonal_to_block(R, sigma, block):
    """R diag(sigma^2) R' into a 3x3 at the start of a flat block with six columns."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += R[i, k] * sigma[k] * sigma[k] * R[j, k]
            block[6 * i + j] = total


@njit
def _block_to_sigma(R, block, sigma):
    """Roots of the diagonal of R' C R, C the 3x3 at the start of a block with six columns."""
    for k in range(3):
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += R[i, k] * block[6 * i + j] * R[j, k]
        sigma[k] = math.sqrt(max(total, 0.0))


@njit
def _R_flu_ned(q_nb):
    """Rotation matrix (3, 3) NED -> FLU of the attitude q_nb (4,)."""
    R_nb = quat_to_R_nb(q_nb)
    R = np.empty((3, 3))
    for j in range(3):
        R[0, j] = R_nb[j, 0]
        R[1, j] = -R_nb[j, 1]
        R[2, j] = -R_nb[j, 2]
    return R


@njit
def _R_enu_ned():
    """Rotation matrix (3, 3) NED -> ENU."""
    R = np.zeros((3, 3))
    R[0, 1] = R[1, 0] = 1.0
    R[2, 2] = -1.0
    return R


@njit
def pack_nav(nav, block):
    """Navigation row (31,) into an Odometry block (85,), twist in the child frame.

    Covariances from the standard deviations: position and rotation about the fixed axes (ENU),
    velocity (FLU); that of the rate, which the row does not carry, is zero.
    """
    block[:] = 0.0
    ned_to_enu(nav[0:3], block[0:3])
    quat_ned_frd_to_enu_flu(nav[6:10], block[3:7])
    R = _R_flu_ned(nav[6:10])
    for i in range(3):
        block[_LINEAR + i] = R[i, 0] * nav[3] + R[i, 1] * nav[4] + R[i, 2] * nav[5]
    frd_to_flu(nav[10:13], block[_ANGULAR : _ANGULAR + 3])
    _diagonal_to_block(_R_enu_ned(), nav[22:25], block[_POSE_COV : _POSE_COV + 36])
    _diagonal_to_block(_R_enu_ned(), nav[28:31], block[_ROTATION_COV : _ROTATION_COV + 15])
    _diagonal_to_block(R, nav[25:28], block[_TWIST_COV : _TWIST_COV + 36])


@njit
def unpack_nav(block, nav):
    """Odometry block (85,) into a navigation row (31,); rotor states and biases become zero."""
    nav[:] = 0.0
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[3:7]):
        return NOT_UNIT
    enu_to_ned(block[0:3], nav[0:3])
    quat_enu_flu_to_ned_frd(block[3:7], nav[6:10])
    R = _R_flu_ned(nav[6:10])
    linear = block[_LINEAR : _LINEAR + 3]
    for j in range(3):
        nav[3 + j] = R[0, j] * linear[0] + R[1, j] * linear[1] + R[2, j] * linear[2]
    flu_to_frd(block[_ANGULAR : _ANGULAR + 3], nav[10:13])
    _block_to_sigma(_R_enu_ned(), block[_POSE_COV : _POSE_COV + 36], nav[22:25])
    _block_to_sigma(_R_enu_ned(), block[_ROTATION_COV : _ROTATION_COV + 15], nav[28:31])
    _block_to_sigma(R, block[_TWIST_COV : _TWIST_COV + 36], nav[25:28])
    return OK


@njit
def pack_truth(x, block):
    """Position NED, velocity FRD, quaternion, rates of the plant (13,) into an Odometry block."""
    block[:] = 0.0
    ned_to_enu(x[0:3], block[0:3])
    quat_ned_frd_to_enu_flu(x[6:10], block[3:7])
    frd_to_flu(x[3:6], block[_LINEAR : _LINEAR + 3])
    frd_to_flu(x[10:13], block[_ANGULAR : _ANGULAR + 3])


@njit
def unpack_truth(block, x):
    """Odometry block (85,) into position NED, velocity FRD, quaternion, rates (13,)."""
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[3:7]):
        return NOT_UNIT
    enu_to_ned(block[0:3], x[0:3])
    quat_enu_flu_to_ned_frd(block[3:7], x[6:10])
    flu_to_frd(block[_LINEAR : _LINEAR + 3], x[3:6])
    flu_to_frd(block[_ANGULAR : _ANGULAR + 3], x[10:13])
    return OK


@njit
def pack_imu(imu, block):
    """Specific force (m/s2) and rate (rad/s), body FRD (6,), into an Imu block (37,)."""
    frd_to_flu(imu[0:3], block[_IMU_ACCEL : _IMU_ACCEL + 3])
    frd_to_flu(imu[3:6], block[_IMU_RATE : _IMU_RATE + 3])


@njit
def unpack_imu(block, imu):
    """Imu block (37,) into specific force and rate, body FRD (6,)."""
    flu_to_frd(block[_IMU_ACCEL : _IMU_ACCEL + 3], imu[0:3])
    flu_to_frd(block[_IMU_RATE : _IMU_RATE + 3], imu[3:6])
    return OK if _finite(imu) else NOT_FINITE


@njit
def pack_body_vector(v, block):
    """Body vector FRD (3,) into the first three doubles, FLU."""
    frd_to_flu(v, block[0:3])


@njit
def unpack_body_vector(block, v):
    """First three doubles, FLU, into a body vector FRD (3,)."""
    flu_to_frd(block[0:3], v)
    return OK if _finite(v) else NOT_FINITE


@njit
def pack_world_vector(v, block):
    """World vector NED (3,) into the first three doubles, ENU."""
    ned_to_enu(v, block[0:3])


@njit
def unpack_world_vector(block, v):
    """First three doubles, ENU, into a world vector NED (3,)."""
    enu_to_ned(block[0:3], v)
    return OK if _finite(v) else NOT_FINITE


@njit
def pack_values(values, block):
    """Values (N,) into the first N doubles, as they are."""
    for i in range(values.size):
        block[i] = values[i]


@njit
def unpack_values(block, values):
    """First N doubles as they are into values (N,)."""
    for i in range(values.size):
        values[i] = block[i]
    return OK if _finite(values) else NOT_FINITE


@njit
def unpack_normalised(block, values):
    """First N doubles into values (N,), each of which must lie in [-1, 1]."""
    code = unpack_values(block, values)
    if code != OK:
        return code
    for value in values:
        if abs(value) > 1.0:
            return OUT_OF_RANGE
    return OK


@njit
def pack_attitude(euler, block):
    """phi, theta, psi (3,), rad, NED/FRD, into a quaternion block (4,) x, y, z, w, ENU/FLU."""
    quat_ned_frd_to_enu_flu(quat_from_euler(euler[0], euler[1], euler[2]), block[0:4])


@njit
def unpack_attitude(block, euler):
    """Quaternion block (4,) into phi, theta, psi (3,), rad."""
    if not _finite(block[0:4]):
        return NOT_FINITE
    if not _unit(block[0:4]):
        return NOT_UNIT
    q_nb = np.empty(4)
    quat_enu_flu_to_ned_frd(block[0:4], q_nb)
    euler[0], euler[1], euler[2] = euler_from_quat(q_nb)
    return OK


@njit
def pack_fix(pos_ned_m, datum: Datum, block):
    """Position NED (3,), m, into latitude, longitude (deg) and altitude (m); NaN stays NaN."""
    if _finite(pos_ned_m):
        ned_to_geodetic(pos_ned_m, datum, block[0:3])
    else:
        block[0:3] = math.nan


@njit
def unpack_fix(block, datum: Datum, pos_ned_m):
    """Latitude, longitude, altitude into position NED (3,), m."""
    if not _finite(block[0:3]):
        return NOT_FINITE
    if abs(block[0]) > 90.0 or abs(block[1]) > 180.0:
        return OUT_OF_RANGE
    geodetic_to_ned(block[0:3], datum, pos_ned_m)
    return OK
