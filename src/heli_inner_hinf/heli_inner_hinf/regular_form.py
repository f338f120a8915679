# SPDX-License-Identifier: Apache-2.0
"""The full-information H-infinity problem in a form that is safe to compute with.

From `x' = A x + B u + E w, h = C x + D u` (eq. (13)) with D injective:

1. cross terms and R = D'D are removed by the QR factors of D (R becomes the identity);
2. states are scaled by powers of two (exact in floating point) so that the Hamiltonian matrix is
   balanced, and w by a power of two so that E has a norm near one;
3. stable modes that the weights cannot see are split off: on them P = 0, so that the rest has P > 0
   and its inverse exists.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_inner_hinf.errors import InvariantZeroError, NotStabilizableError, ShapeError
from heli_inner_hinf.weights import checked

Matrix = NDArray[np.float64]
RANK_TOL = 1e-12
AXIS_TOL = 1e-9


@dataclass(frozen=True)
class RegularForm:
    """Scaled problem `x' = A x + B u + E w`, `|h|^2 = |C x|^2 + |u|^2`, in quotient coordinates.

    Attributes
    ----------
    A, B, E, C : (n, n), (n, n_u), (n, n_w), (n_h, n) arrays
        Scaled data; n may be smaller than the given plant's, see `basis`.
    basis : (n_full, n) array
        Columns span what the weights see (orthonormal, scaled coordinates).
    state_scale : (n_full,) array
        x_given = state_scale * x_scaled.
    wind_scale : float
        gamma_given = wind_scale * gamma_scaled.
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    basis: Matrix
    state_scale: Matrix
    wind_scale: float

    @property
    def n(self) -> int:
        """Number of states that the weights see."""
        return int(self.A.shape[0])

    def P_given(self, P: Matrix) -> Matrix:
        """P (n_full, n_full) in the given coordinates from P (n, n) of this form."""
        lifted = self.basis @ P @ self.basis.T
        return lifted / np.outer(self.state_scale, self.state_scale)

    def hamiltonian(self, mu: float) -> Matrix:
        """H (2n, 2n) of (16) at mu = 1 / gamma_scaled^2."""
        S = self.B @ self.B.T - mu * (self.E @ self.E.T)
        return np.block([[self.A, -S], [-self.C.T @ self.C, -self.A.T]])


def checked_plant(
    A: ArrayLike, B: ArrayLike, E: ArrayLike, C: ArrayLike, D: ArrayLike
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix]:
    """The five matrices as float64 arrays with fitting shapes, or a ShapeError naming one."""
    a = checked("A", A, (None, None))
    n = a.shape[0]
    if n == 0 or a.shape[1] != n:
        raise ShapeError("A", f"A must be square and not empty, but is {n}x{a.shape[1]}")
    b = checked("B", B, (n, None))
    e = checked("E", E, (n, None))
    c = checked("C", C, (None, n))
    d = checked("D", D, (c.shape[0], b.shape[1]))
    if b.shape[1] and np.linalg.matrix_rank(d / _column_norms(d)) < b.shape[1]:
        raise ShapeError("D", "D must have full column rank: every input needs a weight")
    return a, b, e, c, d


def regular_form(A: Matrix, B: Matrix, E: Matrix, C: Matrix, D: Matrix) -> RegularForm:
    """Bring a checked plant into regular form.

    Raises
    ------
    NotStabilizableError, InvariantZeroError
        The two conditions under which no gamma is feasible in the sense of (15)-(17).
    """
    q1, r1 = np.linalg.qr(D)
    gain = np.linalg.solve(r1, q1.T @ C) if B.shape[1] else np.zeros((0, A.shape[0]))
    A0 = A - B @ gain
    B0 = np.linalg.solve(r1.T, B.T).T if B.shape[1] else B
    C0 = C - q1 @ (q1.T @ C)
    # D'C = 0 in exact arithmetic leaves C as it is; rounding must not make rank out of nothing
    C0[np.abs(C0) < 1e-15 * np.max(np.abs(C), axis=0, initial=0.0)] = 0.0
    scale = _balance(A0, B0 @ B0.T, C0.T @ C0)
    As = A0 * scale / scale[:, None]
    Bs, Es, Cs = B0 / scale[:, None], E / scale[:, None], C0 * scale
    e_norm = np.linalg.norm(Es)
    wind_scale = float(2.0 ** np.round(np.log2(e_norm))) if e_norm > 0.0 else 1.0
    _require_stabilizable(As, Bs)
    basis = _seen_basis(As, Cs)
    return RegularForm(
        A=basis.T @ As @ basis,
        B=basis.T @ Bs,
        E=basis.T @ Es / wind_scale,
        C=Cs @ basis,
        basis=basis,
        state_scale=scale,
        wind_scale=wind_scale,
    )


def _column_norms(matrix: Matrix) -> Matrix:
    norms = np.linalg.norm(matrix, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _balance(A: Matrix, S: Matrix, Q: Matrix) -> Matrix:
    """Powers of two t (n,) that balance [[A, S], [Q, -A']] under x = t * x_scaled (Osborne)."""
    n = A.shape[0]
    a, s, q = np.abs(A), np.abs(S), np.abs(Q)
    np.fill_diagonal(a, 0.0)
    t = np.ones(n)
    for _ in range(40):
        changed = False
        for i in range(n):
            down = np.linalg.norm(a[i]) + np.linalg.norm(s[i])
            up = np.linalg.norm(a[:, i]) + np.linalg.norm(q[i])
            if down == 0.0 or up == 0.0:
                continue
            factor = 2.0 ** np.round(0.5 * np.log2(down / up))
            if factor == 1.0:
                continue
            changed = True
            t[i] *= factor
            a[i] /= factor
            a[:, i] *= factor
            s[i] /= factor
            s[:, i] /= factor
            q[i] *= factor
            q[:, i] *= factor
        if not changed:
            break
    return t


def _unobservable_basis(A: Matrix, C: Matrix) -> Matrix:
    """Orthonormal basis of the largest A-invariant subspace inside ker C."""
    n = A.shape[0]
    a_norm, c_norm = np.linalg.norm(A), np.linalg.norm(C)
    basis = np.eye(n)
    out, tol = C, RANK_TOL * max(c_norm, np.finfo(float).tiny)
    seen = np.zeros((n, 0))
    while basis.shape[1]:
        restricted = out @ basis
        _, sigma, vt = np.linalg.svd(restricted, full_matrices=True)
        rank = int(np.sum(sigma > tol))
        if rank == 0:
            break
        new = basis @ vt[:rank].T
        basis = basis @ vt[rank:].T
        seen = np.hstack([seen, new])
        out, tol = seen.T @ A, RANK_TOL * max(a_norm, np.finfo(float).tiny)
    return basis


def _require_stabilizable(A: Matrix, B: Matrix) -> None:
    hidden = _unobservable_basis(A.T, B.T)
    if hidden.shape[1] == 0:
        return
    block = hidden.T @ A @ hidden
    modes = np.linalg.eigvals(block)
    worst = modes[np.argmax(modes.real)]
    if worst.real >= -AXIS_TOL * max(np.linalg.norm(block), np.finfo(float).tiny):
        raise NotStabilizableError(complex(worst))


def _seen_basis(A: Matrix, C: Matrix) -> Matrix:
    """Orthonormal complement of the stable modes that C cannot see."""
    from scipy.linalg import null_space, schur

    hidden = _unobservable_basis(A, C)
    if hidden.shape[1] == 0:
        return np.eye(A.shape[0])
    block = hidden.T @ A @ hidden
    modes = np.linalg.eigvals(block)
    tol = AXIS_TOL * max(np.linalg.norm(block), np.finfo(float).tiny)
    on_axis = modes[np.abs(modes.real) <= tol]
    if on_axis.size:
        raise InvariantZeroError(complex(on_axis[0]))
    _, z, n_stable = schur(block, output="real", sort="lhp")
    if n_stable == 0:
        return np.eye(A.shape[0])
    return null_space((hidden @ z[:, :n_stable]).T)
