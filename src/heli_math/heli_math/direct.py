# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels, called without the look at their arguments' types.

numba looks at every number in a tuple of hundreds at each call, to find the code for its types.
Where the types are known to stay, this look can be made once: it takes ten times as long as to hand
the numbers over.
"""

from collections.abc import Callable
from typing import Any


def direct(kernel: Callable[..., Any], *like: Any) -> Callable[..., Any]:
    """The machine code of a kernel for arguments of these types.

    Parameters
    ----------
    kernel : callable
        As `heli_math.jit.njit` gives it.
    *like : object
        Arguments, all of them, as those of each call will be.

    Returns
    -------
    callable
        Computes the same, bit for bit. It takes positional arguments only, and does not check them:
        an array of another number of dimensions, kind or order would be read as if it were the
        one of `like`. So ask again when a tuple of numbers is swapped.
    """
    import numba

    if not hasattr(kernel, "overloads"):  # NUMBA_DISABLE_JIT
        return kernel
    code: Callable[..., Any] = kernel.compile(tuple(map(numba.typeof, like)))  # type: ignore[attr-defined]
    return code
