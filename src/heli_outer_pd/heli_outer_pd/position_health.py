# SPDX-License-Identifier: Apache-2.0
"""Whether the horizontal position is known, and what is flown while it is not.

Judged by the navigation's own standard deviation of the horizontal velocity. While it is too large
nothing is fed back horizontally: the attitude is that of hover with the lean that the wind took
while the aircraft was at rest, and what the reference itself accelerates. Vertical and heading go
on as before; barometer, inertial sensors and magnetometer serve them.
"""

import math

from heli_core.jit import copy, fill, is_zero, njit, scratch
from heli_core.rotations import wrap_pi
from heli_core.rows import NAV, SHAPED
from heli_outer_pd.disturbance import clip, to_heading
from heli_outer_pd.failsafes import Action, Condition, severest
from heli_outer_pd.modes import LANDING, STEERED, Fact, Phase, decide
from heli_outer_pd.state import (
    ALTITUDE_LOST,
    ALTITUDE_REACQUIRED,
    ALTITUDE_VALID,
    FLIES,
    LEAVES,
    MACHINE,
    MEMORY,
    POSITION_LOST,
    POSITION_REACQUIRED,
    POSITION_VALID,
    ROTOR_DRIVEN,
    ROTOR_LANDED,
    SERVO_DEGRADED,
    SERVO_NOMINAL,
    SERVO_STUCK,
    OuterState,
)

# -------------------------------------------------------------------------------------------------
# A fix after a gap moves the navigation by metres: the reference is moved with it, and back again.
#
# What is flown back then is a way at a limited speed, not a step of the error.
# -------------------------------------------------------------------------------------------------

_BACK_S, _BACK_MPS, _BACK_DOWN_MPS = 2.0, 1.0, 0.3
"""Time constant, largest speed and largest vertical speed with which the reference goes back."""
_GONE_M = 1e-3


@njit
def remember_place(nav, state):
    """Where the navigation puts the aircraft at this step."""
    copy(state.x[MEMORY.was_pos], nav[NAV.pos][:2])
    copy(state.x[MEMORY.was_vel], nav[NAV.vel][:2])


@njit
def _moved_m(nav, k, state):
    """How far a fix has moved the navigation since the last step: beyond what it has flown."""
    pos, vel = state.x[MEMORY.was_pos], state.x[MEMORY.was_vel]
    north = nav[NAV.pos][0] - pos[0] - k.dt_s * vel[0]
    east = nav[NAV.pos][1] - pos[1] - k.dt_s * vel[1]
    return math.hypot(north, east)


@njit
def position_reset(nav, k, state):
    """Move the reference by what a fix has moved the navigation.

    The estimate takes the velocity as it comes: a correction is no gust.
    """
    shift, estimate = state.x[MEMORY.shift], state.x[MEMORY.vel]
    pos, vel = state.x[MEMORY.was_pos], state.x[MEMORY.was_vel]
    for i in range(2):
        shift[i] += nav[NAV.pos][i] - pos[i] - k.dt_s * vel[i]
        estimate[i] += nav[NAV.vel][i] - vel[i]


@njit
def begin_at_height(nav, ref, state):
    """Move the reference (10,), as it comes, to the height at which the navigation is."""
    state.x[MEMORY.shift][2] = nav[NAV.pos][2] - ref[SHAPED.pos][2]


@njit
def move_reference(ref, k, state):
    """Move the reference (10,) by what is left, which goes back to nothing."""
    shift, rate = state.x[MEMORY.shift], scratch(3)
    if is_zero(shift):
        return
    level = math.hypot(shift[0], shift[1])
    rate[0] = rate[1] = min(1.0 / _BACK_S, _BACK_MPS / max(level, _GONE_M))
    rate[2] = min(1.0 / _BACK_S, _BACK_DOWN_MPS / max(abs(shift[2]), _GONE_M))
    for i in range(3):
        speed = -rate[i] * shift[i]
        shift[i] += k.dt_s * speed
        ref[SHAPED.pos][i] += shift[i]
        ref[SHAPED.vel][i] += speed
    if level + abs(shift[2]) < _GONE_M:
        for i in range(3):
            shift[i] = 0.0


# -------------------------------------------------------------------------------------------------
# Altitude without a sensor that knows it: descend on fixed thrust.
#
# Without fixes and barometer the vertical velocity is the integral of an accelerometer, and its
# error
# grows without bound. What does not drift is the rotor: at a thrust that carries the weight it
# climbs
# or sinks at the speed at which its map gives that thrust, and its own damping holds this. So the
# collective is that of the descent that is wanted, with the disturbance as it was at rest; of the
# navigation's velocity what is fast is fed back, what is slow is its error.
#
# That the ground carries it shows in the same way: thrust is taken away for a moment now and then,
# and in the air that speeds up the descent at once, which the accelerometer sees.
# -------------------------------------------------------------------------------------------------

_BY_THRUST_AGAIN, _LANDING = 0.8, 0.5
"""Known again with so much of the limit; in a landing the limit is so much of it."""
_LASTS_S = 1.0
"""Not known for so long: an IMU that stops for a moment leaves a doubt that the next fixes take."""
_BY_THRUST_MEAN_S = 10.0
"""The disturbance is averaged over so long."""
_FAST_S, _DAMPING = 2.0, 1.5
"""What is faster than the first, s, is fed back by the second, 1/s. A velocity whose error grows by
a m/s2 costs a times both over the rotor's own damping."""
_HEAVE, _BY_THRUST_MPS = 0.7, 0.5
"""The rotor's own damping, 1/s; what thrust alone leaves of the speed, sigma: translational lift,
a rotor weaker than its map."""
_CHANGE_MPS2 = 0.5
"""So fast the descent's speed is changed."""
_LATE_M, _HASTE = 2.0, 0.2
"""Where it should be so far below the ground it sinks too slowly: faster by so much, 1/s, of it."""
_EVERY_S, _EASE_MPS3, _MOST_MPS2, _FALLS_MPS = 3.0, 3.0, 4.5, 0.35
"""So often thrust is taken away, more and more, to the most, until it has sped up by the last."""


@njit
def sigma_of_climb(nav):
    """Standard deviation of the vertical velocity, m/s; 0 where none is said."""
    most = 0.0
    for sigma in nav[NAV.sigma_vel][2:]:
        if sigma > most:
            most = sigma
    return most


@njit
def look_down(nav, k, state):
    """Bring up to a navigation row whether the vertical velocity is known."""
    blind = state.machine[MACHINE.altitude] == ALTITUDE_LOST
    limit = k.blind_sigma_down * (_LANDING if state.x[MEMORY.lands] > 0.5 else 1.0)
    doubtful = sigma_of_climb(nav) > limit * (_BY_THRUST_AGAIN if blind else 1.0)
    state.x[MEMORY.doubt_s] = state.x[MEMORY.doubt_s] + k.dt_s if doubtful else 0.0
    if doubtful and (blind or state.x[MEMORY.doubt_s] > _LASTS_S):
        if not blind:
            state.x[MEMORY.takes_over] = 1.0
            state.x[MEMORY.sink_mps], state.x[MEMORY.slow_mps] = nav[NAV.down_vel], 0.0
            state.x[MEMORY.probe_s] = state.x[MEMORY.eased_mps2] = 0.0
            state.x[MEMORY.sunk_m] = nav[NAV.pos][2]
        state.machine[MACHINE.altitude] = ALTITUDE_LOST
    elif blind and not doubtful:
        state.x[MEMORY.takes_over] = 1.0
        state.machine[MACHINE.altitude] = ALTITUDE_REACQUIRED


@njit
def remember_thrust(k, state):
    """Average what thrust is missing in the air while position and speed are known."""
    if (
        state.machine[MACHINE.guidance] == LEAVES
        or state.machine[MACHINE.position] != POSITION_VALID
    ):
        return
    if state.machine[MACHINE.altitude] == ALTITUDE_VALID and state.x[MEMORY.engaged] > 0.5:
        error = state.x[MEMORY.disturbance][2] - state.x[MEMORY.rest_down]
        state.x[MEMORY.rest_down] += k.dt_s / _BY_THRUST_MEAN_S * error


@njit
def _ease(v_down, k, state):
    """Thrust that is taken away to feel for the ground, m/s2."""
    state.x[MEMORY.probe_s] += k.dt_s
    eased = state.x[MEMORY.eased_mps2]
    if eased == 0.0:
        if state.x[MEMORY.probe_s] < _EVERY_S:
            return 0.0
        state.x[MEMORY.probe_mps] = v_down
    elif v_down - state.x[MEMORY.probe_mps] > _FALLS_MPS:
        state.x[MEMORY.probe_s] = state.x[MEMORY.eased_mps2] = 0.0
        return 0.0
    state.x[MEMORY.eased_mps2] = min(eased + _EASE_MPS3 * k.dt_s, _MOST_MPS2)
    return state.x[MEMORY.eased_mps2]


@njit
def sink(nav, ref, k, state, d_h):
    """Fly on, or land on fixed thrust: changes reference (10,) and disturbance d_h (3,)."""
    v_down, wanted, eased = nav[NAV.down_vel], 0.0, 0.0
    if state.x[MEMORY.lands] > 0.5 and ref[SHAPED.down_vel] > 0.0:
        late_m = max(state.x[MEMORY.sunk_m] - state.x[MEMORY.ground_m] - _LATE_M, 0.0)
        wanted = k.blind_descent_mps + _HASTE * late_m
        eased = _ease(v_down, k, state)
    state.x[MEMORY.sink_mps] += clip(wanted - state.x[MEMORY.sink_mps], _CHANGE_MPS2 * k.dt_s)
    state.x[MEMORY.sunk_m] += k.dt_s * min(state.x[MEMORY.sink_mps], k.blind_descent_mps)
    fast = v_down - state.x[MEMORY.sink_mps] - state.x[MEMORY.slow_mps]
    state.x[MEMORY.slow_mps] += (1.0 - math.exp(-k.dt_s / _FAST_S)) * fast
    ref[SHAPED.pos][2] = nav[NAV.pos][2]
    ref[SHAPED.down_vel], ref[SHAPED.acc][2] = state.x[MEMORY.sink_mps], 0.0
    state.x[MEMORY.vel][2], state.x[MEMORY.disturbance][2] = v_down, state.x[MEMORY.rest_down]
    # Of two witnesses of the speed the surer one has more weight.
    doubt = sigma_of_climb(nav) / _BY_THRUST_MPS
    steady = min(_HEAVE / (doubt * doubt), k.K_D[2])
    over = v_down - state.x[MEMORY.sink_mps]
    back = steady * over + max(_DAMPING - steady, 0.0) * fast
    if eased > 0.0:
        back = steady * (state.x[MEMORY.probe_mps] - state.x[MEMORY.sink_mps])
    # The controller itself feeds back K_D times all of the difference.
    d_h[2] = state.x[MEMORY.rest_down] - k.K_D[2] * over + back - eased


# -------------------------------------------------------------------------------------------------
# Position health.
# -------------------------------------------------------------------------------------------------

_HOLDING = (Phase.HOVER, Phase.TRAJECTORY)
_AGAIN, _DOUBT, _JUMPS = 0.5, 0.2, 0.1
"""Known again with so much of the limit; a position that is better known jumps by little in a
landing, or anywhere."""
_SETTLES_S, _MOVED_M = 2.0, 0.01
"""So long the fixes after a gap move it, each by less; no motion moves it by the second in a step.
"""
_FUSED, _LESS = 0.94, 0.985
"""Sigma falls to less than so much of it where a fix is fused, several times a second, and only
there: how the aircraft shakes changes it by less. By less than that it falls where links are late;
then the fix is told by what it moves, too."""
_STRETCH_S = 0.07
"""What sigma falls below is remembered for one to two times as long: so long a vibration lasts."""
_GAP_S = 1.0
"""Without a fix for so long is a gap: several come a second, and links may lose two in a row."""
_GROWTH_S, _BEGINS_S = 0.5, 1.5
"""How fast sigma grows is averaged over the first; a landing takes the second to begin, and to be
told by the ground that it is over."""
_LEVEL_M = 1.0
"""Below this height the lean is held: the skids are 0.25 m below the navigation, which may be some
decimetres off."""
_REST_MPS, _MEAN_S, _TURNED_RAD = 1.0, 10.0, 0.3
"""At rest is slower than the first; the disturbance there is averaged over the second."""


def health_fact(phase: Phase, state: OuterState, low: bool) -> Fact | None:
    """The rotor slow, or at its speed again; position lost, or to be landed without for long; or
    found again, unless the ground is too near (`low`) to begin anew.

    None where that means nothing in a phase.
    """
    if (spun := _spun(phase, state.machine[MACHINE.rotor])) is not None:
        return spun
    fact, gone = None, state.x[MEMORY.gone] > 0.5
    if state.machine[MACHINE.position] == POSITION_LOST or gone:
        # At once, whatever it followed: a node has its phases from another moment on than a loop.
        long = gone and decide(phase, Fact.BLIND_LONG) is not None
        fact = Fact.BLIND_LONG if long else Fact.BLIND
    elif state.machine[MACHINE.position] == POSITION_REACQUIRED and not low:
        fact = Fact.FOUND
    return fact if fact is not None and decide(phase, fact) is not None else None


def _spun(phase: Phase, spin: int) -> Fact | None:
    """What is so of the rotor that means something in a phase."""
    if phase == Phase.AUTOROTATING:
        return {ROTOR_DRIVEN: Fact.ROTOR_BACK, ROTOR_LANDED: Fact.TOUCHED_DOWN}.get(spin)
    slow = spin != ROTOR_DRIVEN and decide(phase, Fact.ROTOR_SLOW) is not None
    return Fact.ROTOR_SLOW if slow else None


def mode_in_words(phase: Phase, held: str) -> str:
    """What is flown in a phase while the position is known; `held` where one is held."""
    if phase.mode in _HOLDING:
        return held
    return phase.mode if phase.mode == phase else f"{phase.mode}: {phase}"


def plight(phase: Phase) -> str:
    """What is flown in a phase while the position is lost, in a sentence."""
    if phase in LANDING:
        return "position lost: level descent on the barometer, no place is held"
    if phase.on_ground or phase in STEERED:
        return f"position lost: {phase.mode}"
    return "position lost: level at its altitude, no place is held; land, or take the sticks"


def flown_in_words(phase: Phase, state: OuterState, held: str) -> str:
    """What is flown in a phase, in a sentence, by a controller's state; `held`: with a place."""
    if state.machine[MACHINE.rotor] != ROTOR_DRIVEN:
        return "rotor slow: autorotation"
    if state.machine[MACHINE.altitude] != ALTITUDE_VALID:
        return "altitude lost: fixed-thrust (open-loop) descent"
    if state.machine[MACHINE.position] != POSITION_VALID:
        return plight(phase)
    if state.x[MEMORY.gone] > 0.5:
        return "position astray: lands where dead reckoning leads"
    return unfollowed(state.machine[MACHINE.servo]) or mode_in_words(phase, held)


def unfollowed(soft: float) -> str:
    """What is wrong with how the attitude follows, in a sentence; empty if nothing is."""
    if soft == SERVO_DEGRADED:
        return "attitude not followed: flown softly, as a servo may be slow; land"
    if soft == SERVO_STUCK:
        return "attitude not followed: a servo may be stuck, or commands are late; do not land"
    return ""


def answer(phase: Phase, state: OuterState) -> Action:
    """What the aircraft does in a phase for want of a position, a vertical or a rotor speed."""
    wants = [Condition.ROTOR_SLOW] if state.machine[MACHINE.rotor] != ROTOR_DRIVEN else []
    if state.machine[MACHINE.position] != POSITION_VALID:
        wants.append(Condition.POSITION_LOST)
        wants += [Condition.POSITION_LOST_LONG] if phase in LANDING else []
    if state.machine[MACHINE.altitude] != ALTITUDE_VALID:
        wants.append(Condition.ALTITUDE_LOST)
    elif state.x[MEMORY.gone] > 0.5:
        wants.append(Condition.POSITION_ASTRAY)
    if state.machine[MACHINE.servo] != SERVO_NOMINAL:
        soft = state.machine[MACHINE.servo] == SERVO_DEGRADED
        wants.append(Condition.SERVO_SLOW if soft else Condition.SERVO_STUCK)
    return severest(wants)


@njit
def sigma_of_speed(nav):
    """The larger standard deviation of the horizontal velocity, m/s; 0 where none is said."""
    most = 0.0
    for sigma in nav[NAV.sigma_vel][:2]:
        if sigma > most:
            most = sigma
    return most


@njit
def well_known(nav, k, state):
    """Whether the position is known so well that it would count as found again."""
    return (
        state.machine[MACHINE.position] == POSITION_VALID
        and sigma_of_speed(nav) <= _AGAIN * k.blind_sigma
    )


@njit
def begin_above(offset_down_m, state):
    """The reference was moved, NED, m, to where the flight begins: it says how high that is."""
    state.x[MEMORY.ground_off_m], state.x[MEMORY.ground_known] = offset_down_m, 1.0


@njit
def ground_begun_m(state):
    """Where the ground is by where the flight has begun, NED, m."""
    return state.x[MEMORY.ground_m] + state.x[MEMORY.ground_off_m]


@njit
def meets_ground(nav, state):
    """Whether a landing by dead reckoning is about to end, where the height of the ground is known.

    The skids then stop a speed that the navigation does not know of; it would lean against that.
    """
    lands = state.x[MEMORY.gone] > 0.5 and state.x[MEMORY.lands] > 0.5
    low = ground_begun_m(state) - nav[NAV.pos][2] < _LEVEL_M
    return lands and low and state.x[MEMORY.ground_known] > 0.5


@njit
def time_down_s(height_m, known, k):
    """Time (s) that a landing by dead reckoning takes from a height (m), at rest, to the ground.

    `known`: whether the height of the ground is.
    """
    height, fast, touch = max(height_m, 0.0), k.quick_mps[0], k.quick_mps[1]
    if not known:
        return height / k.quick_mps[2] + _BEGINS_S
    last_m = max(fast - touch, 0.0) * k.flare_s
    last = k.flare_s * math.log1p(min(height, last_m) / (touch * k.flare_s))
    return last + max(height - last_m, 0.0) / fast + _BEGINS_S


@njit
def _count(nav, sigma, last, along, k, state):
    """For how long no position is known, how far that has led astray; and whether it should land.

    Counted where a reference is flown: by hand the pilot decides. The velocity's sigma is carried
    on to the ground as it grows now; what is far enough to land for is so until a fix is fused.
    """
    lost = state.machine[MACHINE.position] == POSITION_LOST
    state.x[MEMORY.lost_s] += k.dt_s if lost and along else -state.x[MEMORY.lost_s]
    before = state.x[MEMORY.sigmas]
    # A vibration makes sigma rise and fall again; a fix makes it fall below what it was.
    fell = sigma < _FUSED * min(last, before[0], before[1])
    before[0] = min(before[0], last)
    state.x[MEMORY.stretch_s] += k.dt_s
    if state.x[MEMORY.stretch_s] > _STRETCH_S:
        before[1], before[0], state.x[MEMORY.stretch_s] = before[0], last, 0.0
    fell = fell or (sigma < _LESS * last and _moved_m(nav, k, state) > _MOVED_M)
    fused = not along or fell or sigma < _JUMPS * k.blind_sigma
    if fused:
        state.x[MEMORY.astray_m] = state.x[MEMORY.silent_s] = state.x[MEMORY.growth_mps2] = 0.0
    else:
        state.x[MEMORY.astray_m] += k.dt_s * sigma
        state.x[MEMORY.silent_s] += k.dt_s
        grows = (sigma - last) / k.dt_s - state.x[MEMORY.growth_mps2]
        state.x[MEMORY.growth_mps2] += k.dt_s / _GROWTH_S * grows
    known = state.x[MEMORY.ground_known] > 0.5
    down_s = time_down_s(ground_begun_m(state) - nav[NAV.pos][2], known, k)
    ahead_m = down_s * (sigma + 0.5 * down_s * max(state.x[MEMORY.growth_mps2], 0.0))
    far = state.x[MEMORY.astray_m] + ahead_m > k.land_astray_m
    far = far and state.x[MEMORY.silent_s] > k.land_silent_s
    if far:
        state.x[MEMORY.astray_m] = max(state.x[MEMORY.astray_m], k.land_astray_m)
    long = far or state.x[MEMORY.lost_s] > k.land_after_s
    state.x[MEMORY.gone] = 1.0 if long or state.machine[MACHINE.altitude] != ALTITUDE_VALID else 0.0


@njit
def look(nav, k, state):
    """Bring what is known up to a navigation row; True at the step at which fixes have come back.

    What flies along a reference waits for another one that begins where the aircraft is: FOUND.
    """
    reacquired = _look(nav, k, state)
    remember_place(nav, state)
    return reacquired


@njit
def _jumps(nav, sigma, last, silent_s, k, state):
    """Whether a fix has come after a gap (no fix for silent_s), or soon after such a one."""
    state.x[MEMORY.settles_s] = max(state.x[MEMORY.settles_s] - k.dt_s, 0.0)
    fused = silent_s > _GAP_S and state.x[MEMORY.silent_s] == 0.0
    if fused and last > _JUMPS * k.blind_sigma:
        state.x[MEMORY.settles_s] = _SETTLES_S
    return state.x[MEMORY.settles_s] > 0.0 and _moved_m(nav, k, state) > _MOVED_M


@njit
def _look(nav, k, state):
    """As `look`."""
    sigma, before, last = (
        sigma_of_speed(nav),
        state.machine[MACHINE.position],
        state.x[MEMORY.sigma],
    )
    along = state.machine[MACHINE.guidance] == FLIES or state.machine[MACHINE.guidance] == LEAVES
    state.x[MEMORY.sigma] = sigma
    if along:
        look_down(nav, k, state)
    else:
        state.machine[MACHINE.altitude] = ALTITUDE_VALID
        fill(state.x[MEMORY.shift], 0.0)
    silent_s = state.x[MEMORY.silent_s]
    _count(nav, sigma, last, along, k, state)
    if sigma > k.blind_sigma:
        state.machine[MACHINE.position] = POSITION_LOST
        if along and before == POSITION_VALID:
            state.x[MEMORY.takes_over] = 1.0
        return False
    jumps = _jumps(nav, sigma, last, silent_s, k, state)
    again = before != POSITION_VALID and sigma < _AGAIN * k.blind_sigma
    # A landing that nearly lost it is as far off when the fixes come back.
    fell = last > _DOUBT * k.blind_sigma and sigma < _AGAIN * last
    again = again or (before == POSITION_VALID and fell and state.x[MEMORY.lands] > 0.5)
    if along and before == POSITION_VALID and jumps:
        position_reset(nav, k, state)
        state.x[MEMORY.takes_over] = 1.0
    if not again or math.isnan(nav[NAV.down_vel]):
        return False
    state.machine[MACHINE.position] = POSITION_REACQUIRED if along else POSITION_VALID
    if not along or before == POSITION_REACQUIRED:
        return False
    state.x[MEMORY.takes_over] = 1.0
    return True


@njit
def remember_lean(nav, psi, k, state):
    """Average the disturbance while the aircraft is at rest; anew where its nose has turned.

    The side is larger than the front, so what pushes has turned with it.
    """
    north, east = nav[NAV.vel][0], nav[NAV.vel][1]
    if state.machine[MACHINE.guidance] == LEAVES or math.hypot(north, east) > _REST_MPS:
        return
    if abs(wrap_pi(psi - state.x[MEMORY.rest_psi])) > _TURNED_RAD:
        state.x[MEMORY.rested_s], state.x[MEMORY.rest_psi] = 0.0, psi
    state.x[MEMORY.rested_s] = min(state.x[MEMORY.rested_s] + k.dt_s, _MEAN_S)
    mean, disturbance = state.x[MEMORY.rest], state.x[MEMORY.disturbance]
    for i in range(2):
        mean[i] += k.dt_s / state.x[MEMORY.rested_s] * (disturbance[i] - mean[i])


@njit
def hold_lean(nav, ref, c, s, state, d_h):
    """Fly on by what is remembered: reference (10,) and disturbance d_h (3,), horizontally.

    The estimate is held, too, and takes the navigation's velocity as it comes, so that a correction
    of it is no gust. c, s are of the heading.
    """
    for i in range(2):
        ref[SHAPED.pos][i], ref[SHAPED.vel][i] = nav[NAV.pos][i], nav[NAV.vel][i]
        state.x[MEMORY.vel][i] = nav[NAV.vel][i]
        state.x[MEMORY.disturbance][i] = state.x[MEMORY.rest][i]
    down = d_h[2]
    to_heading(state.x[MEMORY.disturbance], c, s, d_h)
    d_h[2] = down
