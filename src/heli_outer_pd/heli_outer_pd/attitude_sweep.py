# SPDX-License-Identifier: Apache-2.0
"""Sweeps and steps of the commanded attitude: what `heli score --response` is read from.

Added to what the law commands, in flight time. A sweep is a sine whose frequency grows by the same
factor in equal times (Tischler, Remple, Aircraft and Rotorcraft System Identification, 2nd ed.,
AIAA 2012, ch. 5); steps go up, back, down and back, then the same at half the size.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from heli_math.jit import njit
from heli_math.multisine import fade_in_and_out
from heli_math.rows import SETPOINT
from heli_parameters.parameters import Parameter

NONE, SWEEP, STEPS = "none", "sweep", "steps"
AXES = ("roll", "pitch", "yaw")
_PLACES = (SETPOINT.phi, SETPOINT.theta, SETPOINT.psi)
PARTS = 8
"""Of steps: up, back, down, back, twice."""
_UP, _DOWN, _HALF = 0, 2, 4

SWEEP_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "sweep.shape", "string", "What is added to the commanded attitude: nothing, a sine of "
        "growing frequency, or steps up and down", choices=(NONE, SWEEP, STEPS), read_only=True,
    ),
    Parameter("sweep.axis", "string", "Angle that it is added to", choices=AXES, read_only=True),
    Parameter(
        "sweep.amplitude_deg", "double", "Its amplitude", "deg", lower=0.0, upper=30.0,
        read_only=True,
    ),
    Parameter(
        "sweep.from_hz", "double", "Frequency at which a sweep begins", "Hz", lower=0.01,
        upper=10.0, read_only=True,
    ),
    Parameter(
        "sweep.to_hz", "double", "Frequency at which it ends", "Hz", lower=0.01, upper=10.0,
        read_only=True,
    ),
    Parameter(
        "sweep.start_s", "double", "When it begins, since the start of the reference", "s",
        lower=0.0, upper=86400.0, read_only=True,
    ),
    Parameter(
        "sweep.duration_s", "double", "Its length; steps: of all eight parts together", "s",
        lower=1.0, upper=3600.0, read_only=True,
    ),
)  # fmt: skip
"""Rows of the `outer_loop` node."""


class SweepKernel(NamedTuple):
    """Numbers of what is added; `shape` 0: nothing, 1: a sweep, 2: steps."""

    shape: int
    place: int  # in a SetpointRow
    amplitude: float  # rad
    from_radps: float
    growth: float  # natural logarithm of last over first frequency
    start_s: float
    duration_s: float


def sweep_kernel(p: Mapping[str, Any]) -> SweepKernel:
    """Numbers of the rows `SWEEP_ROWS`."""
    return SweepKernel(
        (NONE, SWEEP, STEPS).index(p["sweep.shape"]),
        _PLACES[AXES.index(p["sweep.axis"])],
        math.radians(p["sweep.amplitude_deg"]),
        2.0 * math.pi * p["sweep.from_hz"],
        math.log(p["sweep.to_hz"] / p["sweep.from_hz"]),
        p["sweep.start_s"],
        p["sweep.duration_s"],
    )


@njit
def swept_angle(time_s, k):
    """What is added at a time, rad."""
    since = time_s - k.start_s
    if k.shape == 0 or since < 0.0 or since >= k.duration_s:
        return 0.0
    share = since / k.duration_s
    if k.shape == 1:
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
    """Add to a SetpointRow (4,), in place."""
    out[k.place] += swept_angle(time_s, k)
