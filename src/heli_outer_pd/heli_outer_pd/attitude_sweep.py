# SPDX-License-Identifier: Apache-2.0
"""Sweeps and steps of the commanded attitude: what `heli score --response` is read from.

Added to what the law commands, in flight time (`heli_math.sweep`).
"""

import math
from collections.abc import Mapping
from typing import Any

from heli_math.rows import SETPOINT
from heli_math.sweep import SweepKernel
from heli_parameters.parameters import Parameter

NONE, SWEEP, STEPS = "none", "sweep", "steps"
AXES = ("roll", "pitch", "yaw")
_PLACES = (SETPOINT.phi, SETPOINT.theta, SETPOINT.psi)

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
