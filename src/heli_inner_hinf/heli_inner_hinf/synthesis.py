# SPDX-License-Identifier: Apache-2.0
"""Suboptimal H-infinity state feedback u = F x + G (r - h_out_trim), eq. (15)-(17), with
certificate.

A Riccati solver may return a matrix with a tiny residual where no admissible solution exists; a
frequency sweep and the worst-case matrix can look right there too. So a solution counts only when
every condition of the acceptance rule holds, and each is kept with its number in the certificate.
"""

import enum
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.errors import (
    CertificateError,
    FeedforwardError,
    InfeasibleGammaError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
    SynthesisError,
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


# -------------------------------------------------------------------------------------------------
# gamma*: the infimum of the H-infinity norm wind -> h over all stabilising state feedback.
#
# Two things can end feasibility as gamma falls:
#
# - eigenvalues of the Hamiltonian matrix of (16) reach the imaginary axis, at
#   `gamma_0 = max_w sqrt(lambda_max Phi(w))`: what even a controller that knows the future wind
#   could
#   not beat. Found by the level-set iteration of Boyd, Balakrishnan (1990) and Bruinsma, Steinbuch
#   (1990), which converges quadratically;
# - before that, P grows without bound (Scherer, "H-infinity control by state feedback and fast
#   algorithms for the computation of optimal H-infinity norms", IEEE TAC 35(10), 1990). In the
#   split
#   of `riccati` this is `lambda_max(M Z) = 1`, convex and decreasing in gamma^2: a tangent meets
#   one
#   before the root and a chord behind it, so that Newton and secant steps close a bracket from
#   both
#   sides.
#
# Every bound is certified by a test of its own: the lower one by a frequency at which `lambda_max
# Phi` reaches it or by a tangent; the upper one by a stabilising Z with `lambda_max(M Z) < 1`,
# which
# makes P >= 0.
# -------------------------------------------------------------------------------------------------

REL_TOL = 1e-10
_MAX_STEPS = 80


class Mechanism(enum.Enum):
    """What ends feasibility at gamma*."""

    HAMILTONIAN_AXIS = "eigenvalues of the Hamiltonian matrix reach the imaginary axis"
    P_UNBOUNDED = "P grows without bound"
    NO_DISTURBANCE = "the wind does not reach the weighted output: every gamma > 0 is feasible"


@dataclass(frozen=True)
class GammaStar:
    """Result of `gamma_star`.

    Attributes
    ----------
    value : float
        Best estimate of gamma*, in the unit of |h|/|w|.
    lower, upper : float
        Certified bracket, relative width <= 1e-10: nothing below `lower` is feasible, `upper` is.
    frequency : float or None
        Frequency of the worst wind, rad/s; None if P grows without bound or gamma* = 0.
    mechanism : Mechanism
        What ends feasibility.
    iterations : int
        Level-set plus Newton steps taken.
    """

    value: float
    lower: float
    upper: float
    frequency: float | None
    mechanism: Mechanism
    iterations: int


def gamma_star(A: ArrayLike, B: ArrayLike, E: ArrayLike, C: ArrayLike, D: ArrayLike) -> GammaStar:
    """Infimum of ||T_hw||_inf over stabilising u = F x, eq. (13), (14), to 1e-10 relative.

    Parameters
    ----------
    A, B, E : (n, n), (n, n_u), (n, n_w) arrays
        Plant `x' = A x + B u + E w`, any consistent units.
    C, D : (n_h, n), (n_h, n_u) arrays
        Controlled output `h = C x + D u`; D needs full column rank.

    Raises
    ------
    ShapeError, NotStabilizableError, InvariantZeroError
        The problem is not a regular one; the message names the matrix or the mode.
    CertificateError
        The bracket cannot be closed in double precision.
    """
    return gamma_star_of(split(regular_form(*checked_plant(A, B, E, C, D))))


def gamma_star_of(problem: SplitProblem) -> GammaStar:
    """`gamma_star` of a problem that is split already (result in the given units)."""
    if not problem.form.disturbed or not np.any(problem.G):
        return GammaStar(0.0, 0.0, 0.0, None, Mechanism.NO_DISTURBANCE, 0)
    level = _LevelSet(problem)
    level.run()
    scale = problem.form.wind_scale
    coupling = _coupling(problem, level.upper**2) if level.upper > 0.0 else None
    if coupling is not None and coupling < 1.0:
        return GammaStar(
            scale * level.lower,
            scale * level.lower,
            scale * level.upper,
            level.frequency,
            Mechanism.HAMILTONIAN_AXIS,
            level.steps,
        )
    low, high, steps = _unbounded_branch(problem, level.upper**2)
    lower, upper = scale * float(np.sqrt(low)), scale * float(np.sqrt(high))
    return GammaStar(
        0.5 * (lower + upper), lower, upper, None, Mechanism.P_UNBOUNDED, level.steps + steps
    )


class _LevelSet:
    """gamma_0 = max over w of sqrt(lambda_max Phi(w)), as a bracket [lower, upper]; 0, 0 if Phi =
    0."""

    def __init__(self, problem: SplitProblem) -> None:
        self.problem = problem
        self.lower = self.upper = self.frequency = 0.0
        self.steps = 0

    def _improve(self, omega: np.ndarray) -> None:
        for w in omega:
            peak = self.problem.phi_max(float(w))
            if peak > self.lower**2:
                self.lower, self.frequency = float(np.sqrt(peak)), float(w)

    def run(self) -> None:
        problem = self.problem
        poles = np.linalg.eigvals(double(problem.A_c))
        self._improve(np.unique(np.concatenate([[0.0], np.abs(poles), np.abs(poles.imag)])))
        # Phi = 0 up to rounding: a controller that knows the future counters the wind completely
        rounding = 1e-14 * norm_of(problem.G) * np.linalg.norm(problem.form.E)
        if self.lower**2 * np.min(np.abs(poles)) <= rounding:
            self.lower = 0.0
            return
        for _ in range(_MAX_STEPS):
            self.steps += 1
            level = self.lower * (1.0 + 0.5 * REL_TOL)
            scaled, _ = balanced_hamiltonian(problem.hamiltonian(level**-2))
            eigenvalues = np.linalg.eigvals(scaled)
            size = np.abs(eigenvalues)
            # generous: whether one really crosses is told by Phi at its frequency
            near = np.abs(eigenvalues.real) <= 1e-3 * size + 1e-8 * np.max(size)
            crossing = np.unique(np.abs(eigenvalues[near].imag))
            self._improve(np.concatenate([crossing, 0.5 * (crossing[1:] + crossing[:-1])]))
            if self.lower <= level:
                self.upper = level
                return
        raise CertificateError("the level-set iteration for gamma* did not close its bracket")


def _coupling(problem: SplitProblem, s: float) -> float | None:
    """lambda_max(M Z) at s = gamma_scaled^2; None where no Z exists."""
    Z = problem.rest(1.0 / s)
    return None if Z is None else problem.coupling(Z)[0]


def _tangent(problem: SplitProblem, s: float) -> tuple[float, float] | None:
    """lambda_max(M Z) at s and its slope."""
    Z = problem.rest(1.0 / s)
    if Z is None:
        return None
    value, v = problem.coupling(Z)
    return value, problem.slope(Z, 1.0 / s, v)


def _unbounded_branch(problem: SplitProblem, s_0: float) -> tuple[float, float, int]:
    """Bracket (low, high) of s = gamma_scaled^2 where lambda_max(M Z) passes one; s_0 is
    infeasible."""
    low, high, g_high, steps = _outer_bracket(problem, s_0)
    while high - low > 2.0 * REL_TOL * low:
        steps += 1
        if steps > _MAX_STEPS:
            raise CertificateError("the Newton iteration for gamma* did not close its bracket")
        at_low = _tangent(problem, low) if low > 0.0 else None
        if at_low is not None and at_low[0] > 1.0 and at_low[1] < 0.0:
            newton = low + (1.0 - at_low[0]) / at_low[1]
            chord = low + (high - low) * (at_low[0] - 1.0) / (at_low[0] - g_high)
            # far out lambda_max falls like 1 / s
            far = low * at_low[0]
            nudge = 1.0 + 1.5 * REL_TOL
            guesses = [newton, chord * (1.0 + 0.25 * REL_TOL), newton * nudge, far, far * nudge]
        else:
            guesses = [np.sqrt(low * high) if low > 0.0 else 0.25 * high]
        before = high - low
        for guess in guesses:
            low, high, g_high = _narrowed(problem, guess, low, high, g_high)
        if high - low > 0.5 * before:
            low, high, g_high = _narrowed(problem, 0.5 * (low + high), low, high, g_high)
    return low, high, steps


def _narrowed(
    problem: SplitProblem, s: float, low: float, high: float, g_high: float
) -> tuple[float, float, float]:
    """The bracket with the test of `s` put in."""
    if not low < s < high:
        return low, high, g_high
    g = _coupling(problem, s)
    if g is not None and g < 1.0:
        return low, s, g
    return s, high, g_high


def _outer_bracket(problem: SplitProblem, s_0: float) -> tuple[float, float, float, int]:
    """(low, high, lambda_max at high, steps) by doubling from the size of M Z at gamma -> inf."""
    from scipy.linalg import solve_continuous_lyapunov

    G = double(problem.G)
    size, _ = problem.coupling(solve_continuous_lyapunov(double(problem.A_c).T, -G @ G.T))
    low, s = s_0, max(size, s_0 * (1.0 + 1e-6))
    for step in range(1, _MAX_STEPS):
        g = _coupling(problem, s)
        if g is not None and g < 1.0:
            return low, s, g, step
        low, s = s, 4.0 * s
    raise CertificateError("no feasible gamma was found: the problem is too badly conditioned")


# -------------------------------------------------------------------------------------------------
# H-infinity norm of a stable system, with its frequency.
# -------------------------------------------------------------------------------------------------

NORM_REL_TOL = 1e-11


def transfer(A: Matrix, B: Matrix, C: Matrix, omega: float) -> np.ndarray:
    """C (jw I - A)^-1 B (n_y, n_u), complex, at omega rad/s."""
    return C @ np.linalg.solve(1j * omega * np.eye(A.shape[0]) - A, B.astype(np.complex128))


def hinf_norm(A: Matrix, B: Matrix, C: Matrix, D: Matrix | None = None) -> tuple[float, float]:
    """max over w of the largest singular value of C (jw I - A)^-1 B + D.

    Parameters
    ----------
    A, B, C : (n, n), (n, n_u), (n_y, n) arrays
        Stable system.
    D : (n_y, n_u) array, optional
        Default: zero.

    Returns
    -------
    norm, frequency : float
        Relative accuracy 1e-11 (Bruinsma, Steinbuch 1990); rad/s; inf where the direct path has the
        largest gain.
    """
    D = np.zeros((C.shape[0], B.shape[1])) if D is None else D
    direct = float(np.linalg.norm(D, 2))
    if A.shape[0] == 0 or not np.any(B) or not np.any(C):
        return direct, 0.0

    def gain(omega: float) -> float:
        return float(np.linalg.svd(transfer(A, B, C, omega) + D, compute_uv=False)[0])

    poles = np.linalg.eigvals(A)
    best, where = max((gain(w), w) for w in np.concatenate([[0.0], np.abs(poles)]))
    if direct > best:
        best, where = direct, np.inf
    for _ in range(60):
        level = best * (1.0 + NORM_REL_TOL)
        if level == 0.0:
            return 0.0, 0.0
        H = _hamiltonian(A, B, C, D, level)
        eigenvalues = np.linalg.eigvals(balanced_hamiltonian(H)[0])
        size = np.abs(eigenvalues)
        near = np.abs(eigenvalues.real) <= 1e-3 * size + 1e-8 * np.max(size)
        crossing = np.unique(np.abs(eigenvalues[near].imag))
        trial = np.concatenate([crossing, 0.5 * (crossing[1:] + crossing[:-1])])
        if trial.size:
            largest, at = max((gain(w), w) for w in trial)
            if largest > best:
                best, where = largest, at
        if best <= level:
            break
    return float(best), float(where)


def _hamiltonian(A: Matrix, B: Matrix, C: Matrix, D: Matrix, level: float) -> Matrix:
    """Its eigenvalues on the axis are where a singular value equals `level`."""
    inside = np.linalg.inv(np.eye(B.shape[1]) - D.T @ D / level**2)
    a = A + B @ inside @ D.T @ C / level**2
    through = C.T @ (np.eye(C.shape[0]) + D @ inside @ D.T / level**2) @ C
    return np.block([[a, B @ inside @ B.T / level], [-through / level, -a.T]])


# -------------------------------------------------------------------------------------------------
# Synthesis.
# -------------------------------------------------------------------------------------------------

__all__ = [
    "Certificate",
    "CertificateError",
    "CertificateCondition",
    "FeedforwardError",
    "GammaStar",
    "InfeasibleGammaError",
    "InvariantZeroError",
    "Mechanism",
    "NotStabilizableError",
    "ShapeError",
    "Synthesis",
    "SynthesisError",
    "acceptance",
    "gamma_star",
    "synthesize",
]

SYMMETRY_TOL = 1e-9
PSD_TOL = 1e-9
RESIDUAL_TOL = 1e-7


@dataclass(frozen=True)
class CertificateCondition:
    """One line of the certificate: `value` against `bound`, and whether it holds."""

    name: str
    value: float
    bound: float
    holds: bool

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "FAILS"
        return f"{self.name}: {self.value:.6g} (bound {self.bound:.6g}) {verdict}"


@dataclass(frozen=True)
class Certificate:
    """The acceptance rule for a P of eq. (16), condition by condition.

    All in the balanced coordinates of `regular_form`, in which sizes can be compared; none of the
    verdicts depends on the coordinates.
    """

    symmetry: CertificateCondition
    positive_semidefinite: CertificateCondition
    closed_loop_stable: CertificateCondition
    worst_case_stable: CertificateCondition
    residual: CertificateCondition
    norm_below_gamma: CertificateCondition

    @property
    def conditions(self) -> tuple[CertificateCondition, ...]:
        """The six conditions in order."""
        return (
            self.symmetry,
            self.positive_semidefinite,
            self.closed_loop_stable,
            self.worst_case_stable,
            self.residual,
            self.norm_below_gamma,
        )

    @property
    def accepted(self) -> bool:
        """Whether every condition holds."""
        return all(c.holds for c in self.conditions)

    def __str__(self) -> str:
        return "\n".join(str(c) for c in self.conditions)


@dataclass(frozen=True)
class Synthesis:
    """Result of `synthesize`, in the units of the given plant.

    Attributes
    ----------
    F : (n_u, n) array
        State feedback, eq. (15).
    G : (n_u, n_u) array
        Feedforward from r - h_out_trim, eq. (15).
    P : (n, n) array
        Stabilising solution of eq. (16), symmetric, positive semidefinite.
    gamma : float
        The gamma that was asked for.
    solved_at : float
        The gamma with which eq. (16) was solved: `gamma` itself but for the last 1e-4 above gamma*,
        where a value between gamma* and gamma may be needed for the norm to stay below gamma in
        floating point.
    gamma_star : GammaStar
        The infimum and its bracket.
    norm, norm_frequency : float
        Achieved ||T_hw||_inf and the frequency (rad/s) at which it is attained.
    certificate : Certificate
        Each condition of the acceptance rule with its number.
    """

    F: Matrix
    G: Matrix
    P: Matrix
    gamma: float
    solved_at: float
    gamma_star: GammaStar
    norm: float
    norm_frequency: float
    certificate: Certificate


def synthesize(
    A: ArrayLike,
    B: ArrayLike,
    E: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    gamma: float,
    C_out: ArrayLike,
) -> Synthesis:
    """F, G of eq. (15) from the P of eq. (16) at `gamma`.

    Parameters
    ----------
    A, B, E, C, D : (n, n), (n, n_u), (n, n_w), (n_h, n), (n_h, n_u) arrays
        As in `gamma_star`.
    gamma : float
        Bound on ||T_hw||_inf, must be above gamma*.
    C_out : (n_u, n) array
        Selects the commanded outputs; the paper: phi, theta, psi.

    Raises
    ------
    InfeasibleGammaError
        gamma is not above gamma*; carries both numbers.
    ShapeError, NotStabilizableError, InvariantZeroError, FeedforwardError
        The data do not make a regular problem.
    CertificateError
        The solution fails its acceptance rule for numerical reasons.
    """
    a, b, e, c, d = checked_plant(A, B, E, C, D)
    c_out = checked("C_out", C_out, (b.shape[1], a.shape[0]))
    form = regular_form(a, b, e, c, d)
    problem = split(form)
    infimum = gamma_star_of(problem)
    gamma = float(gamma)
    if not (np.isfinite(gamma) and gamma > max(infimum.upper, 0.0)):
        raise InfeasibleGammaError(gamma, infimum.value)
    # just above gamma* the norm comes within rounding of gamma: then a slightly smaller gamma makes
    # room
    for share in (1.0, 0.9, 0.5):
        solved_at = infimum.value + share * (gamma - infimum.value) if share < 1.0 else gamma
        P_form = _riccati(problem, solved_at)
        certificate, norm, frequency = acceptance(form, P_form, solved_at, gamma)
        if certificate.accepted:
            break
    else:
        failing = "; ".join(str(k) for k in certificate.conditions if not k.holds)
        raise CertificateError(f"gamma = {gamma:.10g} cannot be certified: {failing}")
    P = form.P_given(P_form)
    F = state_feedback(b, c, d, P)
    G = feedforward(a, b, F, c_out)
    return Synthesis(
        F,
        G,
        np.asarray(P, dtype=np.float64),
        gamma,
        solved_at,
        infimum,
        norm,
        frequency,
        certificate,
    )


def state_feedback(B: Matrix, C: Matrix, D: Matrix, P: Matrix) -> Matrix:
    """F = -(D'D)^-1 (D'C + B'P) (n_u, n), eq. (15); by the QR factors of D, P in any precision."""
    if D.shape[1] == 0:
        return np.zeros((0, B.shape[0]))
    q1, r1 = np.linalg.qr(D)
    controllability = np.asarray(P @ B, dtype=np.float64).T
    return -np.linalg.solve(r1, q1.T @ C + np.linalg.solve(r1.T, controllability))


def feedforward(A: Matrix, B: Matrix, F: Matrix, C_out: Matrix) -> Matrix:
    """G = -[C_out (A + BF)^-1 B]^-1 (n_u, n_u), eq. (15): outputs settle at their command.

    Raises
    ------
    FeedforwardError
        The inputs cannot set these outputs independently of each other.
    """
    static = C_out @ np.linalg.solve(A + B @ F, B)
    scaled = static.copy()
    for axis in (0, 1, 0, 1):
        size = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0.0, size, 1.0)
    if static.size and np.linalg.svd(scaled, compute_uv=False)[-1] < 1e-12:
        raise FeedforwardError(
            "C_out (A + BF)^-1 B is singular: the inputs cannot set the outputs that C_out selects "
            "independently of each other"
        )
    return -np.linalg.inv(static)


def acceptance(
    form: RegularForm, P: np.ndarray, gamma: float, bound: float | None = None
) -> tuple[Certificate, float, float]:
    """Judge P (n, n; coordinates of `form`) as solution of (16) at `gamma`, its loop against
    `bound`.

    Parameters
    ----------
    form : RegularForm
    P : (n, n) array, double or extended precision
    gamma, bound : float
        Given units; `bound` is `gamma` unless given.

    Returns
    -------
    certificate : Certificate
        The six conditions.
    norm, frequency : float
        ||T_hw||_inf in given units (inf if the loop is unstable) and where (rad/s).
    """
    bound = gamma if bound is None else bound
    mu = (form.wind_scale / gamma) ** 2
    PB, PE, Q = P @ form.B, P @ form.E, form.C.T @ form.C
    size = max(norm_of(P), np.finfo(float).tiny)
    asymmetry = norm_of(P - P.T) / size
    least = float(np.linalg.eigvalsh(np.asarray(0.5 * (P + P.T), dtype=np.float64))[0] / size)
    fine = form.A - form.B @ PB.T
    closed = np.asarray(fine, dtype=np.float64)
    worst = np.asarray(fine + mu * form.E @ PE.T, dtype=np.float64)
    PA, effort, wind = form.A.T @ P, PB @ PB.T, mu * PE @ PE.T
    total = PA + PA.T - effort + wind + Q
    scale = max(sum(norm_of(t) for t in (PA, effort, wind, Q)), np.finfo(float).tiny)
    residual = norm_of(total) / scale
    closed_re, worst_re = spectral_abscissa(closed), spectral_abscissa(worst)
    norm, frequency = np.inf, 0.0
    if closed_re < 0.0:
        output = np.vstack([form.C, np.asarray(-PB.T, dtype=np.float64)])
        norm, frequency = hinf_norm(closed, form.E, output)
        norm *= form.wind_scale
    certificate = Certificate(
        CertificateCondition("asymmetry of P", asymmetry, SYMMETRY_TOL, asymmetry <= SYMMETRY_TOL),
        CertificateCondition("least eigenvalue of P, relative", least, -PSD_TOL, least >= -PSD_TOL),
        CertificateCondition("largest Re of A + BF (rad/s)", closed_re, 0.0, closed_re < 0.0),
        CertificateCondition(
            "largest Re of A + BF + EE'P/gamma^2 (rad/s)", worst_re, 0.0, worst_re < 0.0
        ),
        CertificateCondition(
            "relative residual of (16)", residual, RESIDUAL_TOL, residual <= RESIDUAL_TOL
        ),
        CertificateCondition("||T_hw||_inf", norm, bound, norm < bound),
    )
    return certificate, float(norm), float(frequency)


def _riccati(problem: SplitProblem, gamma: float) -> Matrix:
    """P (n, n) of (16) at `gamma`, in the coordinates of the regular form."""
    mu = (problem.form.wind_scale / gamma) ** 2
    Z = problem.rest(mu)
    if Z is None:
        raise CertificateError(f"eq. (16) has no stabilising solution at gamma = {gamma:.10g}")
    return problem.solution(Z, mu)


# -------------------------------------------------------------------------------------------------
# LQR with the weights of (11), (12): the yardstick beside H-infinity, and its limit gamma ->
#
# inf.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lqr:
    """LQR gains: F (n_u, n), G (n_u, n_u) as in eq. (15), and the norm wind -> h they achieve."""

    F: Matrix
    G: Matrix
    P: Matrix
    norm: float


def lqr(
    A: ArrayLike, B: ArrayLike, E: ArrayLike, C: ArrayLike, D: ArrayLike, C_out: ArrayLike
) -> Lqr:
    """State feedback that minimises the integral of |C x + D u|^2; arguments as in `synthesize`.

    Raises
    ------
    ShapeError, NotStabilizableError, InvariantZeroError, FeedforwardError
        As in `synthesize`.
    """

    a, b, e, c, d = checked_plant(A, B, E, C, D)
    c_out = checked("C_out", C_out, (b.shape[1], a.shape[0]))
    form = regular_form(a, b, e, c, d)
    P = form.P_given(lqr_solution(form))
    F = state_feedback(b, c, d, P)
    norm, _ = hinf_norm(a + b @ F, e, c + d @ F)
    return Lqr(F, feedforward(a, b, F, c_out), np.asarray(P, dtype=np.float64), norm)
