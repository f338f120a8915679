# SPDX-License-Identifier: Apache-2.0
"""D-K iteration, the bound of mu in it, and balanced truncation, each against another way."""

import numpy as np
import pytest
from scipy.optimize import minimize

from heli_core.central_controller import GeneralisedPlant, System
from heli_inner_hinf.mu import discrete_norm, scaled_mu
from heli_inner_hinf.robust import RobustCause, RobustError
from heli_inner_hinf.robust.mu_synthesis import closed_loop, dk_iteration, response
from heli_inner_hinf.robust.uncertain import balancing, truncated

ANGLES = np.geomspace(1e-3, 3.0, 60)


def complex_matrix(seed, *shape):
    draw = np.random.default_rng(seed)
    return draw.normal(size=shape) + 1j * draw.normal(size=shape)


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_is_the_minimum_over_the_scalings(seed):
    """Three numbers and a full block 3 x 2; Nelder and Mead know nothing of the gradient."""
    M = complex_matrix(seed, 1, 6, 5)
    bound, d = scaled_mu(M, 3)

    def size(log_d):
        left, right = np.ones(6), np.ones(5)
        left[:3], right[:3] = np.exp(log_d), np.exp(-np.asarray(log_d))
        return np.linalg.norm(left[:, None] * M[0] * right, 2)

    best = minimize(
        size, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-10}
    )
    assert bound[0] == pytest.approx(best.fun, rel=2e-3)
    assert size(np.log(d[0])) == pytest.approx(bound[0], rel=1e-12)


def test_mu_of_a_product_is_exact():
    """Rank one: mu = sum of |b_i c_i| for numbers, for every b and c."""
    b, c = complex_matrix(1, 4, 1), complex_matrix(2, 1, 4)
    bound, _ = scaled_mu((b @ c)[None], 3)
    assert bound[0] == pytest.approx(np.abs(b[:, 0] * c[0]).sum(), rel=1e-3)


def gain_known_to_half(share):
    """A lag whose gain is known to a share, in units that suit no law; error and command."""
    a, b = 0.9, 0.1
    A, B = np.array([[a]]), np.array([[0.1 * b, b, 0.0, b]])
    C = np.array([[0.0], [5.0], [0.0], [1.0]])
    D = np.zeros((4, 4))
    D[0, 3], D[2, 3], D[3, 2] = 10.0 * share, 0.3, 0.05
    return GeneralisedPlant(System(A, B, C, D), 1, 1)


def test_mu_falls_and_the_law_keeps_what_it_promises():
    plant = gain_known_to_half(0.6)
    result = dk_iteration(plant, (1,), ANGLES)
    assert result.peak < 0.97 * result.peaks[0]
    closed = closed_loop(plant, result.controller.system)
    mu = scaled_mu(response(closed, ANGLES), 1)[0]
    assert np.max(mu) == pytest.approx(result.peak, rel=1e-12)
    # By every gain of the set, up to 1 / mu: the worst performance stays below mu.
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        delta = np.exp(1j * angle) / result.peak
        for M in response(closed, ANGLES):
            through = M[1:, :1] @ (M[:1, 1:] * delta / (1.0 - M[0, 0] * delta))
            assert np.linalg.norm(M[1:, 1:] + through, 2) <= result.peak * (1 + 1e-9)


def test_a_plant_that_no_law_stabilises_is_refused():
    plant = gain_known_to_half(0.6)
    A, B, C, D = plant.system
    blind = System(
        np.diag([0.9, 1.2]), np.vstack([B, np.zeros((1, 4))]), np.pad(C, ((0, 0), (0, 1))), D
    )
    with pytest.raises(RobustError, match=" nominal plant: ") as refused:
        dk_iteration(GeneralisedPlant(blind, 1, 1), (1,), ANGLES)
    assert refused.value.cause is RobustCause.NOT_CONVERGED


@pytest.mark.parametrize("order", [2, 4, 6])
def test_truncation_keeps_its_bound(order):
    draw = np.random.default_rng(5)
    A = draw.normal(size=(8, 8))
    A *= 0.95 / np.max(np.abs(np.linalg.eigvals(A)))
    system = System(A, draw.normal(size=(8, 2)), draw.normal(size=(3, 8)), draw.normal(size=(3, 2)))
    hankel, W, V = balancing(system)
    np.testing.assert_allclose(W @ V, np.eye(8), atol=1e-9)
    small = truncated(system, W, V, order)
    none = np.zeros((8, order))
    error = discrete_norm(
        np.block([[system.A, none], [none.T, small.A]]),
        np.vstack([system.B, small.B]),
        np.hstack([system.C, -small.C]),
        system.D - small.D,
    )[0]
    assert hankel[order] * (1 - 1e-9) <= error <= 2.0 * hankel[order:].sum() * (1 + 1e-9)
    with pytest.raises(RobustError, match="modulus"):
        balancing(system._replace(A=2.0 * A))
