# SPDX-License-Identifier: Apache-2.0
"""gamma*: the infimum of the H-infinity norm wind -> h over all stabilising state feedback.

Two things can end feasibility as gamma falls (eq. (16), R = I in regular form, mu = 1 / gamma^2):

- eigenvalues of the Hamiltonian matrix reach the imaginary axis, at
  `gamma_0 = max_w sqrt(lambda_max Phi(w))`, `Phi(w) = -[0 E'] (H(0) - jw I)^-1 [E; 0]`: what even a
  controller that knows the future wind could not beat. Found by the level-set iteration of Boyd,
  Balakrishnan (1990) and Bruinsma, Steinbuch (1990), which converges quadratically;
- before that, P grows without bound. `Y(mu) = P^-1` is concave and decreasing in mu (Scherer,
  "H-infinity control by state feedback and fast algorithms for the computation of optimal H-infinity
  norms", IEEE TAC 35(10), 1990), `dY/dmu = -W` with W the controllability Gramian of
  `(-(A + Y C'C), E)`. So a tangent meets zero beyond the root and a chord before it: Newton and secant
  steps close a certified bracket from both sides.

Every bound is certified by a test of its own: the lower one by a frequency at which `lambda_max Phi`
reaches it or by a Y with a negative eigenvalue; the upper one by a positive definite, stabilising P.
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_inner_hinf.errors import CertificateError, InvariantZeroError, NotStabilizableError
from heli_inner_hinf.regular_form import Matrix, RegularForm, checked_plant, regular_form

REL_TOL = 1e-10
_MAX_STEPS = 60


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
        Certified bracket: `lower` is infeasible (or 0), `upper` is feasible (or 0).
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
    return gamma_star_of(regular_form(*checked_plant(A, B, E, C, D)))


def gamma_star_of(form: RegularForm) -> GammaStar:
    """`gamma_star` of a problem in regular form (result in the given units)."""
    if form.n == 0 or not np.any(form.E):
        return GammaStar(0.0, 0.0, 0.0, None, Mechanism.NO_DISTURBANCE, 0)
    _require_regular(form)
    level = _LevelSet(form)
    level.run()
    scale = form.wind_scale
    if level.upper > 0.0:
        Y = inverse_riccati(form, level.upper**-2)
        if Y is not None and is_positive_definite(Y):
            value = level.lower
            return GammaStar(
                scale * value,
                scale * level.lower,
                scale * level.upper,
                level.frequency,
                Mechanism.HAMILTONIAN_AXIS,
                level.steps,
            )
    lower, upper, steps = _unbounded_branch(form, level.upper)
    if upper == 0.0:
        return GammaStar(0.0, 0.0, 0.0, None, Mechanism.NO_DISTURBANCE, steps)
    return GammaStar(
        float(scale * 0.5 * (lower + upper)),
        float(scale * lower),
        float(scale * upper),
        None,
        Mechanism.P_UNBOUNDED,
        level.steps + steps,
    )


def stable_subspace(H: Matrix) -> Matrix | None:
    """Orthonormal basis (2n, n) of the stable invariant subspace, None if it has another size."""
    from scipy.linalg import schur

    n = H.shape[0] // 2
    try:
        _, basis, n_stable = schur(H, output="real", sort="lhp", check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return basis[:, :n] if n_stable == n else None


def inverse_riccati(form: RegularForm, mu: float) -> Matrix | None:
    """Y = P^-1 (n, n) at mu = 1/gamma_scaled^2; None where no stabilising solution exists.

    Y solves `A Y + Y A' - B B' + mu E E' + Y C'C Y = 0` with `-(A + Y C'C)` stable; it stays finite where
    P has no bound, and is refined by Newton steps.
    """
    basis = stable_subspace(form.hamiltonian(mu))
    if basis is None:
        return None
    n = form.n
    try:
        Y = np.linalg.solve(basis[n:].T, basis[:n].T).T
    except np.linalg.LinAlgError:
        return None
    Y = 0.5 * (Y + Y.T)
    return _refined(form, Y, mu)


def is_positive_definite(Y: Matrix) -> bool:
    """Whether the symmetric Y is positive definite beyond rounding, after diagonal scaling."""
    diagonal = np.diag(Y)
    if not np.all(diagonal > 0.0):
        return False
    root = np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(Y / np.outer(root, root))[0] > 0.0)


def _refined(form: RegularForm, Y: Matrix, mu: float) -> Matrix:
    """Y after up to three Newton steps on its equation, as long as they make the residual smaller."""
    from scipy.linalg import solve_continuous_lyapunov

    constant = mu * (form.E @ form.E.T) - form.B @ form.B.T

    def residual(y: Matrix) -> Matrix:
        half = form.A @ y
        cy = form.C @ y
        r = half + half.T + constant + cy.T @ cy
        return 0.5 * (r + r.T)

    res = residual(Y)
    for _ in range(3):
        closed = form.A + Y @ (form.C.T @ form.C)
        try:
            step = solve_continuous_lyapunov(closed, -res)
        except (np.linalg.LinAlgError, ValueError):
            break
        if not np.all(np.isfinite(step)):
            break
        better = Y + 0.5 * (step + step.T)
        new = residual(better)
        if not np.linalg.norm(new) < 0.5 * np.linalg.norm(res):
            break
        Y, res = better, new
    return Y


def _decay(form: RegularForm, Y: Matrix) -> Matrix:
    """W = -dY/dmu (n, n) >= 0: Gramian of (-(A + Y C'C), E)."""
    from scipy.linalg import solve_continuous_lyapunov

    closed = -(form.A + Y @ (form.C.T @ form.C))
    W = solve_continuous_lyapunov(closed, -(form.E @ form.E.T))
    return 0.5 * (W + W.T)


def _require_regular(form: RegularForm) -> None:
    """The LQR problem (gamma = inf) must have its solution; otherwise say which condition fails."""
    H = form.hamiltonian(0.0)
    Y = inverse_riccati(form, 0.0)
    if Y is not None and is_positive_definite(Y):
        return
    modes = np.linalg.eigvals(form.A)
    eye = np.eye(form.n)

    def smallest(matrix: NDArray[np.complex128]) -> float:
        return float(np.linalg.svd(matrix, compute_uv=False)[form.n - 1])

    unstable = [m for m in modes if m.real >= 0.0]
    rank = [(smallest(np.hstack([form.A - m * eye, form.B])), m) for m in unstable]
    axis = np.linalg.eigvals(H)
    axis = axis[np.argsort(np.abs(axis.real))][:2]
    seen = [(smallest(np.vstack([form.A - m * eye, form.C])), m) for m in 1j * axis.imag]
    if rank and min(rank, key=lambda v: v[0])[0] < min(seen, key=lambda v: v[0])[0]:
        raise NotStabilizableError(complex(min(rank, key=lambda v: v[0])[1]))
    raise InvariantZeroError(complex(min(seen, key=lambda v: v[0])[1]))


class _LevelSet:
    """gamma_0 = max over w of sqrt(lambda_max Phi(w)), as a bracket [lower, upper]."""

    def __init__(self, form: RegularForm) -> None:
        self.form = form
        self.H0 = form.hamiltonian(0.0)
        n = form.n
        self.inlet = np.vstack([form.E, np.zeros_like(form.E)]).astype(np.complex128)
        self.outlet = np.hstack([np.zeros_like(form.E.T), form.E.T])
        self.eye = np.eye(2 * n)
        self.lower = self.upper = 0.0
        self.frequency = 0.0
        self.steps = 0

    def phi_max(self, omega: NDArray[np.float64]) -> NDArray[np.float64]:
        """lambda_max Phi at each of omega (m,), rad/s."""
        out = np.empty(omega.size)
        for i, w in enumerate(omega):
            phi = -self.outlet @ np.linalg.solve(self.H0 - 1j * w * self.eye, self.inlet)
            out[i] = np.linalg.eigvalsh(0.5 * (phi + phi.conj().T))[-1]
        return out

    def _improve(self, omega: NDArray[np.float64]) -> None:
        if omega.size == 0:
            return
        peaks = self.phi_max(omega)
        best = int(np.argmax(peaks))
        if peaks[best] > self.lower**2:
            self.lower, self.frequency = float(np.sqrt(peaks[best])), float(omega[best])

    def run(self) -> None:
        poles = np.linalg.eigvals(self.H0)
        start = np.concatenate([[0.0], np.abs(poles), np.abs(poles.imag)])
        self._improve(np.unique(start))
        # nothing but rounding: the wind can be countered completely if the future is known
        reference = np.linalg.norm(self.form.E) ** 2 * np.linalg.norm(self.form.C) ** 2
        if self.lower**2 * np.linalg.norm(self.form.A) ** 2 <= 1e-20 * reference:
            self.lower = 0.0
            return
        for _ in range(_MAX_STEPS):
            self.steps += 1
            level = self.lower * (1.0 + 0.5 * REL_TOL)
            eigenvalues = np.linalg.eigvals(self.form.hamiltonian(level**-2))
            near = np.abs(eigenvalues.real) <= 1e-3 * np.abs(eigenvalues)
            crossing = np.unique(np.abs(eigenvalues[near].imag))
            middle = 0.5 * (crossing[1:] + crossing[:-1])
            self._improve(np.concatenate([crossing, middle]))
            if self.lower <= level:
                self.upper = level
                return
        raise CertificateError("the level-set iteration for gamma* did not close its bracket")


def _unbounded_branch(form: RegularForm, gamma_0: float) -> tuple[float, float, int]:
    """(lower, upper, steps) of the gamma at which P grows without bound; upper = 0 if never."""
    from scipy.linalg import eigh

    Y = inverse_riccati(form, 0.0)
    if Y is None:
        raise CertificateError("the LQR limit of the Riccati equation (16) has no clean solution")
    good, bad = 0.0, (gamma_0**-2 if gamma_0 > 0.0 else np.inf)
    # in the coordinates of Y(0) = L L' sizes are comparable, whatever the states' units
    L = np.linalg.cholesky(Y)

    def relative(matrix: Matrix) -> Matrix:
        half = np.linalg.solve(L, matrix)
        out = np.linalg.solve(L, half.T)
        return 0.5 * (out + out.T)

    Y_good = np.eye(form.n)
    slope = relative(_decay(form, Y))
    for step in range(1, _MAX_STEPS + 1):
        # the tangent at a feasible point: Y_good - (mu - good) W bounds Y from above
        reach = eigh(slope, Y_good, eigvals_only=True)[-1]
        if reach <= 0.0:
            return 0.0, 0.0, step
        newton = good + 1.0 / reach
        bad = min(bad, newton)
        if bad - good <= REL_TOL * bad:
            return bad**-0.5, good**-0.5, step
        for mu in _trial_points(form, relative, good, Y_good, bad):
            trial = inverse_riccati(form, mu)
            if trial is None:
                bad = min(bad, mu)
            elif np.linalg.eigvalsh(relative(trial))[0] > 0.0:
                if mu > good:
                    good, Y_good, slope = mu, relative(trial), relative(_decay(form, trial))
            else:
                bad = min(
                    bad, mu, _tangent_root(relative(trial), relative(_decay(form, trial)), mu)
                )
            if bad - good <= REL_TOL * bad:
                return bad**-0.5, good**-0.5, step
    raise CertificateError("the Newton iteration for gamma* did not close its bracket")


def _trial_points(form, relative, good: float, Y_good: Matrix, bad: float):  # type: ignore[no-untyped-def]
    """Where to look next: just below the upper end, then the chord's root, then the middle."""
    yield bad * (1.0 - 0.5 * REL_TOL)
    Y = inverse_riccati(form, bad)
    if Y is not None:
        Y_bad = relative(Y)
        vector = np.linalg.eigh(Y_bad)[1][:, 0]
        low, high = float(vector @ Y_bad @ vector), float(vector @ Y_good @ vector)
        if low < 0.0 < high:
            chord = good + (bad - good) * high / (high - low)
            yield max(good, chord * (1.0 - 0.25 * REL_TOL))
    yield 0.5 * (good + bad)


def _tangent_root(Y: Matrix, W: Matrix, mu: float) -> float:
    """Newton step on v'Yv along the most negative direction v of Y; never past the root."""
    vector = np.linalg.eigh(Y)[1][:, 0]
    drop = float(vector @ W @ vector)
    return mu + float(vector @ Y @ vector) / drop if drop > 0.0 else mu
