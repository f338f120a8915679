# SPDX-License-Identifier: Apache-2.0
"""Side force: the damping of hover that was identified, and the bank that a side wind takes.

Y_v of HeLion in hover, -0.3104 1/s: the identified model of Peng, Cai, Chen, Dong, Lum, Lee, Design
and implementation of an autonomous flight control law for a UAV helicopter, Automatica 45(10),
2009 (as recalled). Drag of a side wind: that of Gavrilets' X-Cell (xcell60.yaml), of its size.
"""

import numpy as np
import pytest

from heli_core.rotations import euler_from_quat
from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.helicopter import state_derivative
from heli_dynamics_sim.trim import trim

PUBLISHED_Y_V = -0.3104
HELION, XCELL, LOGO = (
    HelicopterParameters.from_yaml(f"{name}.yaml") for name in ("helion", "xcell60", "logo600")
)


def side_damping(p):
    """dv'/dv of still-air hover, 1/s, all else held."""
    hover = trim(p)

    def rate(v):
        x = hover.x.copy()
        x[PLANT.down], x[PLANT.v] = -50.0, v
        return state_derivative(x, hover.u, (0.0, 0.0, 0.0), p)[PLANT.v]

    return (rate(1e-4) - rate(-1e-4)) / 2e-4


def bank_deg(p, wind_mps):
    """Bank beyond that of still air in a wind from the right, deg."""
    still, leaning = (
        euler_from_quat(trim(p, (0.0, -speed, 0.0)).x[PLANT.quat])[0] for speed in (0.0, wind_mps)
    )
    return np.degrees(leaning - still)


def test_damping_of_hover_is_the_identified_one():
    assert side_damping(HELION) == pytest.approx(PUBLISHED_Y_V, rel=0.005)


@pytest.mark.parametrize("wind_mps", [4.0, 8.0, 12.0])
def test_bank_in_a_side_wind_is_that_of_the_law(wind_mps):
    """Weight against Y = rho/2 V sqrt((S_wy v_i)^2 + (S_fy V)^2), v_i by Glauert; a sixth for what
    tail rotor and fin add."""
    rho, area = HELION.air_density_kgpm3, np.pi * HELION.main_radius_m**2
    weight = HELION.mass_kg * HELION.gravity_mps2
    hover_sq = weight / (2.0 * rho * area)
    v_i = np.sqrt(np.hypot(0.5 * wind_mps**2, hover_sq) - 0.5 * wind_mps**2)
    areas = np.hypot(HELION.wash_area_y_m2 * v_i, HELION.drag_area_y_m2 * wind_mps)
    expected = np.degrees(np.arctan(0.5 * rho * wind_mps * areas / weight))
    assert bank_deg(HELION, wind_mps) == pytest.approx(expected, rel=1.0 / 6.0)


def test_bank_in_a_strong_side_wind_is_that_of_a_helicopter_of_this_size():
    """12 m/s: within a quarter of the X-Cell's; with one area for both, 0.9 m2, it would be 38."""
    ours, theirs = (bank_deg(p, 12.0) for p in (HELION, XCELL))
    assert ours == pytest.approx(theirs, rel=0.25)
    assert 10.0 < ours < 20.0


@pytest.mark.parametrize("p", [XCELL, LOGO])
def test_where_both_areas_are_the_same_it_is_gavrilets_law(p):
    assert p.wash_area_y_m2 == p.drag_area_y_m2
    k = p.params.fuselage
    assert k.wash_y == k.y == pytest.approx(0.5 * p.air_density_kgpm3 * p.drag_area_y_m2)
