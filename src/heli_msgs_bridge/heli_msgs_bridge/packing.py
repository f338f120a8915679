# SPDX-License-Identifier: Apache-2.0
"""Between the cores' arrays (NED, FRD) and the double blocks of messages (ENU, FLU), compiled.

`pack_*(array, block)` fills a message's doubles, `unpack_*(block, array)` reads them and returns 0
or the code of what is wrong (`REASONS`). Places: `heli_math.rows` and `blocks`.
"""

import math

from heli_math import rows
from heli_math.arrays import fill, scratch, scratch_matrix
from heli_math.jit import njit
from heli_math.rotations import euler_from_quat, fill_from_euler, fill_R_nb
from heli_math.rows import NAV, PLANT, SETPOINT
from heli_msgs_bridge.blocks import FIX, IMU, ODOMETRY, QUATERNION, VECTOR
from heli_msgs_bridge.frames import (
    R_ENU_NED,
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
_UNIT_TOLERANCE = 1e-3
_N_QUATERNION = QUATERNION.size
_COLUMNS = 6  # of the covariances in an Odometry


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
            block[_COLUMNS * i + j] = total


@njit
def _block_to_sigma(R, block, sigma):
    """Roots of the diagonal of R' C R, C the 3x3 at the start of a block with six columns."""
    for k in range(3):
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += R[i, k] * block[_COLUMNS * i + j] * R[j, k]
        sigma[k] = math.sqrt(max(total, 0.0))


@njit
def _R_flu_ned(q_nb, R):
    """Rotation matrix NED -> FLU of the attitude q_nb (4,) into R (3, 3)."""
    R_nb = scratch_matrix(3, 3)
    fill_R_nb(q_nb, R_nb)
    for j in range(3):
        R[0, j] = R_nb[j, 0]
        R[1, j] = -R_nb[j, 1]
        R[2, j] = -R_nb[j, 2]


@njit
def pack_nav(nav, block):
    """Navigation row (31,) into an Odometry block (85,), twist in the child frame.

    Covariances from the standard deviations: position and rotation about the fixed axes (ENU),
    velocity (FLU); that of the rate, which the row does not carry, stays as it is in the block.
    """
    ned_to_enu(nav[NAV.pos], block[ODOMETRY.pos])
    quat_ned_frd_to_enu_flu(nav[NAV.quat], block[ODOMETRY.quat])
    R, vel, linear = scratch_matrix(3, 3), nav[NAV.vel], block[ODOMETRY.linear]
    _R_flu_ned(nav[NAV.quat], R)
    for i in range(3):
        linear[i] = R[i, 0] * vel[0] + R[i, 1] * vel[1] + R[i, 2] * vel[2]
    frd_to_flu(nav[NAV.rate], block[ODOMETRY.angular])
    _diagonal_to_block(R_ENU_NED, nav[NAV.sigma_pos], block[ODOMETRY.pose_cov])
    _diagonal_to_block(R_ENU_NED, nav[NAV.sigma_att], block[ODOMETRY.rotation_cov])
    _diagonal_to_block(R, nav[NAV.sigma_vel], block[ODOMETRY.twist_cov])


@njit
def unpack_nav(block, nav):
    """Odometry block (85,) into a navigation row (31,); rotor states and biases become zero."""
    fill(nav, 0.0)
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[ODOMETRY.quat]):
        return NOT_UNIT
    enu_to_ned(block[ODOMETRY.pos], nav[NAV.pos])
    quat_enu_flu_to_ned_frd(block[ODOMETRY.quat], nav[NAV.quat])
    R, vel, linear = scratch_matrix(3, 3), nav[NAV.vel], block[ODOMETRY.linear]
    _R_flu_ned(nav[NAV.quat], R)
    for j in range(3):
        vel[j] = R[0, j] * linear[0] + R[1, j] * linear[1] + R[2, j] * linear[2]
    flu_to_frd(block[ODOMETRY.angular], nav[NAV.rate])
    _block_to_sigma(R_ENU_NED, block[ODOMETRY.pose_cov], nav[NAV.sigma_pos])
    _block_to_sigma(R_ENU_NED, block[ODOMETRY.rotation_cov], nav[NAV.sigma_att])
    _block_to_sigma(R, block[ODOMETRY.twist_cov], nav[NAV.sigma_vel])
    # Numbers near the largest double overflow when they are turned.
    return OK if _finite(nav) else NOT_FINITE


@njit
def pack_truth(x, block):
    """Rigid part of a plant state (13,), velocity in FRD, into an Odometry block (85,).

    The covariances stay as they are in the block.
    """
    ned_to_enu(x[PLANT.pos], block[ODOMETRY.pos])
    quat_ned_frd_to_enu_flu(x[PLANT.quat], block[ODOMETRY.quat])
    frd_to_flu(x[PLANT.vel], block[ODOMETRY.linear])
    frd_to_flu(x[PLANT.rate], block[ODOMETRY.angular])


@njit
def unpack_truth(block, x):
    """Odometry block (85,) into the rigid part of a plant state (13,)."""
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block[ODOMETRY.quat]):
        return NOT_UNIT
    enu_to_ned(block[ODOMETRY.pos], x[PLANT.pos])
    quat_enu_flu_to_ned_frd(block[ODOMETRY.quat], x[PLANT.quat])
    flu_to_frd(block[ODOMETRY.linear], x[PLANT.vel])
    flu_to_frd(block[ODOMETRY.angular], x[PLANT.rate])
    return OK


@njit
def pack_imu(imu, block):
    """Specific force (m/s2) and rate (rad/s), body FRD (6,), into an Imu block (37,)."""
    frd_to_flu(imu[rows.IMU.force], block[IMU.accel])
    frd_to_flu(imu[rows.IMU.rate], block[IMU.rate])


@njit
def unpack_imu(block, imu):
    """Imu block (37,) into specific force and rate, body FRD (6,)."""
    flu_to_frd(block[IMU.accel], imu[rows.IMU.force])
    flu_to_frd(block[IMU.rate], imu[rows.IMU.rate])
    return OK if _finite(imu) else NOT_FINITE


@njit
def pack_body_vector(v, block):
    """Body vector FRD (3,) into the first three doubles, FLU."""
    frd_to_flu(v, block[VECTOR.xyz])


@njit
def unpack_body_vector(block, v):
    """First three doubles, FLU, into a body vector FRD (3,)."""
    flu_to_frd(block[VECTOR.xyz], v)
    return OK if _finite(v) else NOT_FINITE


@njit
def pack_world_vector(v, block):
    """World vector NED (3,) into the first three doubles, ENU."""
    ned_to_enu(v, block[VECTOR.xyz])


@njit
def unpack_world_vector(block, v):
    """First three doubles, ENU, into a world vector NED (3,)."""
    enu_to_ned(block[VECTOR.xyz], v)
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
def pack_rotor_speed(speed, block):
    """Speed of the main rotor (1,), rad/s, as a joint's velocity about the axis that points up.

    Seen from above it turns clockwise, so the sign changes (REP-103).
    """
    for i in range(speed.size):
        block[i] = -speed[i]


@njit
def unpack_rotor_speed(block, speed):
    """A joint's velocity into the speed of the main rotor (1,), rad/s."""
    for i in range(speed.size):
        speed[i] = -block[i]
    return OK if _finite(speed) else NOT_FINITE


@njit
def pack_attitude(euler, block):
    """phi, theta, psi (3,), rad, NED/FRD, into a quaternion block (4,), ENU/FLU."""
    phi, theta, psi = euler[SETPOINT.phi], euler[SETPOINT.theta], euler[SETPOINT.psi]
    q_nb = scratch(_N_QUATERNION)
    fill_from_euler(phi, theta, psi, q_nb)
    quat_ned_frd_to_enu_flu(q_nb, block)


@njit
def unpack_attitude(block, euler):
    """Quaternion block (4,) into phi, theta, psi (3,), rad."""
    if not _finite(block):
        return NOT_FINITE
    if not _unit(block):
        return NOT_UNIT
    q_nb = scratch(_N_QUATERNION)
    quat_enu_flu_to_ned_frd(block, q_nb)
    euler[SETPOINT.phi], euler[SETPOINT.theta], euler[SETPOINT.psi] = euler_from_quat(q_nb)
    return OK


@njit
def pack_fix(pos_ned_m, datum: Datum, block):
    """Position NED (3,), m, into latitude, longitude (deg) and altitude (m); NaN stays NaN."""
    if _finite(pos_ned_m):
        ned_to_geodetic(pos_ned_m, datum, block[FIX.geodetic])
    else:
        block[FIX.geodetic] = math.nan


@njit
def unpack_fix(block, datum: Datum, pos_ned_m):
    """Latitude, longitude, altitude into position NED (3,), m."""
    if not _finite(block[FIX.geodetic]):
        return NOT_FINITE
    if abs(block[FIX.latitude]) > 90.0 or abs(block[FIX.longitude]) > 180.0:
        return OUT_OF_RANGE
    geodetic_to_ned(block[FIX.geodetic], datum, pos_ned_m)
    return OK if _finite(pos_ned_m) else NOT_FINITE
