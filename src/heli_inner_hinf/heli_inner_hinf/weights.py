# SPDX-License-Identifier: Apache-2.0
"""Weights of the controlled output h = C x + D u, eq. (11), (12).

For every aircraft with the nine states of eq. (10), in order phi theta p q a_s b_s r d_int psi
(rad, rad/s), and the three inputs d_lat d_lon d_ped.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_inner_hinf.errors import ShapeError
from heli_math.rows import NINE
from heli_math.state_names import ATTITUDE, INPUT_NAMES, STATE_NAMES

N_X, N_U, N_H = len(STATE_NAMES), len(INPUT_NAMES), 9
# Parts of h: actuators, then attitude and its rates, then rotor and yaw.
_H_ACTUATORS, _H_ATTITUDE, _H_ROTOR = slice(0, 3), slice(3, 7), slice(7, 9)


def checked(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """`value` as a float64 array of `shape` (None: any length), or a ShapeError naming it."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as exc:
        raise ShapeError(name, f"{name} is not a rectangular array of numbers") from exc
    fits = array.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = "x".join("n" if w is None else str(w) for w in shape)
        have = "x".join(str(s) for s in array.shape) or "a scalar"
        raise ShapeError(name, f"{name} must be {wanted}, but is {have}")
    if not np.all(np.isfinite(array)):
        raise ShapeError(name, f"{name} holds a value that is not finite (NaN or inf)")
    return array


def weights(
    C11: ArrayLike, C22: ArrayLike, D11: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """C (9, 9) and D (9, 3) of eq. (11), (12), with D'C = 0.

    Parameters
    ----------
    C11 : (4, 4) array, or (4,) for a diagonal one
        Weights on phi, theta (1/rad) and p, q (s/rad).
    C22 : (2, 5) array
        Weights on a_s, b_s, r, d_int, psi; the paper: 1 on r in row 1 and 5 on psi in row 2.
    D11 : (3, 3) array, or (3,) for a diagonal one
        Weights on d_lat, d_lon, d_ped; must be invertible.

    Raises
    ------
    ShapeError
        Names the matrix: wrong shape, not finite, negative on the diagonal, or D11 singular.
    """
    C11 = np.asarray(C11, dtype=object)
    D11 = np.asarray(D11, dtype=object)
    c11 = np.diag(checked("C11", C11, (4,))) if C11.ndim == 1 else checked("C11", C11, (4, 4))
    d11 = np.diag(checked("D11", D11, (3,))) if D11.ndim == 1 else checked("D11", D11, (3, 3))
    c22 = checked("C22", C22, (2, 5))
    for name, block in (("C11", c11), ("D11", d11)):
        if np.any(np.diag(block) < 0.0):
            raise ShapeError(name, f"{name} has a negative weight on its diagonal")
    if np.linalg.matrix_rank(d11) < N_U:
        raise ShapeError("D11", "D11 must be invertible: every actuator needs a weight")
    C = np.zeros((N_H, N_X))
    C[_H_ATTITUDE, NINE.phi : NINE.a_s] = c11
    C[_H_ROTOR, NINE.a_s :] = c22
    D = np.zeros((N_H, N_U))
    D[_H_ACTUATORS] = d11
    return C, D


def output_selector() -> NDArray[np.float64]:
    """C_out (3, 9): selects phi, theta, psi from x, eq. (15)."""
    selector = np.zeros((3, N_X))
    selector[range(3), ATTITUDE] = 1.0
    return selector
