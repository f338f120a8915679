# SPDX-License-Identifier: Apache-2.0
"""The full-information H-infinity problem in a form that is safe to compute with.

From `x' = A x + B u + E w, h = C x + D u` (eq. (13)) with D injective:

1. cross terms and R = D'D are removed by the QR factors of D (R becomes the identity);
2. states are scaled by powers of two (exact in floating point) so that the Hamiltonian matrix is
   balanced, and w by a power of two so that E has a norm near one.
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
    """Scaled problem `x' = A x + B u + E w`, `|h|^2 = |C x|^2 + |u|^2`.

    Attributes
    ----------
    A, B, E, C : (n, n), (n, n_u), (n, n_w), (n_h, n) arrays
        Scaled data.
    state_scale : (n,) array
        x_given = state_scale * x_scaled.
    wind_scale : float
        gamma_given = wind_scale * gamma_scaled.
    disturbed : bool
        Whether the wind excites anything that the weights see or that is not stable.
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    state_scale: Matrix
    wind_scale: float
    disturbed: bool

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    def P_given(self, P: Matrix) -> Matrix:
        """P (n, n) in the given coordinates from P (n, n) of this form."""
        return P / np.outer(self.state_scale, self.state_scale)

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
    scale = balance(A0, B0 @ B0.T, C0.T @ C0)
    As = A0 * scale / scale[:, None]
    Bs, Es, Cs = B0 / scale[:, None], E / scale[:, None], C0 * scale
    e_norm = np.linalg.norm(Es)
    wind_scale = float(2.0 ** np.round(np.log2(e_norm))) if e_norm > 0.0 else 1.0
    _require_stabilizable(As, Bs)
    hidden = _hidden_stable_basis(As, Cs)
    seen = Es - hidden @ (hidden.T @ Es)
    return RegularForm(
        A=As,
        B=Bs,
        E=Es / wind_scale,
        C=Cs,
        state_scale=scale,
        wind_scale=wind_scale,
        disturbed=bool(np.linalg.norm(seen) > RANK_TOL * e_norm),
    )


def _column_norms(matrix: Matrix) -> Matrix:
    norms = np.linalg.norm(matrix, axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def balance(A: Matrix, S: Matrix, Q: Matrix) -> Matrix:
    """Powers of two t (n,) that balance [[A, S], [Q, -A']] under x = t * x_scaled.

    Osborne's iteration, all states at once with half steps; exact in floating point.
    """
    a, s, q = np.abs(A), np.abs(S), np.abs(Q)
    a = a - np.diag(np.diag(a))
    log_t = np.zeros(A.shape[0])
    for _ in range(60):
        t = np.exp2(log_t)
        down = np.linalg.norm(a * t, axis=1) / t + np.linalg.norm(s / t, axis=1) / t
        up = np.linalg.norm(a / t[:, None], axis=0) * t + np.linalg.norm(q * t, axis=1) * t
        moves = (down > 0.0) & (up > 0.0)
        step = np.zeros_like(log_t)
        step[moves] = 0.25 * np.log2(down[moves] / up[moves])
        log_t += step
        if np.max(np.abs(step)) < 0.05:
            break
    return np.exp2(np.round(log_t))


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


def _hidden_stable_basis(A: Matrix, C: Matrix) -> Matrix:
    """Orthonormal basis (n, k) of the stable modes that C cannot see."""
    from scipy.linalg import schur

    hidden = _unobservable_basis(A, C)
    if hidden.shape[1] == 0:
        return hidden
    block = hidden.T @ A @ hidden
    modes = np.linalg.eigvals(block)
    tol = AXIS_TOL * max(np.linalg.norm(block), np.finfo(float).tiny)
    on_axis = modes[np.abs(modes.real) <= tol]
    if on_axis.size:
        raise InvariantZeroError(complex(on_axis[0]))
    _, z, n_stable = schur(block, output="real", sort="lhp")
    return hidden @ z[:, :n_stable]
