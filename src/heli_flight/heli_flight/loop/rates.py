# SPDX-License-Identifier: Apache-2.0
"""What may be flown at another rate than 100 Hz, and what may not, with a sentence."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_flight.loop.scenario import NODE_NAME as SCENARIO
from heli_inner_hinf.attitude_disturbance import disturbance_kernel
from heli_inner_hinf.excitation import excitation_kernel
from heli_math.sweep import NOTHING
from heli_math.ticks import TICKS_PER_S
from heli_parameters.parameters import ParameterError

_SCENARIOS = ("hover", "path")


def check_rate(values: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse what is made for steps of 10 ms in a flight of other ones.

    Parameters
    ----------
    values : mapping
        Parameters by section; the nodes agree on `rate_hz`.

    Raises
    ------
    ParameterError
    """
    plant, law = values["plant"], values["inner_loop"]
    rate_hz, kind = plant["rate_hz"], values[SCENARIO]["kind"]
    if rate_hz == TICKS_PER_S:
        return
    if law["controller"] == "matrices":
        raise refused(rate_hz, "controller: matrices: they are those of steps of 10 ms")
    if kind not in _SCENARIOS:
        raise refused(rate_hz, f"scenario: kind: {kind}; allowed: {' or '.join(_SCENARIOS)}")
    if plant["start.on_ground"]:
        raise refused(rate_hz, "start.on_ground: the ground is tried in steps of 10 ms alone")
    excited = excitation_kernel(law).on or disturbance_kernel(law).shape != NOTHING
    if excited or np.any(plant["wind.sines.amplitude_mps"]):
        raise refused(rate_hz, "an excitation: what reads it counts samples of 10 ms")


def refused(rate_hz: int, why: str) -> ParameterError:
    """The error that says it."""
    return ParameterError(f"rate_hz: {rate_hz} does not go with {why}; fly it at {TICKS_PER_S}")
