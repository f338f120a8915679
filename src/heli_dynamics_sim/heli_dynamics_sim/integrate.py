# SPDX-License-Identifier: Apache-2.0
"""Integration: classical Runge-Kutta of order 4 with fixed steps."""

from heli_dynamics_sim.ground import apply_slip
from heli_dynamics_sim.helicopter import derivative_kernel
from heli_dynamics_sim.servo import apply_stops
from heli_dynamics_sim.state import attitude_of
from heli_math.jit import njit
from heli_math.rows import PLANT

WORK_ROWS = 5


@njit
def rk4_step(x, u, air, k, dt_s, work):
    """Advance x (42,) by dt_s with command u (4,) and air (12,) held; in place.

    After the step the quaternion is scaled to unit norm, servos are kept inside their stops and the
    skids' bristles inside Coulomb's cone.
    work is scratch, (5, 42).
    """
    n = x.shape[0]
    k1, k2, k3, k4, stage = work
    derivative_kernel(x, u, air, k, k1)
    for i in range(n):
        stage[i] = x[i] + 0.5 * dt_s * k1[i]
    derivative_kernel(stage, u, air, k, k2)
    for i in range(n):
        stage[i] = x[i] + 0.5 * dt_s * k2[i]
    derivative_kernel(stage, u, air, k, k3)
    for i in range(n):
        stage[i] = x[i] + dt_s * k3[i]
    derivative_kernel(stage, u, air, k, k4)
    for i in range(n):
        x[i] += dt_s / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    qw, qx, qy, qz = attitude_of(x)
    norm = (qw * qw + qx * qx + qy * qy + qz * qz) ** 0.5
    for i in range(PLANT.quat.start, PLANT.quat.stop):
        x[i] /= norm
    apply_stops(x, k.servo)
    apply_slip(x, k.ground)
