# SPDX-License-Identifier: Apache-2.0
"""A sweep added to the measured attitude that the law reads: how it rejects disturbances.

The law answers the sum of true and added attitude, of which `heli score --response --disturbance`
takes the response to what was added: bandwidth and peak of disturbance rejection (Blanken, Tischler
et al.). Nothing else than the law hears of it.
"""

import math
from collections.abc import Mapping
from typing import Any

from heli_math.rows import NINE
from heli_math.sweep import NOTHING, SWEEP, SweepKernel
from heli_parameters.parameters import Parameter

AXES = ("roll", "pitch", "yaw")
PLACES = (NINE.phi, NINE.theta, NINE.psi)
"""Of the angles among the nine states."""

DISTURBANCE_ROWS: tuple[Parameter, ...] = (
    Parameter("disturbance.axis", "string", "Measured angle that a sweep is added to before the "
              "law reads it", choices=AXES, read_only=True),
    Parameter("disturbance.amplitude_deg", "double", "Its amplitude; 0: none", "deg", lower=0.0,
              upper=10.0, read_only=True),
    Parameter("disturbance.from_hz", "double", "Frequency at which it begins", "Hz", lower=0.005,
              upper=10.0, read_only=True),
    Parameter("disturbance.to_hz", "double", "Frequency at which it ends", "Hz", lower=0.005,
              upper=10.0, read_only=True),
    Parameter("disturbance.start_s", "double", "Flight time at which it begins", "s", lower=0.0,
              upper=86400.0, read_only=True),
    Parameter("disturbance.duration_s", "double", "Its length", "s", lower=1.0, upper=3600.0,
              read_only=True),
)  # fmt: skip
"""Rows of the `inner_loop` node."""


def disturbance_kernel(p: Mapping[str, Any]) -> SweepKernel:
    """Numbers of the rows `DISTURBANCE_ROWS`, for an array of the nine states."""
    amplitude = math.radians(p["disturbance.amplitude_deg"])
    return SweepKernel(
        SWEEP if amplitude > 0.0 else NOTHING,
        PLACES[AXES.index(p["disturbance.axis"])],
        amplitude,
        2.0 * math.pi * p["disturbance.from_hz"],
        math.log(p["disturbance.to_hz"] / p["disturbance.from_hz"]),
        p["disturbance.start_s"],
        p["disturbance.duration_s"],
    )
