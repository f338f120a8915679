# SPDX-License-Identifier: Apache-2.0
"""Gradients against differences, norms against other ways, laws against published values.

The published problems are of COMPleib 1.1 (F. Leibfritz, Tech. report, University of Trier, 2004;
its sources are named there): AC2 (Hung, MacFarlane 1982), AC8 (Gangsaas et al. 1986), AC15 (1974),
HE1 (Singh, Coelho 1984). Their matrices were compared with its file COMPleib.m of 2005-03-09.
"""

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_continuous_are
from scipy.signal import dimpulse, dlti

from heli_core.central_controller import System
from heli_inner_hinf.fixed_structure import (
    TOLD_EVERY,
    Goal,
    GoalKind,
    NotStabilizedError,
    TuningProblem,
    affine,
    h2,
    hinf,
    output_feedback,
    plant_of,
    side_by_side,
    tune,
)
from heli_inner_hinf.mu import discrete_norm
from heli_inner_hinf.nonsmooth import Evaluation, minimise

HALF = 1.0 / np.sqrt(2.0)


def entries(shape, values):
    """Zero but for these (row, column, value)."""
    matrix = np.zeros(shape)
    for row, column, value in values:
        matrix[row, column] = value
    return matrix


def ac2():
    A = [[0, 0, 1.132, 0, -1], [0, -0.0538, -0.1712, 0, 0.0705], [0, 0, 0, 1, 0],
         [0, 0.0485, 0, -0.8556, -1.013], [0, -0.2909, 0, 1.0532, -0.6859]]  # fmt: skip
    B = [[0, 0, 0], [-0.12, 1, 0], [0, 0, 0], [4.419, 0, -1.665], [1.575, 0, -0.0732]]
    B1 = [[0.03593, 0, 0.01672], [0, 0.00989, 0], [0, -0.07548, 0], [0, 0, 0.05635],
          [0.00145, 0, 0.06743]]  # fmt: skip
    C1 = HALF * entries((5, 5), [(0, 1, 1), (1, 2, 1)])
    return plant_of(A, B1, B, C1, np.eye(3, 5), D12=HALF * np.eye(5, 3, -2))


def he1():
    A = [[-0.0366, 0.0271, 0.0188, -0.4555], [0.0482, -1.01, 0.0024, -4.0208],
         [0.1002, 0.3681, -0.707, 1.42], [0, 0, 1, 0]]  # fmt: skip
    B = [[0.4422, 0.1761], [3.5446, -7.5922], [-5.52, 4.49], [0, 0]]
    B1 = [[0.04678, 0], [0.04572, 0.00988], [0.04369, 0.00111], [-0.02179, 0]]
    C1 = HALF * np.array([[2, 0, 0, 0], [0, 1, 0, 0]])
    return plant_of(A, B1, B, C1, [[0, 1, 0, 0]], D12=HALF * np.eye(2))


def ac15():
    A = [[-0.037, 0.0123, 0.00055, -1], [0, 0, 1, 0], [-6.37, 0, -0.23, 0.0618],
         [1.25, 0, 0.016, -0.0457]]  # fmt: skip
    B = [[0.00084, 0.000236], [0, 0], [0.08, 0.804], [-0.0862, -0.0665]]
    return plant_of(A, np.eye(4), B, np.eye(6, 4), np.eye(4)[1:], D12=np.eye(6, 2, -4))


def ac8():
    A = np.diag([0, 0, 0, 0, -20, -50, -0.4447, -0.4447, -0.4447])
    A[3, 2], A[4, 5], A[7, 8], A[8, 7] = 1, 10.72, 0.0044, -0.0044
    A[:3] = [
        [-0.01365, 0.178, 0.00017, -0.561, -0.03726, 0, 0.01365, -0.01311, 0],
        [-0.01516, -0.752, 1.001, 0.00127, -0.06311, 0, 0.01516, 0.05536, 0],
        [0.00107, 0.07896, -0.8725, 0, -3.399, 0, -0.00107, -0.00581, 0],
    ]
    C = [
        [0.00646, 0.3203, -0.03358, 0, -0.1032, 0, -0.00646, -0.02358, 0],
        [1, 0, 0, 0, 0, 0, -1, 0, 0],
        A[0],
        [0, -13.58, 0, 13.58, 0, 0, 0, 0, 0],
        [0, 0, 1, 0, 0, 0, 0, 0, 0],
    ]
    B1 = entries((9, 10), [(0, 3, 1), (5, 4, 50), (6, 0, 0.9431), (7, 1, 1.155), (8, 1, -48.82)])
    D21 = entries((5, 10), [(0, 7, 1), (1, 5, 1), (2, 6, 1), (3, 9, 1), (4, 8, 1)])
    B = entries((9, 1), [(5, 0, 50)])
    return plant_of(A, B1, B, 0.5 * np.array(C[:2]), C, D12=[[0.5], [0.5]], D21=D21)


def random_plant(seed, dt_s):
    """Stable: four states, two of each signal, with direct paths."""
    draw = np.random.default_rng(seed)
    A = draw.normal(size=(4, 4))
    A = 0.8 * A / np.max(np.abs(np.linalg.eigvals(A))) if dt_s else A - 4.0 * np.eye(4)
    B1, B2, C1, C2, D11, D12, D21 = (
        draw.normal(size=s) for s in ((4, 2), (4, 2), (2, 4), (2, 4), (2, 2), (2, 2), (2, 2))
    )
    return plant_of(A, B1, B2, C1, C2, D11, D12, D21, dt_s=dt_s)


def laws():
    """Static, with memory, and two blocks of which one knows an integrator."""
    integral = affine(
        lambda g: System(np.zeros((1, 1)), g[:1, None], np.ones((1, 1)), g[1:, None]), 2
    )
    return {
        "static": output_feedback(0, 2, 2),
        "order 2": output_feedback(2, 2, 2),
        "blocks": side_by_side(output_feedback(1, 1, 1), integral),
    }


@pytest.mark.parametrize("dt_s", [0.0, 0.01])
@pytest.mark.parametrize("law", laws())
@pytest.mark.parametrize("kind", GoalKind)
def test_gradients_are_those_of_differences(kind, law, dt_s):
    plant, structure = random_plant(3, dt_s), laws()[law]
    if kind is GoalKind.H2 and dt_s == 0.0:
        nothing = np.zeros((2, 2))
        plant = plant_of(plant.A, plant.B1, plant.B2, plant.C1, plant.C2, nothing, plant.D12,
                         nothing)  # fmt: skip
    problem = TuningProblem(structure, (Goal("one", kind, plant, 0.3),))
    x = 0.05 * np.random.default_rng(1).normal(size=problem.size)
    if dt_s:
        # a law's mode at 0 is one whose logarithm no difference can follow
        x[: structure.order] += 0.1
    value, gradient = problem.share(0, x)
    assert np.isfinite(value)
    step = 1e-6
    for i, slope in enumerate(gradient):
        away = step * np.eye(problem.size)[i]
        difference = (problem.share(0, x + away)[0] - problem.share(0, x - away)[0]) / (2.0 * step)
        assert slope == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.max(np.abs(gradient)))


def test_norms_are_those_of_other_ways():
    plant = random_plant(5, 0.01)
    loop = System(plant.A, plant.B1, plant.C1, plant.D11)
    assert hinf(loop, 0.01).value == pytest.approx(discrete_norm(*loop)[0], rel=1e-8)
    _, responses = dimpulse(dlti(*loop, dt=0.01), n=400)
    energy = sum(np.sum(one**2) for one in responses)
    assert h2(loop, 0.01).value == pytest.approx(np.sqrt(energy), rel=1e-9)


def test_a_direct_path_has_no_continuous_h2_norm():
    plant = random_plant(5, 0.0)
    assert h2(System(plant.A, plant.B1, plant.C1, plant.D11), 0.0).value == np.inf


def test_blocks_stand_side_by_side():
    one, other = output_feedback(1, 1, 2), output_feedback(2, 2, 1)
    both = side_by_side(one, other)
    x = np.arange(1.0, both.size + 1.0)
    A, B, C, D = both.law(x)
    a, b = one.law(x[: one.size]), other.law(x[one.size :])
    assert np.array_equal(A, [[a.A[0, 0], 0, 0], [0, *b.A[0]], [0, *b.A[1]]])
    assert np.array_equal(D[:1, :2], a.D) and np.array_equal(D[1:, 2:], b.D)
    assert np.array_equal(B[:1, :2], a.B) and np.array_equal(C[1:, 1:], b.C)
    assert not np.any(D[:1, 2:]) and not np.any(B[1:, :2])


@pytest.mark.parametrize("sharp", [1.0, 100.0])
def test_a_nonsmooth_valley_under_a_nonsmooth_constraint(sharp):
    """Rosenbrock's valley with an absolute value, x >= 1.2 |y|: the minimum is a corner."""

    def point(x):
        bend, side = x[1] - x[0] ** 2, np.sign(x[1] - x[0] ** 2)
        value = sharp * abs(bend) + (1.0 - x[0]) ** 2
        gradient = np.array([-2.0 * sharp * side * x[0] - 2.0 * (1.0 - x[0]), sharp * side])
        lean = 1.2 * abs(x[1]) - x[0]
        return Evaluation(value, gradient, np.array([lean]),
                     np.array([[-1.0, 1.2 * np.sign(x[1])]]))  # fmt: skip

    end = minimise(point, np.array([-0.9, 1.1]), 400)
    assert end.x == pytest.approx([1.0 / 1.2, 1.0 / 1.44], abs=2e-4)
    assert np.max(end.point.violations) < 1e-5


def problem_of(plant, order=0, **goal):
    structure = output_feedback(order, plant.B2.shape[1], plant.C2.shape[0])
    return TuningProblem(structure, (Goal("T", GoalKind.HINF, plant, 1.0, **goal),))


def test_what_no_gain_stabilises_is_refused():
    """A double integrator whose position alone is read."""
    A, B, C = [[0, 1], [0, 0]], [[0], [1]], [[1, 0]]
    with pytest.raises(NotStabilizedError):
        tune(problem_of(plant_of(A, B, B, C, C)), starts=2)


def test_hard_goals_are_kept_and_cost_something():
    free = tune(problem_of(he1()), starts=2)
    fast = Goal("decay", GoalKind.DECAY, he1(), 0.2, hard=True)
    problem = problem_of(he1())
    kept = tune(TuningProblem(problem.structure, (*problem.goals, fast)), starts=2)
    assert kept.hard <= 1.0 + 1e-3
    assert kept.soft > free.soft
    assert kept.reached[1].value >= 0.2 * (1.0 - 1e-3)


# Static output feedback's H-infinity norm by HIFOO. That AC8 and HE1 are among the examples of
# S. Gumussoy, M. L. Overton, "Fixed-order H-infinity controller design via HIFOO" (ACC 2008, arXiv
# 2003.02295) was looked up; its table, and that of Q. T. Dinh, S. Gumussoy, W. Michiels, M. Diehl
# (IEEE TAC 57(6), 2012) for AC2, could not be: these three numbers are from memory.
PUBLISHED = {"HE1": (he1, 0.154, 4), "AC2": (ac2, 0.1115, 2), "AC8": (ac8, 2.005, 2)}


@pytest.mark.parametrize("name", ["HE1", "AC2"])
def test_published_norms_of_static_output_feedback(name):
    plant, norm, starts = PUBLISHED[name]
    found = tune(problem_of(plant()), starts=starts)
    assert found.soft <= norm * 1.005
    assert found.soft >= norm * 0.99
    assert found.starts[0].evaluations > 10


def test_what_is_done_is_told():
    """Each start, its iterations now and then, its end."""
    lines = []
    found = tune(problem_of(he1()), starts=2, tell=lines.append)
    for number, start in enumerate(found.starts, 1):
        of = [line for line in lines if line.startswith(f"start {number} of 2")]
        assert len(of) >= 2 + start.iterations // TOLD_EVERY
        assert str(start.iterations) in of[-1]


@pytest.mark.slow
def test_published_norm_of_the_transport():
    plant, norm, starts = PUBLISHED["AC8"]
    assert tune(problem_of(plant()), starts=starts).soft == pytest.approx(norm, rel=5e-3)


@pytest.mark.slow
def test_a_supersonic_transport_needs_several_starts():
    """AC15: from zero the descent ends in a worse valley.

    15.2919 by HIFOO and 15.2 by hinfstruct, which prints three digits: baselines in the program of
    X. Guo, D. Keivan, G. Dullerud, P. Seiler, B. Hu, "Complexity of derivative-free policy
    optimization for structured H-infinity control", NeurIPS 2023.
    """
    found = tune(problem_of(ac15()), starts=4)
    assert 15.15 <= found.soft < 15.25
    assert found.soft < 15.2919
    assert max(start.soft for start in found.starts) > found.soft


def beam():
    """A flexible beam's six modes, force to speed at the same place; noises and costs of its LQG.

    MathWorks, "Vibration Control in Flexible Beam",
    https://www.mathworks.com/help/control/ug/vibration-control-in-flexible-beam.html: cost y^2 +
    0.001 u^2, disturbance at the force of variance 1, noise of the speed of variance 0.01.
    """
    alpha = np.array([0.09877, -0.309, -0.891, 0.5878, 0.7071, -0.8091])
    omega_radps, damping = np.array([1.0, 4.0, 9.0, 16.0, 25.0, 36.0]), 0.05
    modes = [[[0.0, 1.0], [-(w**2), -2.0 * damping * w]] for w in omega_radps]
    C = np.kron(alpha, [0.0, 1.0])[None]
    B1, C1 = np.hstack([C.T, np.zeros((12, 1))]), np.vstack([C, np.zeros((1, 12))])
    D12, D21 = [[0.0], [np.sqrt(1e-3)]], [[0.0, 0.1]]
    return plant_of(block_diag(*modes), B1, C.T, C1, C, D12=D12, D21=D21)


def strictly_proper(numbers):
    """A second-order controller without a direct path, as a finite variance of its output asks."""
    A, B, C = numbers[:4].reshape(2, 2), numbers[4:6, None], numbers[None, 6:]
    return System(A, B, C, np.zeros((1, 1)))


def test_the_documented_beam_of_systune():
    """0.478 is published for the second order, less than 5 % above LQG's twelve states.

    What systune prints there is the root of the page's J: LQG's own J, by its two Riccati
    equations, is 0.2184, its root 0.467.
    """
    plant = beam()
    goals = (Goal("LQG", GoalKind.H2, plant, 1.0),)
    start = [-1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0]
    found = tune(TuningProblem(affine(strictly_proper, 8), goals), start, starts=2)
    assert round(found.soft, 3) == 0.478
    X = solve_continuous_are(plant.A, plant.B2, plant.C2.T @ plant.C2, [[1e-3]])
    Y = solve_continuous_are(plant.A.T, plant.C2.T, plant.B2 @ plant.B2.T, [[1e-2]])
    F = plant.B2.T @ X / 1e-3
    lqg = np.sqrt(plant.B2.T @ X @ plant.B2 + 1e-3 * F @ Y @ F.T).item()
    assert lqg < found.soft < 1.05 * lqg
