# SPDX-License-Identifier: Apache-2.0
"""A linear law with memory, from the measured states alone: the kernel of every output feedback.

Each tick of 10 ms, in deviations from trim (`read_inputs` fills v):

    u_lin = C x + D v,   u = clip(u_lin),   x+ = A x + B v + L (u - u_lin)

Heading enters only as psi - psi_ref, so that the law does not depend on which way is north; a new
psi_ref then moves that error without a motion, and `turn` moves the law's memory with it. Errors of
pitch and heading are turned by the bank beyond trim into the axes in which the rates q, r mend
them: at 30 deg, which side wind takes, Euler angles cost both loops 30 deg of phase.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_inner_hinf.errors import ShapeError
from heli_math.arrays import copy_part, scratch
from heli_math.jit import njit
from heli_math.rotations import wrap_pi
from heli_math.rows import NINE, SETPOINT
from heli_math.state_names import INPUT_NAMES, MEASURED
from heli_math.ticks import TICK_S

INPUTS = ("phi", "theta", "p", "q", "r", "psi_error", "phi_ref", "theta_ref")
"""v: deviations from trim, rad and rad/s; the first six in the order of `MEASURED`."""
N_V, N_U = len(INPUTS), len(INPUT_NAMES)
MAX_ORDER = 32
"""Most states that a law may have."""

_PSI_ERROR, _PHI_REF, _THETA_REF = (
    INPUTS.index(name) for name in ("psi_error", "phi_ref", "theta_ref")
)
_MEMORY_S = 1.0
"""States that forget faster than this start at rest; slower ones carry what is flown."""


class OutputLaw(NamedTuple):
    """Numbers of the law; actuators in (-1, 1), angles rad, rates rad/s, one step a tick.

    Attributes
    ----------
    A, B, C, D : (n, n), (n, 8), (3, n), (3, 8) arrays
        x+ = A x + B v, u = C x + D v; n from 0 to `MAX_ORDER`, v as `INPUTS`.
    L : (n, 3) array
        What the cut-off part of the command, u - u_lin, does to the state (conditioning against
        wind-up); for a law with an observer inside its input matrix: the observer then hears what
        was really flown.
    turn : (n,) array
        By how much the state follows, per rad by which a new psi_ref moves the heading error; for a
        law with an observer of that error inside the unit vector of its estimate.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]
    L: NDArray[np.float64]
    turn: NDArray[np.float64]


def output_law(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    L: ArrayLike | None = None,
    turn: ArrayLike | None = None,
) -> OutputLaw:
    """A checked law from its matrices, flat row by row or shaped; L and turn: zero by default.

    Raises
    ------
    ShapeError
        Names the matrix `law.A` ... `law.turn`: wrong shape, not finite, or too many states.
    """
    a = np.asarray(A, float)
    order = round(a.size**0.5)
    if order**2 != a.size or order > MAX_ORDER:
        raise ShapeError(
            "law.A",
            f"law.A has {a.size} numbers, but must be square (n x n, row by row) with n at most "
            f"{MAX_ORDER}",
        )
    L = np.zeros((order, N_U)) if L is None else L
    turn = np.zeros(order) if turn is None else turn
    return OutputLaw(
        _matrix("A", a, (order, order)),
        _matrix("B", B, (order, N_V)),
        _matrix("C", C, (N_U, order)),
        _matrix("D", D, (N_U, N_V)),
        _matrix("L", L, (order, N_U)),
        _matrix("turn", turn, (order,)),
    )


def _matrix(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape and not (array.ndim == 1 and array.size == np.prod(shape)):
        wanted, have = (" x ".join(map(str, s)) for s in (shape, array.shape))
        raise ShapeError(f"law.{name}", f"law.{name} must be {wanted} (order of law.A), is {have}")
    if not np.isfinite(array).all():
        raise ShapeError(f"law.{name}", f"law.{name} holds a value that is not finite (NaN or inf)")
    return np.ascontiguousarray(array.reshape(shape))


NO_LAW = output_law(np.zeros((0, 0)), np.zeros((0, N_V)), np.zeros((N_U, 0)), np.zeros((N_U, N_V)))
"""What the kernel of another kind of law carries."""


@njit
def read_inputs(x9, r3, x_trim, v):
    """v (8,), places of `INPUTS`, of absolute states (9,) and commands (3,), rad and rad/s."""
    for i in range(_PSI_ERROR):
        v[i] = x9[MEASURED[i]] - x_trim[MEASURED[i]]
    v[_PSI_ERROR] = wrap_pi(x9[NINE.psi] - r3[SETPOINT.psi])
    v[_PHI_REF] = r3[SETPOINT.phi] - x_trim[NINE.phi]
    v[_THETA_REF] = r3[SETPOINT.theta] - x_trim[NINE.theta]
    # v[0] is the bank beyond trim, v[1] the pitch.
    c, s = math.cos(v[0]), math.sin(v[0])
    pitch_error, heading_error = v[1] - v[_THETA_REF], v[_PSI_ERROR]
    v[1] = v[_THETA_REF] + c * pitch_error + s * heading_error
    v[_PSI_ERROR] = c * heading_error - s * pitch_error


@njit
def command(law, x, v, u3):
    """u_lin = C x + D v, deviation from trim, into u3 (3,)."""
    for i in range(N_U):
        total = 0.0
        for j in range(x.size):
            total += law.C[i, j] * x[j]
        for j in range(N_V):
            total += law.D[i, j] * v[j]
        u3[i] = total


@njit
def advance(law, x, v, cut):
    """x+ = A x + B v + L cut, in place; cut (3,) is u - u_lin."""
    n = x.size
    old = scratch(MAX_ORDER)
    copy_part(old, 0, x, 0, n)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += law.A[i, j] * old[j]
        for j in range(N_V):
            total += law.B[i, j] * v[j]
        for j in range(N_U):
            total += law.L[i, j] * cut[j]
        x[i] = total


def state_at_rest(
    law: OutputLaw, v: ArrayLike, u: ArrayLike, tick_s: float = TICK_S
) -> NDArray[np.float64]:
    """State (n,) at which the law rests with v (8,) held and commands u (3,), as nearly as can be.

    Least squares of the drift in one tick and of the command's error, in which modes that forget in
    less than a second rest, and slower ones, integrators above all, carry the command.
    """
    rows, of_v, of_u = _at_rest(law, tick_s)
    return np.linalg.lstsq(rows, of_v @ np.asarray(v, float) + of_u @ np.asarray(u, float))[0]


def rest_map(law: OutputLaw, tick_s: float = TICK_S) -> NDArray[np.float64]:
    """`state_at_rest` as a matrix (n, 11) that takes v and u, one behind the other."""
    rows, of_v, of_u = _at_rest(law, tick_s)
    return np.ascontiguousarray(np.linalg.pinv(rows) @ np.hstack([of_v, of_u]))


def _at_rest(law: OutputLaw, tick_s: float) -> tuple[NDArray[np.float64], ...]:
    """(rows, of_v, of_u): least squares of rows x = of_v v + of_u u is the state at rest."""
    n = law.A.shape[0]
    weight = tick_s / _MEMORY_S
    rows = np.vstack([np.eye(n) - law.A, weight * law.C])
    of_v = np.vstack([law.B, -weight * law.D])
    of_u = np.vstack([np.zeros((n, N_U)), weight * np.eye(N_U)])
    return rows, of_v, of_u
