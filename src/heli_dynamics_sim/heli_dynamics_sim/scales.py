# SPDX-License-Identifier: Apache-2.0
"""The aircraft that flies as a multiple of that of its file, which the controllers keep."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from heli_dynamics_sim.parameters import HelicopterParameters

PREFIX = "scale."
SCALED: Mapping[str, tuple[str, ...]] = {
    "mass": ("mass_kg",),
    "inertia": ("inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2"),
    "rotor_stiffness": ("hub_stiffness_nmprad",),
    # The thrust map, T = slope (blade speed - inflow): its slope is proportional to this one.
    "thrust": ("main_lift_slope",),
    "servo_speed": ("servo_bandwidth_radps", "servo_rate_limit_per_s"),
    "drag": ("drag_area_x_m2", "drag_area_y_m2", "drag_area_z_m2"),
}
"""Per scale what it multiplies. One factor for the three inertias: they stay a rigid body's."""


def scaled(aircraft: HelicopterParameters, values: Mapping[str, Any]) -> HelicopterParameters:
    """The aircraft times the plant's parameters `scale.*`.

    Parameters
    ----------
    aircraft : HelicopterParameters
        Of the file.
    values : mapping
        Parameters of the node `plant`.

    Raises
    ------
    AircraftError
        A product is out of bounds.
    """
    changes = {
        name: getattr(aircraft, name) * values[PREFIX + scale]
        for scale, names in SCALED.items()
        for name in names
    }
    return replace(aircraft, **changes)
