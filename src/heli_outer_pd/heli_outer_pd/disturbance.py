# SPDX-License-Identifier: Apache-2.0
"""What the law takes for disturbance: an observer beside its own model, and how it begins."""

import math

from heli_math.arrays import scratch
from heli_math.jit import njit
from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, SETPOINT
from heli_outer_pd.outer_state import LEAVES, LOW_BY_HAND, MEMORY
from heli_outer_pd.softness import d_share, p_share
from heli_outer_pd.thrust_map import thrust_for_collective


@njit
def to_heading(v, c, s, out):
    """NED vector (3,) -> heading frame (forward, right, down), rotated by psi only."""
    out[0] = c * v[0] + s * v[1]
    out[1] = -s * v[0] + c * v[1]
    out[2] = v[2]


@njit
def to_ned(v, c, s, out):
    """Heading-frame vector (3,) -> NED."""
    out[0] = c * v[0] - s * v[1]
    out[1] = s * v[0] + c * v[1]
    out[2] = v[2]


@njit
def trim_thrust(k):
    """Thrust (N) of still-air hover."""
    return k.mass * k.g / (math.cos(k.trim[SETPOINT.phi]) * math.cos(k.trim[SETPOINT.theta]))


@njit
def clip(value, limit):
    """Value within +-limit."""
    return min(max(value, -limit), limit)


@njit
def flown_acceleration(phi, theta, k, out):
    """Horizontal acceleration (2,) m/s2, heading frame, that the attitude explains in still air."""
    forward, right = -(theta - k.trim[SETPOINT.theta]), phi - k.trim[SETPOINT.phi]
    if k.exact_tilt > 0.5:
        out[0], out[1] = k.g * math.tan(forward), k.g * math.tan(right)
    else:
        out[0], out[1] = k.g * math.sin(forward), k.g * math.sin(right)


@njit
def modelled_acceleration(phi, theta, v_down, k, state, out):
    """Acceleration (3,) m/s2, heading frame, that the law's model expects of its last command.

    Horizontally the commanded one behind the attitude loop's lag: what the attitude loop leaves
    standing counts as disturbance and is trimmed out with it. Vertically the thrust of the last
    collective at the present speed, so that the rotor's own damping is no disturbance.
    """
    commanded, lagged, last = scratch(2), state[MEMORY.lagged], state[MEMORY.command]
    flown_acceleration(last[SETPOINT.phi], last[SETPOINT.theta], k, commanded)
    for i in range(2):
        keep = math.exp(-k.dt_s / k.attitude_lag[i])
        lagged[i] = keep * lagged[i] + (1.0 - keep) * commanded[i]
        out[i] = lagged[i]
    d_col, d_col_trim = last[SETPOINT.col], k.trim[SETPOINT.col]
    thrust = thrust_for_collective(d_col, v_down, trim_thrust(k), d_col_trim, k.rotor)
    out[2] = k.g - thrust * math.cos(phi) * math.cos(theta) / k.mass


@njit
def all_finite(values):
    """Whether no element of the vector is NaN or inf."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def flyable(nav):
    """Whether what the law reads of the navigation row is finite."""
    pos, vel, attitude = nav[NAV.pos], nav[NAV.vel], nav[NAV.quat]
    return all_finite(pos) and all_finite(vel) and all_finite(attitude)


@njit
def estimate_disturbance(vel_h, a_h, k, state, c, s, d_h):
    """One step of the velocity/disturbance observer (Luenberger, forward Euler at the law's rate).

    v_hat' = a_model + d_hat + l1 (v - v_hat), d_hat' = l2 (v - v_hat); kept in NED because steady
    wind stands still there while the nose turns. Writes the estimate to d_h (3,), heading frame.
    """
    v_hat = scratch(3)
    to_heading(state[MEMORY.vel], c, s, v_hat)
    to_heading(state[MEMORY.disturbance], c, s, d_h)
    for i in range(3):
        innovation = vel_h[i] - v_hat[i]
        l1, l2 = k.observer_l1[i], k.observer_l2[i]
        if i < 2:
            l1, l2 = d_share(state) * l1, p_share(state) * l2
        v_hat[i] += k.dt_s * (a_h[i] + d_h[i] + l1 * innovation)
        d_h[i] = clip(d_h[i] + k.dt_s * l2 * innovation, k.disturbance_limit[i])
    to_ned(v_hat, c, s, state[MEMORY.vel])
    to_ned(d_h, c, s, state[MEMORY.disturbance])


@njit
def engage(nav, phi, theta, k, state, c, s, d_h):
    """Bumpless start: what is flown is taken for equilibrium and so is the first command."""
    vel, estimate, lagged = nav[NAV.vel], state[MEMORY.vel], state[MEMORY.lagged]
    for i in range(3):
        estimate[i] = vel[i]
    flown_acceleration(phi, theta, k, lagged)
    d_h[0] = clip(-lagged[0], k.disturbance_limit[0])
    d_h[1] = clip(-lagged[1], k.disturbance_limit[1])
    d_h[2] = 0.0  # what collective is flown is not known here: trim is assumed
    to_ned(d_h, c, s, state[MEMORY.disturbance])


@njit
def leave(vel, v_down, phi, theta, k, state):
    """Lift-off: the ground may still carry a part, so what it does is not taken for wind."""
    unused, estimate, d = scratch(3), state[MEMORY.vel], state[MEMORY.disturbance]
    if state[MEMORY.engaged] > 0.5:
        modelled_acceleration(phi, theta, v_down, k, state, unused)
    for i in range(3):
        estimate[i], d[i] = vel[i], 0.0


@njit
def hover_share(d_col, k):
    """Thrust of a collective in still air as a share of that of hover."""
    thrust = trim_thrust(k)
    return thrust_for_collective(d_col, 0.0, thrust, k.trim[SETPOINT.col], k.rotor) / thrust


@njit
def estimate(nav, phi, theta, c, s, k, state, d_h):
    """One step of what is known of the disturbance, into d_h (3,), m/s2, heading frame.

    c, s are of the heading; the rest as for `position_law`.
    """
    vel_h, a_h = scratch(3), scratch(3)
    to_heading(nav[NAV.vel], c, s, vel_h)
    ground = state[MEMORY.ground]
    if ground == LEAVES or ground == LOW_BY_HAND:
        leave(nav[NAV.vel], nav[NAV.down_vel], phi, theta, k, state)
    elif k.wind_compensation > 0.5:
        if state[MEMORY.engaged] < 0.5:
            engage(nav, phi, theta, k, state, c, s, d_h)
        else:
            modelled_acceleration(phi, theta, nav[NAV.down_vel], k, state, a_h)
            estimate_disturbance(vel_h, a_h, k, state, c, s, d_h)


@njit
def flown_acceleration_ned(nav, k, state, out):
    """Acceleration (3,) m/s2, NED, of what is flown: by attitude, last collective and estimate."""
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    a_h = scratch(3)
    flown_acceleration(phi, theta, k, a_h)
    d_col, d_col_trim = state[MEMORY.command][SETPOINT.col], k.trim[SETPOINT.col]
    thrust = thrust_for_collective(d_col, nav[NAV.down_vel], trim_thrust(k), d_col_trim, k.rotor)
    a_h[2] = k.g - thrust * math.cos(phi) * math.cos(theta) / k.mass
    to_ned(a_h, math.cos(psi), math.sin(psi), out)
    disturbance = state[MEMORY.disturbance]
    for i in range(3):
        out[i] += disturbance[i]
