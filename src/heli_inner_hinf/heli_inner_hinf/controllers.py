# SPDX-License-Identifier: Apache-2.0
"""The attitude controller: state feedback by eq. (17), output feedback or PID, one step a tick.

`attitude_law(x9, r3, k, state, u3)` reads the nine absolute states of eq. (10) (places `NINE`, rad,
rad/s) and the absolute commands phi, theta, psi (places `SETPOINT`, rad), and writes the absolute
actuators d_lat, d_lon, d_ped. your own controller goes into a branch here; `controller_template`
shows one.
"""

import numpy as np

from heli_core.jit import njit, scratch
from heli_core.rotations import wrap_pi
from heli_core.rows import NINE, SETPOINT
from heli_inner_hinf.controller_state import (
    INTEGRAL,
    LAST_R,
    LAST_U,
    LAST_X,
    MEMORY,
    N_LAW_STATE,
    N_V,
    OFFSET,
    OUTPUT_FEEDBACK,
    PID,
    RUN,
    SHIFT_LIMIT_RAD,
    STATE_FEEDBACK,
    AttitudeParams,
    AttitudeStatus,
    advance,
    all_finite,
    command,
    initial_law_state,
    read_inputs,
    save_state,
    state_at_rest,
)

# -------------------------------------------------------------------------------------------------
# PID attitude controller for roll, pitch, yaw: the baseline of the paper's Fig. 3.
#
# Three single loops on the same nine-state estimate, from which it takes phi, theta, psi and p, q,
# r:
# derivative on measurement, clamping anti-windup. The gains are found by `pid_tuning`.
# -------------------------------------------------------------------------------------------------


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


# -------------------------------------------------------------------------------------------------
# Attitude controller.
# -------------------------------------------------------------------------------------------------

__all__ = [
    "AttitudeParams",
    "AttitudeStatus",
    "attitude_law",
    "initial_law_state",
    "linear_law",
    "swap_bumpless",
]

_SATURATED = int(AttitudeStatus.SATURATED)
_NOT_FINITE = int(AttitudeStatus.NOT_FINITE)


@njit
def linear_law(x9, r3, k, state, u3):
    """u = u_trim + F (x - x_trim) + H (u_last - u_trim) + G (r + s - h_out_trim), unlimited, into
    u3 (3,).

    Eq. (17) at the state as it will be when the command reaches the rotor
    (`loops.predicting_gains`). psi enters as the wrapped difference psi - psi_ref: heading is a
    pure integrator of the model, so that the psi column of G is minus that of F (eq. (15)) and the
    controller does not depend on which way is north. s is the shift of `shift_target`, zero by
    default.
    """
    shift = state[INTEGRAL : INTEGRAL + 3]
    psi_error = wrap_pi(x9[NINE.psi] - r3[SETPOINT.psi]) - shift[SETPOINT.psi]
    phi_command = r3[SETPOINT.phi] - k.x_trim[NINE.phi] + shift[SETPOINT.phi]
    theta_command = r3[SETPOINT.theta] - k.x_trim[NINE.theta] + shift[SETPOINT.theta]
    for i in range(3):
        total = k.u_trim[i] + k.F[i, NINE.psi] * psi_error
        for j in range(NINE.psi):
            total += k.F[i, j] * (x9[j] - k.x_trim[j])
        for j in range(3):
            total += k.H[i, j] * (state[LAST_U + j] - k.u_trim[j])
        total += k.G[i, SETPOINT.phi] * phi_command
        u3[i] = total + k.G[i, SETPOINT.theta] * theta_command


@njit
def shift_target(x9, r3, k, state):
    """Offset-free target: s' = shift_rate (r - h_out), at most `SHIFT_LIMIT_RAD` on each axis.

    State feedback has no integrator: a moment that the model lacks leaves an error. G makes r ->
    h_out one at rest, so that the shift that cancels a lasting error is the error itself, and the
    loop through s is that of an integrator with crossover `shift_rate`, far below the attitude
    loop's bandwidth.
    """
    shift = state[INTEGRAL : INTEGRAL + 3]
    step = k.tick_s * k.shift_rate
    shift[SETPOINT.phi] += step * (r3[SETPOINT.phi] - x9[NINE.phi])
    shift[SETPOINT.theta] += step * (r3[SETPOINT.theta] - x9[NINE.theta])
    shift[SETPOINT.psi] += step * wrap_pi(r3[SETPOINT.psi] - x9[NINE.psi])
    for i in range(3):
        shift[i] = min(max(shift[i], -SHIFT_LIMIT_RAD), SHIFT_LIMIT_RAD)


@njit
def output_feedback(v, r3, k, state, u3):
    """u = u_trim + C x + D v, unlimited, into u3 (3,); a new psi_ref takes the memory along."""
    x = state[MEMORY : MEMORY + k.law.A.shape[0]]
    if state[RUN] > 0.0:
        turned = wrap_pi(state[LAST_R + SETPOINT.psi] - r3[SETPOINT.psi])
        for i in range(x.size):
            x[i] += k.law.turn[i] * turned
    command(k.law, x, v, u3)
    for i in range(3):
        u3[i] += k.u_trim[i]


@njit
def attitude_law(x9, r3, k, state, u3):
    """One tick of the controller that `k.controller` names.

    Parameters
    ----------
    x9 : (9,) array
        Absolute states, places of `NINE`, rad and rad/s.
    r3 : (3,) array
        Commanded phi, theta, psi, absolute, rad.
    k : AttitudeParams
    state : (N_LAW_STATE,) array
        Changed in place; layout in `controller_state`.
    u3 : (3,) array
        Out: d_lat, d_lon, d_ped, absolute, within +-k.limit, always finite.

    Returns
    -------
    int
        `AttitudeStatus`; on a value that is not finite the last good output is repeated.
    """
    if not (all_finite(x9) and all_finite(r3)):
        for i in range(3):
            u3[i] = state[LAST_U + i]
        return _NOT_FINITE
    v, cut = scratch(N_V), scratch(3)
    if k.controller == PID:
        pid_law(x9, r3, k, state, u3)
    elif k.controller == OUTPUT_FEEDBACK:
        read_inputs(x9, r3, k.x_trim, v)
        output_feedback(v, r3, k, state, u3)
    else:
        linear_law(x9, r3, k, state, u3)
    if not all_finite(u3):
        for i in range(3):
            u3[i] = state[LAST_U + i]
        return _NOT_FINITE
    status = 0
    for i in range(3):
        unlimited = u3[i] + state[OFFSET + i]
        u = unlimited
        state[OFFSET + i] *= k.offset_decay
        if u > k.limit:
            u = k.limit
            status = _SATURATED
        elif u < -k.limit:
            u = -k.limit
            status = _SATURATED
        u3[i] = u
        cut[i] = u - unlimited
        state[LAST_U + i] = u
    if k.controller == OUTPUT_FEEDBACK:
        advance(k.law, state[MEMORY : MEMORY + k.law.A.shape[0]], v, cut)
    elif k.controller == STATE_FEEDBACK and k.shift_rate > 0.0 and status == 0:
        shift_target(x9, r3, k, state)
    save_state(x9, r3, state)
    state[RUN] = 1.0
    return status


def swap_bumpless(
    state: np.ndarray, k_new: AttitudeParams, u_flown: np.ndarray | None = None
) -> None:
    """Prepare `state` (in place) so that `k_new` goes on from what is flown.

    Output feedback starts at rest (`state_at_rest`). The difference between the flown command and
    what the new controller would give at the newest state becomes the new PID's integrator, or an
    offset of the other controllers that fades with `k_new.offset_decay`.

    Parameters
    ----------
    state : (N_LAW_STATE,) array
    k_new : AttitudeParams
    u_flown : (3,) array, optional
        d_lat, d_lon, d_ped as flown; default: the controller's own last output.
    """
    flown = state[LAST_U : LAST_U + 3].copy() if u_flown is None else np.asarray(u_flown, float)
    state[LAST_U : LAST_U + 3] = np.clip(flown, -k_new.limit, k_new.limit)
    x9, r3 = state[LAST_X : LAST_X + 9].copy(), state[LAST_R : LAST_R + 3].copy()
    would = np.empty(3)
    state[OFFSET : OFFSET + 3] = 0.0
    state[INTEGRAL : INTEGRAL + 3] = 0.0
    state[MEMORY:N_LAW_STATE] = 0.0
    if k_new.controller == PID:
        pid_terms(x9, r3, k_new, np.empty(3), would)
        state[INTEGRAL : INTEGRAL + 3] = flown - would
        return
    if k_new.controller == OUTPUT_FEEDBACK:
        v = np.empty(N_V)
        read_inputs(x9, r3, k_new.x_trim, v)
        x = state_at_rest(k_new.law, v, flown - k_new.u_trim, k_new.tick_s)
        state[MEMORY : MEMORY + x.size] = x
        output_feedback(v, r3, k_new, state, would)
    else:
        linear_law(x9, r3, k_new, state, would)
    state[OFFSET : OFFSET + 3] = flown - would
