# SPDX-License-Identifier: Apache-2.0
"""H-infinity output feedback: against closed forms, the norm by frequencies, and what cannot be."""

import numpy as np
import pytest

from heli_core.central_controller import (
    GeneralisedPlant,
    NoControllerError,
    Obstacle,
    System,
    central_controller,
    optimal_gamma,
    to_continuous,
    to_sampled,
)


def random_plant(seed, n=6, n_w=4, n_u=2, n_z=5, n_y=3):
    g = np.random.default_rng(seed)
    A = g.standard_normal((n, n))
    A *= 1.1 / np.max(np.abs(np.linalg.eigvals(A)))
    B, C = g.standard_normal((n, n_w + n_u)), g.standard_normal((n_z + n_y, n))
    D = g.standard_normal((n_z + n_y, n_w + n_u))
    return GeneralisedPlant(System(A, B, C, D), n_u, n_y)


def closed_gains(plant, K, angles):
    """Largest singular values of w -> z at these angles of the unit circle, by plain solves."""
    A, B, C, D = plant.system
    n_z, n_w = C.shape[0] - plant.n_y, B.shape[1] - plant.n_u
    z = np.exp(1j * np.asarray(angles))[:, None, None]
    P = D + C @ np.linalg.solve(z * np.eye(A.shape[0]) - A, B[None])
    k = K.D + K.C @ np.linalg.solve(z * np.eye(K.A.shape[0]) - K.A, K.B[None])
    through = np.linalg.solve(np.eye(plant.n_u) - k @ P[:, n_z:, n_w:], k @ P[:, n_z:, :n_w])
    return np.linalg.norm(P[:, :n_z, :n_w] + P[:, :n_z, n_w:] @ through, 2, axis=(1, 2))


def closed_radius(plant, K):
    """Largest eigenvalue of the loop, D22 in it."""
    A, B, C, D = plant.system
    B2, C2, D22 = B[:, -plant.n_u :], C[-plant.n_y :], D[-plant.n_y :, -plant.n_u :]
    M = np.linalg.inv(np.eye(plant.n_u) - K.D @ D22)
    u_x, u_k = M @ K.D @ C2, M @ K.C
    y_x, y_k = C2 + D22 @ u_x, D22 @ u_k
    loop = np.block([[A + B2 @ u_x, B2 @ u_k], [K.B @ y_x, K.A + K.B @ y_k]])
    return np.max(np.abs(np.linalg.eigvals(loop)))


@pytest.mark.parametrize("seed", range(5))
def test_norm_is_below_gamma_and_near_the_infimum_close_to_it(seed):
    plant = random_plant(seed)
    best = optimal_gamma(plant)
    for ratio in (1.001, 1.3):
        controller = central_controller(plant, ratio * best.value)
        assert closed_radius(plant, controller.system) < 1.0
        gains = closed_gains(plant, controller.system, np.linspace(0.0, np.pi, 600))
        assert gains.max() < ratio * best.value
        assert controller.radius < 1.0
        assert controller.residual < 1e-6
    with pytest.raises(NoControllerError):
        central_controller(plant, 0.999 * best.lower)


def test_infimum_of_a_scalar_with_a_known_answer():
    """x+ = a x + w1 + u, y = x + w2, z = (x, u): state and noise cost the same. By a fine search
    over all first-order controllers, which for a first-order plant are enough."""
    from scipy.optimize import minimize

    a = 0.9
    system = System(
        np.array([[a]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    )
    plant = GeneralisedPlant(system, 1, 1)
    angles = np.linspace(0.0, np.pi, 200)

    def norm(p):
        pole, residue, direct = p  # K = direct + residue / (z - pole)
        K = System(*(np.array([[value]]) for value in (pole, 1.0, residue, direct)))
        if closed_radius(plant, K) >= 1.0:
            return 10.0 + closed_radius(plant, K)
        return closed_gains(plant, K, angles).max()

    starts = ([0.1, -0.25, -0.3], [0.0, -0.01, -0.6])
    options = {"maxiter": 1500, "xatol": 1e-8, "fatol": 1e-9}
    least = min(minimize(norm, s, method="Nelder-Mead", options=options).fun for s in starts)
    assert optimal_gamma(plant).value == pytest.approx(least, rel=3e-3)
    assert optimal_gamma(plant).value <= least * (1.0 + 2e-4)


def test_integrals_of_what_is_measured_are_known():
    """A plant whose integral of y is a state: no filter estimates it, and none need to."""
    inner = random_plant(3, n_y=3).system
    n, n_w = inner.A.shape[0], 4
    y, through = inner.C[-1:], inner.D[-1:, :n_w]
    A = np.block([[inner.A, np.zeros((n, 1))], [0.1 * y, np.eye(1)]])
    B = np.vstack([inner.B, np.hstack([0.1 * through, np.zeros((1, 2))])])
    C = np.hstack([inner.C, np.vstack([np.ones((1, 1)), np.zeros((inner.C.shape[0] - 1, 1))])])
    D = inner.D.copy()
    D[-3:, n_w:] = 0.0
    plant = GeneralisedPlant(System(A, B, C, D), 2, 3, 1)
    best = optimal_gamma(plant)
    controller = central_controller(plant, 1.1 * best.value)
    gains = closed_gains(plant, controller.system, np.geomspace(1e-3, np.pi, 600))
    assert gains.max() < 1.1 * best.value
    assert controller.residual < 1e-6
    assert np.min(np.abs(np.linalg.eigvals(controller.system.A) - 1.0)) < 1e-6


def test_bilinear_map_there_and_back():
    system = random_plant(0).system
    back = to_sampled(to_continuous(system))
    assert all(np.allclose(a, b, atol=1e-10) for a, b in zip(system, back, strict=True))
    z = np.exp(0.7j)
    s = 2.0 * (z - 1.0) / (z + 1.0)
    cont = to_continuous(system)
    eye = np.eye(6)
    left = system.D + system.C @ np.linalg.solve(z * eye - system.A, system.B)
    right = cont.D + cont.C @ np.linalg.solve(s * eye - cont.A, cont.B)
    assert np.allclose(left, right)


def test_direct_path_that_no_controller_reaches_ends_feasibility():
    """z1 = 2 w1, whatever u does."""
    system = random_plant(1).system
    C, D = system.C.copy(), system.D.copy()
    C[0], D[0] = 0.0, 0.0
    D[0, 0] = 1000.0
    infimum = optimal_gamma(GeneralisedPlant(System(system.A, system.B, C, D), 2, 3))
    assert infimum.value == pytest.approx(1000.0, rel=2e-4)
    assert infimum.mechanism is Obstacle.DIRECT


def test_a_plant_that_u_cannot_stabilise_has_no_controller():
    system = random_plant(2).system
    A, B = system.A.copy(), system.B.copy()
    A[0], B[0] = 0.0, 0.0
    A[0, 0] = 1.2
    with pytest.raises(NoControllerError):
        optimal_gamma(GeneralisedPlant(System(A, B, system.C, system.D), 2, 3))


def wave_plant(n=5, n_w=4, n_u=2, n_z=4, n_y=2):
    """A plant without a random number in it, so that what others make of it can stand here."""

    def wave(rows, columns, shift):
        i, j = np.indices((rows, columns))
        return np.sin(shift + 3 * i - 5 * j * (i + 1))

    i, j = np.indices((n, n))
    A = np.cos(1 + 2 * i + 3 * j)
    A *= 1.1 / np.max(np.abs(np.linalg.eigvals(A)))
    D = wave(n_z + n_y, n_w + n_u, 2.0)
    D[n_z:, n_w:] = 0.0
    return GeneralisedPlant(
        System(A, wave(n, n_w + n_u, 0.5), wave(n_z + n_y, n, 1.0), D), n_u, n_y
    )


SLICOT_INFIMUM = 11.62459
"""Least gamma at which SB10DD, which stays in discrete time, finds a controller of `wave_plant`."""
SLICOT_CONTROLLER = {
    1.0: [[-0.728910574679, -0.310094415736], [-0.023856557097, -0.185986774342]],
    1j: [
        [-0.163247423554 + 0.740891718804j, 0.42228893862 - 0.017220678993j],
        [-0.215833808023 - 0.019552016545j, -0.183190954835 + 0.097880470855j],
    ],
}
"""Response at z of the controller of SB10FD for gamma = 15, mapped by the bilinear transform."""


def test_controller_and_infimum_are_those_of_slicot():
    """SLICOT's SB10DD and SB10FD (ctrlsys 1.1.1, worked out on 2026-11-22)."""
    plant = wave_plant()
    best = optimal_gamma(plant)
    assert best.lower < SLICOT_INFIMUM < best.value
    K = central_controller(plant, 15.0).system
    for z, expected in SLICOT_CONTROLLER.items():
        response = K.D + K.C @ np.linalg.solve(z * np.eye(K.A.shape[0]) - K.A, K.B)
        np.testing.assert_allclose(response, expected, rtol=0.0, atol=1e-9)
    # The norm that SB10FD's controller has in the loop.
    gains = closed_gains(plant, K, np.linspace(0.0, np.pi, 2000))
    assert gains.max() == pytest.approx(14.77816611, rel=1e-4)
    assert gains.max() <= 14.77816612
