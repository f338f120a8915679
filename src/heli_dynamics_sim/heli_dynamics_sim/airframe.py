# SPDX-License-Identifier: Apache-2.0
"""Fuselage and fins: aerodynamic forces in body axes.

Source: Cai, Chen, Lee, Unmanned Rotorcraft Systems (Springer 2011), ch. 6. The source switches a
fin from its unstalled to its stalled law at |v| = 0.3 |u|, where the force would jump by a factor
of almost ten; here the two are blended by a cubic between 0.3 and a second ratio (a parameter),
so the force is continuous.

The source's drag is `-rho/2 S v max(|v_i|, |v|)` along each axis. One area cannot hold two numbers:
with the one that gives the damping of hover, v_i v, the drag of a side wind, v^2, is four times
that of a helicopter of this size. So the side force has two areas and Gavrilets' speed at the
fuselage, `sqrt(v^2 + v_i^2)` (Dynamic Model for a Miniature Aerobatic Helicopter, Handbook of
Unmanned Aerial Vehicles, Springer 2015), whose law it is where both are the same:

    Y = -rho/2 v sqrt((S_wy v_i)^2 + (S_fy v)^2).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference, njit
from heli_core.rotations import quat_from_euler
from heli_core.rows import PLANT

# -------------------------------------------------------------------------------------------------
# Airframe.
# -------------------------------------------------------------------------------------------------


class FuselageParams(NamedTuple):
    """rho/2 times the drag areas, kg/m."""

    x: float
    y: float
    z: float
    wash_y: float  # of side motion in the downwash


class FinParams(NamedTuple):
    """One fin."""

    dynamic_area: float  # rho/2 S, kg/m
    lift_slope: float  # 1/rad
    arm: float  # behind the c.g., m
    height: float  # above the c.g., m
    stall_onset: float  # ratio |across| / |u| where the stall begins
    stall_full: float  # and where it is complete


@njit
def fuselage_force(u_a, v_a, w_a, v_i, k):
    """Drag (N, 3 floats) of the fuselage in the body airspeed and the downwash v_i (m/s)."""
    w_f = w_a - v_i
    wash = abs(v_i)
    x = -k.x * u_a * max(wash, abs(u_a))
    y = -v_a * math.hypot(k.wash_y * wash, k.y * v_a)
    z = -k.z * w_f * max(wash, abs(w_f))
    return x, y, z


@njit
def fin_force(across, u_a, k):
    """Force (N) of a fin against the flow across it (m/s), with the axial airspeed u_a (m/s)."""
    speed = abs(across)
    along = abs(u_a)
    attached = -k.dynamic_area * k.lift_slope * across * along
    stalled = -k.dynamic_area * across * speed
    if speed <= k.stall_onset * along:
        return attached
    if speed >= k.stall_full * along:
        return stalled
    s = (speed / along - k.stall_onset) / (k.stall_full - k.stall_onset)
    share = s * s * (3.0 - 2.0 * s)
    return attached + share * (stalled - attached)


# -------------------------------------------------------------------------------------------------
# Yaw-rate gyro with heading lock: a PI controller between the pedal servo and the tail rotor.
#
# Eq. (8) of the paper, split into its state d_int and its output: `d_int' = K_a d_ped - r`,
# `d_ped' = K_P (K_a d_ped - r) + K_I d_int`. With the term `tail_authority` the pitch of the
# blades
# ends at their stops, which is where the gyro's own limits are set, and its integrator rests
# there.
# -------------------------------------------------------------------------------------------------


@by_reference
class GyroParams(NamedTuple):
    """Gains of the gyro and its way to the tail blades."""

    proportional: float  # K_P, rad per rad/s
    integral: float  # K_I, rad per rad
    pedal_gain: float  # K_a, rad/s of commanded yaw rate per unit of pedal
    pitch_gain: float  # K_ped, rad of tail blade pitch per rad of gyro output
    pitch_offset: float  # theta_ped0, rad
    pitch_min: float  # of the tail blades, rad; infinite without the term tail_authority
    pitch_max: float


@njit
def gyro(d_ped, r, d_int, k):
    """(d_int rate in rad/s, output d_ped' in rad) at yaw rate r (rad/s)."""
    error = k.pedal_gain * d_ped - r
    output = k.proportional * error + k.integral * d_int
    pitch = k.pitch_gain * output + k.pitch_offset
    outward = k.pitch_gain * error
    stuck = (pitch > k.pitch_max and outward > 0.0) or (pitch < k.pitch_min and outward < 0.0)
    return 0.0 if stuck else error, output


@njit
def tail_pitch(output, k):
    """Pitch of the tail blades (rad) for the gyro's output (rad)."""
    return min(max(k.pitch_gain * output + k.pitch_offset, k.pitch_min), k.pitch_max)


# -------------------------------------------------------------------------------------------------
# The plant's state at rest, and in parts as its kernels take them; places: `heli_core.rows.PLANT`.
#
# Inside: NED and FRD, SI units, rad.
# -------------------------------------------------------------------------------------------------

STEP_S = 0.002
"""Integration step, s: of a tick of 10 ms; the longest of any other."""


def make_state(
    pos_ned_m: NDArray[np.float64] | tuple[float, float, float] = (0.0, 0.0, 0.0),
    phi: float = 0.0,
    theta: float = 0.0,
    psi: float = 0.0,
) -> NDArray[np.float64]:
    """Plant state (42,) at rest at a position (NED, m) and attitude (rad), all else zero."""
    x = np.zeros(PLANT.size)
    x[PLANT.pos] = pos_ned_m
    x[PLANT.quat] = quat_from_euler(phi, theta, psi)
    return x


@njit
def velocity_of(x):
    """Inertial velocity (u, v, w), body axes, m/s, of a plant state."""
    return x[PLANT.u], x[PLANT.v], x[PLANT.w]


@njit
def attitude_of(x):
    """Quaternion (w, x, y, z), body -> NED, of a plant state."""
    return x[PLANT.qw], x[PLANT.qx], x[PLANT.qy], x[PLANT.qz]


@njit
def rates_of(x):
    """Body rates (p, q, r), rad/s, of a plant state."""
    return x[PLANT.p], x[PLANT.q], x[PLANT.r]


# -------------------------------------------------------------------------------------------------
# Rigid body: kinematics with a quaternion, Newton and Euler in body axes.
#
# Eq. (1)-(5) of the paper, corrected: eq. (1)-(2) print the NED -> body matrix, its transpose
# moves
# the position; eq. (3)-(4) are singular at theta = +-90 deg, so the attitude is a quaternion; eq.
# (5)
# needs the body rates where the Euler angles are printed. J is diagonal.
# -------------------------------------------------------------------------------------------------


class BodyParams(NamedTuple):
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
    k : BodyParams
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


# -------------------------------------------------------------------------------------------------
# Lever arms: a point r of the rigid body, from the c.g., moves with v + omega x r and is
# accelerated by omega' x r + omega x (omega x r) more (Groves, Principles of GNSS, Inertial, and
# Multisensor Integrated Navigation Systems, 2nd ed. 2013, sec. 2.5.5: lever arms).
# -------------------------------------------------------------------------------------------------


class LeverArm(NamedTuple):
    """Place of a sensor, from the c.g., body FRD, m."""

    on: bool  # whether it is elsewhere than at the c.g.
    x: float
    y: float
    z: float


@njit
def cross(a, b):
    """The vector product a x b of 3 floats each."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit
def add_lever_acceleration(rates, angular, arm, force):
    """Make of the specific force (3,) at the c.g., body, m/s2, that at the end of a lever arm.

    Parameters
    ----------
    rates, angular : 3 floats
        Body rates, rad/s, and their derivatives, rad/s2.
    arm : LeverArm
    force : (3,) array
        In place.
    """
    r = (arm.x, arm.y, arm.z)
    tangential, radial = cross(angular, r), cross(rates, cross(rates, r))
    for i in range(3):
        force[i] += tangential[i] + radial[i]
