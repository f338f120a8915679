# SPDX-License-Identifier: Apache-2.0
"""Tuples that kernels get by their address: every kind of member, nested, made in a kernel."""

import copy
import os
import pickle
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof, types

from heli_core.jit import ByReference, by_reference, direct, njit, referred


@by_reference
class Part(NamedTuple):
    """One of each kind of member."""

    gain: float
    ticks: int
    on: bool
    row: np.ndarray
    matrix: np.ndarray
    pair: tuple[float, float]
    nothing: None = None


@by_reference
class Whole(NamedTuple):
    """A nested tuple."""

    part: Part
    scale: float


def whole(scale=2.0):
    matrix = np.arange(6.0).reshape(2, 3)
    return Whole(Part(1.5, -3, True, np.arange(4.0), matrix, (5.0, 7.0)), scale)


@njit
def read(k, out):
    out[0], out[1] = k.part.gain * k.scale, float(k.part.ticks)
    out[2], out[3] = 1.0 if k.part.on else 0.0, k.part.row[3]
    out[4], out[5] = k.part.matrix[1, 2], k.part.pair[0] - k.part.pair[1]
    out[6] = float(k.part.row.shape[0] * k.part.matrix.shape[1])
    k.part.row[0] += 1.0


@njit
def read_twice_the_gain(k, out):
    p = k.part
    made = Part(2.0 * p.gain, p.ticks, p.on, p.row, p.matrix, p.pair, p.nothing)
    read(referred(Whole(made, k.scale)), out)


@njit
def counted(n):
    return n + 1


@njit
def count_with_a_constant(n):
    return counted(3) + counted(4) + counted(n)


AS_PYTHON = """
from heli_core.jit import referred, njit
pair = (1.0, 2.0)
print(njit(lambda k: referred(k) is k)(pair))
"""


def by_pickle(k):
    return pickle.loads(pickle.dumps(k))


def test_a_kernel_reads_every_member():
    k, out = whole(), np.zeros(7)
    read(k, out)
    assert out.tolist() == [3.0, -3.0, 1.0, 3.0, 5.0, -2.0, 12.0]
    read(k._replace(scale=4.0), out)
    assert out[0] == 6.0
    assert k.part.row[0] == 2.0  # changed in place, in the array that both hold
    assert isinstance(typeof(k), ByReference) and len(read.signatures) == 1


def test_a_tuple_that_a_kernel_makes():
    out = np.zeros(7)
    read_twice_the_gain(whole(), out)
    assert out.tolist() == [6.0, -3.0, 1.0, 3.0, 5.0, -2.0, 12.0]


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, by_pickle])
def test_a_copy_has_an_address_of_its_own(again):
    k, out = whole(), np.zeros(7)
    read(k, out)
    other = again(k)
    del k
    read(other, out)
    assert out[0] == 3.0


def test_python_sees_a_tuple():
    k = whole()
    assert k == whole()._replace(part=k.part) and k._fields == ("part", "scale")
    assert Whole.__name__ == "Whole" and Whole.__doc__ == "A nested tuple."
    part, scale = k
    assert (part, scale) == (k.part, 2.0)


def test_one_code_for_all_constants():
    """Asked as a caller's compilation asks, whether or not the code then comes from the cache."""
    assert count_with_a_constant(5) == 15
    counted.get_call_template((types.literal(3),), {})
    assert counted(2) == 3 and len(counted.signatures) == 1


def test_who_is_no_such_tuple_is_refused():
    """`direct` looks at no type: what has no address must not be read as one."""
    call, out = direct(read, whole(), np.zeros(7)), np.zeros(7)
    with pytest.raises(AttributeError):
        call(object(), out)
    assert not out.any()


def test_kernels_run_as_python_too():
    """As a debugger wants them, those that make a tuple and hand it over, too."""
    done = subprocess.run(
        [sys.executable, "-c", AS_PYTHON],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.stdout == "True\n", done.stderr
