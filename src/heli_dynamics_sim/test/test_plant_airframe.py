# SPDX-License-Identifier: Apache-2.0
"""Fuselage and fins: signs, sizes by hand, no jumps."""

import numpy as np
import pytest

from heli_dynamics_sim.airframe import fin_force, fuselage_force


def test_fuselage_drag_opposes_the_flow(helicopter):
    k = helicopter.params.fuselage
    x, y, z = fuselage_force(10.0, -8.0, 0.0, 5.0, k)
    assert x == pytest.approx(-0.5 * 1.29 * 0.103 * 100.0)
    assert y == pytest.approx(0.5 * 1.29 * 8.0 * np.hypot(k.wash_y / 0.645 * 5.0, 0.22 * 8.0))
    assert z == pytest.approx(0.5 * 1.29 * 0.084 * 25.0)  # the downwash pushes it down


def test_fin_has_its_two_laws_and_no_jump(helicopter):
    k = helicopter.params.vertical_fin
    area = 0.5 * 1.29 * 0.012
    assert fin_force(1.0, 10.0, k) == pytest.approx(-area * 2.85 * 10.0)
    assert fin_force(-1.0, -10.0, k) == pytest.approx(area * 2.85 * 10.0)
    assert fin_force(9.0, 10.0, k) == pytest.approx(-area * 81.0)
    assert fin_force(3.0, 0.0, k) == pytest.approx(-area * 9.0)
    across = np.arange(-12.0, 12.0, 0.001)
    force = np.array([fin_force(v, 10.0, k) for v in across])
    assert np.abs(np.diff(force)).max() < 0.01
