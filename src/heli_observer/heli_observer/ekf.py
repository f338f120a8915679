# SPDX-License-Identifier: Apache-2.0
"""Error-state Kalman filter on GPS, inertial sensors, barometer and magnetometer (digest of the
paper's section 3.1 and 4: low-rate GPS fused with integrated inertial data).

Nominal state: position and velocity NED, quaternion body -> NED, gyro bias, accelerometer bias, the
slowly drifting part of the GPS position error (first-order Gauss-Markov), the barometer's bias, and
what is left of hard and soft iron in the heading (Gauss-Markov).
Error state (20): the same with a rotation vector in NED axes, R_true = exp([d_theta]x) R; hence
  d_pos' = d_vel, d_vel' = -[R f]x d_theta - R d_accel_bias, d_theta' = -R d_gyro_bias
(J. Sola, "Quaternion kinematics for the error-state Kalman filter", 2017, section 7: angular errors
defined globally). Yaw in hover is then exactly the third attitude error.
Updates are scalar and sequential; a vector is accepted or refused as a whole by the sum of its
normalised innovations squared, which equals the joint one.
"""

import math

from heli_core.atmosphere import EXPONENT, LAPSE_RATE_K_PER_M, SEA_LEVEL_TEMPERATURE_K, pressure_pa
from heli_core.jit import copy_matrix, copy_part, fill, fill_matrix, njit, scratch, scratch_matrix
from heli_core.rotations import (
    fill_from_euler,
    fill_from_rotvec,
    fill_product,
    fill_R_nb,
    normalize,
    wrap_pi,
)
from heli_core.rows import IMU
from heli_observer.layout import (
    AID,
    AID_PLACES,
    BARO_AID,
    COUNT,
    DIAG,
    ERROR,
    MAG_AID,
    NO_TICK,
    NOMINAL,
)

# -------------------------------------------------------------------------------------------------
# Strapdown navigation: specific force and rate of one tick into position, velocity, attitude.
# -------------------------------------------------------------------------------------------------


@njit
def strapdown_without_imu(x, dt_s):
    """Propagate the nominal state x (21,) over a tick of unaccelerated flight, in place."""
    for i in range(3):
        x[NOMINAL.pos + i] += dt_s * x[NOMINAL.vel + i]


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
    w0, w1, bias = imu0[IMU.rate], imu1[IMU.rate], x[NOMINAL.gyro_bias : NOMINAL.gyro_bias + 3]
    w0x, w0y, w0z = w0[0] - bias[0], w0[1] - bias[1], w0[2] - bias[2]
    w1x, w1y, w1z = w1[0] - bias[0], w1[1] - bias[1], w1[2] - bias[2]
    coning = dt_s * dt_s / 12.0
    rotvec, turn, q1 = scratch(3), scratch(4), scratch(4)
    R0, R1 = scratch_matrix(3, 3), scratch_matrix(3, 3)
    rotvec[0] = 0.5 * dt_s * (w0x + w1x) + coning * (w0y * w1z - w0z * w1y)
    rotvec[1] = 0.5 * dt_s * (w0y + w1y) + coning * (w0z * w1x - w0x * w1z)
    rotvec[2] = 0.5 * dt_s * (w0z + w1z) + coning * (w0x * w1y - w0y * w1x)
    q0 = x[NOMINAL.quat : NOMINAL.quat + 4]
    fill_R_nb(q0, R0)
    fill_from_rotvec(rotvec, turn)
    fill_product(q0, turn, q1)
    normalize(q1)
    fill_R_nb(q1, R1)
    f0, f1, bias = imu0[IMU.force], imu1[IMU.force], x[NOMINAL.accel_bias : NOMINAL.accel_bias + 3]
    for i in range(3):
        a0 = 0.0
        a1 = 0.0
        for j in range(3):
            a0 += R0[i, j] * (f0[j] - bias[j])
            a1 += R1[i, j] * (f1[j] - bias[j])
        g = gravity_mps2 if i == 2 else 0.0
        a_ned[i] = 0.5 * (a0 + a1)
        x[NOMINAL.pos + i] += dt_s * x[NOMINAL.vel + i] + dt_s * dt_s * (
            a0 / 3.0 + a1 / 6.0 + 0.5 * g
        )
        x[NOMINAL.vel + i] += dt_s * (a_ned[i] + g)
    copy_part(x, NOMINAL.quat, q1, 0, 4)
    for i in range(3):
        for j in range(3):
            R_mid[i, j] = 0.5 * (R0[i, j] + R1[i, j])


# -------------------------------------------------------------------------------------------------
# Lever arms. The filter's position and velocity are those of the IMU, so that no angular
# acceleration is needed: a fix is brought from the antenna to the IMU before anything sees it, the
# output from the IMU to the c.g. So do PX4 (EKF2_IMU_POS_*, EKF2_GPS_POS_*; its output predictor)
# and ArduPilot (INS_POS*, GPS1_POS_*; in CorrectGPSForAntennaOffset and the output of EKF3). As
# there, how a fix is weighed leaves out the error of the attitude that moves it.
# -------------------------------------------------------------------------------------------------


@njit
def leave_arm(quat, rate, arm_m, pos, vel):
    """Take away from position and velocity what the end of a lever arm has more than its foot.

    Parameters
    ----------
    quat : ndarray (4,)
        Body -> NED.
    rate : ndarray (3,)
        Body, rad/s.
    arm_m : ndarray (3,)
        Body FRD.
    pos, vel : ndarray (3,)
        NED, m, m/s; in place.
    """
    R = scratch_matrix(3, 3)
    fill_R_nb(quat, R)
    v0 = rate[1] * arm_m[2] - rate[2] * arm_m[1]
    v1 = rate[2] * arm_m[0] - rate[0] * arm_m[2]
    v2 = rate[0] * arm_m[1] - rate[1] * arm_m[0]
    for i in range(3):
        pos[i] -= R[i, 0] * arm_m[0] + R[i, 1] * arm_m[1] + R[i, 2] * arm_m[2]
        vel[i] -= R[i, 0] * v0 + R[i, 1] * v1 + R[i, 2] * v2


@njit
def move_fix_to_imu(quat, gyro_bias, imu, aid, k):
    """Bring a fix (aid row) once from the antenna to the IMU, with the attitude and rates then.

    Parameters
    ----------
    quat : ndarray (>= 4,)
        Body -> NED.
    gyro_bias : ndarray (>= 3,)
        rad/s.
    imu : ndarray (>= 6,)
        A row `IMU`.
    aid : ndarray
        In place.
    k : EkfParams
    """
    if aid[AID.gps_at_imu] == 1.0:
        return
    rate, measured = scratch(3), imu[IMU.rate]
    for i in range(3):
        rate[i] = measured[i] - gyro_bias[i]
    pos, vel = aid[AID.gps_pos : AID.gps_pos + 3], aid[AID.gps_vel : AID.gps_vel + 3]
    leave_arm(quat, rate, k.antenna_m, pos, vel)
    aid[AID.gps_at_imu] = 1.0


# -------------------------------------------------------------------------------------------------
# Ins ekf.
# -------------------------------------------------------------------------------------------------


@njit
def apply_transition(e, R, a_ned, k):
    """Error state e (20,) <- Phi e, one tick on, in place, by shears instead of a 20x20 product."""
    dt_s = k.dt_s
    h = 0.5 * dt_s
    b0, b1, b2 = e[ERROR.gyro_bias], e[ERROR.gyro_bias + 1], e[ERROR.gyro_bias + 2]
    c0, c1, c2 = e[ERROR.accel_bias], e[ERROR.accel_bias + 1], e[ERROR.accel_bias + 2]
    for i in range(3):
        e[ERROR.pos + i] += h * e[ERROR.vel + i]
        e[ERROR.att + i] -= h * (R[i, 0] * b0 + R[i, 1] * b1 + R[i, 2] * b2)
    t0, t1, t2 = e[ERROR.att], e[ERROR.att + 1], e[ERROR.att + 2]
    e[ERROR.vel] -= dt_s * (a_ned[1] * t2 - a_ned[2] * t1)
    e[ERROR.vel + 1] -= dt_s * (a_ned[2] * t0 - a_ned[0] * t2)
    e[ERROR.vel + 2] -= dt_s * (a_ned[0] * t1 - a_ned[1] * t0)
    for i in range(3):
        e[ERROR.vel + i] -= dt_s * (R[i, 0] * c0 + R[i, 1] * c1 + R[i, 2] * c2)
        e[ERROR.pos + i] += h * e[ERROR.vel + i]
        e[ERROR.att + i] -= h * (R[i, 0] * b0 + R[i, 1] * b1 + R[i, 2] * b2)
        e[ERROR.drift + i] *= k.drift_decay
    e[ERROR.mag_error] *= k.mag_error_decay


@njit
def propagate_covariance(P, R, a_ned, k):
    """P (20, 20) <- Phi P Phi' + Q, in place, kept exactly symmetric; k is the EkfParams."""
    for i in range(ERROR.size):
        apply_transition(P[i], R, a_ned, k)
    for i in range(ERROR.size):
        for j in range(i):
            P[i, j], P[j, i] = P[j, i], P[i, j]
    for i in range(ERROR.size):
        apply_transition(P[i], R, a_ned, k)
    for i in range(ERROR.size):
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean
    for i in range(3):
        P[ERROR.vel + i, ERROR.vel + i] += k.var_vel_step
        P[ERROR.att + i, ERROR.att + i] += k.var_att_step
        P[ERROR.gyro_bias + i, ERROR.gyro_bias + i] += k.var_gyro_bias_step
        P[ERROR.accel_bias + i, ERROR.accel_bias + i] += k.var_accel_bias_step
        drift = k.var_drift_step_vertical if i == 2 else k.var_drift_step_horizontal
        P[ERROR.drift + i, ERROR.drift + i] += drift
    P[ERROR.baro_bias, ERROR.baro_bias] += k.var_baro_bias_step
    P[ERROR.mag_error, ERROR.mag_error] += k.var_mag_error_step


@njit
def _predict_with(x, P, R, a_ned, k):
    """What a tick does to the covariance and to the errors that decay, in place."""
    for i in range(3):
        x[NOMINAL.drift + i] *= k.drift_decay
    x[NOMINAL.mag_error] *= k.mag_error_decay
    propagate_covariance(P, R, a_ned, k)


@njit
def predict(x, P, imu0, imu1, k):
    """One tick of the filter without measurements: nominal x (21,) and P (20, 20), in place."""
    a_ned, R = scratch(3), scratch_matrix(3, 3)
    strapdown(x, imu0, imu1, k.gravity_mps2, k.dt_s, a_ned, R)
    _predict_with(x, P, R, a_ned, k)


@njit
def predict_without_imu(x, P, k):
    """`predict` for a tick before the first IMU sample: unaccelerated, not turning, in place.

    Nothing was integrated that an error of tilt or bias could have spoiled, so none of them shows
    in velocity or attitude.
    """
    strapdown_without_imu(x, k.dt_s)
    a_ned, R = scratch(3), scratch_matrix(3, 3)
    fill(a_ned, 0.0)
    fill_matrix(R, 0.0)
    _predict_with(x, P, R, a_ned, k)


@njit
def scalar_update(P, dx, i0, c0, i1, c1, i2, c2, i3, c3, residual, variance):
    """Fuse one scalar with H = c0 at i0, c1 at i1 and so on (an unused one has c = 0).

    Parameters
    ----------
    P : ndarray (20, 20)
        Covariance, in place; the rank-one downdate keeps it exactly symmetric.
    dx : ndarray (2, 20)
        Row 0: correction accumulated so far, in place. Row 1: scratch.
    residual : float
        Measurement - prediction from the nominal state (not yet counting dx[0]).
    variance : float
        Of the measurement noise.

    Returns
    -------
    float
        Innovation squared over its variance.
    """
    correction = dx[0]
    ph = dx[1]
    for i in range(ERROR.size):
        ph[i] = c0 * P[i, i0] + c1 * P[i, i1] + c2 * P[i, i2] + c3 * P[i, i3]
    s = c0 * ph[i0] + c1 * ph[i1] + c2 * ph[i2] + c3 * ph[i3] + variance
    innovation = residual - c0 * correction[i0] - c1 * correction[i1]
    innovation -= c2 * correction[i2] + c3 * correction[i3]
    gain = 1.0 / s
    for i in range(ERROR.size):
        correction[i] += ph[i] * gain * innovation
        for j in range(ERROR.size):
            P[i, j] -= ph[i] * ph[j] * gain
    return innovation * innovation * gain


@njit
def start_scalar(P, i0, i1, c1, i2, c2, i3, c3, variance):
    """Replace error i0 by what e[i0] + c1 e[i1] + c2 e[i2] + c3 e[i3] = noise says, in place.

    The limit of scalar_update for an unbounded prior of error i0, for heading and barometer bias.
    """
    for j in range(ERROR.size):
        if j != i0:
            P[i0, j] = -c1 * P[i1, j] - c2 * P[i2, j] - c3 * P[i3, j]
    var_i0 = variance - c1 * P[i0, i1] - c2 * P[i0, i2] - c3 * P[i0, i3]
    for j in range(ERROR.size):
        P[j, i0] = P[i0, j]
    P[i0, i0] = var_i0


@njit
def inject(x, dx):
    """Put the correction dx[0] into the nominal state x (21,), in place."""
    e = dx[0]
    for i in range(3):
        x[NOMINAL.pos + i] += e[ERROR.pos + i]
        x[NOMINAL.vel + i] += e[ERROR.vel + i]
        x[NOMINAL.gyro_bias + i] += e[ERROR.gyro_bias + i]
        x[NOMINAL.accel_bias + i] += e[ERROR.accel_bias + i]
        x[NOMINAL.drift + i] += e[ERROR.drift + i]
    x[NOMINAL.baro_bias] += e[ERROR.baro_bias]
    x[NOMINAL.mag_error] += e[ERROR.mag_error]
    dq, q = scratch(4), scratch(4)
    fill_from_rotvec(e[ERROR.att : ERROR.att + 3], dq)
    fill_product(dq, x[NOMINAL.quat : NOMINAL.quat + 4], q)
    normalize(q)
    copy_part(x, NOMINAL.quat, q, 0, 4)


@njit
def conclude(x, P, trial, dx, passed):
    """Make the trial update the filter's own if it passed its gate, forget it if not."""
    if passed:
        copy_matrix(P, trial)
        inject(x, dx)
    fill(dx[0], 0.0)


@njit
def _fuse_triple(x, P, trial, dx, z, x_at, e_at, drift, var_horizontal, var_vertical, gates):
    """Fuse the finite components of a NED vector z (3,) of the state at x_at / e_at, if they pass.

    With drift = 1.0 the drifting GPS error adds to the state, with 0.0 not.

    Returns
    -------
    (float, int, bool)
        Normalised innovation squared, its degrees of freedom, whether it was fused.
    """
    copy_matrix(trial, P)
    nis = 0.0
    dof = 0
    for i in range(3):
        if math.isfinite(z[i]):
            residual = z[i] - x[x_at + i] - drift * x[NOMINAL.drift + i]
            var = var_vertical if i == 2 else var_horizontal
            nis += scalar_update(
                trial, dx, e_at + i, 1.0, ERROR.drift + i, drift, 0, 0.0, 0, 0.0, residual, var
            )
            dof += 1
    passed = dof > 0 and nis <= gates[dof]
    conclude(x, P, trial, dx, passed)
    return nis, dof, passed


@njit
def fuse_gps(x, P, trial, dx, diag, aid, k):
    """Fuse a fix (aid row): position, then velocity, each as a whole; NaN components are left out.

    Returns
    -------
    (int, int)
        1 fused, 0 refused by the gate, -1 nothing finite; for position and for velocity.
    """
    z = aid[AID.gps_pos : AID.gps_pos + 3]
    var_h, var_v = k.var_gps_pos_horizontal, k.var_gps_pos_vertical
    nis, dof, ok = _fuse_triple(
        x, P, trial, dx, z, NOMINAL.pos, ERROR.pos, 1.0, var_h, var_v, k.gates
    )
    diag[DIAG.nis_pos], diag[DIAG.dof_pos] = nis, dof
    position = -1 if dof == 0 else int(ok)
    z = aid[AID.gps_vel : AID.gps_vel + 3]
    var_h, var_v = k.var_gps_vel_horizontal, k.var_gps_vel_vertical
    nis, dof, ok = _fuse_triple(
        x, P, trial, dx, z, NOMINAL.vel, ERROR.vel, 0.0, var_h, var_v, k.gates
    )
    diag[DIAG.nis_vel], diag[DIAG.dof_vel] = nis, dof
    velocity = -1 if dof == 0 else int(ok)
    return position, velocity


@njit
def take_for_jump(x, P, aid, k):
    """Take what a fix (aid row) says of position for a new error of the receiver, in place.

    The drift begins anew, as far as the fix tells it from a position that is believed.
    """
    for i in range(3):
        z = aid[AID.gps_pos + i]
        if math.isfinite(z):
            x[NOMINAL.drift + i] = z - x[NOMINAL.pos + i]
            var = k.var_gps_pos_vertical if i == 2 else k.var_gps_pos_horizontal
            start_scalar(P, ERROR.drift + i, ERROR.pos + i, 1.0, 0, 0.0, 0, 0.0, var)


@njit
def baro_slope(altitude_m):
    """Derivative of the ISA pressure with altitude (Pa/m, negative)."""
    ratio = 1.0 - LAPSE_RATE_K_PER_M * altitude_m / SEA_LEVEL_TEMPERATURE_K
    decay = EXPONENT * LAPSE_RATE_K_PER_M / SEA_LEVEL_TEMPERATURE_K
    return -pressure_pa(altitude_m) * decay / ratio


@njit
def predicted_pressure(x, k):
    """Pressure (Pa) the barometer should read in the nominal state, and its derivative by pos_d."""
    altitude = k.origin_altitude_m - x[NOMINAL.pos + 2]
    if k.arms:  # the barometer is at the c.g.
        R, arm_m = scratch_matrix(3, 3), k.imu_arm_m
        fill_R_nb(x[NOMINAL.quat : NOMINAL.quat + 4], R)
        altitude += R[2, 0] * arm_m[0] + R[2, 1] * arm_m[1] + R[2, 2] * arm_m[2]
    return pressure_pa(altitude) + x[NOMINAL.baro_bias], -baro_slope(altitude)


@njit
def start_baro(x, P, aid, k):
    """Start the barometer's bias from its first sample, so that it agrees with the position."""
    predicted, slope = predicted_pressure(x, k)
    x[NOMINAL.baro_bias] += aid[AID.baro] - predicted
    start_scalar(P, ERROR.baro_bias, ERROR.pos + 2, slope, 0, 0.0, 0, 0.0, k.var_aid[BARO_AID])


@njit
def fuse_baro(x, P, trial, dx, diag, aid, k):
    """Fuse the barometer sample of an aid row; True if it passed its gate."""
    predicted, slope = predicted_pressure(x, k)
    residual, var = aid[AID.baro] - predicted, k.var_aid[BARO_AID]
    copy_matrix(trial, P)
    nis = scalar_update(
        trial, dx, ERROR.pos + 2, slope, ERROR.baro_bias, 1.0, 0, 0.0, 0, 0.0, residual, var
    )
    diag[DIAG.nis_baro] = nis
    passed = nis <= k.gates[1]
    conclude(x, P, trial, dx, passed)
    return passed


@njit
def heading_innovation(q, mag_body, field_ned):
    """What the magnetometer says about the heading.

    Parameters
    ----------
    q : ndarray (4,)
    mag_body, field_ned : ndarray (3,)
        Measured field in body axes, local field in NED (same unit).

    Returns
    -------
    (float, float)
        Direction of the local field minus direction of the measured one turned into NED (rad,
        wrapped), and the horizontal field strength measured.
    """
    R = scratch_matrix(3, 3)
    fill_R_nb(q, R)
    m0 = R[0, 0] * mag_body[0] + R[0, 1] * mag_body[1] + R[0, 2] * mag_body[2]
    m1 = R[1, 0] * mag_body[0] + R[1, 1] * mag_body[1] + R[1, 2] * mag_body[2]
    residual = wrap_pi(math.atan2(field_ned[1], field_ned[0]) - math.atan2(m1, m0))
    return residual, math.sqrt(m0 * m0 + m1 * m1)


@njit
def heading_derivatives(field_ned):
    """Derivatives of the heading innovation by the north and east attitude errors, and horizontal
    field strength; the derivative by the yaw error is 1.

    From the local field, not the measured one: derivatives that share the sample's noise with its
    innovation drive the tilt away, a little with every sample.
    """
    horizontal_sq = field_ned[0] * field_ned[0] + field_ned[1] * field_ned[1]
    return (
        -field_ned[0] * field_ned[2] / horizontal_sq,
        -field_ned[1] * field_ned[2] / horizontal_sq,
        math.sqrt(horizontal_sq),
    )


@njit
def field_plausible(mag, field_ned, tolerance):
    """Whether the measured field mag (3,) is as strong as the local one, within tolerance."""
    measured = math.sqrt(mag[0] ** 2 + mag[1] ** 2 + mag[2] ** 2)
    local = math.sqrt(field_ned[0] ** 2 + field_ned[1] ** 2 + field_ned[2] ** 2)
    return abs(measured - local) <= tolerance * local


@njit
def fuse_mag(x, P, trial, dx, diag, aid, k):
    """Fuse the magnetometer sample of an aid row as a heading; True if it passed every gate.

    Gates: field strength within its tolerance, heading innovation below its fixed bound (a fault is
    not let in when the heading's own variance has grown), chi-square.
    """
    mag = aid[AID.mag : AID.mag + 3]
    residual, horizontal = heading_innovation(
        x[NOMINAL.quat : NOMINAL.quat + 4], mag, k.field_ned_t
    )
    h_north, h_east, local = heading_derivatives(k.field_ned_t)
    residual = wrap_pi(residual - x[NOMINAL.mag_error])
    diag[DIAG.heading_innovation] = residual
    if not field_plausible(mag, k.field_ned_t, k.field_tolerance):
        return False
    if not horizontal >= 0.2 * local:
        return False
    variance = k.var_aid[MAG_AID] / (local * local)
    copy_matrix(trial, P)
    north, east, yaw = ERROR.att, ERROR.att + 1, ERROR.att + 2
    nis = scalar_update(
        trial, dx, yaw, 1.0, north, h_north, east, h_east, ERROR.mag_error, 1.0, residual, variance
    )
    diag[DIAG.nis_mag] = nis
    passed = nis <= k.gates[1] and abs(residual) <= k.max_heading_innovation_rad
    conclude(x, P, trial, dx, passed)
    return passed


FUSED_IN_ORDER = tuple(reversed(range(len(AID_PLACES))))
"""Of the samples of a tick: the newest kind of sensor first, the heading last."""


@njit
def fuse_aid(which, x, P, trial, dx, diag, aid, k):
    """Fuse the sample of a sensor of `AIDS` of an aid row; each has its line here.

    Parameters
    ----------
    which : int
        Its place in `heli_core.sensors.AIDS`.
    x, P, trial, dx, diag : arrays
        As of `ObserverState`, changed in place; its innovation squared goes into `diag`.
    aid : ndarray
        Slot of the ring, places of `AID_PLACES[which]`.
    k : EkfParams

    Returns
    -------
    bool
        Whether it passed its gate.
    """
    if which == BARO_AID:
        return fuse_baro(x, P, trial, dx, diag, aid, k)
    return fuse_mag(x, P, trial, dx, diag, aid, k)


# -------------------------------------------------------------------------------------------------
# Start of the filter from its own sensors, in unaccelerated flight.
#
# Position and velocity come from one GPS fix, roll and pitch from the specific force, heading from
# the magnetometer and the configured local field. The covariance is the one these equations imply:
# - position error = -(white + drift), so it is correlated with the drift state;
# - tilt error: an accelerometer bias b turns the level by b / g, so it is correlated with the
# bias;
# - heading error: magnetometer noise and error, and the tilt error through the dip of the field.
# -------------------------------------------------------------------------------------------------

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
def start_covariance(P, q, age_s, k):
    """Covariance of a fresh alignment into P (20, 20); see the head of this file."""
    fill_matrix(P, 0.0)
    R = scratch_matrix(3, 3)
    fill_R_nb(q, R)
    for i in range(3):
        drift = k.var0[ERROR.drift + i]
        white = k.var_gps_pos_vertical if i == 2 else k.var_gps_pos_horizontal
        velocity = k.var_gps_vel_vertical if i == 2 else k.var_gps_vel_horizontal
        P[ERROR.pos + i, ERROR.pos + i] = white + drift + velocity * age_s * age_s
        P[ERROR.drift + i, ERROR.drift + i] = drift
        P[ERROR.pos + i, ERROR.drift + i] = -drift
        P[ERROR.drift + i, ERROR.pos + i] = -drift
        P[ERROR.vel + i, ERROR.vel + i] = velocity
        P[ERROR.pos + i, ERROR.vel + i] = -velocity * age_s
        P[ERROR.vel + i, ERROR.pos + i] = -velocity * age_s
        P[ERROR.gyro_bias + i, ERROR.gyro_bias + i] = k.var0[ERROR.gyro_bias + i]
        bias = k.var0[ERROR.accel_bias + i]
        P[ERROR.accel_bias + i, ERROR.accel_bias + i] = bias
        # R b / g = (-theta_y, theta_x) g / g: the level is where the biased force points up
        east = R[1, i] * bias / k.gravity_mps2
        north = -R[0, i] * bias / k.gravity_mps2
        P[ERROR.att, ERROR.accel_bias + i] = east
        P[ERROR.accel_bias + i, ERROR.att] = east
        P[ERROR.att + 1, ERROR.accel_bias + i] = north
        P[ERROR.accel_bias + i, ERROR.att + 1] = north
        P[ERROR.att, ERROR.att] += R[1, i] * east / k.gravity_mps2
        P[ERROR.att + 1, ERROR.att + 1] -= R[0, i] * north / k.gravity_mps2
        P[ERROR.att, ERROR.att + 1] += R[1, i] * north / k.gravity_mps2
    P[ERROR.att + 1, ERROR.att] = P[ERROR.att, ERROR.att + 1]
    P[ERROR.att, ERROR.att] += k.var0[ERROR.att]
    P[ERROR.att + 1, ERROR.att + 1] += k.var0[ERROR.att + 1]
    h_north, h_east, horizontal = heading_derivatives(k.field_ned_t)
    variance = k.var_aid[MAG_AID] / (horizontal * horizontal) + k.var0[ERROR.att + 2]
    P[ERROR.mag_error, ERROR.mag_error] = k.var0[ERROR.mag_error]
    start_scalar(
        P, ERROR.att + 2, ERROR.att, h_north, ERROR.att + 1, h_east, ERROR.mag_error, 1.0, variance
    )


@njit
def align(state, tick, horizon_ticks, k):
    """Start the filter at tick - horizon_ticks if the buffered sensors allow it.

    Parameters
    ----------
    state : ObserverState
        Changed in place if the alignment succeeds.
    tick, horizon_ticks : int
    k : EkfParams

    Returns
    -------
    bool
        False while a GPS fix (all six components) or a plausible magnetometer sample is missing, or
        the specific force is not about that of unaccelerated flight.
    """
    aid = state.aid
    size = aid.shape[0]
    fix_tick = newest_aid(aid, AID.gps_valid, tick, horizon_ticks)
    mag_tick = newest_aid(aid, AID.mag_valid, tick, horizon_ticks)
    if fix_tick == NO_TICK or mag_tick == NO_TICK:
        return False
    fix = aid[fix_tick % size]
    pos, vel = fix[AID.gps_pos : AID.gps_pos + 3], fix[AID.gps_vel : AID.gps_vel + 3]
    finite = True
    for i in range(3):
        finite = finite and math.isfinite(pos[i]) and math.isfinite(vel[i])
    mag = aid[mag_tick % size, AID.mag : AID.mag + 3]
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
    psi = heading_from_mag(phi, theta, mag, k.field_ned_t)
    x = state.nominal
    fill(x, 0.0)
    fill_from_euler(phi, theta, psi, x[NOMINAL.quat : NOMINAL.quat + 4])
    if k.arms:
        imu = state.imu[fix_tick % size]
        move_fix_to_imu(x[NOMINAL.quat :], x[NOMINAL.gyro_bias :], imu, fix, k)
    age_s = (fix_tick - (tick - horizon_ticks)) * k.dt_s
    for i in range(3):
        x[NOMINAL.vel + i] = vel[i]
        x[NOMINAL.pos + i] = pos[i] - age_s * vel[i]
    start_covariance(state.P, x[NOMINAL.quat : NOMINAL.quat + 4], age_s, k)
    fill_matrix(state.dx, 0.0)
    # used up: they must not be fused a second time
    aid[fix_tick % size, AID.gps_valid] = 0.0
    aid[mag_tick % size, AID.mag_valid] = 0.0
    count = state.count
    count[COUNT.aligned] = 1
    count[COUNT.baro_ready] = 0
    count[COUNT.gps_fused] += 1
    count[COUNT.gps_ok] = count[COUNT.gps_seen] = tick
    for which in range(len(AID_PLACES)):
        at = AID_PLACES[which]
        count[at.ok] = count[at.seen] = tick
    return True
