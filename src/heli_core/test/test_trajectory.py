# SPDX-License-Identifier: Apache-2.0
"""Trajectories: the hover test's by hand, a random one against numpy, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.trajectory import Trajectory, TrajectoryError
from support.step_climb import step_climb

S = 1_000_000_000


def test_reference_of_the_hover_test():
    trajectory = step_climb(np.array([1.0, 2.0, -10.0]), 0.5, 18.0, 22.0, 2.5)
    later = replace(trajectory, start_ns=5 * S)
    for t_s, z, v_z in ((0, -10, 0), (17.99, -10, 0), (18, -10, -2.5), (20, -15, -2.5),
                        (22, -20, 0), (59, -20, 0), (-1, -10, 0)):  # fmt: skip
        time_ns = round(t_s * 1e9)
        np.testing.assert_allclose(later.at(5 * S + time_ns), [1, 2, z, 0, 0, v_z, 0.5], atol=1e-9)


def test_positions_are_interpolated_as_numpy_does():
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.integers(1, S, 8))
    way = Trajectory(0, times, rng.standard_normal((8, 7)))
    stamps = rng.integers(-S, times[-1] + S, 200)
    rows = np.array([way.at(int(stamp)) for stamp in stamps])
    for i in range(3):
        expected = np.interp(stamps, times, way.points[:, i])
        np.testing.assert_allclose(rows[:, i], expected, atol=1e-9)
    last = np.clip(np.searchsorted(times, stamps, side="right") - 1, 0, None)
    moving = (stamps >= times[0]) & (stamps < times[-1])
    np.testing.assert_array_equal(rows[:, 6], way.points[last, 6])
    np.testing.assert_array_equal(rows[:, 3:6], way.points[last, 3:6] * moving[:, None])


@pytest.mark.parametrize(
    ("times", "points", "word"),
    [
        ([0, 0], np.zeros((2, 7)), "does not increase"),
        ([0], np.full((1, 7), np.nan), "not finite"),
        ([0], np.zeros((1, 6)), "shape"),
        ([], np.zeros((0, 7)), "0 points"),
    ],
)
def test_bad_references_say_why(times, points, word):
    with pytest.raises(TrajectoryError, match=word):
        Trajectory(0, np.array(times), points)
