# SPDX-License-Identifier: Apache-2.0
"""The Riccati equation (16), split into an LQR problem and a rest that stays finite.

With X0 the stabilising solution for gamma = inf, `A_c = A - B B' X0` (stable) and M the
controllability Gramian of (A_c, B), the similarity `T = [[I, -M], [X0, I - X0 M]]` turns the
Hamiltonian matrix at mu = 1/gamma^2 into

    [[A_c + mu Et G', mu Et Et'], [-mu G G', -(A_c + mu Et G')']],  G = X0 E,  Et = (I - M X0) E,

whose stable subspace is spanned by [I; Z] for every mu below mu_0 (no eigenvalue on the axis), with

    A_c' Z + Z A_c + mu (Z Et + G)(Z Et + G)' = 0,   Z >= 0.

Back in (16): `P = X0 + Z (I - M Z)^-1`. So P >= 0 exists if and only if the spectral radius of M Z
is below one, and nothing here grows without bound when P does.

Z x0-wise is the supremum over w of an expression affine in s = gamma^2, hence convex and decreasing
in s; so is `lambda_max(M Z)`.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from heli_inner_hinf.errors import CertificateError, InvariantZeroError, NotStabilizableError
from heli_inner_hinf.regular_form import Matrix, RegularForm, balance

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
    reach = [(rank_gap(np.hstack([form.A - m * eye, form.B])), m) for m in unstable]
    sight = [(rank_gap(np.vstack([form.A - m * eye, form.C])), m) for m in axis]
    worst_reach = min(reach, key=lambda v: v[0], default=(1.0, 0j))
    worst_sight = min(sight, key=lambda v: v[0], default=(1.0, 0j))
    if min(worst_reach[0], worst_sight[0]) > 1e-8:
        return CertificateError("the Riccati equation (16) is too badly conditioned to be solved")
    if worst_reach[0] < worst_sight[0]:
        return NotStabilizableError(complex(worst_reach[1]))
    return InvariantZeroError(complex(worst_sight[1]))
