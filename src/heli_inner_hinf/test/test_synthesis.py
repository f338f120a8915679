# SPDX-License-Identifier: Apache-2.0
"""F, G, P of the aircraft: residual, certificate, norm, and what is refused."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from heli_core.errors import FeedforwardError, InfeasibleGammaError, ShapeError
from heli_inner_hinf.regular_form import checked_plant, output_selector, regular_form, weights
from heli_inner_hinf.synthesis import acceptance, gamma_star, hinf_norm, lqr, synthesize

GAMMA = 0.0632
OUT = output_selector()


def riccati_residual(plant, P, gamma):
    """Left side of (16) as the paper writes it."""
    A, B, E, C, D = plant
    R = D.T @ D
    return (A.T @ P + P @ A + C.T @ C + P @ E @ E.T @ P / gamma**2
            - (P @ B + C.T @ D) @ np.linalg.solve(R, D.T @ C + B.T @ P))  # fmt: skip


def test_riccati_equation_of_the_paper(published):
    design = synthesize(*published, GAMMA, OUT)
    residual = riccati_residual(published, design.P, GAMMA)
    assert np.linalg.norm(residual) < 1e-9 * np.linalg.norm(published[0].T @ design.P)
    A, B, E, C, D = published
    assert np.allclose(design.F, -np.linalg.solve(D.T @ D, D.T @ C + B.T @ design.P), rtol=1e-9)
    assert design.solved_at == GAMMA


def test_scipy_finds_the_same_p(published):
    A, B, E, C, D = published
    R = np.zeros((6, 6))
    R[:3, :3], R[3:, 3:] = D.T @ D, -(GAMMA**2) * np.eye(3)
    P = solve_continuous_are(A, np.hstack([B, E]), C.T @ C, R)
    assert np.allclose(synthesize(*published, GAMMA, OUT).P, P, rtol=1e-7, atol=1e-9)


def test_norm_of_the_loop_by_frequency_sweep(published):
    A, B, E, C, D = published
    design = synthesize(*published, GAMMA, OUT)
    omega = np.concatenate([np.geomspace(1e-3, 1e3, 2000), np.linspace(23.5, 24.6, 2001)])
    Ac, Cc = A + B @ design.F, C + D @ design.F
    response = Cc @ np.linalg.solve(
        1j * omega[:, None, None] * np.eye(9) - Ac, E.astype(complex)[None]
    )
    sweep = np.linalg.svd(response, compute_uv=False)[:, 0]
    assert design.norm == pytest.approx(np.max(sweep), rel=1e-7)
    assert design.norm_frequency == pytest.approx(omega[np.argmax(sweep)], rel=1e-3)
    assert gamma_star(*published).lower <= design.norm < GAMMA


def test_feedforward_settles_the_outputs_at_their_command(published):
    A, B, _, _, _ = published
    design = synthesize(*published, GAMMA, OUT)
    at_rest = -np.linalg.solve(A + B @ design.F, B @ design.G)
    assert np.allclose(OUT @ at_rest, np.eye(3), atol=1e-9)
    # heading is a pure integrator: G takes what F gives, the law sees only the difference
    assert np.allclose(design.G[:, 2], -design.F[:, 8], rtol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 0.9, 0.999, 1.0])
def test_infeasible_gamma_is_refused_with_both_numbers(published, factor):
    infimum = gamma_star(*published).value
    with pytest.raises(InfeasibleGammaError, match=r"infeasible.*gamma\* = 0\.0516") as caught:
        synthesize(*published, factor * infimum, OUT)
    assert caught.value.gamma == factor * infimum
    assert caught.value.gamma_star == pytest.approx(infimum, rel=1e-12)


@pytest.mark.parametrize("gamma", [0.0, -1.0, float("nan"), float("inf")])
def test_gamma_that_is_no_bound_is_refused(published, gamma):
    with pytest.raises(InfeasibleGammaError):
        synthesize(*published, gamma, OUT)


@pytest.mark.parametrize("factor", [1.0001, 1.01, 2.0, 1e3, 1e9])
def test_feasible_gamma_is_solved_with_certificate(published, factor):
    design = synthesize(*published, factor * gamma_star(*published).value, OUT)
    assert design.certificate.accepted
    assert len(design.certificate.conditions) == 6
    assert "FAILS" not in str(design.certificate)


def test_the_trap_below_gamma_star_is_seen():
    """Just below gamma* SciPy returns a P with a tiny residual; the acceptance rule refuses it."""
    plant = ([[2.0]], [[0.7]], [[1.3]], [[1.0], [0.0]], [[0.0], [1.0]])
    A, B, E, C, D = (np.array(m) for m in plant)
    infimum = gamma_star(*plant).value
    gamma = 0.99 * infimum
    R = np.diag([1.0, -(gamma**2)])
    P = solve_continuous_are(A, np.hstack([B, E]), C.T @ C, R)
    assert abs(riccati_residual((A, B, E, C, D), P, gamma)) < 1e-9 * abs(A * P)
    form = regular_form(*checked_plant(*plant))
    scaled = P * np.outer(form.state_scale, form.state_scale)
    certificate, norm, _ = acceptance(form, scaled, gamma)
    assert not certificate.accepted
    assert certificate.residual.holds and certificate.worst_case_stable.holds
    assert not certificate.positive_semidefinite.holds
    assert not certificate.closed_loop_stable.holds
    assert norm == np.inf


@pytest.mark.parametrize("condition", ["symmetry", "residual"])
def test_a_spoilt_p_is_refused(published, condition):
    design = synthesize(*published, GAMMA, OUT)
    form = regular_form(*checked_plant(*published))
    P = design.P * np.outer(form.state_scale, form.state_scale)
    spoilt = P.copy()
    if condition == "symmetry":
        spoilt[0, 1] += 1e-6 * np.linalg.norm(P)
    else:
        spoilt *= 1.001
    assert acceptance(form, P, GAMMA)[0].accepted
    assert not getattr(acceptance(form, spoilt, GAMMA)[0], condition).holds


def test_lqr_is_the_limit_of_large_gamma(published):
    yardstick = lqr(*published, OUT)
    far = synthesize(*published, 1e6, OUT)
    assert np.allclose(yardstick.F, far.F, rtol=1e-6, atol=1e-9)
    A, B, _, C, D = published
    P = solve_continuous_are(A, B, C.T @ C, D.T @ D)
    assert np.allclose(yardstick.P, P, rtol=1e-8, atol=1e-8)
    assert yardstick.norm > synthesize(*published, GAMMA, OUT).norm


def test_dependent_outputs_are_refused(published):
    with pytest.raises(FeedforwardError, match="independently"):
        synthesize(*published, GAMMA, np.eye(9)[[0, 0, 8]])


def test_wrong_selector_is_named(published):
    with pytest.raises(ShapeError, match="C_out must be 3x9"):
        synthesize(*published, GAMMA, np.eye(9))


def test_norm_of_a_first_order_lag():
    norm, frequency = hinf_norm(np.array([[-2.0]]), np.array([[3.0]]), np.array([[4.0]]))
    assert norm == pytest.approx(6.0, rel=1e-12)
    assert frequency == 0.0


class TestWeights:
    C22 = ((0.0, 0, 1, 0, 0), (0, 0, 0, 0, 5))

    def test_layout_of_eq_12(self):
        C, D = weights([13, 11, 1, 1], self.C22, [12, 11, 31])
        assert C.shape == (9, 9) and D.shape == (9, 3)
        assert np.array_equal(np.diag(D[:3]), [12, 11, 31]) and not D[3:].any()
        assert not C[:3].any()
        assert np.array_equal(np.diag(C[3:7, :4]), [13, 11, 1, 1])
        assert C[7, 6] == 1 and C[8, 8] == 5 and np.count_nonzero(C) == 6
        assert not (D.T @ C).any()

    @pytest.mark.parametrize(
        ("C11", "C22", "D11", "name", "sentence"),
        [
            ([1, 2, 3], C22, [1, 1, 1], "C11", "C11 must be 4, but is 3"),
            (np.eye(4), np.zeros((2, 4)), np.eye(3), "C22", "C22 must be 2x5, but is 2x4"),
            (np.eye(4), C22, [1, 0, 1], "D11", "D11 must be invertible"),
            (np.full((4, 4), np.inf), C22, np.eye(3), "C11", "not finite"),
            ([1, -2, 3, 1], C22, [1, 1, 1], "C11", "C11 has a negative weight on its diagonal"),
            (np.eye(4), C22, [1, 1, -1], "D11", "D11 has a negative weight on its diagonal"),
        ],
    )
    def test_bad_weights_are_named(self, C11, C22, D11, name, sentence):
        with pytest.raises(ShapeError, match=sentence) as caught:
            weights(C11, C22, D11)
        assert caught.value.name == name
