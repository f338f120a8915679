# SPDX-License-Identifier: Apache-2.0
"""A plant that is to be designed for: its assumptions, its regular form, the split problem."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.errors import (
    CertificateError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
)
from heli_core.rows import ATTITUDE, INPUT_NAMES, NINE, STATE_NAMES

# -------------------------------------------------------------------------------------------------
# Weights of the controlled output h = C x + D u, eq. (11), (12).
#
# For every aircraft with the nine states of eq. (10), in order phi theta p q a_s b_s r d_int psi
# (rad, rad/s), and the three inputs d_lat d_lon d_ped.
# -------------------------------------------------------------------------------------------------

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


# -------------------------------------------------------------------------------------------------
# The full-information H-infinity problem in a form that is safe to compute with.
#
# From `x' = A x + B u + E w, h = C x + D u` (eq. (13)) with D injective:
#
# 1. cross terms and R = D'D are removed by the QR factors of D (R becomes the identity);
# 2. states are scaled by powers of two (exact in floating point) so that the Hamiltonian matrix is
#    balanced, and w by a power of two so that E has a norm near one.
# -------------------------------------------------------------------------------------------------

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
    E_visible = Es - hidden @ (hidden.T @ Es)
    return RegularForm(
        A=As,
        B=Bs,
        E=Es / wind_scale,
        C=Cs,
        state_scale=scale,
        wind_scale=wind_scale,
        disturbed=bool(np.linalg.norm(E_visible) > RANK_TOL * e_norm),
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
    observable = np.zeros((n, 0))
    while basis.shape[1]:
        restricted = out @ basis
        _, sigma, vt = np.linalg.svd(restricted, full_matrices=True)
        rank = int(np.sum(sigma > tol))
        if rank == 0:
            break
        new = basis @ vt[:rank].T
        basis = basis @ vt[rank:].T
        observable = np.hstack([observable, new])
        out, tol = observable.T @ A, RANK_TOL * max(a_norm, np.finfo(float).tiny)
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


# -------------------------------------------------------------------------------------------------
# The Riccati equation (16), split into an LQR problem and a rest that stays finite.
#
# With X0 the stabilising solution for gamma = inf, `A_c = A - B B' X0` (stable) and M the
# controllability Gramian of (A_c, B), the similarity `T = [[I, -M], [X0, I - X0 M]]` turns the
# Hamiltonian matrix at mu = 1/gamma^2 into
#
#     [[A_c + mu Et G', mu Et Et'], [-mu G G', -(A_c + mu Et G')']],  G = X0 E,  Et = (I - M X0) E,
#
# whose stable subspace is spanned by [I; Z] for every mu below mu_0 (no eigenvalue on the axis),
# with
#
#     A_c' Z + Z A_c + mu (Z Et + G)(Z Et + G)' = 0,   Z >= 0.
#
# Back in (16): `P = X0 + Z (I - M Z)^-1`. So P >= 0 exists if and only if the spectral radius of M
# Z
# is below one, and nothing here grows without bound when P does.
#
# Z x0-wise is the supremum over w of an expression affine in s = gamma^2, hence convex and
# decreasing
# in s; so is `lambda_max(M Z)`.
# -------------------------------------------------------------------------------------------------

_NEWTON_STEPS = 12


@dataclass(frozen=True)
class SplitProblem:
    """X0, A_c, M (n, n), G, Et (n, n_w) of the module's text in extended precision; N N' = M in
    double."""

    form: RegularForm
    X0: np.ndarray
    A_c: np.ndarray
    M: np.ndarray
    G: np.ndarray
    Et: np.ndarray
    N: Matrix

    def hamiltonian(self, mu: float) -> Matrix:
        """The transformed Hamiltonian matrix (2n, 2n) at mu = 1 / gamma_scaled^2."""
        A_c, G, Et = double(self.A_c), double(self.G), double(self.Et)
        a = A_c + mu * (Et @ G.T)
        return np.block([[a, mu * (Et @ Et.T)], [-mu * (G @ G.T), -a.T]])

    def phi_max(self, omega: float) -> float:
        """lambda_max of Phi(w) = G'(jw - A_c)^-1 Et + its conjugate transpose, omega in rad/s."""
        resolvent = 1j * omega * np.eye(self.form.n) - double(self.A_c)
        half = double(self.G).T @ np.linalg.solve(resolvent, self.Et.astype(np.complex128))
        return float(np.linalg.eigvalsh(half + half.conj().T)[-1])

    def rest(self, mu: float) -> np.ndarray | None:
        """Z (n, n), extended precision, at mu; None where no stabilising one exists."""
        basis = stable_subspace(self.hamiltonian(mu))
        if basis is None:
            return None
        n = self.form.n
        try:
            Z = np.linalg.solve(basis[:n].T, basis[n:].T).T
        except np.linalg.LinAlgError:
            return None

        def residual(z: np.ndarray) -> np.ndarray:
            half = self.A_c.T @ z
            gain = z @ self.Et + self.G
            return half + half.T + mu * (gain @ gain.T)

        def closed(z: np.ndarray) -> np.ndarray:
            return self.A_c + mu * self.Et @ (z @ self.Et + self.G).T

        return newton_refined(0.5 * (Z + Z.T), residual, closed)

    def coupling(self, Z: np.ndarray) -> tuple[float, np.ndarray]:
        """lambda_max(M Z) and its eigenvector (n,).

        The eigenvector comes from N'ZN; its Rayleigh quotient, which forgives the vector's error to
        first order, is taken in extended precision.
        """
        coupled = self.N.T @ double(Z) @ self.N
        v = self.N @ np.linalg.eigh(0.5 * (coupled + coupled.T))[1][:, -1]
        z = Z @ v
        energy = float(v @ z)
        return (float((z @ self.M @ z) / energy) if energy > 0.0 else 0.0), v

    def slope(self, Z: np.ndarray, mu: float, v: np.ndarray) -> float:
        """d lambda_max(M Z) / d(gamma^2) <= 0 along the eigenvector v (n,) that `coupling` gave."""
        from scipy.linalg import solve_continuous_lyapunov

        gain = double(mu * (Z @ self.Et + self.G).T)
        closed = double(self.A_c) + double(self.Et) @ gain
        change = solve_continuous_lyapunov(closed.T, gain.T @ gain)
        z = double(Z @ v)
        return float(self.coupling(Z)[0] * (v @ change @ v) / (v @ z))

    def solution(self, Z: np.ndarray, mu: float) -> np.ndarray:
        """P (n, n), extended precision, of (16) from Z at mu, refined."""
        lift = double(Z) @ self.N
        middle = np.eye(self.form.n) - self.N.T @ lift
        P = double(self.X0 + Z) + lift @ np.linalg.solve(0.5 * (middle + middle.T), lift.T)
        form = self.form
        Q = form.C.T @ form.C

        def residual(p: Matrix) -> Matrix:
            half = form.A.T @ p
            # p B first: P is large where B is small
            pb, pe = p @ form.B, p @ form.E
            return half + half.T - pb @ pb.T + mu * (pe @ pe.T) + Q

        def closed(p: Matrix) -> Matrix:
            return form.A - form.B @ (p @ form.B).T + mu * form.E @ (p @ form.E).T

        return newton_refined(0.5 * (P + P.T), residual, closed)


def split(form: RegularForm) -> SplitProblem:
    """Solve the LQR part of `form`.

    Raises
    ------
    NotStabilizableError, InvariantZeroError
        No stabilising X0 exists.
    CertificateError
        X0 exists but cannot be found in double precision.
    """
    from scipy.linalg import solve_continuous_lyapunov

    X0 = lqr_solution(form)
    A_c = form.A - form.B @ (X0 @ form.B).T
    BBt = form.B.astype(np.longdouble) @ form.B.T

    def gramian_residual(m: np.ndarray) -> np.ndarray:
        half = A_c @ m
        return half + half.T + BBt

    first = solve_continuous_lyapunov(double(A_c), -double(BBt))
    M = newton_refined(first, gramian_residual, lambda _: A_c.T)
    values, vectors = np.linalg.eigh(double(0.5 * (M + M.T)))
    N = vectors * np.sqrt(np.maximum(values, 0.0))
    G = X0 @ form.E
    return SplitProblem(form, X0, A_c, M, G, form.E - M @ G, N)


def lqr_solution(form: RegularForm) -> np.ndarray:
    """X0 (n, n) >= 0, extended precision: stabilising solution of (16) for gamma = inf."""
    basis = stable_subspace(form.hamiltonian(0.0))
    n = form.n
    Q = form.C.T @ form.C
    if basis is not None:
        X = np.linalg.solve(basis[:n].T, basis[n:].T).T

        def residual(x: np.ndarray) -> np.ndarray:
            half = form.A.T @ x
            xb = x @ form.B
            return half + half.T - xb @ xb.T + Q

        def closed(x: np.ndarray) -> np.ndarray:
            return form.A - form.B @ (x @ form.B).T

        X = newton_refined(0.5 * (X + X.T), residual, closed)
        if spectral_abscissa(double(closed(X))) < 0.0:
            return X
    raise _irregular(form)


def balanced_hamiltonian(H: Matrix) -> tuple[Matrix, Matrix]:
    """H (2n, 2n) balanced by a diagonal similarity that keeps it Hamiltonian, and its diagonal."""
    n = H.shape[0] // 2
    t = balance(H[:n, :n], H[:n, n:], H[n:, :n])
    t = np.concatenate([t, 1.0 / t])
    return H * t / t[:, None], t


def stable_subspace(H: Matrix) -> Matrix | None:
    """Basis (2n, n) of the stable invariant subspace of a Hamiltonian matrix; None if of another
    size."""
    from scipy.linalg import schur

    n = H.shape[0] // 2
    scaled, t = balanced_hamiltonian(H)
    try:
        _, basis, n_stable = schur(scaled, output="real", sort="lhp", check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return basis[:, :n] * t[:, None] if n_stable == n else None


def newton_refined(X: Matrix, residual, closed) -> np.ndarray:  # type: ignore[no-untyped-def]
    """X after Newton steps on its Riccati (or Lyapunov) equation, as long as they shrink the
    residual.

    `residual(X)` is the equation's left side, evaluated in extended precision where the machine has
    it; its derivative in direction d is `K'd + dK` with K = `closed(X)`. The result has extended
    precision too: just above gamma* the loop depends on digits of P that double precision would
    round away.
    """
    from scipy.linalg import solve_continuous_lyapunov

    fine = X.astype(np.longdouble)
    res = residual(fine)
    size, moved = norm_of(res), np.inf
    for _ in range(_NEWTON_STEPS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)  # a singular Lyapunov equation
                step = solve_continuous_lyapunov(
                    double(closed(fine)).T, -double(0.5 * (res + res.T))
                )
        except (np.linalg.LinAlgError, ValueError, RuntimeWarning):
            break
        step = 0.5 * (step + step.T)
        better = fine + step
        new = residual(better)
        new_size, length = norm_of(new), norm_of(step)
        # at the residual's rounding floor its small directions may still be on their way
        if not (new_size < 0.5 * size or (length < 0.7 * moved and new_size < 100.0 * size)):
            break
        fine, res, size, moved = better, new, min(size, new_size), length
        if length <= 1e-17 * norm_of(fine):
            break
    return fine


def double(matrix: np.ndarray) -> Matrix:
    """The matrix rounded to double precision."""
    return np.asarray(matrix, dtype=np.float64)


def spectral_abscissa(matrix: Matrix) -> float:
    """Largest real part of the eigenvalues, rad/s."""
    return float(np.max(np.linalg.eigvals(matrix).real))


def norm_of(matrix: np.ndarray) -> float:
    """Frobenius norm of a matrix of any precision."""
    return float(np.sqrt(np.sum(matrix * matrix)))


def _irregular(form: RegularForm) -> CertificateError | NotStabilizableError | InvariantZeroError:
    """Which condition fails at the mode where it fails most; neither: the problem is
    ill-conditioned."""
    eye = np.eye(form.n)

    def rank_gap(matrix: np.ndarray) -> float:
        sigma = np.linalg.svd(matrix, compute_uv=False)
        return float(sigma[form.n - 1] / sigma[0])

    unstable = [m for m in np.linalg.eigvals(form.A) if m.real >= 0.0]
    near = np.linalg.eigvals(form.hamiltonian(0.0))
    axis = 1j * near[np.argsort(np.abs(near.real))][:2].imag
    controllability = [(rank_gap(np.hstack([form.A - m * eye, form.B])), m) for m in unstable]
    observability = [(rank_gap(np.vstack([form.A - m * eye, form.C])), m) for m in axis]
    worst_controllability = min(controllability, key=lambda v: v[0], default=(1.0, 0j))
    worst_observability = min(observability, key=lambda v: v[0], default=(1.0, 0j))
    if min(worst_controllability[0], worst_observability[0]) > 1e-8:
        return CertificateError("the Riccati equation (16) is too badly conditioned to be solved")
    if worst_controllability[0] < worst_observability[0]:
        return NotStabilizableError(complex(worst_controllability[1]))
    return InvariantZeroError(complex(worst_observability[1]))
