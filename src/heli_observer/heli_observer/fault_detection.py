# SPDX-License-Identifier: Apache-2.0
"""Tilt and biases solved again over the last seconds, where the inertial sensors are doubted.

A bias that jumps shows only after a while, as tilt that has grown and as velocity that grew with
it: three errors that belong together. Widening each for itself lets the next fixes share them out
wrongly, and far too much of it. So the filter keeps what it knew at each of the last fixes, and all
that it took since; when doubted it goes back to before the first refusal and takes the same samples
and fixes again, once with gyro biases that may have jumped, once with those of the accelerometers,
once with the attitude itself: two do not fail at once, and all together explain anything. What
surprised least on the way is believed, and with it the tilt and velocity that follow from it.
"""

import math

import numpy as np

from heli_core.jit import copy_matrix, copy_part, fill, njit
from heli_observer import layout as L
from heli_observer.buffers import replaced_for_long
from heli_observer.ekf import FUSED_IN_ORDER, fuse_aid, fuse_gps, predict

# -------------------------------------------------------------------------------------------------
# Whom to believe where fixes and inertial sensors contradict each other, and samples that nobody
#
# measured.
#
# A refused velocity tells who is wrong by how it goes on. A receiver that is off by a step stays
# off
# by it, since the inertial sensors have felt none: it is refused for as long as it keeps to that,
# however wide the gate opens meanwhile. What grows steadily is an error of tilt or of the inertial
# sensors, as no receiver accelerates: these are solved again over the last seconds (`relearn`).
# -------------------------------------------------------------------------------------------------

_AXES = 3  # of a velocity: degrees of freedom of its gate
FORCE_DENSITY, RATE_DENSITY = 0.6, 0.045
"""Of a sample that no sensor said, m/s2/sqrt(Hz), rad/s/sqrt(Hz): wrong by 1 m/s2 and 0.1 rad/s for
0.2 s and 0.1 s."""
FOLLOWS = 0.2
"""Part of what a fix says anew by which the offset of a refused receiver is followed."""
CERTAIN_FIXES = 10
"""Fixes after which it is certain that the receiver is off: only a step ends that."""
RETURNS = 0.5
"""Part of the offset that this step has at least; what the filter drifts is slower."""
MIN_FIXES, MAX_FIXES = 5, 25
"""Refused fixes over which growth is looked for."""
GROWTH_MPS2, GROWTH_SIGMA = 0.4, 4.0
"""What counts as growth: so much, and so many standard deviations."""
ATT_RAD, GYRO_RADPS, ACCEL_MPS2 = 0.1, 0.1, 1.0
"""By how much attitude or biases may then have jumped, sigma."""


@njit
def widen_covariance(P, dt_s):
    """Add to P (20, 20), in place, what a tick costs over which nothing was measured."""
    for i in range(3):
        P[L.ERROR.vel + i, L.ERROR.vel + i] += FORCE_DENSITY * FORCE_DENSITY * dt_s
        P[L.ERROR.att + i, L.ERROR.att + i] += RATE_DENSITY * RATE_DENSITY * dt_s


@njit
def _velocity_noise(i, k):
    return k.var_gps_vel_vertical if i == 2 else k.var_gps_vel_horizontal


@njit
def _whole(row):
    """Whether a fix (aid row) has a velocity."""
    for i in range(3):
        if not math.isfinite(row[L.AID.gps_vel + i]):
            return False
    return True


@njit
def is_certain(state):
    """Whether a receiver has been off by a velocity that stays for long enough."""
    return state.count[L.COUNT.gps_offset] >= CERTAIN_FIXES


@njit
def keeps_its_offset(state, row, k):
    """Whether a receiver that was refused is off by the same velocity still (aid row, EkfParams).

    It is not if it says something else; in the beginning, too, if its velocity agrees with what the
    filter was sure of when it was refused first. Later it may be the filter that has drifted there:
    then only a step from one fix to the next ends it that is like the one that began it.
    """
    x, heard, count = state.nominal, state.heard, state.count
    if count[L.COUNT.gps_offset] == 0 or not _whole(row):
        return False
    off, change, step_sq, noise = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        r, var = row[L.AID.gps_vel + i] - x[L.NOMINAL.vel + i], _velocity_noise(i, k)
        d, e = r - heard[L.HEARD.offset + i], r - heard[L.HEARD.off_last + i]
        off += r * r / (var + heard[L.HEARD.offset_var + i])
        change += d * d / (2.0 * var)
        step_sq += e * e
        noise += e * e / (2.0 * var)
        heard[L.HEARD.off_last + i] = r
    if is_certain(state):
        first = heard[L.HEARD.off_first]
        ended = noise > k.gates[_AXES] and step_sq > RETURNS * RETURNS * first * first
    else:
        ended = off <= k.gates[_AXES] or change > k.gates[_AXES]
    if ended:
        count[L.COUNT.gps_offset] = 0
        return False
    count[L.COUNT.gps_offset] += 1
    first_sq = 0.0
    for i in range(3):
        offset = heard[L.HEARD.offset + i]
        heard[L.HEARD.offset + i] = offset + FOLLOWS * (heard[L.HEARD.off_last + i] - offset)
        first_sq += heard[L.HEARD.offset + i] * heard[L.HEARD.offset + i]
    if count[L.COUNT.gps_offset] == CERTAIN_FIXES:
        heard[L.HEARD.off_first] = math.sqrt(first_sq)
    return True


@njit
def accept_velocity(state):
    """A velocity was fused: nothing counts against the receiver any more."""
    state.count[L.COUNT.gps_offset] = 0
    state.count[L.COUNT.gps_grows] = 0


@njit
def reject_velocity(state, row, time_s, k):
    """A velocity was refused: remember how it is off; True if that has grown steadily."""
    x, P, heard, count = state.nominal, state.P, state.heard, state.count
    if not _whole(row) or is_certain(state):
        return False
    if count[L.COUNT.gps_offset] == 0:
        count[L.COUNT.gps_offset] = 1
        for i in range(3):
            heard[L.HEARD.offset + i] = row[L.AID.gps_vel + i] - x[L.NOMINAL.vel + i]
            heard[L.HEARD.offset_var + i] = P[L.ERROR.vel + i, L.ERROR.vel + i]
            heard[L.HEARD.off_last + i] = heard[L.HEARD.offset + i]
    if count[L.COUNT.gps_grows] == 0 or count[L.COUNT.gps_grows] == MAX_FIXES:
        count[L.COUNT.gps_grows] = 0
        fill(heard[L.HEARD.fit : L.HEARD.off_last], 0.0)
        heard[L.HEARD.fit_began] = time_s
    count[L.COUNT.gps_grows] += 1
    n, t = count[L.COUNT.gps_grows], time_s - heard[L.HEARD.fit_began]
    heard[L.HEARD.fit] += t
    heard[L.HEARD.fit + 1] += t * t
    spread = heard[L.HEARD.fit + 1] - heard[L.HEARD.fit] * heard[L.HEARD.fit] / n
    growth_sq, certain = 0.0, 0.0
    for i in range(3):
        r = row[L.AID.gps_vel + i] - x[L.NOMINAL.vel + i]
        heard[L.HEARD.fit_sum + i] += r
        heard[L.HEARD.fit_moment + i] += t * r
        if spread > 0.0:
            moment = (
                heard[L.HEARD.fit_moment + i] - heard[L.HEARD.fit] * heard[L.HEARD.fit_sum + i] / n
            )
            growth_sq += (moment / spread) * (moment / spread)
            certain += moment * moment / (spread * _velocity_noise(i, k))
    enough = n >= MIN_FIXES and certain > GROWTH_SIGMA * GROWTH_SIGMA
    return enough and growth_sq > GROWTH_MPS2 * GROWTH_MPS2


# -------------------------------------------------------------------------------------------------
# Relearn.
# -------------------------------------------------------------------------------------------------

MOST = 30.0
"""Of one innovation squared that counts."""
HANDICAP = 60.0
"""Of a tilt from nowhere: it explains a bias, too, until that tilts it again."""
FIXES = 32
"""So many fixes back at most."""
TICKS = 700
"""And so many ticks."""
BEFORE_S = 1.0
"""The jump may have been so long before the first refusal: the gate sees a velocity error late,
as it grows with the square of that time."""


def empty_window() -> L.Window:
    """Nothing was taken yet."""
    tick = np.full(FIXES + 1, L.NO_TICK, dtype=np.int64)
    tick[FIXES] = 0
    return L.Window(
        np.zeros((TICKS, L.RING.size)),
        np.zeros((TICKS, L.AID.size)),
        np.zeros((FIXES + 1, L.NOMINAL.size)),
        np.zeros((FIXES + 1, L.ERROR.size, L.ERROR.size)),
        tick,
    )


@njit
def forget(window):
    """What was taken so far no longer leads to what the filter knows."""
    for slot in range(FIXES):
        window.tick[slot] = L.NO_TICK


@njit
def keep_window(state, horizon, sample, aid):
    """Keep what the filter takes at its horizon; what it knows, too, where a fix (aid row) is."""
    window = state.window
    copy_part(window.imu[horizon % TICKS], 0, sample, 0, L.RING.size)
    copy_part(window.aid[horizon % TICKS], 0, aid, 0, L.AID.size)
    if aid[L.AID.gps_valid] > 0.0:
        newest = (window.tick[FIXES] + 1) % FIXES
        copy_part(window.nominal[newest], 0, state.nominal, 0, L.NOMINAL.size)
        copy_matrix(window.P[newest], state.P)
        window.tick[newest], window.tick[FIXES] = horizon, newest


@njit
def from_where(window, horizon, wanted):
    """Place of the newest knowledge that is not after a tick; else of the oldest, else -1."""
    best, oldest = -1, -1
    for slot in range(FIXES):
        tick = window.tick[slot]
        if tick == L.NO_TICK or horizon - tick >= TICKS:
            continue
        if oldest < 0 or tick < window.tick[oldest]:
            oldest = slot
        if tick <= wanted and (best < 0 or tick > window.tick[best]):
            best = slot
    return best if best >= 0 else oldest


@njit
def take_row(state, x, P, row, k):
    """Fuse what was measured at a tick (aid row) into x (21,) and P (20, 20), each by its gate.

    Returns
    -------
    (float, float)
        Innovations squared that tell of the inertial sensors: of a fix's velocity, of the heading.
    """
    trial, dx, diag = state.trial, state.dx, state.diag
    by_fix, by_heading = 0.0, 0.0
    if row[L.AID.gps_valid] > 0.0:
        _, velocity = fuse_gps(x, P, trial, dx, diag, row, k)
        by_fix = min(diag[L.DIAG.nis_vel], MOST) if velocity >= 0 else 0.0
    if row[L.AID.mag_valid] > 0.0:
        diag[L.DIAG.nis_mag] = 0.0  # stays so where the field is none
    for which in FUSED_IN_ORDER:
        if row[L.AID_PLACES[which].valid] > 0.0:
            fuse_aid(which, x, P, trial, dx, diag, row, k)
    if row[L.AID.mag_valid] > 0.0:
        by_heading = min(diag[L.DIAG.nis_mag], MOST)
    return by_fix, by_heading


@njit
def _from_there(state, slot, refused, horizon, at, sigma, k):
    """Take all again from a fix on, three errors from `at` on wandering until the refusal.

    Returns the sum of what surprised on the way: normalised innovations squared.
    """
    window, x, P = state.window, state.nominal, state.P
    first = window.tick[slot]
    copy_part(x, 0, window.nominal[slot], 0, L.NOMINAL.size)
    copy_matrix(P, window.P[slot])
    fill(state.dx[0], 0.0)
    steps, surprise = max(refused - first, 1), 0.0
    for tick in range(first, horizon + 1):
        if tick > first:
            predict(x, P, window.imu[(tick - 1) % TICKS], window.imu[tick % TICKS], k)
            if replaced_for_long(window.imu, tick):
                widen_covariance(P, k.dt_s)
        if tick < first + steps:
            for i in range(at, at + 3):
                P[i, i] += sigma * sigma / steps
        by_fix, by_heading = take_row(state, x, P, window.aid[tick % TICKS], k)
        surprise += by_fix + by_heading
    return surprise


@njit
def take_again_from(state, slot, horizon, k):
    """Take all again from a fix on, as it was taken; nominal and P in place."""
    _from_there(state, slot, 0, horizon, 0, 0.0, k)


@njit
def reset_biases(state, horizon, k):
    """Take the last seconds again with biases that may have jumped; nominal and P in place.

    Parameters
    ----------
    state : ObserverState
        A line through refused velocities is in `heard` (`fault_detection.reject_velocity`).
    horizon : int
        Tick that the filter is at, its fix among what is taken again.
    k : EkfParams
    """
    window, count, x, P = state.window, state.count, state.nominal, state.P
    count[L.COUNT.imu_doubts] += 1
    count[L.COUNT.gps_offset] = 0
    count[L.COUNT.gps_grows] = 0
    refused = int(round(state.heard[L.HEARD.fit_began] / k.dt_s))
    slot = from_where(window, horizon, refused - int(round(BEFORE_S / k.dt_s)))
    if slot < 0:
        return
    least = math.inf
    for at, sigma, handicap in (
        (L.ERROR.gyro_bias, GYRO_RADPS, 0.0),
        (L.ERROR.accel_bias, ACCEL_MPS2, 0.0),
        (L.ERROR.att, ATT_RAD, HANDICAP),
    ):
        surprise = handicap + _from_there(state, slot, refused, horizon, at, sigma, k)
        if surprise < least:
            least = surprise
            copy_part(window.nominal[FIXES], 0, x, 0, L.NOMINAL.size)
            copy_matrix(window.P[FIXES], P)
    copy_part(x, 0, window.nominal[FIXES], 0, L.NOMINAL.size)
    copy_matrix(P, window.P[FIXES])
    # What was kept belongs to what was believed before.
    forget(window)


# -------------------------------------------------------------------------------------------------
# A filter whose state is none any more begins again in flight, from what it knew before.
#
# No sensor can make a state that is not finite: each is judged before it is fused. What can is an
# error of ours or of the machine; then the filter would say nothing ever again. It keeps what it
# knew
# at each of the last fixes, and all that it took since (`relearn`): from the newest knowledge that
# is
# sound it takes the same samples and fixes again, and is where it would have been.
# -------------------------------------------------------------------------------------------------

QUAT_NORM_OFF = 0.1
"""A unit quaternion is so near to 1."""
VEL_MPS = 150.0
"""No helicopter is faster."""
CORRELATION2 = 1.05
"""Of two errors, squared: beyond 1 there is no covariance; rounding may be so far."""
_TINY = 1e-24


@njit
def is_state(x, P):
    """Whether nominal state and covariance can be those of an aircraft: finite, not absurd."""
    for i in range(L.NOMINAL.size):
        if not math.isfinite(x[i]):
            return False
    norm2 = 0.0
    for i in range(4):
        norm2 += x[L.NOMINAL.quat + i] ** 2
    if not abs(norm2 - 1.0) <= QUAT_NORM_OFF:
        return False
    for i in range(3):
        if not abs(x[L.NOMINAL.vel + i]) <= VEL_MPS:
            return False
    for i in range(L.ERROR.size):
        if not (math.isfinite(P[i, i]) and P[i, i] >= 0.0):
            return False
        for j in range(i):
            if not P[i, j] * P[i, j] <= CORRELATION2 * P[i, i] * P[j, j] + _TINY:
                return False
    return True


@njit
def is_rotor(rotor):
    """Whether the states of the reduced-order observer are finite."""
    for i in range(L.ROTOR_W.size):
        if not math.isfinite(rotor[i]):
            return False
    return True


@njit
def reset_filter(state, horizon, k):
    """Go on from the newest knowledge that is sound; nominal and P in place.

    Parameters
    ----------
    state : ObserverState
    horizon : int
        Tick that the filter is at.
    k : EkfParams

    Returns
    -------
    bool
        False where there is none: then it has to be aligned anew.
    """
    window = state.window
    before = horizon + 1
    for _ in range(FIXES):
        best = -1
        for slot in range(FIXES):
            tick = window.tick[slot]
            if tick == L.NO_TICK or tick >= before or horizon - tick >= TICKS:
                continue
            if best < 0 or tick > window.tick[best]:
                best = slot
        if best < 0:
            return False
        before = window.tick[best]
        if is_state(window.nominal[best], window.P[best]):
            take_again_from(state, best, horizon, k)
            if is_state(state.nominal, state.P):
                accept_velocity(state)
                state.count[L.COUNT.recovered] += 1
                return True
    return False
