# SPDX-License-Identifier: Apache-2.0
"""Start of the filter from its own sensors, in unaccelerated flight.

Position and velocity come from one GPS fix, roll and pitch from the specific force, heading from
the magnetometer and the configured local field. The covariance is the one these equations imply:
- position error = -(white + drift), so it is correlated with the drift state;
- tilt error: an accelerometer bias b turns the level by b / g, so it is correlated with the bias;
- heading error: magnetometer noise and error, and the tilt error through the dip of the field.
"""

import math

from heli_math.arrays import fill, fill_matrix, scratch, scratch_matrix
from heli_math.jit import njit
from heli_math.rotations import fill_from_euler, fill_R_nb
from heli_math.rows import IMU
from heli_observer.ins_ekf import field_plausible, heading_derivatives, start_scalar
from heli_observer.layout import (
    AID_GPS_POS,
    AID_GPS_VALID,
    AID_GPS_VEL,
    AID_MAG,
    AID_MAG_VALID,
    C_ALIGNED,
    C_BARO_OK,
    C_BARO_READY,
    C_BARO_SEEN,
    C_GPS_FUSED,
    C_GPS_OK,
    C_GPS_SEEN,
    C_MAG_OK,
    C_MAG_SEEN,
    E_ACCEL_BIAS,
    E_ATT,
    E_DRIFT,
    E_GYRO_BIAS,
    E_MAG_ERROR,
    E_POS,
    E_VEL,
    NO_TICK,
    X_POS,
    X_QUAT,
    X_VEL,
)

FORCE_TOLERANCE = 0.3
"""How far the specific force may be from gravity at alignment, as a fraction of it."""


@njit
def newest_aid(aid, flag, tick, depth):
    """Newest tick in [tick - depth, tick] whose ring slot has its flag set; NO_TICK if none."""
    size = aid.shape[0]
    for back in range(depth + 1):
        if aid[(tick - back) % size, flag] > 0.0:
            return tick - back
    return NO_TICK


@njit
def level_from_force(f):
    """Roll and pitch (rad) at which the specific force f (3,), body, points straight up."""
    return math.atan2(-f[1], -f[2]), math.atan2(f[0], math.sqrt(f[1] * f[1] + f[2] * f[2]))


@njit
def heading_from_mag(phi, theta, mag_body, field_ned):
    """Heading (rad) at which mag_body (3,), levelled by phi, theta, points along field_ned (3,)."""
    q, R = scratch(4), scratch_matrix(3, 3)
    fill_from_euler(phi, theta, 0.0, q)
    fill_R_nb(q, R)
    north = R[0, 0] * mag_body[0] + R[0, 1] * mag_body[1] + R[0, 2] * mag_body[2]
    east = R[1, 0] * mag_body[0] + R[1, 1] * mag_body[1] + R[1, 2] * mag_body[2]
    return math.atan2(field_ned[1], field_ned[0]) - math.atan2(east, north)


@njit
def _start_covariance(P, q, age_s, k):
    """Covariance of a fresh alignment into P (20, 20); see the head of this file."""
    fill_matrix(P, 0.0)
    R = scratch_matrix(3, 3)
    fill_R_nb(q, R)
    for i in range(3):
        drift = k.var0[E_DRIFT + i]
        white = k.var_gps_pos_vertical if i == 2 else k.var_gps_pos_horizontal
        velocity = k.var_gps_vel_vertical if i == 2 else k.var_gps_vel_horizontal
        P[E_POS + i, E_POS + i] = white + drift + velocity * age_s * age_s
        P[E_DRIFT + i, E_DRIFT + i] = drift
        P[E_POS + i, E_DRIFT + i] = -drift
        P[E_DRIFT + i, E_POS + i] = -drift
        P[E_VEL + i, E_VEL + i] = velocity
        P[E_POS + i, E_VEL + i] = -velocity * age_s
        P[E_VEL + i, E_POS + i] = -velocity * age_s
        P[E_GYRO_BIAS + i, E_GYRO_BIAS + i] = k.var0[E_GYRO_BIAS + i]
        bias = k.var0[E_ACCEL_BIAS + i]
        P[E_ACCEL_BIAS + i, E_ACCEL_BIAS + i] = bias
        # R b / g = (-theta_y, theta_x) g / g: the level is where the biased force points up
        east = R[1, i] * bias / k.gravity_mps2
        north = -R[0, i] * bias / k.gravity_mps2
        P[E_ATT, E_ACCEL_BIAS + i] = east
        P[E_ACCEL_BIAS + i, E_ATT] = east
        P[E_ATT + 1, E_ACCEL_BIAS + i] = north
        P[E_ACCEL_BIAS + i, E_ATT + 1] = north
        P[E_ATT, E_ATT] += R[1, i] * east / k.gravity_mps2
        P[E_ATT + 1, E_ATT + 1] -= R[0, i] * north / k.gravity_mps2
        P[E_ATT, E_ATT + 1] += R[1, i] * north / k.gravity_mps2
    P[E_ATT + 1, E_ATT] = P[E_ATT, E_ATT + 1]
    P[E_ATT, E_ATT] += k.var0[E_ATT]
    P[E_ATT + 1, E_ATT + 1] += k.var0[E_ATT + 1]
    h_north, h_east, horizontal = heading_derivatives(k.field_ned_t)
    variance = k.var_mag / (horizontal * horizontal) + k.var0[E_ATT + 2]
    P[E_MAG_ERROR, E_MAG_ERROR] = k.var0[E_MAG_ERROR]
    start_scalar(P, E_ATT + 2, E_ATT, h_north, E_ATT + 1, h_east, E_MAG_ERROR, 1.0, variance)


@njit
def align(state, tick, horizon_ticks, k):
    """Start the filter at tick - horizon_ticks if the buffered sensors allow it.

    Parameters
    ----------
    state : ObserverState
        Changed in place if the alignment succeeds.
    tick, horizon_ticks : int
    k : EkfKernel

    Returns
    -------
    bool
        False while a GPS fix (all six components) or a plausible magnetometer sample is missing, or
        the specific force is not about that of unaccelerated flight.
    """
    aid = state.aid
    size = aid.shape[0]
    fix_tick = newest_aid(aid, AID_GPS_VALID, tick, horizon_ticks)
    mag_tick = newest_aid(aid, AID_MAG_VALID, tick, horizon_ticks)
    if fix_tick == NO_TICK or mag_tick == NO_TICK:
        return False
    fix = aid[fix_tick % size]
    pos, vel = fix[AID_GPS_POS : AID_GPS_POS + 3], fix[AID_GPS_VEL : AID_GPS_VEL + 3]
    finite = True
    for i in range(3):
        finite = finite and math.isfinite(pos[i]) and math.isfinite(vel[i])
    mag = aid[mag_tick % size, AID_MAG : AID_MAG + 3]
    if not (finite and field_plausible(mag, k.field_ned_t, k.field_tolerance)):
        return False
    force = scratch(3)
    fill(force, 0.0)
    for back in range(horizon_ticks + 1):
        for i in range(3):
            sample = state.imu[(tick - back) % size, IMU.force.start + i]
            force[i] += sample / (horizon_ticks + 1.0)
    strength = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2) / k.gravity_mps2
    if not abs(strength - 1.0) <= FORCE_TOLERANCE:
        return False
    phi, theta = level_from_force(force)
    x = state.nominal
    fill(x, 0.0)
    age_s = (fix_tick - (tick - horizon_ticks)) * k.dt_s
    for i in range(3):
        x[X_VEL + i] = vel[i]
        x[X_POS + i] = pos[i] - age_s * vel[i]
    psi = heading_from_mag(phi, theta, mag, k.field_ned_t)
    fill_from_euler(phi, theta, psi, x[X_QUAT : X_QUAT + 4])
    _start_covariance(state.P, x[X_QUAT : X_QUAT + 4], age_s, k)
    fill_matrix(state.dx, 0.0)
    # used up: they must not be fused a second time
    aid[fix_tick % size, AID_GPS_VALID] = 0.0
    aid[mag_tick % size, AID_MAG_VALID] = 0.0
    count = state.count
    count[C_ALIGNED] = 1
    count[C_BARO_READY] = 0
    count[C_GPS_FUSED] += 1
    for entry in (C_MAG_OK, C_BARO_OK, C_GPS_OK, C_MAG_SEEN, C_BARO_SEEN, C_GPS_SEEN):
        count[entry] = tick
    return True
