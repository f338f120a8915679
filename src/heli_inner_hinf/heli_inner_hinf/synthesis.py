# SPDX-License-Identifier: Apache-2.0
"""Suboptimal H-infinity state feedback u = F x + G (r - h_out_trim), eq. (15)-(17), with
certificate.

A Riccati solver may return a matrix with a tiny residual where no admissible solution exists; a
frequency sweep and the worst-case matrix can look right there too. So a solution counts only when
every condition of the acceptance rule holds, and each is kept with its number in the certificate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.errors import (
    CertificateError,
    FeedforwardError,
    InfeasibleGammaError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
    SynthesisError,
)
from heli_inner_hinf.gamma_star import (
    GammaStar,
    Mechanism,
    gamma_star,
    gamma_star_of,
)
from heli_inner_hinf.regular_form import Matrix, RegularForm, checked_plant, regular_form
from heli_inner_hinf.riccati import SplitProblem, norm_of, spectral_abscissa, split
from heli_inner_hinf.system_norm import hinf_norm
from heli_inner_hinf.weights import checked

__all__ = [
    "Certificate",
    "CertificateError",
    "Condition",
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
class Condition:
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

    symmetry: Condition
    positive_semidefinite: Condition
    closed_loop_stable: Condition
    worst_case_stable: Condition
    residual: Condition
    norm_below_gamma: Condition

    @property
    def conditions(self) -> tuple[Condition, ...]:
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
    reach = np.asarray(P @ B, dtype=np.float64).T
    return -np.linalg.solve(r1, q1.T @ C + np.linalg.solve(r1.T, reach))


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
        Condition("asymmetry of P", asymmetry, SYMMETRY_TOL, asymmetry <= SYMMETRY_TOL),
        Condition("least eigenvalue of P, relative", least, -PSD_TOL, least >= -PSD_TOL),
        Condition("largest Re of A + BF (rad/s)", closed_re, 0.0, closed_re < 0.0),
        Condition("largest Re of A + BF + EE'P/gamma^2 (rad/s)", worst_re, 0.0, worst_re < 0.0),
        Condition("relative residual of (16)", residual, RESIDUAL_TOL, residual <= RESIDUAL_TOL),
        Condition("||T_hw||_inf", norm, bound, norm < bound),
    )
    return certificate, float(norm), float(frequency)


def _riccati(problem: SplitProblem, gamma: float) -> Matrix:
    """P (n, n) of (16) at `gamma`, in the coordinates of the regular form."""
    mu = (problem.form.wind_scale / gamma) ** 2
    Z = problem.rest(mu)
    if Z is None:
        raise CertificateError(f"eq. (16) has no stabilising solution at gamma = {gamma:.10g}")
    return problem.solution(Z, mu)
