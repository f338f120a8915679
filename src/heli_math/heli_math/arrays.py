# SPDX-License-Identifier: Apache-2.0
"""Small arrays in kernels: made on the stack, copied and filled by plain loops.

numba's own slice assignment makes a copy where source and target may overlap, and costs seconds of
compilation.
"""

import math
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.extending import lower_builtin, type_callable

from heli_math.jit import njit


def scratch(length: int) -> np.ndarray:
    """A float64 vector that lives as long as the kernel that asks for it; its numbers are anything.

    It lies on the stack: nothing is allocated, and a short one ends up in registers. So it must not
    be returned, nor kept.

    Parameters
    ----------
    length : int
        A number, or the name of a module's constant.
    """
    return np.empty(length)


def scratch_matrix(rows: int, columns: int) -> np.ndarray:
    """As `scratch`, a float64 matrix."""
    return np.empty((rows, columns))


def _type_of(*lengths: Any) -> Any:
    """Type of an array of these lengths; None, which numba asks for, if one is not a constant."""
    if all(isinstance(length, types.IntegerLiteral) for length in lengths):
        return types.Array(types.float64, len(lengths), "C")
    return None


@type_callable(scratch)
def _type_of_vector(_context: Any) -> Any:
    def typer(length):  # type: ignore[no-untyped-def]  # numba reads its signature
        return _type_of(length)

    return typer


@type_callable(scratch_matrix)
def _type_of_matrix(_context: Any) -> Any:
    def typer(rows, columns):  # type: ignore[no-untyped-def]
        return _type_of(rows, columns)

    return typer


@lower_builtin(scratch, types.IntegerLiteral)
@lower_builtin(scratch_matrix, types.IntegerLiteral, types.IntegerLiteral)
def _on_stack(context: Any, builder: Any, signature: Any, _arguments: Any) -> Any:
    """Code of an array in the frame of the kernel; nobody counts references to it."""
    shape = [length.literal_value for length in signature.args]
    number = context.get_data_type(types.float64)
    width = context.get_abi_sizeof(number)

    def integers(values: list[int]) -> Any:
        words = [context.get_constant(types.intp, value) for value in values]
        return cgutils.pack_array(builder, words)

    made = context.make_array(signature.return_type)(context, builder)
    context.populate_array(
        made,
        data=cgutils.alloca_once(builder, number, size=math.prod(shape)),
        shape=integers(shape),
        strides=integers([width * math.prod(shape[i + 1 :]) for i in range(len(shape))]),
        itemsize=context.get_constant(types.intp, width),
        meminfo=None,
    )
    return made._getvalue()


@njit
def copy_part(target, i, source, j, n):
    """target[i : i + n] = source[j : j + n] of contiguous vectors."""
    for m in range(n):
        target[i + m] = source[j + m]


@njit
def copy(target, source):
    """target[:] = source of vectors of one length."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@njit
def difference(a, b, out):
    """out[:] = a - b of vectors of one length."""
    for i in range(out.shape[0]):
        out[i] = a[i] - b[i]


@njit
def is_zero(values):
    """Whether every number of a vector is 0; NaN is not."""
    for value in values:
        if value != 0.0:
            return False
    return True


@njit
def copy_matrix(target, source):
    """target[:, :] = source."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@njit
def fill(target, value):
    """target[:] = value of a contiguous vector."""
    for i in range(target.shape[0]):
        target[i] = value


@njit
def fill_matrix(target, value):
    """target[:, :] = value."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = value
