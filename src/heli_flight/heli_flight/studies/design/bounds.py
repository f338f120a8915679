# SPDX-License-Identifier: Apache-2.0
"""Which bounds on the norm a design is asked to keep."""

from collections.abc import Mapping
from typing import Any

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.design import added_weights
from heli_inner_hinf.output_feedback import generalised_plant
from heli_inner_hinf.synthesis import gamma_star
from heli_inner_hinf.weights import weights
from heli_math.central_controller import NoControllerError, optimal_gamma

_OUTPUT_GAMMA_FACTOR = 1.05  # least output.gamma over gamma*: nearer the law loses its margins


def bound_of(inner: Mapping[str, Any], gamma: float | None, factor: float | None) -> float:
    """gamma as it is asked for: itself, a multiple of gamma*, else the parameter."""
    if gamma is not None:
        return gamma
    if factor is None:
        return float(inner["gamma"])
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    plant = (inner["model.A"], inner["model.B"], inner["model.E"])
    return factor * gamma_star(*plant, C, D).value


def output_bound_of(inner: Mapping[str, Any], actuation: Actuation) -> float:
    """`output.gamma`, or a bound above gamma* for an aircraft that has no law below it."""
    model = inner["model.A"], inner["model.B"], inner["model.E"]
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    gamma = float(inner["output.gamma"])
    plant = generalised_plant(*model, C, D, added_weights(inner), actuation)
    try:
        least = _OUTPUT_GAMMA_FACTOR * optimal_gamma(plant, gamma).value
    except NoControllerError:
        return gamma  # what flies it says why
    return gamma if gamma >= least else float(f"{least:.3g}")
