# SPDX-License-Identifier: Apache-2.0
"""Sweeps and steps of an angle over time.

A sweep is a sine whose frequency grows by the same factor in equal times (Tischler, Remple,
Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012, ch. 5); steps go up, back, down
and back, then the same at half the size.
"""

import math
from typing import NamedTuple

from heli_math.jit import njit
from heli_math.multisine import fade_in_and_out

NOTHING, SWEEP, STEPS = range(3)
"""Shapes."""
PARTS = 8
"""Of steps: up, back, down, back, twice."""
_UP, _DOWN, _HALF = 0, 2, 4


class SweepKernel(NamedTuple):
    """Numbers of what is added; `shape` 0: nothing, 1: a sweep, 2: steps."""

    shape: int
    place: int  # of the angle in the array that it is added to
    amplitude: float  # rad
    from_radps: float
    growth: float  # natural logarithm of last over first frequency
    start_s: float
    duration_s: float


@njit
def swept_angle(time_s, k):
    """What is added at a time, rad."""
    since = time_s - k.start_s
    if k.shape == NOTHING or since < 0.0 or since >= k.duration_s:
        return 0.0
    share = since / k.duration_s
    if k.shape == SWEEP:
        turns = share if k.growth == 0.0 else math.expm1(k.growth * share) / k.growth
        fade = fade_in_and_out(since, k.duration_s, 0.5 * math.pi / k.from_radps)
        return fade * k.amplitude * math.sin(k.from_radps * k.duration_s * turns)
    part = int(PARTS * share)
    size = k.amplitude if part < _HALF else 0.5 * k.amplitude
    if part % _HALF == _UP:
        return size
    return -size if part % _HALF == _DOWN else 0.0


@njit
def add_sweep(time_s, k, out):
    """Add to the array in which `k.place` is the place of the angle, in place."""
    out[k.place] += swept_angle(time_s, k)
