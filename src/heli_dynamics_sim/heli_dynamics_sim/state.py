# SPDX-License-Identifier: Apache-2.0
"""Layout of the plant's arrays: state, command, measurement. Named once, here.

Inside: NED and FRD, SI units, rad. The plant state x is (24,), the command u (4,), the measurement
y (23,). The njit kernels take these constants in when they are compiled.
"""

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import quat_from_euler

TICK_S = 0.01
"""Length of a tick (s): command, sensors and wind change once per tick."""
SUBSTEPS = 5
"""Integration steps per tick."""
STEP_S = TICK_S / SUBSTEPS
"""Length of an integration step (s)."""

# --- plant state x ---------------------------------------------------------------------------
N_STATE = 24
POS = slice(0, 3)  # position of the c.g., NED, m
VEL = slice(3, 6)  # inertial velocity in body axes, m/s
QUAT = slice(6, 10)  # attitude quaternion (w, x, y, z), body -> NED
RATE = slice(10, 13)  # body rates p, q, r, rad/s
A_S = 13  # longitudinal flapping angle, rad, positive: disc tilted backwards
B_S = 14  # lateral flapping angle, rad, positive: disc tilted to the right
D_INT = 15  # integrator of the yaw-rate gyro, rad
SERVO = slice(16, 20)  # servo positions: lateral, longitudinal, pedal, collective, (-1, 1)
SERVO_RATE = slice(20, 24)  # their rates, 1/s

# --- command u and servo order -----------------------------------------------------------------
N_COMMAND = 4
LAT, LON, PED, COL = 0, 1, 2, 3

# --- measurement y -------------------------------------------------------------------------------
N_MEAS = 23
MEAS_FORCE = slice(0, 3)  # specific force, body, m/s2
MEAS_GYRO = slice(3, 6)  # body rates, rad/s
MEAS_MAG = slice(6, 9)  # magnetic field, body, T
MEAS_BARO = 9  # static pressure, Pa
MEAS_GPS_POS = slice(10, 13)  # NED, m
MEAS_GPS_VEL = slice(13, 16)  # NED, m/s
MEAS_MAG_VALID = 16  # 1 if a new value arrived at this tick, else 0
MEAS_BARO_VALID = 17
MEAS_GPS_VALID = 18
MEAS_GPS_TICK = 19  # tick at which the arriving fix was valid
MEAS_WIND = slice(20, 23)  # true velocity of the air, NED, m/s


def make_state(
    pos_ned_m: NDArray[np.float64] | tuple[float, float, float] = (0.0, 0.0, 0.0),
    phi: float = 0.0,
    theta: float = 0.0,
    psi: float = 0.0,
) -> NDArray[np.float64]:
    """Plant state (24,) at rest at a position (NED, m) and attitude (rad), all else zero."""
    x = np.zeros(N_STATE)
    x[POS] = pos_ned_m
    x[QUAT] = quat_from_euler(phi, theta, psi)
    return x
