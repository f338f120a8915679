# SPDX-License-Identifier: Apache-2.0
"""Kernels without the look at their arguments: the same numbers, the types of each time asked."""

from typing import NamedTuple

import numpy as np

from heli_core.jit import direct, njit


class Numbers(NamedTuple):
    gain: float
    offset: np.ndarray


@njit
def _apply(x, k, out):
    for i in range(x.size):
        out[i] = k.gain * x[i] + k.offset[i]
    return out.sum()


def test_it_computes_the_same_bit_for_bit_whatever_the_values_are():
    rng = np.random.default_rng(1)
    k = Numbers(0.1, rng.normal(size=3))
    quick = direct(_apply, np.zeros(3), k, np.zeros(3))
    for _ in range(5):
        x, k = rng.normal(size=3), Numbers(float(rng.normal()), rng.normal(size=3))
        a, b = np.zeros(3), np.zeros(3)
        assert quick(x, k, a) == _apply(x, k, b)
        np.testing.assert_array_equal(a, b)


def test_it_is_asked_for_each_kind_of_arguments():
    numbers = Numbers(2.0, np.zeros(2))
    whole = direct(_apply, np.zeros(2, dtype=np.int64), numbers, np.zeros(2))
    assert whole(np.array([1, 2]), numbers, np.zeros(2)) == 6.0
    strided = np.arange(4.0)[::2]
    assert direct(_apply, strided, numbers, np.zeros(2))(strided, numbers, np.zeros(2)) == 4.0


def test_what_is_not_compiled_stays_as_it_is():
    assert direct(max, 1, 2) is max
