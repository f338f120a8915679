# SPDX-License-Identifier: Apache-2.0
"""Whom to believe where fixes and inertial sensors contradict each other, and samples that nobody
measured.

A refused velocity tells who is wrong by how it goes on. A receiver that is off by a step stays off
by it, since the inertial sensors have felt none: it is refused for as long as it keeps to that,
however wide the gate opens meanwhile. What grows steadily is an error of tilt or of the inertial
sensors, as no receiver accelerates: these are solved again over the last seconds (`relearn`).
"""

import math

from heli_math.arrays import fill
from heli_math.jit import njit
from heli_observer import layout as L

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
def widen(P, dt_s):
    """Add to P (20, 20), in place, what a tick costs over which nothing was measured."""
    for i in range(3):
        P[L.E_VEL + i, L.E_VEL + i] += FORCE_DENSITY * FORCE_DENSITY * dt_s
        P[L.E_ATT + i, L.E_ATT + i] += RATE_DENSITY * RATE_DENSITY * dt_s


@njit
def _velocity_noise(i, k):
    return k.var_gps_vel_vertical if i == 2 else k.var_gps_vel_horizontal


@njit
def _whole(row):
    """Whether a fix (aid row) has a velocity."""
    for i in range(3):
        if not math.isfinite(row[L.AID_GPS_VEL + i]):
            return False
    return True


@njit
def is_certain(state):
    """Whether a receiver has been off by a velocity that stays for long enough."""
    return state.count[L.C_GPS_OFFSET] >= CERTAIN_FIXES


@njit
def keeps_its_offset(state, row, k):
    """Whether a receiver that was refused is off by the same velocity still (aid row, EkfKernel).

    It is not if it says something else; in the beginning, too, if its velocity agrees with what the
    filter was sure of when it was refused first. Later it may be the filter that has drifted there:
    then only a step from one fix to the next ends it that is like the one that began it.
    """
    x, heard, count = state.nominal, state.heard, state.count
    if count[L.C_GPS_OFFSET] == 0 or not _whole(row):
        return False
    off, change, step_sq, noise = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        r, var = row[L.AID_GPS_VEL + i] - x[L.X_VEL + i], _velocity_noise(i, k)
        d, e = r - heard[L.H_OFFSET + i], r - heard[L.H_OFF_LAST + i]
        off += r * r / (var + heard[L.H_OFFSET_VAR + i])
        change += d * d / (2.0 * var)
        step_sq += e * e
        noise += e * e / (2.0 * var)
        heard[L.H_OFF_LAST + i] = r
    if is_certain(state):
        first = heard[L.H_OFF_FIRST]
        ended = noise > k.gates[_AXES] and step_sq > RETURNS * RETURNS * first * first
    else:
        ended = off <= k.gates[_AXES] or change > k.gates[_AXES]
    if ended:
        count[L.C_GPS_OFFSET] = 0
        return False
    count[L.C_GPS_OFFSET] += 1
    first_sq = 0.0
    for i in range(3):
        offset = heard[L.H_OFFSET + i]
        heard[L.H_OFFSET + i] = offset + FOLLOWS * (heard[L.H_OFF_LAST + i] - offset)
        first_sq += heard[L.H_OFFSET + i] * heard[L.H_OFFSET + i]
    if count[L.C_GPS_OFFSET] == CERTAIN_FIXES:
        heard[L.H_OFF_FIRST] = math.sqrt(first_sq)
    return True


@njit
def believe(state):
    """A velocity was fused: nothing is held against the receiver."""
    state.count[L.C_GPS_OFFSET] = 0
    state.count[L.C_GPS_GROWS] = 0


@njit
def refuse(state, row, time_s, k):
    """A velocity was refused: remember how it is off; True if that has grown steadily."""
    x, P, heard, count = state.nominal, state.P, state.heard, state.count
    if not _whole(row) or is_certain(state):
        return False
    if count[L.C_GPS_OFFSET] == 0:
        count[L.C_GPS_OFFSET] = 1
        for i in range(3):
            heard[L.H_OFFSET + i] = row[L.AID_GPS_VEL + i] - x[L.X_VEL + i]
            heard[L.H_OFFSET_VAR + i] = P[L.E_VEL + i, L.E_VEL + i]
            heard[L.H_OFF_LAST + i] = heard[L.H_OFFSET + i]
    if count[L.C_GPS_GROWS] == 0 or count[L.C_GPS_GROWS] == MAX_FIXES:
        count[L.C_GPS_GROWS] = 0
        fill(heard[L.H_FIT : L.H_OFF_LAST], 0.0)
        heard[L.H_FIT_BEGAN] = time_s
    count[L.C_GPS_GROWS] += 1
    n, t = count[L.C_GPS_GROWS], time_s - heard[L.H_FIT_BEGAN]
    heard[L.H_FIT] += t
    heard[L.H_FIT + 1] += t * t
    spread = heard[L.H_FIT + 1] - heard[L.H_FIT] * heard[L.H_FIT] / n
    growth_sq, certain = 0.0, 0.0
    for i in range(3):
        r = row[L.AID_GPS_VEL + i] - x[L.X_VEL + i]
        heard[L.H_FIT_SUM + i] += r
        heard[L.H_FIT_MOMENT + i] += t * r
        if spread > 0.0:
            moment = heard[L.H_FIT_MOMENT + i] - heard[L.H_FIT] * heard[L.H_FIT_SUM + i] / n
            growth_sq += (moment / spread) * (moment / spread)
            certain += moment * moment / (spread * _velocity_noise(i, k))
    enough = n >= MIN_FIXES and certain > GROWTH_SIGMA * GROWTH_SIGMA
    return enough and growth_sq > GROWTH_MPS2 * GROWTH_MPS2
