# SPDX-License-Identifier: Apache-2.0
"""Copies and fills as plain loops: numba's slice assignment costs seconds of compilation."""

from heli_math.jit import njit


@njit
def copy_part(target, i, source, j, n):
    """target[i : i + n] = source[j : j + n] of contiguous vectors."""
    for m in range(n):
        target[i + m] = source[j + m]


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
