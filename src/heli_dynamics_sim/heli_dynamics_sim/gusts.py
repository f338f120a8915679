# SPDX-License-Identifier: Apache-2.0
"""Discrete 1-cosine gusts: at given times, and at random ones drawn once per flight.

The shape is the discrete gust of MIL-F-8785C (3.7.1.3), run up to its peak and down again. Random
gusts come one after the other: the pauses between them are exponentially distributed; length, peak
and direction are uniform in their ranges. The peak is given as a share of W20, so that it grows
with the wind.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.noise import gust_generator
from heli_dynamics_sim.rigid_body import to_ned
from heli_dynamics_sim.state import attitude_of
from heli_math.jit import njit


class RandomGusts(NamedTuple):
    """What random gusts are drawn from."""

    rate_per_min: float  # gusts per minute of pause; 0: none
    least_share: float  # of W20, peak of the velocity
    most_share: float
    least_s: float  # length
    most_s: float
    spread_rad: float  # largest angle between a gust and the mean wind
    until_s: float  # the last one starts before


class GustRow(NamedTuple):
    """A random gust (5,)."""

    start: int = 0  # flight time at the c.g., s
    duration: int = 1  # s
    peak: slice = slice(2, 5)  # velocity of the air, NED, m/s
    size: int = 5


GUST = GustRow()


def draw_gusts(
    seed: int, k: RandomGusts, w20_mps: float, towards_rad: float
) -> NDArray[np.float64]:
    """Random gusts of a flight, in the order of their starts.

    Parameters
    ----------
    seed : int
        Of the flight; the gusts have a stream of their own.
    k : RandomGusts
    w20_mps : float
        Wind at 20 ft.
    towards_rad : float
        Direction the mean wind blows to, clockwise from north.

    Returns
    -------
    (m, 5) array
        One row `GUST` per gust; none if the rate is 0. They do not overlap.
    """
    rows: list[list[float]] = []
    rng, time_s = gust_generator(seed), 0.0
    while k.rate_per_min > 0.0:
        time_s += rng.exponential(60.0 / k.rate_per_min)
        if time_s >= k.until_s:
            break
        duration_s = rng.uniform(k.least_s, k.most_s)
        peak_mps = w20_mps * rng.uniform(k.least_share, k.most_share)
        angle = towards_rad + rng.uniform(-k.spread_rad, k.spread_rad)
        peak = [peak_mps * math.cos(angle), peak_mps * math.sin(angle), 0.0]
        rows.append([time_s, duration_s, *peak])
        time_s += duration_s
    return np.array(rows, dtype=np.float64).reshape(-1, GUST.size)


@njit
def gust_shape(time_s, start_s, duration_s):
    """1-cosine gust, 0 to 1 and back to 0 within its duration."""
    phase = (time_s - start_s) / duration_s
    if phase <= 0.0 or phase >= 1.0:
        return 0.0
    return 0.5 * (1.0 - math.cos(2.0 * math.pi * phase))


@njit
def _last_started(time_s, drawn):
    """Index of the last random gust that began before time_s, -1: none."""
    before, after = -1, drawn.shape[0]
    while after - before > 1:
        middle = (before + after) // 2
        if drawn[middle, GUST.start] < time_s:
            before = middle
        else:
            after = middle
    return before


@njit
def gusts_at(x, time_s, k, drawn):
    """Velocity (3 floats) of all discrete gusts, NED, m/s.

    Parameters
    ----------
    x : (PLANT.size,) array
        Plant state: attitude, for gusts in body axes.
    time_s : float
        Flight time.
    k : WindKernel
        The gusts at given times.
    drawn : (m, 5) array
        Random gusts, rows `GUST`.
    """
    g0, g1, g2 = 0.0, 0.0, 0.0
    for i in range(k.gust_start_s.shape[0]):
        shape = gust_shape(time_s, k.gust_start_s[i], k.gust_duration_s[i])
        g0 += shape * k.gust_amplitude_mps[i, 0]
        g1 += shape * k.gust_amplitude_mps[i, 1]
        g2 += shape * k.gust_amplitude_mps[i, 2]
    if k.gust_body:
        g0, g1, g2 = to_ned(attitude_of(x), g0, g1, g2)
    i = _last_started(time_s, drawn)
    if i >= 0:
        shape = gust_shape(time_s, drawn[i, GUST.start], drawn[i, GUST.duration])
        peak = drawn[i, GUST.peak]
        g0, g1, g2 = g0 + shape * peak[0], g1 + shape * peak[1], g2 + shape * peak[2]
    return g0, g1, g2
