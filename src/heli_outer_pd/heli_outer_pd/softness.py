# SPDX-License-Identifier: Apache-2.0
"""Whether the attitude follows what is commanded, and how softly is flown while it does not.

A servo that has grown slow turns brisk loops into a growing oscillation, first where a GPS of
metres steps the set-point. What shows it is the attitude, which is not where the attitude loop
would have brought it: the difference to the command behind that loop's lag. How much it swings,
over a second, stays below `failsafe.unfollowed_deg` in flights without a fault.

Beyond, position is held softly: small gains and tilts, and of the command only a part, the rest is
the attitude as it is. That takes three quarters of its stiffness from the attitude loop and leaves
its damping: little is asked of the servo's speed, and the oscillation dies. A servo that is stuck
follows that no better: the attitude hangs to one side. Then the gains are as before: with them the
other axes hold what they can. What has become calm has its gains again, each time later. Where
messages are late the attitude swings, too, and soft flight would be worse: that is told by how
quickly it swings, or by navigation that is late itself.
"""

import math

from heli_math.arrays import fill
from heli_math.jit import njit
from heli_math.rotations import wrap_pi
from heli_math.rows import SETPOINT
from heli_outer_pd.outer_state import FLIES, FULL, MEMORY, SOFT, STUCK

_MEAN_S = 1.0
_HANGS, _HALF, _HANGS_S = 0.6, 0.5, 2.0
"""It hangs to one side if its mean has so much of its mean square, at half the limit, for so
long."""
_TRIED_S, _LATE = 4.0, 0.3
_END, _LATELY_S, _BRISK = 0.8, 3.0, 1.35
"""A slow servo's first swing is slow and is found out before the second; where commands come late
they come and go every 1.2 s: so often over the last seconds it is not a servo."""
_CALM_S = 5.0
"""Below half the limit for so long, each time twice as long, it has its gains again."""
_TURNED_RAD, _TURNS_RADPS = math.radians(30.0), 1.5
K_P_SHARE, K_D_SHARE, AS_IT_IS = 0.1, 0.5, 0.75
"""In soft flight, of the horizontal gains, and of those of the disturbance's observer (l2, l1): the
bandwidth falls to a third, damping grows; of the attitude as it is in what is commanded."""
SOFT_TILT_RAD = math.radians(15.0)


@njit
def p_share(state):
    """Share of the gains that act on what is off: 1.0 unless it flies softly."""
    return K_P_SHARE if state[MEMORY.soft] == SOFT else 1.0


@njit
def d_share(state):
    """Share of the gains that act on speeds."""
    return K_D_SHARE if state[MEMORY.soft] == SOFT else 1.0


@njit
def softly(a, k, state):
    """Cut the wanted acceleration (3,), horizontally and in place, to that of a small tilt."""
    if state[MEMORY.soft] == SOFT:
        limit = k.g * math.tan(SOFT_TILT_RAD)
        for i in range(2):
            a[i] = min(max(a[i], -limit), limit)


@njit
def ease(phi, theta, state, out):
    """Bring the commanded roll and pitch of out (4,) near those that are flown, rad."""
    if state[MEMORY.soft] == SOFT:
        out[SETPOINT.phi] += AS_IT_IS * (phi - out[SETPOINT.phi])
        out[SETPOINT.theta] += AS_IT_IS * (theta - out[SETPOINT.theta])


@njit
def forget_swings(state):
    """Full gains, and nothing seen so far."""
    fill(state[MEMORY.off_mean], 0.0)
    fill(state[MEMORY.off_square], 0.0)
    fill(state[MEMORY.side], 0.0)
    fill(state[MEMORY.turns], 0.0)
    state[MEMORY.soft] = FULL
    state[MEMORY.calm_wanted_s] = 0.0


@njit
def watch_attitude(flown, psi, rate, k, state):
    """Bring up to what the attitude explains, (2,) m/s2, whether commands are followed.

    Only where the law itself holds a place, and estimates the disturbance, behind that: there the
    command is known behind the attitude loop's lag. A nose that turns away takes roll and pitch
    along: nothing is said of their servos, and the full gains hold a place even so.
    """
    own = k.wind_compensation > 0.5 and k.hold_horizontal > 0.5 and k.sweep.shape == 0
    state[MEMORY.late] += k.dt_s / _MEAN_S * (state[MEMORY.is_late] - state[MEMORY.late])
    if state[MEMORY.ground] != FLIES or not own or state[MEMORY.late] > _LATE:
        forget_swings(state)
        return
    mean, square, lagged = state[MEMORY.off_mean], state[MEMORY.off_square], state[MEMORY.lagged]
    swings, brisk, hangs, calm = False, False, False, True
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
    off_rad = abs(wrap_pi(psi - state[MEMORY.command][SETPOINT.psi]))
    turned = off_rad > _TURNED_RAD or abs(rate[2]) > _TURNS_RADPS
    _decide(swings and not turned, brisk, hangs or turned, calm, k, state)


@njit
def _turns(off, i, k, state):
    """How often an axis has lately swung from beyond one end to beyond the other."""
    side, turns, end = state[MEMORY.side], state[MEMORY.turns], _END * k.unfollowed[i]
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
    state[MEMORY.soft], state[MEMORY.calm_wanted_s] = soft, calm_wanted_s
    state[MEMORY.hangs_s], state[MEMORY.calm_s], state[MEMORY.soft_s] = 0.0, 0.0, 0.0


@njit
def _decide(swings, brisk, hangs, calm, k, state):
    """The next of FULL, SOFT, STUCK."""
    soft, wanted_s = state[MEMORY.soft], state[MEMORY.calm_wanted_s]
    lands = state[MEMORY.lands] > 0.5
    if soft == FULL:
        # A landing is no place for another try; what softness has calmed once is a slow servo.
        if (swings or lands) and wanted_s > 0.0:
            _begin(2.0 * wanted_s, SOFT, state)
        elif swings and brisk:
            _begin(0.0, STUCK, state)
        elif swings:
            _begin(_CALM_S, SOFT, state)
        return
    state[MEMORY.hangs_s] = state[MEMORY.hangs_s] + k.dt_s if hangs else 0.0
    state[MEMORY.calm_s] = state[MEMORY.calm_s] + k.dt_s if calm else 0.0
    state[MEMORY.soft_s] += k.dt_s
    in_vain = swings and state[MEMORY.soft_s] > _TRIED_S
    if soft == SOFT and (state[MEMORY.hangs_s] > _HANGS_S or in_vain):
        state[MEMORY.soft] = STUCK
    elif state[MEMORY.calm_s] > max(wanted_s, _CALM_S) and not lands:
        state[MEMORY.soft], state[MEMORY.takes_over] = FULL, 1.0
