# SPDX-License-Identifier: Apache-2.0
"""The controller's disturbance: an observer beside its own model, and how it begins."""

import math

from heli_core.jit import fill, njit, scratch
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, SETPOINT
from heli_outer_pd.state import (
    FLIES,
    LEAVES,
    LOW_BY_HAND,
    MACHINE,
    MEMORY,
    ROTOR_AUTOROTATES,
    ROTOR_DRIVEN,
    ROTOR_LANDED,
    SERVO_DEGRADED,
    SERVO_NOMINAL,
    SERVO_STUCK,
    STEERED,
    thrust_for_collective,
)

# -------------------------------------------------------------------------------------------------
# Whether the attitude follows what is commanded, and how softly is flown while it does not.
#
# A servo that has grown slow turns brisk loops into a growing oscillation, first where a GPS of
# metres steps the set-point. What shows it is the attitude, which is not where the attitude loop
# would have brought it: the difference to the command behind that loop's lag. How much it swings,
# over a second, stays below `failsafe.unfollowed_deg` in flights without a fault.
#
# Beyond, position is held softly: small gains and tilts, and of the command only a part, the rest
# is
# the attitude as it is. That takes four fifths of its stiffness from the attitude loop and
# leaves
# its damping: little is asked of the servo's speed, and the oscillation dies. A servo that is
# stuck
# follows that no better: the attitude hangs to one side. Then the gains are as before: with them
# the
# other axes hold what they can. What has become calm has its gains again, each time later. Where
# messages are late the attitude swings, too, and soft flight would be worse: that is told by how
# quickly it swings, or by navigation that is late itself.
# -------------------------------------------------------------------------------------------------

_MEAN_S = 1.0
_HANGS, _HALF, _HANGS_S, _FAR = 0.6, 0.5, 2.0, 2.0
"""It hangs to one side if its mean has so much of its mean square, at half the limit, for so long;
or at once if its mean is so many times the limit."""
_TRIED_S, _LATE = 4.0, 0.3
_END, _LATELY_S, _BRISK = 0.8, 3.0, 1.75
"""A slow servo's first swing is slow and is found out before the second; where commands come late
they come and go every 1.2 s: so often over the last seconds it is not a servo."""
_CALM_S = 5.0
"""Below half the limit for so long, each time twice as long, it has its gains again."""
_TURNED_RAD, _TURNS_RADPS = math.radians(30.0), 1.5
K_P_SHARE, K_D_SHARE, AS_IT_IS = 0.1, 0.3, 0.8
"""In soft flight, of the horizontal gains, and of those of the disturbance's observer (l2, l1): the
bandwidth falls to a third, damping grows; of the attitude as it is in what is commanded."""
SOFT_TILT_RAD = math.radians(15.0)


@njit
def gain_share(state):
    """Share of the gains that act on what is off: 1.0 unless it flies softly."""
    return K_P_SHARE if state.machine[MACHINE.servo] == SERVO_DEGRADED else 1.0


@njit
def damping_share(state):
    """Share of the gains that act on speeds."""
    return K_D_SHARE if state.machine[MACHINE.servo] == SERVO_DEGRADED else 1.0


@njit
def limit_acceleration(a, k, state):
    """Cut the wanted acceleration (3,), horizontally and in place, to that of a small tilt."""
    if state.machine[MACHINE.servo] == SERVO_DEGRADED:
        limit = k.g * math.tan(SOFT_TILT_RAD)
        for i in range(2):
            a[i] = min(max(a[i], -limit), limit)


@njit
def blend_attitude(phi, theta, state, out):
    """Bring the commanded roll and pitch of out (4,) near those that are flown, rad."""
    if state.machine[MACHINE.servo] == SERVO_DEGRADED:
        out[SETPOINT.phi] += AS_IT_IS * (phi - out[SETPOINT.phi])
        out[SETPOINT.theta] += AS_IT_IS * (theta - out[SETPOINT.theta])


@njit
def forget_swings(state):
    """Full gains, and nothing seen so far."""
    fill(state.x[MEMORY.off_mean], 0.0)
    fill(state.x[MEMORY.off_square], 0.0)
    fill(state.x[MEMORY.side], 0.0)
    fill(state.x[MEMORY.turns], 0.0)
    state.machine[MACHINE.servo] = SERVO_NOMINAL
    state.x[MEMORY.calm_wanted_s] = 0.0


@njit
def watch_attitude(flown, psi, rate, k, state):
    """Bring up to what the attitude explains, (2,) m/s2, whether commands are followed.

    Only where the controller itself holds a place, and estimates the disturbance, behind that:
    there the command is known behind the attitude loop's lag. A nose that turns away takes roll and
    pitch along: nothing is said of their servos, and the full gains hold a place even so.
    """
    compensates = k.wind_compensation > 0.5 and k.hold_horizontal > 0.5 and k.sweep.shape == 0
    state.x[MEMORY.late] += k.dt_s / _MEAN_S * (state.x[MEMORY.is_late] - state.x[MEMORY.late])
    if state.machine[MACHINE.guidance] != FLIES or not compensates or state.x[MEMORY.late] > _LATE:
        forget_swings(state)
        return
    mean, square, lagged = (
        state.x[MEMORY.off_mean],
        state.x[MEMORY.off_square],
        state.x[MEMORY.lagged],
    )
    swings, brisk, hangs, calm, far = False, False, False, True, False
    for i in range(2):
        off = math.atan((flown[i] - lagged[i]) / k.g)
        mean[i] += k.dt_s / _MEAN_S * (off - mean[i])
        square[i] += k.dt_s / _MEAN_S * (off * off - square[i])
        turns = _turns(off, i, k, state)
        if square[i] - mean[i] ** 2 > k.unfollowed[i] ** 2:
            swings, brisk = True, brisk or turns > _BRISK
        beyond = square[i] > (_HALF * k.unfollowed[i]) ** 2
        hangs = hangs or (beyond and mean[i] ** 2 > _HANGS * square[i])
        calm = calm and not beyond
        far = far or abs(mean[i]) > _FAR * k.unfollowed[i]
    off_rad = abs(wrap_pi(psi - state.x[MEMORY.command][SETPOINT.psi]))
    turned = off_rad > _TURNED_RAD or abs(rate[2]) > _TURNS_RADPS
    stuck = ((swings and brisk) or far) and not turned
    _decide(swings and not turned, stuck, hangs or turned, calm, k, state)


@njit
def _turns(off, i, k, state):
    """How often an axis has lately swung from beyond one end to beyond the other."""
    side, turns, end = state.x[MEMORY.side], state.x[MEMORY.turns], _END * k.unfollowed[i]
    turns[i] -= k.dt_s / _LATELY_S * turns[i]
    if abs(off) > end:
        now = 1.0 if off > 0.0 else -1.0
        if side[i] * now < 0.0:
            turns[i] += 1.0
        side[i] = now
    return turns[i]


@njit
def _begin(calm_wanted_s, soft, state):
    """Fly on as SOFT or STUCK until it is calm for so long."""
    state.machine[MACHINE.servo], state.x[MEMORY.calm_wanted_s] = soft, calm_wanted_s
    state.x[MEMORY.hangs_s], state.x[MEMORY.calm_s], state.x[MEMORY.soft_s] = 0.0, 0.0, 0.0


@njit
def _decide(swings, stuck, hangs, calm, k, state):
    """The next of FULL, SOFT, STUCK."""
    soft, wanted_s = state.machine[MACHINE.servo], state.x[MEMORY.calm_wanted_s]
    lands = state.x[MEMORY.lands] > 0.5
    if soft == SERVO_NOMINAL:
        # A landing is no place for another try; what small gains have calmed once is a slow servo.
        if (swings or lands) and wanted_s > 0.0:
            _begin(2.0 * wanted_s, SERVO_DEGRADED, state)
        elif stuck:
            _begin(0.0, SERVO_STUCK, state)
        elif swings:
            _begin(_CALM_S, SERVO_DEGRADED, state)
        return
    state.x[MEMORY.hangs_s] = state.x[MEMORY.hangs_s] + k.dt_s if hangs else 0.0
    state.x[MEMORY.calm_s] = state.x[MEMORY.calm_s] + k.dt_s if calm else 0.0
    state.x[MEMORY.soft_s] += k.dt_s
    in_vain = swings and state.x[MEMORY.soft_s] > _TRIED_S
    if soft == SERVO_DEGRADED and (state.x[MEMORY.hangs_s] > _HANGS_S or in_vain):
        state.machine[MACHINE.servo] = SERVO_STUCK
    elif state.x[MEMORY.calm_s] > max(wanted_s, _CALM_S) and not lands:
        state.machine[MACHINE.servo], state.x[MEMORY.takes_over] = SERVO_NOMINAL, 1.0


# -------------------------------------------------------------------------------------------------
# Disturbance.
# -------------------------------------------------------------------------------------------------

_CALM_SHARE = 0.68
"""Of the vertical observer's bandwidth where the navigation is late: links that delay it lose
commands, too, and what was commanded and not flown must not be found as disturbance so fast."""


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
def kept(dt_s, lag_s):
    """Share of its state that a first-order lag keeps over a step; 0 without a lag."""
    return math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0


@njit
def thrust_acceleration(d_col, v_down, lift, k):
    """Acceleration down, m/s2, that a collective explains at a speed down, m/s; lift: share up."""
    thrust = thrust_for_collective(d_col, v_down, trim_thrust(k), k.trim[SETPOINT.col], k.rotor)
    return k.g - thrust * lift / k.mass


@njit
def modelled_acceleration(phi, theta, v_down, k, state, out):
    """Acceleration (3,) m/s2, heading frame, that the controller's model expects.

    Horizontally that of the measured tilt, so that the controller's command is an increment to what
    is flown: incremental nonlinear dynamic inversion (Smeur, de Croon, Chu, Control Engineering
    Practice 73, 2018, sec. 3). What the attitude loop leaves standing of its command for longer
    than `tilt_standing_s` counts as disturbance and is trimmed out with it; 0 s: all that it is off
    by, and the model is the commanded tilt behind the attitude loop's lag. Vertically the thrust of
    the commanded collective behind its lag, at the present speed, so that neither what is on its
    way nor the rotor's own damping is a disturbance. What flies softly has a servo that does not
    follow, and its model is the commanded tilt.
    """
    commanded, lagged, last = scratch(2), state.x[MEMORY.lagged], state.x[MEMORY.command]
    stands = state.x[MEMORY.stands]
    flown_acceleration(last[SETPOINT.phi], last[SETPOINT.theta], k, commanded)
    flown_acceleration(phi, theta, k, out)
    stay = kept(k.dt_s, k.tilt_standing_s)
    for i in range(2):
        keep = kept(k.dt_s, k.attitude_lag[i])
        lagged[i] = keep * lagged[i] + (1.0 - keep) * commanded[i]
        stands[i] = stay * stands[i] + (1.0 - stay) * (lagged[i] - out[i])
        soft = state.machine[MACHINE.servo] == SERVO_DEGRADED
        out[i] = lagged[i] if soft or stay == 0.0 else out[i] + stands[i]
    lift = math.cos(phi) * math.cos(theta)
    out[2] = thrust_acceleration(state.x[MEMORY.col_behind], v_down, lift, k)


@njit
def all_finite(values):
    """Whether no element of the vector is NaN or inf."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def flyable(nav):
    """Whether what the controller reads of the navigation row is finite."""
    pos, vel, attitude = nav[NAV.pos], nav[NAV.vel], nav[NAV.quat]
    return all_finite(pos) and all_finite(vel) and all_finite(attitude)


@njit
def estimate_disturbance(vel_h, a_h, k, state, c, s, d_h):
    """One step of the velocity/disturbance observer (Luenberger, forward Euler, every step).

    v_hat' = a_model + d_hat + l1 (v - v_hat), d_hat' = l2 (v - v_hat); kept in NED because steady
    wind stands still there while the nose turns. Writes the estimate to d_h (3,), heading frame.
    """
    v_hat = scratch(3)
    to_heading(state.x[MEMORY.vel], c, s, v_hat)
    to_heading(state.x[MEMORY.disturbance], c, s, d_h)
    for i in range(3):
        innovation = vel_h[i] - v_hat[i]
        l1, l2 = k.observer_l1[i], k.observer_l2[i]
        if i < 2:
            l1, l2 = damping_share(state) * l1, gain_share(state) * l2
        elif state.x[MEMORY.late] > _LATE:
            l1, l2 = _CALM_SHARE * l1, _CALM_SHARE * _CALM_SHARE * l2
        v_hat[i] += k.dt_s * (a_h[i] + d_h[i] + l1 * innovation)
        d_h[i] = clip(d_h[i] + k.dt_s * l2 * innovation, k.disturbance_limit[i])
    to_ned(v_hat, c, s, state.x[MEMORY.vel])
    to_ned(d_h, c, s, state.x[MEMORY.disturbance])


@njit
def engage(nav, phi, theta, k, state, c, s, d_h):
    """Bumpless start: what is flown is taken for equilibrium and so is the first command."""
    vel, estimate, lagged = nav[NAV.vel], state.x[MEMORY.vel], state.x[MEMORY.lagged]
    for i in range(3):
        estimate[i] = vel[i]
    flown_acceleration(phi, theta, k, lagged)
    fill(state.x[MEMORY.stands], 0.0)
    d_h[0] = clip(-lagged[0], k.disturbance_limit[0])
    d_h[1] = clip(-lagged[1], k.disturbance_limit[1])
    d_h[2] = 0.0  # what collective is flown is not known here: trim is assumed
    to_ned(d_h, c, s, state.x[MEMORY.disturbance])


@njit
def leave(vel, v_down, phi, theta, k, state):
    """Lift-off: the ground may still carry a part, so what it does is not taken for wind."""
    unused, estimate, d = scratch(3), state.x[MEMORY.vel], state.x[MEMORY.disturbance]
    if state.x[MEMORY.engaged] < 0.5:
        fill(state.x[MEMORY.stands], 0.0)
    else:
        modelled_acceleration(phi, theta, v_down, k, state, unused)
    for i in range(3):
        estimate[i], d[i] = vel[i], 0.0


@njit
def hover_share(d_col, k):
    """Thrust of a collective in still air as a share of that of hover."""
    return sinking_share(d_col, 0.0, k)


@njit
def sinking_share(d_col, down_mps, k):
    """The same in a descent (m/s), whose air through the rotor adds to its thrust."""
    thrust = trim_thrust(k)
    return thrust_for_collective(d_col, down_mps, thrust, k.trim[SETPOINT.col], k.rotor) / thrust


@njit
def _lag_collective(k, state):
    """One step of the collective as it acts: the last command behind its lag."""
    last, keep = state.x[MEMORY.command][SETPOINT.col], kept(k.dt_s, k.collective_lag_s)
    if state.x[MEMORY.engaged] < 0.5:
        keep = 0.0
    state.x[MEMORY.col_behind] = keep * state.x[MEMORY.col_behind] + (1.0 - keep) * last


@njit
def estimate(nav, phi, theta, c, s, k, state, d_h):
    """One step of what is known of the disturbance, into d_h (3,), m/s2, heading frame.

    c, s are of the heading; the rest as for `position_law`.
    """
    vel_h, a_h = scratch(3), scratch(3)
    to_heading(nav[NAV.vel], c, s, vel_h)
    _lag_collective(k, state)
    ground = state.machine[MACHINE.guidance]
    if ground == LEAVES or ground == LOW_BY_HAND:
        leave(nav[NAV.vel], nav[NAV.down_vel], phi, theta, k, state)
    elif k.wind_compensation > 0.5:
        if state.x[MEMORY.engaged] < 0.5:
            engage(nav, phi, theta, k, state, c, s, d_h)
        else:
            modelled_acceleration(phi, theta, nav[NAV.down_vel], k, state, a_h)
            estimate_disturbance(vel_h, a_h, k, state, c, s, d_h)


@njit
def flown_acceleration_ned(nav, k, state, out):
    """Acceleration (3,) m/s2, NED, of what is flown: by attitude, collective and estimate."""
    phi, theta, psi = euler_from_quat(nav[NAV.quat])
    a_h = scratch(3)
    flown_acceleration(phi, theta, k, a_h)
    lift = math.cos(phi) * math.cos(theta)
    a_h[2] = thrust_acceleration(state.x[MEMORY.col_behind], nav[NAV.down_vel], lift, k)
    to_ned(a_h, math.cos(psi), math.sin(psi), out)
    disturbance = state.x[MEMORY.disturbance]
    for i in range(3):
        out[i] += disturbance[i]


# -------------------------------------------------------------------------------------------------
# Whether the rotor is too slow, and whether the sensor that says so is to be believed.
#
# Its speed as a share of the governed one. A sensor is believed after some samples at the usual
# speed, and from there on as long as it goes on from sample to sample as a rotor can: what jumps,
# stands still to the last bit, is zero or silent is not believed until it says the usual speed
# again.
# So a sensor that fails says nothing of the rotor. One that drifts as slowly as a rotor might is
# believed.
# -------------------------------------------------------------------------------------------------

_USUAL, _SAMPLES = 0.03, 5
"""So near to the governed speed so many samples in a row are believed."""
_FALLS, _JITTER = 0.6, 0.012
"""Largest change from sample to sample: share per second, and what noise makes of it besides. With
the engine off the default aircraft loses 0.13 a second in hover."""
_SILENT_S = 0.1
_STUCK = 10
"""So many samples in a row the same to the last bit are no measurement."""
_AGAIN, _AGAIN_S, _SINKS_MPS = 0.97, 0.1, 6.0
"""At this share for so long an engine drives it; without one it stays below 0.93."""
_STILL_MPS, _STILL_S, _NEAR_M = 0.2, 0.32, 4.0
"""On the ground: it sinks no more, for so long, and is near it, as far as that is known."""


@njit
def hear_rotor(state, time_s, speed, k):
    """Take a sample of the rotor's speed, rad/s, stamped with a flight time, s.

    Parameters
    ----------
    state : OuterState
        Of the controller; changed in place.
    time_s : float
    speed : float
    k : OuterParams
    """
    since = time_s - state.x[MEMORY.rotor_s]
    if since <= 0.0:
        return
    share, last = speed / k.rotor.omega, state.x[MEMORY.rotor]
    state.x[MEMORY.rotor], state.x[MEMORY.rotor_s] = share, time_s
    state.x[MEMORY.rotor_same] = state.x[MEMORY.rotor_same] + 1.0 if share == last else 0.0
    sound = math.isfinite(share) and since < _SILENT_S and state.x[MEMORY.rotor_same] < _STUCK
    sound = sound and abs(share - last) <= _FALLS * since + _JITTER
    usual = abs(share - 1.0) < _USUAL
    if not sound or (state.x[MEMORY.rotor_sound] < _SAMPLES and not usual):
        state.x[MEMORY.rotor_sound] = 0.0
    elif usual and state.x[MEMORY.rotor_sound] < _SAMPLES:
        state.x[MEMORY.rotor_sound] += 1.0
    believed = state.x[MEMORY.rotor_sound] >= _SAMPLES
    if believed:
        state.x[MEMORY.rotor_known] = share
    slow = believed and share < k.rotor_slow_share
    state.x[MEMORY.slow_s] = state.x[MEMORY.slow_s] + since if slow else 0.0
    driven = believed and share > _AGAIN
    state.x[MEMORY.driven_s] = state.x[MEMORY.driven_s] + since if driven else 0.0


@njit
def watch_rotor(down_m, down_mps, k, state):
    """Bring up to a step of the controller whether it autorotates; not on the ground, nor by hand.

    Parameters
    ----------
    down_m, down_mps : float
        Of the navigation, NED.
    k : OuterParams
    state : OuterState
        Changed in place.
    """
    ground = state.machine[MACHINE.guidance]
    if not (ground == FLIES or ground == LEAVES or ground == STEERED):
        state.machine[MACHINE.rotor], state.x[MEMORY.still_s] = ROTOR_DRIVEN, 0.0
        return
    if state.machine[MACHINE.rotor] == ROTOR_DRIVEN:
        if state.x[MEMORY.slow_s] >= k.rotor_slow_s:
            state.machine[MACHINE.rotor], state.x[MEMORY.still_s] = ROTOR_AUTOROTATES, 0.0
        return
    if state.machine[MACHINE.rotor] == ROTOR_AUTOROTATES:
        if state.x[MEMORY.driven_s] >= _AGAIN_S and down_mps < _SINKS_MPS:
            state.machine[MACHINE.rotor], state.x[MEMORY.takes_over] = ROTOR_DRIVEN, 1.0
            return
        near = state.x[MEMORY.ground_m] - down_m < _NEAR_M
        still = near and abs(down_mps) < _STILL_MPS and state.x[MEMORY.rotor_known] < _AGAIN
        state.x[MEMORY.still_s] = state.x[MEMORY.still_s] + k.dt_s if still else 0.0
        if state.x[MEMORY.still_s] >= _STILL_S:
            state.machine[MACHINE.rotor] = ROTOR_LANDED
