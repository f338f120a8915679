# SPDX-License-Identifier: Apache-2.0
"""PD position and altitude law with a disturbance estimate: eq. (20) and (21), corrected.

eq. (20) prints a position where a thrust must stand; eq. (21) carries a misprinted K_D subscript.
Used here:

    T         = m (g + K_P (z - z_ref) + K_D (z' - z_ref') - z_ref'' + d_z) / (cos phi cos theta)
    theta_ref = theta_trim - sat(atan(a_x / g)),   phi_ref = phi_trim + sat(atan(a_y / g))
    a         = acc_ref + K_P (pos_ref - pos) + K_D (vel_ref - vel) - d

with z down (NED) and a rotated from NED to the heading frame; in (21) it goes through a lead that
makes up for part of the attitude loop's lag. d is the estimated acceleration that the law's own
model does not explain (wind drag, a rotor weaker than its map). (21) prints asin(sat(a / g)), which
`exact_tilt: false` flies: as (20) holds the lift at any tilt, the thrust then accelerates sideways
by g tan, more than what was wanted (a fifth more at 35 deg). The trims stand in
front because a helicopter hangs sideways in still-air hover: the tail rotor's side force is
balanced by roll.
"""

import enum
import math
from typing import NamedTuple

import numpy as np

from heli_math.jit import njit
from heli_math.rotations import euler_from_quat, wrap_pi
from heli_math.rows import NAV, SETPOINT, SHAPED
from heli_math.sweep import SweepKernel, add_sweep
from heli_math.ticks import NS_PER_S
from heli_outer_pd.reference import shaped_reference_at
from heli_outer_pd.thrust_map import RotorMap, collective_for_thrust, thrust_for_collective


class Memory(NamedTuple):
    """State of the law (18,)."""

    vel: slice = slice(0, 3)  # estimated velocity, NED, m/s
    disturbance: slice = slice(3, 6)  # estimated disturbance, NED, m/s2
    engaged: int = 6  # 1.0 once the law has made a step
    command: slice = slice(7, 11)  # last output, a SetpointRow
    lagged: slice = slice(11, 13)  # commanded acceleration behind the attitude loop's lag, m/s2
    led: slice = slice(13, 15)  # wanted acceleration behind the lead's filter, NED, m/s2
    ground: int = 15  # one of FLIES, STANDS, LEAVES
    col_goal: int = 16  # collective that is gone to while it stands
    col_rate: int = 17  # at so much per second
    size: int = 18


MEMORY = Memory()
FLIES, STANDS, LEAVES = 0.0, 1.0, 2.0
"""In the air; on the skids, the law not engaged; lifting off, engaged without estimating."""
_COLLECTIVE_LIMIT = 0.98
# Below this cos(phi) cos(theta) lift compensation no longer helps: the thrust points sideways.
_MIN_LIFT_FRACTION = 0.5


class OuterStatus(enum.IntEnum):
    """Outcome of one step of the outer loop; `sentence` says it for people."""

    OK = 0
    BAD_NAVIGATION = 1
    BAD_REFERENCE = 2

    @property
    def sentence(self) -> str:
        """One line for a diagnostic message."""
        return _SENTENCES[self]


_OK = int(OuterStatus.OK)
_BAD_NAVIGATION = int(OuterStatus.BAD_NAVIGATION)
_BAD_REFERENCE = int(OuterStatus.BAD_REFERENCE)
_SENTENCES = {
    OuterStatus.OK: "position is held",
    OuterStatus.BAD_NAVIGATION: "the navigation solution is not finite: the last command is held",
    OuterStatus.BAD_REFERENCE: "the reference is not finite: the last command is held",
}


class OuterKernel(NamedTuple):
    """Numbers of the law, in the form that compiled code takes."""

    K_P: np.ndarray  # (3,) 1/s2, heading x, heading y, down
    K_D: np.ndarray  # (3,) 1/s, same axes
    approach_speed_mps: float  # at which a large position error is flown back
    observer_l1: np.ndarray  # (3,) 1/s, same axes
    observer_l2: np.ndarray  # (3,) 1/s2, same axes
    disturbance_limit: np.ndarray  # (3,) m/s2, same axes
    wind_compensation: float  # 1 or 0
    hold_horizontal: float  # 1: hold position; 0: command level trim attitude (attitude test)
    level_phi_theta: np.ndarray  # (2,) rad, commanded when hold_horizontal is 0
    tilt_limit: float  # rad, of sat() in (21)
    exact_tilt: float  # 1: tilt whose thrust gives what is wanted; 0: asin() as printed in (21)
    mass: float  # kg
    g: float  # m/s2
    thrust_limits: np.ndarray  # (2,) fractions of m g
    trim: np.ndarray  # (4,) a SetpointRow: phi, theta rad, d_col; its heading is not used
    rotor: RotorMap
    shaping_ns: int  # window of the reference shaping
    heading_lead_s: float  # lead of the commanded heading on the reference's
    attitude_lag: np.ndarray  # (2,) s, forward and right: time constants of the attitude loop
    attitude_lead: np.ndarray  # (2,) s, forward and right: lead of the commanded acceleration
    lead_filter_s: float
    dt_s: float
    sweep: SweepKernel


def initial_state(k: OuterKernel) -> np.ndarray:
    """State (18,) of a law that is not engaged yet; its last command is the trim."""
    state = np.zeros(MEMORY.size)
    state[MEMORY.command] = k.trim
    return state


@njit
def _to_heading(v, c, s, out):
    """NED vector (3,) -> heading frame (forward, right, down), rotated by psi only."""
    out[0] = c * v[0] + s * v[1]
    out[1] = -s * v[0] + c * v[1]
    out[2] = v[2]


@njit
def _to_ned(v, c, s, out):
    """Heading-frame vector (3,) -> NED."""
    out[0] = c * v[0] - s * v[1]
    out[1] = s * v[0] + c * v[1]
    out[2] = v[2]


@njit
def _trim_thrust(k):
    """Thrust (N) of still-air hover."""
    return k.mass * k.g / (math.cos(k.trim[SETPOINT.phi]) * math.cos(k.trim[SETPOINT.theta]))


@njit
def _clip(value, limit):
    return min(max(value, -limit), limit)


@njit
def tilt_for(acceleration, k):
    """Tilt from trim, rad, that (21) commands for an acceleration, m/s2."""
    ratio = acceleration / k.g
    if k.exact_tilt > 0.5:
        return _clip(math.atan(ratio), k.tilt_limit)
    return math.asin(_clip(ratio, math.sin(k.tilt_limit)))


@njit
def _flown_acceleration(phi, theta, k, out):
    """Horizontal acceleration (2,) m/s2, heading frame, that the attitude explains in still air."""
    forward, right = -(theta - k.trim[SETPOINT.theta]), phi - k.trim[SETPOINT.phi]
    if k.exact_tilt > 0.5:
        out[0], out[1] = k.g * math.tan(forward), k.g * math.tan(right)
    else:
        out[0], out[1] = k.g * math.sin(forward), k.g * math.sin(right)


@njit
def _modelled_acceleration(phi, theta, v_down, k, state, out):
    """Acceleration (3,) m/s2, heading frame, that the law's model expects of its last command.

    Horizontally the commanded one behind the attitude loop's lag: what the attitude loop leaves
    standing counts as disturbance and is trimmed out with it. Vertically the thrust of the last
    collective at the present speed, so that the rotor's own damping is no disturbance.
    """
    commanded, lagged, last = np.empty(2), state[MEMORY.lagged], state[MEMORY.command]
    _flown_acceleration(last[SETPOINT.phi], last[SETPOINT.theta], k, commanded)
    for i in range(2):
        keep = math.exp(-k.dt_s / k.attitude_lag[i])
        lagged[i] = keep * lagged[i] + (1.0 - keep) * commanded[i]
        out[i] = lagged[i]
    d_col, d_col_trim = last[SETPOINT.col], k.trim[SETPOINT.col]
    thrust = thrust_for_collective(d_col, v_down, _trim_thrust(k), d_col_trim, k.rotor)
    out[2] = k.g - thrust * math.cos(phi) * math.cos(theta) / k.mass


@njit
def _all_finite(values):
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def flyable(nav):
    """Whether what the law reads of the navigation row is finite."""
    pos, vel, attitude = nav[NAV.pos], nav[NAV.vel], nav[NAV.quat]
    return _all_finite(pos) and _all_finite(vel) and _all_finite(attitude)


@njit
def _estimate_disturbance(vel_h, a_h, k, state, c, s, d_h):
    """One step of the velocity/disturbance observer (Luenberger, forward Euler at the law's rate).

    v_hat' = a_model + d_hat + l1 (v - v_hat), d_hat' = l2 (v - v_hat); kept in NED because steady
    wind stands still there while the nose turns. Writes the estimate to d_h (3,), heading frame.
    """
    v_hat = np.empty(3)
    _to_heading(state[MEMORY.vel], c, s, v_hat)
    _to_heading(state[MEMORY.disturbance], c, s, d_h)
    for i in range(3):
        innovation = vel_h[i] - v_hat[i]
        v_hat[i] += k.dt_s * (a_h[i] + d_h[i] + k.observer_l1[i] * innovation)
        d_h[i] = _clip(d_h[i] + k.dt_s * k.observer_l2[i] * innovation, k.disturbance_limit[i])
    _to_ned(v_hat, c, s, state[MEMORY.vel])
    _to_ned(d_h, c, s, state[MEMORY.disturbance])


@njit
def _engage(nav, phi, theta, k, state, c, s, d_h):
    """Bumpless start: what is flown is taken for equilibrium and so is the first command."""
    vel, estimate, lagged = nav[NAV.vel], state[MEMORY.vel], state[MEMORY.lagged]
    for i in range(3):
        estimate[i] = vel[i]
    _flown_acceleration(phi, theta, k, lagged)
    d_h[0] = _clip(-lagged[0], k.disturbance_limit[0])
    d_h[1] = _clip(-lagged[1], k.disturbance_limit[1])
    d_h[2] = 0.0  # what collective is flown is not known here: trim is assumed
    _to_ned(d_h, c, s, state[MEMORY.disturbance])


@njit
def _leave(vel, v_down, phi, theta, k, state):
    """Lift-off: the ground may still carry a part, so what it does is not taken for wind."""
    scratch, estimate, d = np.empty(3), state[MEMORY.vel], state[MEMORY.disturbance]
    if state[MEMORY.engaged] > 0.5:
        _modelled_acceleration(phi, theta, v_down, k, state, scratch)
    for i in range(3):
        estimate[i], d[i] = vel[i], 0.0


@njit
def hover_share(d_col, k):
    """Thrust of a collective in still air as a share of that of hover."""
    thrust = _trim_thrust(k)
    return thrust_for_collective(d_col, 0.0, thrust, k.trim[SETPOINT.col], k.rotor) / thrust


@njit
def _stand(nav, ref, k, state, out):
    """On the skids: the collective goes to its goal, the attitude is what the skids make it.

    What is commanded is the measured attitude, so that no error winds up against the ground, and
    becomes that of hover as the second half of the weight goes over to the rotor.
    """
    last = state[MEMORY.command]
    step = state[MEMORY.col_rate] * k.dt_s
    col = last[SETPOINT.col] + _clip(state[MEMORY.col_goal] - last[SETPOINT.col], step)
    known = flyable(nav)
    phi, theta, psi = last[SETPOINT.phi], last[SETPOINT.theta], last[SETPOINT.psi]
    if known:
        phi, theta, psi = euler_from_quat(nav[NAV.quat])
        share = min(max(2.0 * hover_share(col, k) - 1.0, 0.0), 1.0)
        phi += share * (k.trim[SETPOINT.phi] - phi)
        theta += share * (k.trim[SETPOINT.theta] - theta)
        psi += share * wrap_pi(ref[SHAPED.psi] - psi)
    out[SETPOINT.phi], out[SETPOINT.theta], out[SETPOINT.psi] = phi, theta, psi
    out[SETPOINT.col] = col
    for i in range(SETPOINT.size):
        last[i] = out[i]
    state[MEMORY.disturbance] = 0.0
    state[MEMORY.engaged] = 0.0
    return _OK if known else _BAD_NAVIGATION


@njit
def _with_lead(a, c, s, k, state):
    """Lead the wanted acceleration (3,), in place, forward and right: (1 + (T + L) s)/(1 + T s).

    L is `attitude_lead`, T `lead_filter_s`. What is wanted is filtered in NED, where it stands
    still while the nose turns: else the lead would make much of the nose's least motion when bank
    holds against a side wind. The first one goes through as it is.
    """
    wanted, beyond, led = np.empty(3), np.empty(3), state[MEMORY.led]
    _to_ned(a, c, s, wanted)
    if state[MEMORY.engaged] < 0.5:
        led[:] = wanted[:2]
    keep = math.exp(-k.dt_s / k.lead_filter_s)
    for i in range(2):
        wanted[i] -= led[i]
        led[i] += (1.0 - keep) * wanted[i]
    _to_heading(wanted, c, s, beyond)
    for i in range(2):
        a[i] += k.attitude_lead[i] / k.lead_filter_s * beyond[i]


@njit
def _command(nav, ref, d_h, c, s, lift, k, state, out):
    """PD action, lift compensation and the inversions of (20) and (21); writes out (4,)."""
    pos_error_h = np.empty(3)
    vel_error_h = np.empty(3)
    _to_heading(ref[SHAPED.pos] - nav[NAV.pos], c, s, pos_error_h)
    _to_heading(ref[SHAPED.vel] - nav[NAV.vel], c, s, vel_error_h)
    a = np.empty(3)
    _to_heading(ref[SHAPED.acc], c, s, a)
    for i in range(3):
        back = _clip(k.K_P[i] * pos_error_h[i], k.K_D[i] * k.approach_speed_mps)
        a[i] += back + k.K_D[i] * vel_error_h[i] - d_h[i]
    _with_lead(a, c, s, k, state)
    if k.hold_horizontal > 0.5:
        out[SETPOINT.phi] = k.trim[SETPOINT.phi] + tilt_for(a[1], k)
        out[SETPOINT.theta] = k.trim[SETPOINT.theta] - tilt_for(a[0], k)
    else:
        out[SETPOINT.phi] = k.level_phi_theta[0]
        out[SETPOINT.theta] = k.level_phi_theta[1]
    out[SETPOINT.psi] = ref[SHAPED.psi]
    weight = k.mass * k.g
    thrust = k.mass * (k.g - a[2]) / max(lift, _MIN_LIFT_FRACTION)
    thrust = min(max(thrust, k.thrust_limits[0] * weight), k.thrust_limits[1] * weight)
    # The inflow of the climb that the reference asks for is fed forward.
    d_col = collective_for_thrust(
        thrust, ref[SHAPED.down_vel], _trim_thrust(k), k.trim[SETPOINT.col], k.rotor
    )
    out[SETPOINT.col] = min(max(d_col, -_COLLECTIVE_LIMIT), _COLLECTIVE_LIMIT)


@njit
def position_law(nav, ref, k, state, out):
    """One step of the outer loop: eq. (20), (21).

    Parameters
    ----------
    nav : (>= 10,) ndarray
        Navigation row; position, velocity and attitude are used.
    ref : (10,) ndarray
        Shaped reference, places of `heli_math.rows.SHAPED`.
    k : OuterKernel
        Gains and limits.
    state : (18,) ndarray
        Updated in place; places of `MEMORY`.
    out : (4,) ndarray
        Written: places of `heli_math.rows.SETPOINT`, absolute.

    Returns
    -------
    int
        An OuterStatus. On anything but OK the last good output is repeated.
    """
    last = state[MEMORY.command]
    if not flyable(nav) or not _all_finite(ref):
        for i in range(SETPOINT.size):
            out[i] = last[i]
        if not flyable(nav):
            return _BAD_NAVIGATION
        return _BAD_REFERENCE
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    c, s = math.cos(psi), math.sin(psi)
    vel_h = np.empty(3)
    a_h = np.empty(3)
    d_h = np.zeros(3)
    _to_heading(nav[NAV.vel], c, s, vel_h)
    if state[MEMORY.ground] > 0.5:
        _leave(nav[NAV.vel], nav[NAV.down_vel], phi, theta, k, state)
    elif k.wind_compensation > 0.5:
        if state[MEMORY.engaged] < 0.5:
            _engage(nav, phi, theta, k, state, c, s, d_h)
        else:
            _modelled_acceleration(phi, theta, nav[NAV.down_vel], k, state, a_h)
            _estimate_disturbance(vel_h, a_h, k, state, c, s, d_h)
    _command(nav, ref, d_h, c, s, math.cos(phi) * math.cos(theta), k, state, out)
    for i in range(SETPOINT.size):
        last[i] = out[i]
    state[MEMORY.engaged] = 1.0
    return _OK


@njit
def follow(nav, time_ns, times_ns, points, k, state, out):
    """One step of the outer loop along a trajectory: shaped reference, then `position_law`.

    Parameters
    ----------
    nav, k, state, out
        As for `position_law`.
    time_ns : int
        Time since the trajectory's own start.
    times_ns, points : ndarray
        See `heli_math.trajectory.Trajectory`.

    Returns
    -------
    int
        An OuterStatus.
    """
    ref = np.empty(SHAPED.size)
    shaped_reference_at(time_ns, k.shaping_ns, k.heading_lead_s, times_ns, points, ref)
    if state[MEMORY.ground] == STANDS:
        return _stand(nav, ref, k, state, out)
    code = position_law(nav, ref, k, state, out)
    if k.sweep.shape != 0:
        add_sweep(time_ns / NS_PER_S, k.sweep, out)
    return code
