# SPDX-License-Identifier: Apache-2.0
"""One quadratic bound for several loops: against formulas, an LMI solver, and switching flown."""

import cvxpy as cp
import numpy as np
import pytest

from heli_inner_hinf.robust import RobustCause, RobustError, common_bound, contraction_of


def _family(seed, n=4, members=3, spread=0.15):
    rng = np.random.default_rng(seed)
    middle = rng.standard_normal((n, n))
    middle *= 0.8 / np.max(np.abs(np.linalg.eigvals(middle)))
    return [middle + spread * rng.standard_normal((n, n)) / n for _ in range(members)]


def test_of_symmetric_members_it_is_the_largest_eigenvalue():
    """P = I shows it, and no other can do better than the spectral radius."""
    family = [np.diag([0.9, 0.1]), np.array([[0.5, 0.3], [0.3, 0.5]])]
    bound = common_bound(family)
    assert 0.9 <= bound.contraction < 0.99
    assert contraction_of(family[0], np.eye(2)) == pytest.approx(0.9, rel=1e-12)


def test_the_contraction_is_the_residual_of_the_inequality():
    family = _family(1)
    P, rate = common_bound(family)
    assert np.linalg.eigvalsh(P).min() > 0.0
    for A in family:
        assert np.linalg.eigvalsh(A.T @ P @ A - rate**2 * P).max() < 1e-12 * np.linalg.norm(P)
    tight = max(np.linalg.eigvalsh(A.T @ P @ A - (0.999 * rate) ** 2 * P).max() for A in family)
    assert tight > 0.0


def _exists_by_lmi(family, rate):
    n = family[0].shape[0]
    P = cp.Variable((n, n), symmetric=True)
    rows = [rate**2 * P - A.T @ P @ A >> 0 for A in family]
    problem = cp.Problem(cp.Minimize(cp.trace(P)), [P >> np.eye(n), *rows])
    problem.solve(solver=cp.CLARABEL)
    return problem.status == cp.OPTIMAL


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_lmi_solver_finds_one_too_and_not_much_better(seed):
    family = _family(seed)
    contraction = common_bound(family).contraction
    assert _exists_by_lmi(family, contraction)
    radius = max(np.max(np.abs(np.linalg.eigvals(A))) for A in family)
    assert not _exists_by_lmi(family, 0.99 * radius)


def test_every_order_of_the_members_and_of_what_lies_between_them_decays():
    family, rng = _family(2), np.random.default_rng(7)
    P, rate = common_bound(family)
    x = rng.standard_normal(4)
    for _ in range(200):
        shares = rng.dirichlet(np.ones(len(family)))
        before = np.sqrt(x @ P @ x)
        x = sum(share * A for share, A in zip(shares, family, strict=True)) @ x
        assert np.sqrt(x @ P @ x) <= rate * before * (1.0 + 1e-12)


def test_units_of_states_matter_little():
    """They are balanced first."""
    family, units = _family(2), np.array([1.0, 1e3, 1e-4, 7.0])
    other = [A * units / units[:, None] for A in family]
    assert common_bound(other).contraction == pytest.approx(
        common_bound(family).contraction, rel=0.05
    )


def test_members_whose_product_grows_share_none():
    """Each is stable by far; one after the other they are not."""
    one = np.array([[0.1, 2.0], [0.0, 0.1]])
    assert np.max(np.abs(np.linalg.eigvals(one @ one.T))) > 1.0
    with pytest.raises(RobustError) as error:
        common_bound([one, one.T])
    assert error.value.cause == RobustCause.NO_CERTIFICATE
    assert "all 2 members" in str(error.value)


def test_an_unstable_or_broken_member_is_named():
    good = 0.5 * np.eye(2)
    with pytest.raises(RobustError) as error:
        common_bound([good, 1.2 * np.eye(2)])
    assert error.value.cause == RobustCause.UNSTABLE and "member 1" in str(error.value)
    with pytest.raises(RobustError) as error:
        common_bound([good, np.full((2, 2), np.nan)])
    assert error.value.cause == RobustCause.NOT_FINITE and "member 1" in str(error.value)
