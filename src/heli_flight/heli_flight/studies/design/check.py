# SPDX-License-Identifier: Apache-2.0
"""`heli design --check`: whether the packaged YAML holds what the searches yield."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heli_dynamics_sim.parameters import HelicopterParameters
from heli_flight.loop.settings import resolve
from heli_flight.studies.design import rivals
from heli_flight.studies.design.attitude import yardstick
from heli_flight.studies.design.make import Design
from heli_inner_hinf.design import AttitudeConfig

SEARCHED = {
    "inner_loop": (
        "output.effort",
        "output.integral",
        "output.load",
        "output.noise",
    ),
    "outer_loop": (
        "K_P",
        "K_D",
        "disturbance.bandwidth_radps",
        "disturbance.attitude_lag_s",
        "attitude_lead.lead_s",
    ),
}
"""By node the parameters that a search chooses, on a grid of rounded numbers."""


def differences(design: Design, params: Sequence[Path] = ()) -> list[str]:
    """Where what is shipped is not what the searches yield, a sentence each.

    Parameters
    ----------
    design : Design
        Made with the searches.
    params : sequence of path
        Parameter files that the design was made with.
    """
    nodes = resolve(params=params).nodes
    yielded = {
        node: {key: design.values[node][key] for key in keys} for node, keys in SEARCHED.items()
    }
    told = [line for node, values in yielded.items() for line in _told(node, nodes[node], values)]
    actuation = AttitudeConfig.from_parameters(
        {**nodes["inner_loop"], "controller": "pid"}
    ).actuation
    helicopter = HelicopterParameters.from_yaml(nodes["plant"]["aircraft_file"])
    measure = yardstick(helicopter, actuation)
    for controller in rivals.KEYS:
        own = resolve(params=params, laws=controller).nodes
        # One number at a time, from what is shipped on.
        found = rivals.chosen(controller, own, measure, (1,), pairs=False)
        told += _told(f"laws {controller}: inner_loop", own["inner_loop"], found)
    return told


def _told(where: str, shipped: Mapping[str, Any], yielded: Mapping[str, Any]) -> list[str]:
    """A sentence for each parameter that differs."""
    return [
        f"{where}: {key}: shipped {np.asarray(shipped[key]).tolist()}, the search yields "
        f"{np.asarray(value).tolist()}"
        for key, value in yielded.items()
        if not np.array_equal(np.ravel(shipped[key]), np.ravel(value))
    ]
