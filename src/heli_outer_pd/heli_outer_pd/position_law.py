# SPDX-License-Identifier: Apache-2.0
"""PD position and altitude controller with a disturbance estimate: eq. (20) and (21), corrected.

eq. (20) prints a position where a thrust must stand; eq. (21) carries a misprinted K_D subscript.
Used here:

    T         = m (g + K_P (z - z_ref) + K_D (z' - z_ref') - z_ref'' + d_z) / (cos phi cos theta)
    theta_ref = theta_trim - sat(atan(a_x / g)),   phi_ref = phi_trim + sat(atan(a_y / g))
    a         = acc_ref + K_P (pos_ref - pos) + K_D (vel_ref - vel) - d

with z down (NED) and a rotated from NED to the heading frame; in (21) it goes through a lead that
makes up for part of the attitude loop's lag. d is the estimated acceleration that the controller's
own model does not explain (wind drag, a rotor weaker than its map). (21) prints asin(sat(a / g)),
which `exact_tilt: false` flies: as (20) holds the lift at any tilt, the thrust then accelerates
sideways by g tan, more than what was wanted (a fifth more at 35 deg). The trims stand in
front because a helicopter hangs sideways in still-air hover: the tail rotor's side force is
balanced by roll.
"""

import math

from heli_core.jit import copy, difference, fill, njit, scratch
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, SETPOINT, SHAPED
from heli_core.signals import add_sweep
from heli_core.ticks import NS_PER_S
from heli_outer_pd.disturbance import (
    all_finite,
    blend_attitude,
    clip,
    damping_share,
    estimate,
    flown_acceleration,
    flyable,
    forget_swings,
    gain_share,
    hover_share,
    limit_acceleration,
    thrust_acceleration,
    to_heading,
    to_ned,
    trim_thrust,
    watch_attitude,
    watch_rotor,
)
from heli_outer_pd.manual_controller import (
    above_floor,
    count_at_limit,
    least_thrust,
    manual_law,
    take_over,
)
from heli_outer_pd.position_health import (
    begin_at_height,
    hold_lean,
    look,
    meets_ground,
    move_reference,
    remember_lean,
    remember_thrust,
    sink,
)
from heli_outer_pd.reference import shaped_reference_at, window_of
from heli_outer_pd.state import (
    ALTITUDE_LOST,
    ALTITUDE_REACQUIRED,
    ALTITUDE_VALID,
    BY_HAND,
    FLIES,
    LEAVES,
    MACHINE,
    MEMORY,
    POSITION_VALID,
    ROTOR_DRIVEN,
    SERVO_DEGRADED,
    STANDS,
    STEERED,
    OuterParams,
    OuterState,
    OuterStatus,
    RotorMap,
    blade_pitch,
    collective_for_thrust,
    initial_state,
)

# -------------------------------------------------------------------------------------------------
# Down without an engine: what the rotor still holds, spent on a slow touch-down.
#
# The vertical speed follows a profile over the height above the ground: fast at first, which takes
# little power, then slower at a constant deceleration, and in the last part in proportion to the
# height. The blade pitch is that of the thrust map at the speed that the rotor has: as it slows
# down
# the pitch rises, until all that turns has been spent. Horizontally and in heading the position
# controller flies on, its tilt held small. Whether the rotor is slow: `rotor_watch`.
# -------------------------------------------------------------------------------------------------

_FASTEST_MPS, _TOUCH_MPS, _SLOWS_MPS2, _LAST_S = 9.0, 0.7, 5.0, 0.6
"""Of the profile: speed at most and at the ground, m/s; deceleration; height over speed at last, s.
These and the next ones are tuned from 10 m and 20 m, worlds honest and hard, seeds 1 to 6."""
_BACK = 4.0
"""A speed that is off is brought back so, 1/s."""
_LEAST, _MOST = 0.05, 2.0
"""Thrust over weight."""
_THROUGH_MPS = 2.0
"""The map is read at no faster descent: beyond it the air through the disc is turbulent."""
_SLOWEST = 0.35
"""Nor at a rotor speed below this share: there the blades stall."""
_GEAR_M = 0.25
"""Ground that is met before the navigation is at its height."""
_TILT_RAD = math.radians(20.0)
_COLLECTIVE_LIMIT = 0.98


@njit
def wanted_sink(height_m):
    """Speed down (m/s) at a height above the ground (m), and how fast it should fall (1/s)."""
    height = max(height_m, 0.0)
    slowing = math.sqrt(_TOUCH_MPS * _TOUCH_MPS + 2.0 * _SLOWS_MPS2 * height)
    last = _TOUCH_MPS + height / _LAST_S
    if slowing <= last:
        if slowing >= _FASTEST_MPS:
            return _FASTEST_MPS, 0.0
        return slowing, _SLOWS_MPS2 / slowing if height > 0.0 else 0.0
    if last >= _FASTEST_MPS:
        return _FASTEST_MPS, 0.0
    return last, 1.0 / _LAST_S if height > 0.0 else 0.0


@njit
def autorotate(nav, k, state, out):
    """Replace the collective of a command (4,), in place, and hold its tilt small.

    Parameters
    ----------
    nav : (31,) array
        Navigation row.
    k : OuterParams
    state : OuterState
        Of the controller, places of `MEMORY`; remembers the command and no disturbance downwards.
    out : (4,) array
        Places of `heli_core.rows.SETPOINT`.
    """
    down = nav[NAV.down_vel]
    wanted, slows = wanted_sink(state.x[MEMORY.ground_m] - nav[NAV.pos][2] - _GEAR_M)
    speeds_up = _BACK * (wanted - down) - slows * max(down, 0.0)
    share = min(max((k.g - speeds_up) / k.g, _LEAST), _MOST)
    r = k.rotor
    omega = r.omega * max(state.x[MEMORY.rotor_known], _SLOWEST)
    slow = RotorMap(r.rho, omega, r.radius, r.lift_slope, r.blades, r.chord, r.K_col)
    pitch = blade_pitch(share * k.mass * k.g, min(down, _THROUGH_MPS), slow)
    step = pitch - blade_pitch(trim_thrust(k), 0.0, r)
    out[SETPOINT.col] = clip(k.trim[SETPOINT.col] + step / r.K_col, _COLLECTIVE_LIMIT)
    last = state.x[MEMORY.command]
    for i in range(SETPOINT.psi):
        out[i] = k.trim[i] + clip(out[i] - k.trim[i], _TILT_RAD)
    for i in range(SETPOINT.size):
        last[i] = out[i]
    state.x[MEMORY.disturbance][2] = 0.0


# -------------------------------------------------------------------------------------------------
# Position controller.
# -------------------------------------------------------------------------------------------------

__all__ = [
    "FLIES",
    "LEAVES",
    "MACHINE",
    "MEMORY",
    "STANDS",
    "OuterParams",
    "OuterState",
    "OuterStatus",
    "flyable",
    "follow",
    "hover_share",
    "initial_state",
    "position_law",
    "tilt_for",
]
_N_SHAPED, _N_SETPOINT = SHAPED.size, SETPOINT.size
# Below this cos(phi) cos(theta) lift compensation no longer helps: the thrust points sideways.
_MIN_LIFT_FRACTION = 0.5
_OK = int(OuterStatus.OK)
_BAD_NAVIGATION = int(OuterStatus.BAD_NAVIGATION)
_BAD_REFERENCE = int(OuterStatus.BAD_REFERENCE)


@njit
def tilt_for(acceleration, k):
    """Tilt from trim, rad, that (21) commands for an acceleration, m/s2."""
    ratio = acceleration / k.g
    if k.exact_tilt > 0.5:
        return clip(math.atan(ratio), k.tilt_limit)
    return math.asin(clip(ratio, math.sin(k.tilt_limit)))


@njit
def _stand(nav, ref, k, state, out):
    """On the skids: the collective goes to its goal, the attitude is what the skids make it.

    What is commanded is the measured attitude, so that no error winds up against the ground, and
    becomes that of hover, leaning against what it slips, as the rotor takes over the second half
    of the weight.
    """
    last = state.x[MEMORY.command]
    step = state.x[MEMORY.col_rate] * k.dt_s
    col = last[SETPOINT.col] + clip(state.x[MEMORY.col_goal] - last[SETPOINT.col], step)
    known = flyable(nav)
    phi, theta, psi = last[SETPOINT.phi], last[SETPOINT.theta], last[SETPOINT.psi]
    if known:
        phi, theta, psi = euler_from_quat(nav[NAV.quat])
        share = min(max(2.0 * hover_share(col, k) - 1.0, 0.0), 1.0)
        slip = scratch(3)
        to_heading(nav[NAV.vel], math.cos(psi), math.sin(psi), slip)
        if state.machine[MACHINE.position] != POSITION_VALID or state.x[MEMORY.gone] > 0.5:
            fill(slip, 0.0)
        phi += share * (k.trim[SETPOINT.phi] + tilt_for(-k.K_D[1] * slip[1], k) - phi)
        theta += share * (k.trim[SETPOINT.theta] - tilt_for(-k.K_D[0] * slip[0], k) - theta)
        psi += share * wrap_pi(ref[SHAPED.psi] - psi)
    out[SETPOINT.phi], out[SETPOINT.theta], out[SETPOINT.psi] = phi, theta, psi
    out[SETPOINT.col] = col
    for i in range(SETPOINT.size):
        last[i] = out[i]
    fill(state.x[MEMORY.disturbance], 0.0)
    forget_swings(state)
    state.x[MEMORY.engaged] = 0.0
    return _OK if known else _BAD_NAVIGATION


@njit
def _with_lead(a, lead, led, c, s, k, state):
    """Lead a wanted acceleration (3,), in place: (1 + (T + L) s)/(1 + T s).

    L (n,) is `lead`, forward, right and, if n is 3, down; T `lead_filter_s`, `led` (n,) the
    filter's state. What is wanted is filtered in NED, where it stands still while the nose turns:
    else the lead would make much of the nose's least motion when bank holds against a side wind.
    The first one goes through as it is.
    """
    wanted, beyond = scratch(3), scratch(3)
    to_ned(a, c, s, wanted)
    if state.x[MEMORY.engaged] < 0.5 or state.x[MEMORY.takes_over] > 0.5:
        copy(led, wanted)
    keep = math.exp(-k.dt_s / k.lead_filter_s)
    for i in range(led.size):
        wanted[i] -= led[i]
        led[i] += (1.0 - keep) * wanted[i]
    to_heading(wanted, c, s, beyond)
    if state.machine[MACHINE.servo] == SERVO_DEGRADED:
        return
    for i in range(led.size):
        a[i] += lead[i] / k.lead_filter_s * beyond[i]


@njit
def _error_ahead_mps(nav, wanted_mps2, d_down, lift, k, state):
    """What the prediction adds to the error of the speed down (m/s).

    Thrust follows the collective late, by delay, servo and half a step: the error is taken where
    the new command acts, by what reference, thrust and disturbance make of it until then. Only in
    flight, and where disturbance and speed are known: on the ground the skids carry a part.
    """
    guidance = state.machine[MACHINE.guidance]
    flies = guidance == FLIES or guidance == STEERED
    known = k.wind_compensation > 0.5 and state.machine[MACHINE.altitude] == ALTITUDE_VALID
    if not (flies and known):
        return 0.0
    d_col = state.x[MEMORY.col_behind]
    flown_mps2 = thrust_acceleration(d_col, nav[NAV.down_vel], lift, k) + d_down
    return k.collective_prediction_s * (wanted_mps2 - flown_mps2)


@njit
def _command(nav, ref, d_h, c, s, lift, phi, theta, k, state, out):
    """PD action, lift compensation and the inversions of (20) and (21); writes out (4,)."""
    error, pos_error_h, vel_error_h, a = scratch(3), scratch(3), scratch(3), scratch(3)
    difference(ref[SHAPED.pos], nav[NAV.pos], error)
    to_heading(error, c, s, pos_error_h)
    difference(ref[SHAPED.vel], nav[NAV.vel], error)
    to_heading(error, c, s, vel_error_h)
    follows = scratch(3)
    to_heading(ref[SHAPED.acc], c, s, follows)
    vel_error_h[2] += _error_ahead_mps(nav, follows[2], d_h[2], lift, k, state)
    for i in range(3):
        K_P, K_D = k.K_P[i], k.K_D[i]
        if i < 2:
            K_P, K_D = gain_share(state) * K_P, damping_share(state) * K_D
        back = clip(K_P * pos_error_h[i], K_D * k.approach_speed_mps)
        a[i] = back + K_D * vel_error_h[i] - d_h[i]
    _with_lead(a, k.attitude_lead, state.x[MEMORY.led], c, s, k, state)
    # What the reference wants is known, and led by what attitude loop and collective lag behind.
    _with_lead(follows, k.reference_lead, state.x[MEMORY.led_reference], c, s, k, state)
    for i in range(3):
        a[i] += follows[i]
    limit_acceleration(a, k, state)
    if k.hold_horizontal > 0.5:
        out[SETPOINT.phi] = k.trim[SETPOINT.phi] + tilt_for(a[1], k)
        out[SETPOINT.theta] = k.trim[SETPOINT.theta] - tilt_for(a[0], k)
    else:
        out[SETPOINT.phi] = k.level_phi_theta[0]
        out[SETPOINT.theta] = k.level_phi_theta[1]
    blend_attitude(phi, theta, state, out)
    out[SETPOINT.psi] = ref[SHAPED.psi]
    weight = k.mass * k.g
    thrust = k.mass * (k.g - a[2]) / max(lift, _MIN_LIFT_FRACTION)
    thrust = min(max(thrust, least_thrust(k, state)), k.thrust_limits[1] * weight)
    # The inflow of the climb that the reference asks for is fed forward.
    d_col = collective_for_thrust(
        thrust, ref[SHAPED.down_vel], trim_thrust(k), k.trim[SETPOINT.col], k.rotor
    )
    d_col = above_floor(d_col, k)
    out[SETPOINT.col] = min(max(d_col, -_COLLECTIVE_LIMIT), _COLLECTIVE_LIMIT)


@njit
def position_law(nav, ref, k, state, out):
    """One step of the outer loop: eq. (20), (21).

    Parameters
    ----------
    nav : (>= 10,) ndarray
        Navigation row; position, velocity and attitude are used, and sigma of the velocity, if it
        is there.
    ref : (10,) ndarray
        Shaped reference, places of `heli_core.rows.SHAPED`; changed where no position is known.
    k : OuterParams
        Gains and limits.
    state : OuterState
        Updated in place; places of `MEMORY`.
    out : (4,) ndarray
        Written: places of `heli_core.rows.SETPOINT`, absolute.

    Returns
    -------
    int
        An OuterStatus. On anything but OK the last good output is repeated.
    """
    last = state.x[MEMORY.command]
    if not flyable(nav) or not all_finite(ref):
        for i in range(SETPOINT.size):
            out[i] = last[i]
        if not flyable(nav):
            return _BAD_NAVIGATION
        return _BAD_REFERENCE
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    c, s = math.cos(psi), math.sin(psi)
    d_h = scratch(3)
    fill(d_h, 0.0)
    estimate(nav, phi, theta, c, s, k, state, d_h)
    flown = scratch(2)
    flown_acceleration(phi, theta, k, flown)
    watch_attitude(flown, psi, nav[NAV.rate], k, state)
    if state.machine[MACHINE.altitude] == ALTITUDE_REACQUIRED:
        begin_at_height(nav, ref, state)
        state.machine[MACHINE.altitude] = ALTITUDE_VALID
    move_reference(ref, k, state)
    if state.machine[MACHINE.position] == POSITION_VALID and not meets_ground(nav, state):
        remember_lean(nav, psi, k, state)
    else:
        hold_lean(nav, ref, c, s, state, d_h)
    remember_thrust(k, state)
    if state.machine[MACHINE.altitude] == ALTITUDE_LOST:
        sink(nav, ref, k, state, d_h)
    _command(nav, ref, d_h, c, s, math.cos(phi) * math.cos(theta), phi, theta, k, state, out)
    for i in range(SETPOINT.size):
        last[i] = out[i]
    state.x[MEMORY.engaged] = 1.0
    return _OK


@njit
def _steered(nav, ref, k, state, out):
    """Attitude, climb and turn as a pilot's sticks command them; nothing holds the place.

    The reference (10,) becomes where the aircraft is and how it moves, so that of the controller
    the vertical, the heading and the estimate of the disturbance are left.
    """
    copy(ref[SHAPED.pos], nav[NAV.pos])
    copy(ref[SHAPED.vel], nav[NAV.vel])
    fill(ref[SHAPED.acc], 0.0)
    steer = state.x[MEMORY.steer_attitude]
    ref[SHAPED.pos][2] = state.x[MEMORY.steer_down]
    ref[SHAPED.down_vel] = state.x[MEMORY.steer_down_vel]
    ref[SHAPED.acc][2] = state.x[MEMORY.steer_down_acc]
    ref[SHAPED.psi] = steer[SETPOINT.psi]
    code = position_law(nav, ref, k, state, out)
    if code == _OK:
        last = state.x[MEMORY.command]
        for i in range(SETPOINT.psi):
            out[i] = last[i] = steer[i]
    return code


@njit
def follow(nav, time_ns, times_ns, points, k, state, out):
    """One step of the outer loop along a trajectory: shaped reference, then `position_law`.

    A step that finds its position again repeats the last command: the reference is elsewhere.

    Parameters
    ----------
    nav, k, state, out
        As for `position_law`.
    time_ns : int
        Time since the trajectory's own start.
    times_ns, points : ndarray
        See `heli_core.trajectory.Trajectory`.

    Returns
    -------
    int
        An OuterStatus.
    """
    ref, before = scratch(_N_SHAPED), scratch(_N_SETPOINT)
    shaped_reference_at(time_ns, window_of(k, state), k.heading_lead_s, times_ns, points, ref)
    ground, reacquired = state.machine[MACHINE.guidance], look(nav, k, state)
    watch_rotor(nav[NAV.pos][2], nav[NAV.down_vel], k, state)
    if ground == STANDS:
        return _stand(nav, ref, k, state, out)
    copy(before, state.x[MEMORY.command])
    if reacquired:
        copy(out, before)
        return _OK
    if ground >= BY_HAND:
        code = manual_law(nav, k, state, out)
    elif ground == STEERED:
        code = _steered(nav, ref, k, state, out)
    else:
        code = position_law(nav, ref, k, state, out)
    if code == _OK or ground >= BY_HAND:
        take_over(before, k, state, out)
    if code == _OK and state.machine[MACHINE.rotor] != ROTOR_DRIVEN:
        autorotate(nav, k, state, out)
    if k.sweep.shape != 0:
        add_sweep(time_ns / NS_PER_S, k.sweep, out)
    count_at_limit(state.x[MEMORY.command][SETPOINT.col], k, state)
    return code
