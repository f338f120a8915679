# SPDX-License-Identifier: Apache-2.0
"""Rotations between recorded attitudes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_flight.loop.record import rotation_between


def test_rotation_between_is_scipys():
    """Random attitudes, either sign of the quaternion, nearly equal ones; SciPy; 1e-12."""
    rng = np.random.default_rng(3)
    first = Rotation.random(50, random_state=4)
    turn = Rotation.from_rotvec(rng.normal(size=(50, 3)) * np.geomspace(1e-9, 1.0, 50)[:, None])
    second = turn * first
    sign = rng.choice([-1.0, 1.0], (50, 1))
    found = rotation_between(
        np.roll(first.as_quat(), 1, axis=1), sign * np.roll(second.as_quat(), 1, axis=1)
    )
    assert found == pytest.approx(turn.as_rotvec(), abs=1e-12)


def test_equal_attitudes_and_missing_ones():
    q = np.array([[0.5, 0.5, -0.5, 0.5], [np.nan] * 4])
    found = rotation_between(q, q)
    assert found[0] == pytest.approx(np.zeros(3), abs=1e-15) and np.isnan(found[1]).all()
