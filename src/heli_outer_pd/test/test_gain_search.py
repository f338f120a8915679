# SPDX-License-Identifier: Apache-2.0
"""The search for gains: its ends, its floor on the margins."""

import math
from dataclasses import replace

import numpy as np
import pytest

from heli_core.search import on_grid, place_of, search
from heli_outer_pd.analysis import (
    Axis,
    AxisRequirements,
    NoGainsError,
    Sampled,
    best_gains,
    cost,
    deviations,
    disk_margin,
    drifting,
    dryden_across,
    gains_at,
    open_loop,
)


def lagging(lag_s):
    """A first-order lag with drag."""
    keep = math.exp(-0.01 / lag_s)
    one = np.eye(1)
    return Sampled(keep * one, np.array([[1.0 - keep, 0.0]]), one, np.array([[0.0, 0.3]]))


AXIS = Axis(
    actuation=lagging(0.4),
    modelled_lag_s=0.35,
    modelled_damping_per_s=0.0,
    gusts=(dryden_across(0.6, 20.0),),
    position_error=drifting(0.02, 2.0),
    speed_error=drifting(0.01, 0.5),
    period_ticks=4,
)
WANTED = AxisRequirements(0.05, 0.05, disk_margin=0.6, disk_margin_of_others=0.4, step_mps2=np.inf)


def test_rounding_does_not_move_the_end():
    """Costs that are off by a millionth, as on another machine, end at the same gains."""
    rng = np.random.default_rng(1)

    def price(values, noise):
        exact = cost(gains_at(values, 0.8, 0.1), AXIS, (), WANTED)
        return exact * (1.0 + noise * rng.uniform(-1.0, 1.0))

    ends = {search((0.43, 1.1, 0.3, 0.3), lambda v, n=n: price(v, n)) for n in (0.0, 1e-6, 1e-6)}
    assert len(ends) == 1


def test_best_gains_keep_the_floor_and_no_neighbour_is_better():
    late = replace(AXIS, actuation=lagging(0.55))
    best = best_gains("forward", AXIS, (late,), WANTED, 0.8, 0.1)
    best_g = gains_at(best, 0.8, 0.1)
    assert disk_margin(open_loop(AXIS, best_g)[1]) >= 0.6
    assert disk_margin(open_loop(late, best_g)[1]) >= 0.4
    least = cost(best_g, AXIS, (late,), WANTED)
    rms = np.array([deviations(axis, best_g)[:2] for axis in (AXIS, late)])
    assert least == pytest.approx(np.mean(np.sum((rms / 0.05) ** 2, axis=1)), rel=1e-12)
    for i in range(4):
        for way in (-1, 1):
            beside = list(best)
            beside[i] = on_grid(place_of(best[i]) + way)
            assert cost(gains_at(beside, 0.8, 0.1), AXIS, (late,), WANTED) > least * (1.0 - 1e-4)


def test_gains_whose_command_shakes_are_none():
    """The step is the bound of the axis as modelled alone; without the bound they would be best."""
    free = gains_at(best_gains("forward", AXIS, (), WANTED, 0.8, 0.1), 0.8, 0.1)
    calm = replace(WANTED, step_mps2=0.7 * deviations(AXIS, free).step_mps2)
    bound = gains_at(best_gains("forward", AXIS, (), calm, 0.8, 0.1), 0.8, 0.1)
    assert deviations(AXIS, bound).step_mps2 <= calm.step_mps2
    assert cost(free, AXIS, (), calm) == np.inf
    assert cost(bound, AXIS, (), WANTED) > cost(free, AXIS, (), WANTED)


def test_an_axis_that_nothing_holds_is_refused_by_name():
    slow = replace(AXIS, actuation=lagging(30.0))
    with pytest.raises(NoGainsError, match=r"right: .* 1\.9"):
        best_gains("right", slow, (), replace(WANTED, disk_margin=1.9), 0.8, 0.1)
