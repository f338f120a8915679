# SPDX-License-Identifier: Apache-2.0
"""Two IMUs as one: their mean while they agree, and whom to leave when they do not.

What they say differs by errors that stay (bias, scale, misalignment); that is learnt, and taken off
half and half, so that either alone says what their mean says: who is left out leaves no step. One
that is silent, out of range, zero or repeats itself to the last bit is left at once.

Where both measure and disagree, no majority tells who is wrong. Then, beside the filter, which goes
on with the mean, two more begin from what it knew a while ago, each with one IMU alone, and fuse
what it fuses: the sum of their normalised innovations of velocity and heading tells who predicts
the fixes and the compass better (D. T. Magill, "Optimal adaptive estimation of sampled stochastic
processes", IEEE Trans. Automatic Control 10(4), 1965). The better one takes the filter's place, as
if the other IMU had never been there.
"""

import math

import numpy as np

from heli_core.jit import copy_matrix, copy_part, fill, njit, scratch
from heli_core.rows import IMU, MEAS
from heli_observer import layout as L
from heli_observer.buffers import SAME, motion_at, usable_imu
from heli_observer.ekf import predict
from heli_observer.fault_detection import TICKS, accept_velocity, forget, from_where, take_row
from heli_observer.layout import PAIR

_N_RING = L.RING.size  # a length of what lies on the stack
FAST_S, OFFSET_S = 0.1, 20.0
"""Time constants: of how far they are apart now, and of what of that stays."""
LEARN_TICKS = 50
"""Samples after which what stays is known well enough to judge."""
RETURN_S = 2.0
"""Who agrees for so long without a gap is believed again."""
BACK_S = 2.0
"""So long ago they were still one: what grows slowly has spoilt little of what was known then."""
TRIAL_S = 5.0
"""A comparison that has told nothing begins anew after so long."""
LEAD = 15.0
"""By so much one sum of innovations is larger: odds of exp(LEAD / 2), 1800 to 1."""
WHY_NOTHING, WHY_STOPPED, WHY_FIXES, WHY_COMPASS = 0, 1, 2, 3
WHY_WORDS = (
    "",
    "silent, out of range, zero or frozen",
    "contradicts the fixes",
    "contradicts the compass",
)
"""Why one was left, for people."""
NAMES = ("none", "first", "second")


def new_pair() -> L.ImuPair:
    """Nothing is known yet."""
    return L.ImuPair(
        np.zeros((2, TICKS, L.RING.size)),
        np.full((2, IMU.size), np.nan),
        np.zeros(IMU.size),
        np.zeros(IMU.size),
        np.zeros((2, L.NOMINAL.size)),
        np.zeros((2, L.ERROR.size, L.ERROR.size)),
        np.zeros((2, 2)),
        np.zeros(PAIR.size, dtype=np.int64),
    )


@njit
def begin_pair(state):
    """The filter was aligned: what was known before leads nowhere."""
    state.pair.count[PAIR.trial] = 0
    forget(state.window)


@njit
def _measures(pair, which, z, k):
    """Whether an IMU's sample z (6,) was measured: finite, within range, some force, and anew."""
    heard, count, good = pair.heard[which], pair.count, True
    for part in range(2):
        same = True
        for i in range(3 * part, 3 * part + 3):
            same = same and z[i] == heard[i]
        at = PAIR.same + 2 * which + part
        count[at] = count[at] + 1 if same else 0
        good = good and count[at] < SAME
    for i in range(IMU.size):
        heard[i] = z[i]
        good = good and usable_imu(z, i, k)
    return good and not (z[0] == 0.0 and z[1] == 0.0 and z[2] == 0.0)


@njit
def _leave(pair, which, why):
    """Leave the first (0) or the second (1)."""
    count = pair.count
    count[PAIR.left], count[PAIR.why], count[PAIR.trial] = which + 1, why, 0
    count[PAIR.agreed] = 0
    count[PAIR.switches] += 1


@njit
def _judge(state, which, row, k):
    """Let one of the two filters fuse what a tick measured (aid row), and add to its sums."""
    pair = state.pair
    score = pair.score[which]
    by_fix, by_heading = take_row(state, pair.nominal[which], pair.P[which], row, k)
    score[0] += by_fix
    score[1] += by_heading


@njit
def _carry(state, which, tick, k):
    """Bring one of the two filters to a tick."""
    pair, newest = state.pair, state.count[L.COUNT.tick]
    before, now = scratch(_N_RING), scratch(_N_RING)
    motion_at(pair.ring[which], tick - 1, newest, k, before)
    motion_at(pair.ring[which], tick, newest, k, now)
    predict(pair.nominal[which], pair.P[which], before, now, k)


@njit
def _begin_trial(state, tick, horizon, k):
    """Two filters from what the one knew `BACK_S` ago, brought to the horizon with one IMU each."""
    pair, window = state.pair, state.window
    slot = from_where(window, horizon, horizon - int(round(BACK_S / k.dt_s)))
    for which in range(2):
        nominal, P, first = state.nominal, state.P, horizon
        if slot >= 0:
            nominal, P, first = window.nominal[slot], window.P[slot], window.tick[slot]
        copy_part(pair.nominal[which], 0, nominal, 0, L.NOMINAL.size)
        copy_matrix(pair.P[which], P)
        fill(pair.score[which], 0.0)
        for t in range(first, horizon + 1 if slot >= 0 else horizon):
            if t > first:
                _carry(state, which, t, k)
            _judge(state, which, window.aid[t % TICKS], k)
    pair.count[PAIR.trial], pair.count[PAIR.began] = 1, tick


@njit
def _compare(state, tick, first, second, k):
    """How far apart two samples (6,) are beside what stays; begins and ends what follows of it."""
    pair = state.pair
    count, offset, apart = pair.count, pair.offset, pair.apart
    agree = True
    for i in range(IMU.size):
        e = second[i] - first[i] - offset[i]
        apart[i] += min(k.ekf.dt_s / FAST_S, 1.0) * (e - apart[i])
        agree = agree and abs(apart[i]) <= k.pair.apart[i]
    count[PAIR.agreed] = count[PAIR.agreed] + 1 if agree else 0
    settled = count[PAIR.agreed] * k.ekf.dt_s >= RETURN_S
    if count[PAIR.left] > 0:
        if settled:
            count[PAIR.left], count[PAIR.why] = 0, WHY_NOTHING
        return
    if count[PAIR.trial] == 1:
        if settled:
            count[PAIR.trial] = 0
        return
    if not agree and count[PAIR.compared] >= LEARN_TICKS:
        if state.count[L.COUNT.aligned] == 1:
            _begin_trial(state, tick, tick - 1 - k.horizon_ticks, k.ekf)
        return
    count[PAIR.compared] += 1
    share = max(1.0 / count[PAIR.compared], k.ekf.dt_s / OFFSET_S)
    for i in range(IMU.size):
        step = share * (second[i] - first[i] - offset[i])
        limit = k.pair.offset[i]
        offset[i] = min(max(offset[i] + step, -limit), limit)


@njit
def combine(state, tick, y, k, out):
    """What two IMUs say together at a tick, (6,); NaN if neither measures.

    Parameters
    ----------
    state : ObserverState
        Its pair in place.
    tick : int
    y : ndarray (>= 26,)
        Measurement row.
    k : ObserverParams
    out : ndarray (6,)
    """
    pair, first, second = state.pair, y[MEAS.imu], y[MEAS.imu2]
    count, offset, apart = pair.count, pair.offset, pair.apart
    good = (_measures(pair, 0, first, k.ekf), _measures(pair, 1, second, k.ekf))
    if good[0] and good[1]:
        _compare(state, tick, first, second, k)
    else:
        count[PAIR.agreed] = 0
        if good[0] != good[1]:
            bad = 1 if good[0] else 0
            if count[PAIR.left] == 0:
                _leave(pair, bad, WHY_STOPPED)
    slot = tick % TICKS
    for i in range(IMU.size):
        pair.ring[0, slot, i] = first[i] + 0.5 * offset[i]
        pair.ring[1, slot, i] = second[i] - 0.5 * offset[i]
    left = count[PAIR.left]
    for i in range(IMU.size):
        a, b = pair.ring[0, slot, i], pair.ring[1, slot, i]
        if left == 0:
            out[i] = 0.5 * (a + b) if good[0] and good[1] else math.nan
        elif left == 2:
            # Who was left is better than nobody, less what he was off by.
            out[i] = a if good[0] else b - apart[i] if good[1] else math.nan
        else:
            out[i] = b if good[1] else a + apart[i] if good[0] else math.nan
    for which in range(2):
        if not good[which]:
            copy_part(pair.ring[which, slot], 0, out, 0, IMU.size)
        # ticks that never came
        for t in range(max(state.count[L.COUNT.tick] + 1, tick - k.max_gap_ticks), tick):
            copy_part(pair.ring[which, t % TICKS], 0, pair.ring[which, slot], 0, IMU.size)


@njit
def follow_trial(state, horizon, tick, k):
    """Both filters at the horizon; once one is better by far it becomes the observer's own.

    Parameters
    ----------
    state : ObserverState
        In place, its filter at the horizon.
    horizon, tick : int
    k : EkfParams
    """
    pair, imu = state.pair, state.imu
    count, score, size = pair.count, pair.score, state.imu.shape[0]
    if count[PAIR.trial] == 0:
        return
    for which in range(2):
        _carry(state, which, horizon, k)
        _judge(state, which, state.aid[horizon % size], k)
    lead = score[0, 0] + score[0, 1] - score[1, 0] - score[1, 1]
    if abs(lead) < LEAD:
        if (tick - count[PAIR.began]) * k.dt_s >= TRIAL_S:
            _begin_trial(state, tick, horizon, k)
        return
    worse = 0 if lead > 0.0 else 1
    better = 1 - worse
    by_fixes = score[worse, 0] - score[better, 0] >= score[worse, 1] - score[better, 1]
    _leave(pair, worse, WHY_FIXES if by_fixes else WHY_COMPASS)
    copy_part(state.nominal, 0, pair.nominal[better], 0, L.NOMINAL.size)
    copy_matrix(state.P, pair.P[better])
    for t in range(horizon, tick + 1):
        copy_part(imu[t % size], 0, pair.ring[better, t % TICKS], 0, IMU.size)
    accept_velocity(state)
    forget(state.window)
