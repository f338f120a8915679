# SPDX-License-Identifier: Apache-2.0
"""PID attitude law for roll, pitch, yaw: the baseline of the paper's Fig. 3.

Three single loops on the same nine-state estimate, from which it takes phi, theta, psi and p, q, r:
derivative on measurement, clamping anti-windup. The gains are found by `pid_tuning`.
"""

from heli_inner_hinf.law_state import INTEGRAL, OFFSET
from heli_math.arrays import scratch
from heli_math.jit import njit
from heli_math.rotations import wrap_pi
from heli_math.rows import NINE, SETPOINT


@njit
def pid_terms(x9, r3, k, error, held):
    """Tracking error (3,) into `error`, proportional and derivative part plus trim (3,) into
    `held`."""
    error[0] = r3[SETPOINT.phi] - x9[NINE.phi]
    error[1] = r3[SETPOINT.theta] - x9[NINE.theta]
    error[2] = wrap_pi(r3[SETPOINT.psi] - x9[NINE.psi])
    held[0] = k.u_trim[0] + k.K_P[0] * error[0] - k.K_D[0] * x9[NINE.p]
    held[1] = k.u_trim[1] + k.K_P[1] * error[1] - k.K_D[1] * x9[NINE.q]
    held[2] = k.u_trim[2] + k.K_P[2] * error[2] - k.K_D[2] * x9[NINE.r]


@njit
def pid_law(x9, r3, k, state, u3):
    """Unlimited PID command (3,) into u3; integrators in state[INTEGRAL:INTEGRAL+3].

    An integrator stands still while its actuator is at the limit and the error would drive it
    further.
    """
    error = scratch(3)
    pid_terms(x9, r3, k, error, u3)
    for i in range(3):
        rate = k.K_I[i] * error[i]
        integral = state[INTEGRAL + i] + k.tick_s * rate
        raw = u3[i] + integral + state[OFFSET + i]
        if (raw > k.limit and rate > 0.0) or (raw < -k.limit and rate < 0.0):
            integral = state[INTEGRAL + i]
        state[INTEGRAL + i] = integral
        u3[i] += integral
