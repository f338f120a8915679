# SPDX-License-Identifier: Apache-2.0
"""The discrete norm against formulas and a dense grid."""

import numpy as np
import pytest

from heli_inner_hinf.robust import RobustCause, RobustError, discrete_norm


def test_first_order_lag_by_its_formula():
    # 2 / (z + 0.8) is largest at z = -1: 2 / 0.2.
    norm, angle = discrete_norm(*(np.array([[v]]) for v in (-0.8, 1.0, 2.0, 0.0)))
    assert norm == pytest.approx(10.0, rel=1e-9)
    assert angle == pytest.approx(np.pi)


def test_a_sharp_resonance_is_found_where_no_grid_point_is():
    radius, at = 0.99999, 0.731
    A = radius * np.array([[np.cos(at), np.sin(at)], [-np.sin(at), np.cos(at)]])
    B, C, D = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.array([[0.3]])
    norm, angle = discrete_norm(A, B, C, D)
    fine = at + np.linspace(-1e-4, 1e-4, 20001)
    z = np.exp(1j * fine)
    size = np.abs(0.3 + radius * np.sin(at) / (z * z - 2 * radius * np.cos(at) * z + radius**2))
    assert norm == pytest.approx(np.max(size), rel=1e-6)
    assert angle == pytest.approx(fine[np.argmax(size)], abs=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_several_inputs_and_outputs_against_a_grid(seed):
    draw = np.random.default_rng(seed)
    A = draw.normal(size=(6, 6))
    A *= 0.97 / np.max(np.abs(np.linalg.eigvals(A)))
    B, C, D = (draw.normal(size=shape) for shape in ((6, 2), (3, 6), (3, 2)))
    norm, angle = discrete_norm(A, B, C, D)

    def gain(at):
        return np.linalg.norm(D + C @ np.linalg.solve(np.exp(1j * at) * np.eye(6) - A, B), 2)

    grid = max(gain(at) for at in np.linspace(0.0, np.pi, 4001))
    assert grid <= norm * (1 + 1e-9) and grid == pytest.approx(norm, rel=1e-3)
    assert gain(angle) == pytest.approx(norm, rel=1e-9)


def test_unstable_and_not_finite_are_refused():
    one = np.ones((1, 1))
    with pytest.raises(RobustError, match="modulus 1.01") as refused:
        discrete_norm(1.01 * one, one, one, one)
    assert refused.value.cause is RobustCause.UNSTABLE
    with pytest.raises(RobustError, match="B holds"):
        discrete_norm(0.5 * one, np.nan * one, one, one)
