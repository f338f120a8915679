# SPDX-License-Identifier: Apache-2.0
"""gamma* against closed forms, an independent bisection, an LMI, and on random plants."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from heli_core.errors import (
    InfeasibleGammaError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
)
from heli_inner_hinf.regular_form import checked_plant, regular_form, split
from heli_inner_hinf.synthesis import REL_TOL, Mechanism, gamma_star, synthesize


def scalar(a, b, e, q, r):
    """Scalar plant with cost q x^2 + r u^2."""
    root = np.sqrt([q, r])
    return [[a]], [[b]], [[e]], [[root[0]], [0.0]], [[0.0], [root[1]]]


def rotated_pair(first, second, seed=3):
    """Two scalar plants side by side, states rotated into each other and scaled."""
    A, B, E = (np.diag([np.ravel(f)[0], np.ravel(s)[0]])
               for f, s in zip(first[:3], second[:3], strict=True))  # fmt: skip
    q1, r1 = first[3][0][0], first[4][1][0]
    q2, r2 = second[3][0][0], second[4][1][0]
    C = np.vstack([np.diag([q1, q2]), np.zeros((2, 2))])
    D = np.vstack([np.zeros((2, 2)), np.diag([r1, r2])])
    rng = np.random.default_rng(seed)
    T = np.linalg.qr(rng.standard_normal((2, 2)))[0] @ np.diag([1.0, 50.0])
    inverse = np.linalg.inv(T)
    return inverse @ A @ T, inverse @ B, inverse @ E, C @ T, D


@pytest.mark.parametrize("e", [0.2, 1.0, 30.0])
@pytest.mark.parametrize(("b", "q", "r"), [(0.7, 3.0, 0.5), (2.0, 0.1, 4.0)])
class TestScalar:
    """x' = a x + b u + e w: gamma*^2 = e^2 / (a^2/q + b^2/r) if a <= 0, e^2 r / b^2 if a > 0."""

    def test_stable_plant_ends_on_the_axis(self, b, q, r, e):
        limit = gamma_star(*scalar(-1.5, b, e, q, r))
        exact = e / np.sqrt(1.5**2 / q + b**2 / r)
        assert limit.value == pytest.approx(exact, rel=1e-12)
        assert limit.mechanism is Mechanism.HAMILTONIAN_AXIS
        assert limit.frequency == 0.0

    def test_unstable_plant_ends_with_p_unbounded(self, b, q, r, e):
        limit = gamma_star(*scalar(2.0, b, e, q, r))
        exact = e * np.sqrt(r) / b
        assert limit.value == pytest.approx(exact, rel=1e-10)
        assert limit.lower <= exact * (1 + 1e-14) and exact * (1 - 1e-14) <= limit.upper
        assert limit.mechanism is Mechanism.P_UNBOUNDED
        assert limit.frequency is None

    def test_no_weight_on_the_state_of_an_unstable_plant(self, b, q, r, e):
        # Phi is zero: with foresight the wind costs nothing, without it e sqrt(r) / b
        limit = gamma_star(*scalar(2.0, b, e, 0.0, r))
        assert limit.value == pytest.approx(e * np.sqrt(r) / b, rel=1e-10)
        assert limit.mechanism is Mechanism.P_UNBOUNDED


def test_oscillator_without_control_gives_its_resonance_peak():
    w0, damping, weight = 3.0, 0.1, 2.0
    A = [[0.0, 1.0], [-(w0**2), -2 * damping * w0]]
    C, D = [[weight, 0.0], [0.0, 0.0]], [[0.0], [1.0]]
    limit = gamma_star(A, [[0.0], [0.0]], [[0.0], [1.0]], C, D)
    peak = weight / (2 * damping * w0**2 * np.sqrt(1 - damping**2))
    assert limit.value == pytest.approx(peak, rel=1e-12)
    assert limit.frequency == pytest.approx(w0 * np.sqrt(1 - 2 * damping**2), rel=1e-5)
    no_input = gamma_star(A, np.zeros((2, 0)), [[0.0], [1.0]], C, np.zeros((2, 0)))
    assert no_input.value == pytest.approx(peak, rel=1e-12)


def test_double_integrator_with_matched_wind():
    # Phi = q r / (q + r w^4): largest at w = 0, where countering the wind costs sqrt(r)
    r = 0.49
    C, D = [[2.0, 0.0], [0.0, 0.0]], [[0.0], [np.sqrt(r)]]
    limit = gamma_star([[0, 1], [0, 0]], [[0], [1]], [[0], [1]], C, D)
    assert limit.value == pytest.approx(np.sqrt(r), rel=1e-9)


@pytest.mark.parametrize(
    ("e_stable", "mechanism"),
    [(10.0, Mechanism.HAMILTONIAN_AXIS), (0.1, Mechanism.P_UNBOUNDED)],
)
def test_two_states_take_the_worse_of_the_two(e_stable, mechanism):
    stable = scalar(-1.0, 0.5, e_stable, 2.0, 1.0)
    unstable = scalar(0.8, 1.5, 1.0, 1.0, 0.6)
    limit = gamma_star(*rotated_pair(stable, unstable))
    exact = max(e_stable / np.sqrt(1.0 / 2.0 + 0.25), np.sqrt(0.6) / 1.5)
    assert limit.value == pytest.approx(exact, rel=1e-9)
    assert limit.mechanism is mechanism


def test_no_wind_at_all_is_a_value(published):
    A, B, E, C, D = published
    limit = gamma_star(A, B, 0.0 * E, C, D)
    assert limit.value == limit.upper == 0.0
    assert limit.mechanism is Mechanism.NO_DISTURBANCE
    assert synthesize(A, B, 0.0 * E, C, D, 1e-3, np.eye(9)[[0, 1, 8]]).norm == 0.0


def test_wind_on_hidden_stable_states_only_is_a_value():
    A = [[-1.0, 0.0], [0.5, -2.0]]
    C, D = [[3.0, 0.0], [0.0, 0.0]], [[0.0], [1.0]]
    limit = gamma_star(A, [[1.0], [0.0]], [[0.0], [1.0]], C, D)
    assert limit.value == 0.0
    assert limit.mechanism is Mechanism.NO_DISTURBANCE


def test_published_aircraft(published):
    limit = gamma_star(*published)
    assert limit.value == pytest.approx(0.05164933140, rel=1e-9)
    assert limit.mechanism is Mechanism.HAMILTONIAN_AXIS
    assert 23.0 < limit.frequency < 25.0  # the flapping mode
    assert (limit.upper - limit.lower) <= REL_TOL * limit.upper


def test_does_not_depend_on_units(published):
    A, B, E, C, D = published
    t = 10.0 ** np.random.default_rng(5).uniform(-5, 5, 9)
    scaled = (A * t[:, None] / t, B * t[:, None], E * t[:, None], C / t, D)
    assert gamma_star(*scaled).value == pytest.approx(gamma_star(*published).value, rel=2e-10)


def feasible(plant, gamma):
    """The acceptance rule, written again with SciPy's solver on the plain matrices."""
    A, B, E, C, D = (np.asarray(m, float) for m in plant)
    m, k = B.shape[1], E.shape[1]
    R = np.zeros((m + k, m + k))
    R[:m, :m], R[m:, m:] = D.T @ D, -(gamma**2) * np.eye(k)
    cross = np.hstack([C.T @ D, np.zeros((A.shape[0], E.shape[1]))])
    try:
        P = solve_continuous_are(A, np.hstack([B, E]), C.T @ C, R, s=cross)
    except np.linalg.LinAlgError:
        return False
    F = -np.linalg.solve(D.T @ D, D.T @ C + B.T @ P)
    closed = A + B @ F
    worst = closed + E @ E.T @ P / gamma**2
    terms = (A.T @ P, C.T @ C, P @ E @ E.T @ P / gamma**2)
    residual = terms[0] + terms[0].T + terms[1] + terms[2] - (P @ B + C.T @ D) @ -F
    if np.linalg.norm(residual) > 1e-7 * sum(np.linalg.norm(t) for t in terms):
        return False
    omega = np.concatenate([np.geomspace(1e-4, 1e4, 300), np.abs(np.linalg.eigvals(closed))])
    resolvent = 1j * omega[:, None, None] * np.eye(A.shape[0]) - closed
    response = (C + D @ F) @ np.linalg.solve(resolvent, E.astype(complex)[None])
    return bool(
        np.max(np.linalg.svd(response, compute_uv=False)) < gamma * (1 + 1e-5)
        and np.linalg.eigvalsh(0.5 * (P + P.T))[0] >= -1e-9 * np.linalg.norm(P)
        and np.max(np.linalg.eigvals(closed).real) < 0
        and np.max(np.linalg.eigvals(worst).real) < 0
    )


def bisected(plant, top, rel=1e-7):
    low, high = 0.0, top
    assert feasible(plant, high)
    while high - low > rel * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if feasible(plant, middle) else (middle, high)
    return high


def test_bisection_agrees_on_the_aircraft(published):
    gamma = gamma_star(*published).value
    assert bisected(published, 3 * gamma) == pytest.approx(gamma, rel=1e-6)


@pytest.mark.parametrize("i", [5, 7, 11, 13, 19, 23])
def test_bisection_agrees_on_random_plants(random_plant, i):
    plant = random_plant(i)
    gamma = gamma_star(*plant).value
    assert bisected(plant, 3 * gamma) == pytest.approx(gamma, rel=1e-5)


@pytest.mark.parametrize("name", ["aircraft", "stable", "unstable"])
def test_linear_matrix_inequality_agrees(published, name):
    cvxpy = pytest.importorskip("cvxpy")
    plant = {
        "aircraft": published,
        "stable": rotated_pair(scalar(-1.0, 0.5, 3.0, 2.0, 1.0), scalar(-2.0, 1.0, 1.0, 1.0, 1.0)),
        "unstable": rotated_pair(scalar(-1.0, 0.5, 0.1, 2.0, 1.0), scalar(0.8, 1.5, 1.0, 1.0, 0.6)),
    }[name]
    form = regular_form(*checked_plant(*plant))  # scaled: an interior-point solver needs that
    A, B, E = form.A, form.B, form.E
    n, m = B.shape
    C = np.vstack([form.C, np.zeros((m, n))])
    D = np.vstack([np.zeros((form.C.shape[0], m)), np.eye(m)])
    Y, W = cvxpy.Variable((n, n), symmetric=True), cvxpy.Variable((m, n))
    g2 = cvxpy.Variable()
    AY, CY = A @ Y + B @ W, C @ Y + D @ W
    lmi = cvxpy.bmat([[AY + AY.T + E @ E.T, CY.T], [CY, -g2 * np.eye(C.shape[0])]])
    problem = cvxpy.Problem(cvxpy.Minimize(g2), [lmi << 0, Y >> 0])
    problem.solve(solver=cvxpy.CLARABEL)
    by_lmi = form.wind_scale * np.sqrt(g2.value)
    assert by_lmi == pytest.approx(gamma_star(*plant).value, rel=2e-4)


def check_plant(plant, expected_width=REL_TOL):
    limit = gamma_star(*plant)
    assert 0.0 < limit.lower <= limit.value <= limit.upper
    assert limit.upper - limit.lower <= 1.01 * expected_width * limit.upper
    selector = np.eye(plant[0].shape[0])[: plant[1].shape[1]]
    with pytest.raises(InfeasibleGammaError):
        synthesize(*plant, 0.999 * limit.value, selector)
    design = synthesize(*plant, 1.0001 * limit.value, selector)
    assert design.certificate.accepted
    assert limit.lower * (1 - 1e-6) <= design.norm < design.gamma
    return limit.mechanism


@pytest.mark.parametrize("start", range(0, 30, 10))
def test_random_plants(random_plant, start):
    mechanisms = {check_plant(random_plant(i)) for i in range(start, start + 10)}
    assert mechanisms == {Mechanism.HAMILTONIAN_AXIS, Mechanism.P_UNBOUNDED}


@pytest.mark.nightly
@pytest.mark.parametrize("start", range(0, 500, 50))
def test_five_hundred_random_plants(random_plant, start):
    for i in range(start, start + 50):
        check_plant(random_plant(i))


def test_slow_peak_of_a_stiff_plant_is_not_missed(random_plant):
    """Plant 348 peaks near 0.02 rad/s beside modes of 2000 rad/s: its crossings drown in rounding
    unless the Hamiltonian matrix is balanced and candidates are judged by Phi itself."""
    plant = random_plant(348)
    check_plant(plant)
    problem = split(regular_form(*checked_plant(*plant)))
    sweep = max(problem.phi_max(w) for w in np.geomspace(1e-3, 10.0, 2000))
    assert problem.form.wind_scale * np.sqrt(sweep) <= gamma_star(*plant).upper


def test_phi_two_ways(published):
    """Phi from the split equals -[0 E'](H - jwI)^-1 [E; 0] of the plain Hamiltonian matrix."""
    form = regular_form(*checked_plant(*published))
    problem, n = split(form), form.n
    H = form.hamiltonian(0.0)
    inlet = np.vstack([form.E, np.zeros_like(form.E)])
    outlet = np.hstack([np.zeros_like(form.E.T), form.E.T])
    for w in (0.0, 0.3, 5.0, 24.0, 100.0):
        phi = -outlet @ np.linalg.solve(H - 1j * w * np.eye(2 * n), inlet)
        assert problem.phi_max(w) == pytest.approx(np.linalg.eigvalsh(phi)[-1], rel=1e-8)


def test_newton_converges_quadratically(published):
    assert gamma_star(*published).iterations <= 5


class TestBadInput:
    def test_uncontrollable_unstable_mode(self):
        with pytest.raises(NotStabilizableError) as caught:
            gamma_star(
                np.diag([2.0, -1.0]), [[0.0], [1.0]], np.eye(2), [[1, 1], [0, 0]], [[0], [1]]
            )
        assert caught.value.mode == pytest.approx(2.0)

    def test_uncontrollable_integrator(self):
        with pytest.raises(NotStabilizableError):
            gamma_star(
                np.diag([0.0, -1.0]), [[0.0], [1.0]], np.eye(2), [[1, 1], [0, 0]], [[0], [1]]
            )

    def test_unweighted_heading_is_a_zero_on_the_axis(self, published):
        A, B, E, C, D = published
        C = C.copy()
        C[:, 8] = 0.0
        with pytest.raises(InvariantZeroError) as caught:
            gamma_star(A, B, E, C, D)
        assert caught.value.zero == pytest.approx(0.0, abs=1e-12)

    def test_unweighted_oscillation(self):
        A = np.zeros((3, 3))
        A[:2, :2] = [[0, 4], [-4, 0]]
        A[2, 2] = -1.0
        with pytest.raises(InvariantZeroError) as caught:
            gamma_star(A, np.ones((3, 1)), np.eye(3), [[0, 0, 1], [0, 0, 0]], [[0], [1]])
        assert abs(caught.value.zero) == pytest.approx(4.0)

    @pytest.mark.parametrize(
        ("name", "position", "bad", "sentence"),
        [
            ("A", 0, np.zeros((9, 8)), "A must be square"),
            ("A", 0, np.zeros((0, 0)), "A must be square and not empty"),
            ("B", 1, np.zeros((8, 3)), "B must be 9xn, but is 8x3"),
            ("E", 2, np.full((9, 3), np.nan), "E holds a value that is not finite"),
            ("C", 3, np.zeros((9, 7)), "C must be nx9, but is 9x7"),
            ("D", 4, np.zeros((9, 3)), "D must have full column rank"),
            ("D", 4, np.zeros((8, 3)), "D must be 9x3, but is 8x3"),
            ("B", 1, [[1.0], [1.0, 2.0]], "B is not a rectangular array of numbers"),
        ],
    )
    def test_matrix_is_named(self, published, name, position, bad, sentence):
        plant = list(published)
        plant[position] = bad
        with pytest.raises(ShapeError, match=sentence) as caught:
            gamma_star(*plant)
        assert caught.value.name == name
