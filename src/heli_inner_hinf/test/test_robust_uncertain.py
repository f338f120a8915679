# SPDX-License-Identifier: Apache-2.0
"""Matrices that depend on parameters: every operation against the same one on numbers."""

import numpy as np
import pytest

from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.robust.uncertain import Range, Uncertain

MASS = Range("m", 2.0, 1.5, 3.0)
SPRING = Range("k", 5.0, 4.0, 6.0)
AT: tuple[dict[str, float], ...] = ({}, {"m": 1.0}, {"m": -0.7, "k": 0.4}, {"k": -2.5, "m": 1.7})


def _numbers(deltas: dict[str, float]) -> tuple[float, float]:
    return MASS.value(deltas.get("m", 0.0)), SPRING.value(deltas.get("k", 0.0))


def test_range_ends_are_deviations_of_one() -> None:
    for at in (MASS, SPRING):
        assert [at.value(d) for d in (-1.0, 0.0, 1.0)] == pytest.approx(
            [at.low, at.nominal, at.high]
        )


@pytest.mark.parametrize("deltas", AT)
def test_operations_are_those_of_the_numbers(deltas: dict[str, float]) -> None:
    m, k = _numbers(deltas)
    left, right = np.array([[1.0, 2.0]]), np.array([[3.0], [-1.0]])
    force = SPRING.matrix @ left
    stack = Uncertain.stacked([[MASS.matrix.inverse() @ force, MASS.matrix], [left, right[:1]]])
    np.testing.assert_allclose(
        stack.at(deltas), np.block([[left * k / m, np.array([[m]])], [left, right[:1]]]), rtol=1e-12
    )
    total = right @ MASS.matrix @ SPRING.matrix @ MASS.matrix + right
    np.testing.assert_allclose(total.at(deltas), right * (m * k * m + 1.0), rtol=1e-12)


@pytest.mark.parametrize("deltas", AT)
def test_reduction_keeps_the_dependence(deltas: dict[str, float]) -> None:
    twice = np.ones((3, 1)) @ SPRING.matrix @ np.ones((1, 3)) @ np.diag([1.0, 2.0, 3.0])
    full = twice + np.ones((3, 1)) @ SPRING.matrix @ np.eye(1, 3)
    small = full.reduced()
    assert len(small.channels) == 1 < len(full.channels)
    np.testing.assert_allclose(small.at(deltas), full.at(deltas), rtol=1e-12)


@pytest.mark.parametrize(
    ("low", "high", "sentence"),
    [(3.0, 1.5, "from low to high"), (2.5, 3.0, "has to lie inside"), (np.nan, 3.0, "finite")],
)
def test_bad_range_is_refused_by_name(low: float, high: float, sentence: str) -> None:
    with pytest.raises(RobustError, match=sentence) as refused:
        Range("mass", 2.0, low, high)
    assert refused.value.cause is RobustCause.BAD_RANGE
    assert str(refused.value).startswith("mass: ")
