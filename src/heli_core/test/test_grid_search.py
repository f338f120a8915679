# SPDX-License-Identifier: Apache-2.0
"""The search along a grid of rounded numbers."""

import math

from heli_core.search import GRID, on_grid, place_of, search


def test_grid_is_its_own_inverse_and_rounded():
    for step in range(-60, 61):
        value = on_grid(step)
        assert place_of(value) == step
        assert value == float(f"{value:.2g}")
    assert place_of(1.24) == GRID.index(1.2) and place_of(0.098) == place_of(0.1)


def test_search_ends_where_a_smooth_bowl_does():
    """The least of a bowl in the logarithm, with its axes oblique to the grid's."""

    def bowl(values):
        a, b = math.log(values[0] / 3.0), math.log(values[1] / 0.36)
        return 1.0 + (a + b) ** 2 + 10.0 * (a - b) ** 2

    assert search((0.5, 4.0, 0.0), bowl) == (3.0, 0.36, 0.0)
