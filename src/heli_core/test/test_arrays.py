# SPDX-License-Identifier: Apache-2.0
"""Arrays on the stack: what a kernel writes into them, and what numba refuses."""

import numpy as np
import pytest
from numba.core.errors import NumbaError

from heli_core.jit import copy, fill, njit, njit_counted, scratch, scratch_matrix

N = 4


@njit
def _weighted(x):
    doubled, table = scratch(N), scratch_matrix(2, N)
    for i in range(N):
        doubled[i] = 2.0 * x[i]
        table[0, i], table[1, i] = 10.0 * doubled[i], 1.0
    return table[0].shape[0] + doubled.size + np.sum(table) + table[0, N - 1]


@njit
def _deep(x, depth):
    """Each call has memory of its own, though the next one lies where the last one was."""
    copied, total = scratch(N), 0.0
    copy(copied, x)
    for _ in range(depth):
        total += _weighted(copied)
        fill(copied, copied[0] + 1.0)
    return total + copied[0]


def test_scratch_is_an_array_of_the_kernel():
    x = np.arange(4.0)
    assert _weighted(x) == _weighted.py_func(x) == 4 + 4 + 120.0 + 4.0 + 60.0
    assert _deep(x, 3) == _deep.py_func(x, 3)


def test_a_kernel_of_njit_makes_no_array_that_somebody_must_free():
    @njit_counted
    def made(x):
        return np.zeros(3) + x

    @njit
    def refused(x):
        return np.zeros(3) + x

    assert made(1.0).tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(NumbaError, match="array"):
        refused(1.0)


def test_the_length_of_scratch_is_a_constant():
    @njit
    def make(n):
        return scratch(n)[0]

    with pytest.raises(NumbaError):
        make(3)
