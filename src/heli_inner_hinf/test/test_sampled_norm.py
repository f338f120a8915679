# SPDX-License-Identifier: Apache-2.0
"""The norm between samples against a formula, fast sampling, and another toolbox's number."""

import numpy as np
import pytest
from scipy.linalg import expm

from heli_inner_hinf.robust import RobustCause, RobustError, discrete_norm
from heli_inner_hinf.robust.sampled_norm import HeldPlant, SampledLaw, sampled_norm

LIGHTLY_DAMPED = np.array([[0.0, 1.0], [-1.0, -0.2]])
INTO, OUT = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
NO_LAW = SampledLaw(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 1)))


def fast_sampled(plant, law, parts):
    """A, B, C, D of the loop with the wind held over 1/parts of a tick, the error's energy exact.

    Nothing of the Hamiltonian is in it. The delay has to be a whole number of parts.
    """
    n, m = plant.B.shape
    n_w, k = plant.E.shape[1], law.A.shape[0]
    step_s = plant.tick_s / parts
    late = round(plant.delay_s / step_s)
    depth = -(-late // parts)
    F = np.zeros((n + m + n_w, n + m + n_w))
    F[:n] = np.hstack([plant.A, plant.B, plant.E / np.sqrt(step_s)])
    out = np.hstack([plant.C, np.zeros((plant.C.shape[0], m + n_w))])
    both = expm(np.block([[-F.T, out.T @ out], [np.zeros_like(F), F]]) * step_s)
    flow = both[F.shape[0] :, F.shape[0] :]
    values, vectors = np.linalg.eigh(flow.T @ both[: F.shape[0], F.shape[0] :])
    energy = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    size = n + k + m * depth
    command = np.zeros((m * (depth + 1), size))
    command[:m, :n], command[:m, n : n + k] = law.D @ plant.C_y, law.C
    command[m:, n + k :] = np.eye(m * depth)
    x, x_w = np.eye(n, size), np.zeros((n, n_w * parts))
    z, z_w = [], []
    for i in range(parts):
        lag = -((i - late) // parts)
        held = command[m * lag : m * (lag + 1)]
        w = np.zeros((n_w, n_w * parts))
        w[:, n_w * i : n_w * (i + 1)] = np.eye(n_w)
        now = np.vstack([x, held, np.zeros((n_w, size))])
        now_w = np.vstack([x_w, np.zeros((m, n_w * parts)), w])
        z.append(energy @ now)
        z_w.append(energy @ now_w)
        x, x_w = flow[:n] @ now, flow[:n] @ now_w
    law_rows = np.zeros((size - n, size))
    law_rows[:k, :n], law_rows[:k, n : n + k] = law.B @ plant.C_y, law.A
    law_rows[k:] = command[: m * depth]
    A, B = np.vstack([x, law_rows]), np.vstack([x_w, np.zeros((size - n, n_w * parts))])
    return A, B, np.vstack(z), np.vstack(z_w)


def richardson(value, parts):
    """What values whose error falls with the square of the parts tend to."""
    coarse, fine = value(parts), value(2 * parts)
    return fine + (fine - coarse) / 3.0


@pytest.mark.parametrize("tick_s", [0.01, 1.0, 7.0, 30.0])
def test_without_a_law_it_is_the_norm_of_the_plant(tick_s):
    # 1 / (s^2 + 2 d s + 1) has the norm 1 / (2 d sqrt(1 - d^2)), however long the tick is.
    plant = HeldPlant(LIGHTLY_DAMPED, INTO, INTO, OUT, OUT, tick_s, 0.0)
    norm = sampled_norm(plant, NO_LAW)
    exact = 1.0 / (0.2 * np.sqrt(0.99))
    assert norm.lower <= exact <= norm.upper
    assert norm.upper - norm.lower <= 1.1e-7 * exact


def random_loop(seed, delay_s):
    """A stable loop of an integrating plant with two inputs and a law with a state of its own."""
    draw = np.random.default_rng(seed)
    A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 1.0], [0.0, 0.0, -8.0]])
    B, E = np.array([[0.0], [0.0], [8.0]]), draw.normal(size=(3, 2))
    plant = HeldPlant(A, B, E, draw.normal(size=(2, 3)), np.eye(2, 3), 0.2, delay_s)
    law = SampledLaw(
        np.array([[0.6]]), np.array([[0.3, 0.1]]), np.array([[-0.8]]), np.array([[-0.5, -0.4]])
    )
    return plant, law


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.2, 0.3])
def test_fast_sampling_tends_to_it(delay_s):
    plant, law = random_loop(3, delay_s)
    norm = sampled_norm(plant, law)

    def fast(parts):
        return discrete_norm(*fast_sampled(plant, law, parts))[0]

    assert fast(8) < norm.upper
    assert richardson(fast, 8) == pytest.approx(norm.upper, rel=1e-5)
    assert norm.upper - norm.lower <= 1.1e-7 * norm.upper


@pytest.mark.parametrize("tick_s, other", [(0.05, 0.78605736), (1.0, 1.34894926)])
def test_the_associated_norm_of_directsd_is_met_and_is_an_upper_bound(tick_s, other):
    """`sdhinorm` of directsd-python 0.2.0 gives the associated norm.

    That is the largest Hilbert-Schmidt norm on the circle, worked out on a grid: above the norm
    itself by what the aliases add, which is nothing where the tick is short.
    """
    A = np.array([[-1.0, 0.0], [1.0, -0.5]])
    into, out = np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]])
    law = SampledLaw(*(np.array([[v]]) for v in (0.5, 1.0, -0.2, -0.4)))
    plant = HeldPlant(A, into, into, out, out, tick_s, 0.0)
    norm = sampled_norm(plant, law)

    def associated(parts):
        system = fast_sampled(plant, law, parts)
        near = norm.frequency_radps * tick_s * np.linspace(0.95, 1.05, 101)
        return max(np.linalg.norm(at(system, angle)) for angle in near)

    assert richardson(associated, 8) == pytest.approx(other, rel=1e-5)
    assert norm.lower < other * (1 + 2e-6)
    assert norm.upper == pytest.approx(other, rel=1e-6 if tick_s < 0.1 else 5e-4)


def at(system, angle):
    """Response of a discrete system at an angle of the circle, rad."""
    A, B, C, D = system
    return D + C @ np.linalg.solve(np.exp(1j * angle) * np.eye(A.shape[0]) - A, B)


def test_an_error_within_one_tick_counts():
    """A tick so long that wind to error within it is most of the norm."""
    plant = HeldPlant(np.array([[-1.0]]), *(np.ones((1, 1)),) * 4, 3.0, 0.0)
    law = NO_LAW._replace(D=np.array([[-0.5]]))
    norm = sampled_norm(plant, law)

    def fast(parts):
        return discrete_norm(*fast_sampled(plant, law, parts))[0]

    assert richardson(fast, 16) == pytest.approx(norm.upper, rel=1e-4)


def test_an_unstable_loop_and_what_is_not_finite_are_refused():
    plant, law = random_loop(3, 0.1)
    with pytest.raises(RobustError, match="modulus") as refused:
        sampled_norm(plant, law._replace(D=-40.0 * law.D))
    assert refused.value.cause is RobustCause.UNSTABLE
    with pytest.raises(RobustError, match="matrix 2 ") as refused:
        sampled_norm(plant, law._replace(B=np.nan * law.B))
    assert refused.value.cause is RobustCause.NOT_FINITE
