# SPDX-License-Identifier: Apache-2.0
"""Integration: classical Runge-Kutta of order 4 with fixed steps."""

from heli_dynamics_sim.ground import apply_slip
from heli_dynamics_sim.helicopter import derivative_kernel
from heli_dynamics_sim.servo import apply_stops
from heli_dynamics_sim.state import attitude_of
from heli_math.jit import njit
from heli_math.rows import PLANT

_STAGES = 4
WORK_ROWS = _STAGES + 1


@njit
def rk4_step(x, u, air, k, dt_s, work):
    """Advance x (42,) by dt_s with command u (4,) and air (12,) held; in place.

    After the step the quaternion is scaled to unit norm, servos are kept inside their stops and the
    skids' bristles inside Coulomb's cone.
    work is scratch, (5, 42).
    """
    n = x.shape[0]
    stage = work[_STAGES]
    for i in range(n):
        stage[i] = x[i]
    for j in range(_STAGES):  # a loop, so that the derivative is compiled into it once
        rate = work[j]
        derivative_kernel(stage, u, air, k, rate)
        ahead_s = 0.5 * dt_s if j < _STAGES - 2 else dt_s
        for i in range(n):
            stage[i] = x[i] + ahead_s * rate[i]
    for i in range(n):
        middle = work[1, i] + work[2, i]
        x[i] += dt_s / 6.0 * (work[0, i] + 2.0 * middle + work[_STAGES - 1, i])
    qw, qx, qy, qz = attitude_of(x)
    norm = (qw * qw + qx * qx + qy * qy + qz * qz) ** 0.5
    for i in range(PLANT.quat.start, PLANT.quat.stop):
        x[i] /= norm
    apply_stops(x, k.servo)
    apply_slip(x, k.ground)
