# SPDX-License-Identifier: Apache-2.0
"""Worst-case gains against formulas, a published example and many members; the barrier method."""

import cvxpy as cp
import numpy as np
import pytest

from heli_core.errors import RobustError
from heli_inner_hinf.robust.certificate import Block, UncertainSystem, certify, largest_slack
from heli_inner_hinf.robust.uncertain import Range, Uncertain
from heli_inner_hinf.robust.worst_case import GainFamily, worst_gain

NAMES = ("m", "c", "k")


@pytest.fixture(scope="module")
def oscillator() -> GainFamily:
    """m x'' + c x' + k x = w, out x; mass +-20 %, damping +-50 %, spring -30 % to +60 %."""
    m, c, k = (
        Range(name, 1.0, low, high).matrix
        for name, low, high in zip(NAMES, (0.8, 0.5, 0.7), (1.2, 1.5, 1.6), strict=True)
    )
    c = c @ np.array([[0.2]])
    force = Uncertain.stacked([[-np.eye(1) @ k, -np.eye(1) @ c, np.eye(1)]])
    rows = [[np.array([[0.0, 1.0, 0.0]])], [m.inverse() @ force], [np.array([[1.0, 0.0, 0.0]])]]
    return GainFamily(Uncertain.stacked(rows).reduced(), 2)


def peak(m: float, c: float, k: float) -> float:
    return 1.0 / (c * np.sqrt(k / m - (c / (2.0 * m)) ** 2))


def test_worst_gain_of_an_oscillator_is_the_formula(oscillator: GainFamily) -> None:
    worst = worst_gain(oscillator, 0.02)
    assert worst.nominal == pytest.approx(peak(1.0, 0.2, 1.0), rel=1e-3)
    assert worst.lower == pytest.approx(peak(1.2, 0.1, 0.7), rel=1e-3)
    assert worst.lower <= worst.upper <= 1.03 * worst.lower
    assert {k: np.sign(v) for k, v in worst.deltas.items()} == {"m": 1.0, "c": -1.0, "k": -1.0}
    assert worst.certificate.largest_psi(oscillator.system) < 0.0


def test_slopes_of_the_gain_are_its_differences(oscillator: GainFamily) -> None:
    at = np.array([0.3, -0.2, 0.5])
    slopes = oscillator.gain(at)[2]
    for i, step in enumerate(1e-4 * np.eye(3)):
        difference = (oscillator.gain(at + step)[0] - oscillator.gain(at - step)[0]) / 2e-4
        assert slopes[i] == pytest.approx(difference, rel=0.02)


def test_matlab_wcgain_example() -> None:
    """MATLAB's documentation of `wcgain`, first example: 5.1036 to 5.1140.

    G = 1 / s + delta, |delta| <= 0.4 and complex, C = 2 - 0.04 s / (0.02 s + 1) = 2 / (0.02 s + 1),
    the gain is that of 1 / (1 + G C).
    """
    system = UncertainSystem(
        np.array([[0.0, 2.0], [-50.0, -50.0]]),
        np.array([[0.0, 0.0], [-50.0, 50.0]]),
        np.array([[0.0, 0.8], [-1.0, 0.0]]),
        np.array([[0.0, 0.0], [-1.0, 1.0]]),
    )
    blocks = [Block("delta", "complex", 1, 1, fixed=True), Block("gain", "full", 1, 1)]
    assert certify(system, blocks, 5.1140).level == 5.1140
    with pytest.raises(RobustError, match="no scalings"):
        certify(system, blocks, 5.09, most=5.1036)
    s = 1j * np.linspace(5.0, 20.0, 4001)
    C = 2.0 / (0.02 * s + 1.0)
    formula = np.max(1.0 / (np.abs(1.0 + C / s) - 0.4 * np.abs(C)))
    assert 5.1036 <= formula <= 5.1140


def test_disk_margin_over_a_set_is_the_worst_members() -> None:
    """L = g / (s (0.1 s + 1)), g within 50 %: |S - T| / 2 of the member with the largest g."""
    g = Range("g", 4.0, 2.0, 6.0).matrix
    u = np.array([[0.0, -1.0, 0.0]])
    plant = g @ (u + np.array([[0.0, 0.0, 1.0]]))
    rows = [
        [np.array([[-10.0, 0.0, 0.0]]) + np.array([[10.0]]) @ plant],
        [np.array([[1.0, 0.0, 0.0]])],
        [u + np.array([[0.0, 0.0, 0.5]])],
    ]
    worst = worst_gain(GainFamily(Uncertain.stacked(rows).reduced(), 2, scalars=1), 0.02)
    s = 1j * np.geomspace(0.1, 100.0, 20001)
    L = 6.0 / (s * (0.1 * s + 1.0))
    alpha = 1.0 / np.max(np.abs(1.0 / (1.0 + L) - 0.5))
    assert 1.0 / worst.lower == pytest.approx(alpha, rel=1e-3)
    assert 0.96 * alpha <= 1.0 / worst.upper <= alpha
    assert worst.deltas["g"] == pytest.approx(1.0)


def test_barrier_finds_what_a_general_solver_finds() -> None:
    """The same problem by cvxpy and clarabel; t is within its share of the largest, never above."""
    rng = np.random.default_rng(5)

    def hermitian(k: int, n: int) -> np.ndarray:
        X = rng.normal(size=(k, n, n)) + 1j * rng.normal(size=(k, n, n))
        return X + X.conj().transpose(0, 2, 1)

    E = np.array([np.diag(row) for row in np.eye(3)], complex)
    for shift in (0.5, -3.0):  # slack above and below 0
        T = hermitian(6, 4) * 0.5
        T[:3] += shift * np.eye(4)
        x, t = cp.Variable(6), cp.Variable()
        inside = sum(x[i] * T[i] for i in range(6)) - t * np.eye(4)
        problem = cp.Problem(cp.Maximize(t), [inside >> 0, x[:3] >= 0, cp.sum(x[:3]) == 3])
        problem.solve(solver=cp.CLARABEL)
        multipliers, slack = largest_slack(T, E)
        assert np.sign(slack) == np.sign(t.value)
        assert slack <= t.value + 1e-6
        if slack > 0.0:
            assert slack >= 0.95 * t.value
            assert np.linalg.eigvalsh(np.tensordot(multipliers, T, 1))[0] >= slack - 1e-9
            assert np.sum(multipliers[:3]) == pytest.approx(3.0)
