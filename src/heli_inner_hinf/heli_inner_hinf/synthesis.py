# SPDX-License-Identifier: Apache-2.0
"""Suboptimal H-infinity state feedback u = F x + G (r - h_out_trim), eq. (15)-(17), with certificate.

A Riccati solver may return a matrix with a tiny residual where no admissible solution exists; a frequency
sweep and the worst-case matrix can look right there too. So a solution counts only when every condition
of the acceptance rule holds, and each is kept with its number in the certificate.
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
    inverse_riccati,
)
from heli_inner_hinf.regular_form import Matrix, RegularForm, checked_plant, regular_form
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

    All in the balanced coordinates of `regular_form`, in which sizes can be compared; none of the verdicts
    depends on the coordinates.
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
    infimum = gamma_star_of(form)
    gamma = float(gamma)
    if not (np.isfinite(gamma) and gamma > max(infimum.upper, 0.0)):
        raise InfeasibleGammaError(gamma, infimum.value)
    P_form = _riccati(form, gamma)
    certificate, norm, frequency = acceptance(form, P_form, gamma)
    if not certificate.accepted:
        failing = "; ".join(str(k) for k in certificate.conditions if not k.holds)
        raise CertificateError(
            f"gamma = {gamma:.10g} is feasible, but its solution is not: {failing}"
        )
    P = form.P_given(P_form)
    F = -np.linalg.solve(d.T @ d, d.T @ c + b.T @ P)
    G = feedforward(a, b, F, c_out)
    return Synthesis(F, G, P, gamma, infimum, norm, frequency, certificate)


def feedforward(A: Matrix, B: Matrix, F: Matrix, C_out: Matrix) -> Matrix:
    """G = -[C_out (A + BF)^-1 B]^-1 (n_u, n_u), eq. (15): outputs settle at their command.

    Raises
    ------
    FeedforwardError
        The inputs cannot set these outputs independently of each other.
    """
    static = C_out @ np.linalg.solve(A + B @ F, B)
    size = np.linalg.norm(static, axis=0)
    if static.size and (np.any(size == 0.0) or np.linalg.cond(static / size) > 1e12):
        raise FeedforwardError(
            "C_out (A + BF)^-1 B is singular: the inputs cannot set the outputs that C_out selects "
            "independently of each other"
        )
    return -np.linalg.inv(static)


def acceptance(form: RegularForm, P: Matrix, gamma: float) -> tuple[Certificate, float, float]:
    """Judge P (n, n; coordinates of `form`) at `gamma` (given units).

    Returns
    -------
    certificate : Certificate
        The six conditions.
    norm, frequency : float
        ||T_hw||_inf in given units (inf if the loop is unstable) and where (rad/s).
    """
    mu = (form.wind_scale / gamma) ** 2
    BBt, EEt, Q = form.B @ form.B.T, form.E @ form.E.T, form.C.T @ form.C
    size = max(np.linalg.norm(P), np.finfo(float).tiny)
    asymmetry = float(np.linalg.norm(P - P.T) / size)
    least = float(_scaled_eigenvalues(P)[0]) if P.size else 0.0
    closed = form.A - BBt @ P
    worst = closed + mu * EEt @ P
    terms = [form.A.T @ P, P @ BBt @ P, mu * P @ EEt @ P, Q]
    total = terms[0] + terms[0].T - terms[1] + terms[2] + terms[3]
    scale = max(sum(float(np.linalg.norm(t)) for t in terms), np.finfo(float).tiny)
    residual = float(np.linalg.norm(total)) / scale
    closed_re, worst_re = _abscissa(closed), _abscissa(worst)
    norm, frequency = np.inf, 0.0
    if closed_re < 0.0:
        output = np.vstack([form.C, -form.B.T @ P])
        norm, frequency = hinf_norm(closed, form.E, output)
        norm *= form.wind_scale
    certificate = Certificate(
        Condition("asymmetry of P", asymmetry, SYMMETRY_TOL, asymmetry <= SYMMETRY_TOL),
        Condition("least eigenvalue of scaled P", least, -PSD_TOL, least >= -PSD_TOL),
        Condition("largest real part of A + BF (rad/s)", closed_re, 0.0, closed_re < 0.0),
        Condition(
            "largest real part of A + BF + EE'P/gamma^2 (rad/s)", worst_re, 0.0, worst_re < 0.0
        ),
        Condition("relative residual of (16)", residual, RESIDUAL_TOL, residual <= RESIDUAL_TOL),
        Condition("||T_hw||_inf", norm, gamma, norm < gamma),
    )
    return certificate, float(norm), float(frequency)


def _riccati(form: RegularForm, gamma: float) -> Matrix:
    """P (n, n) of (16) at `gamma`: inverse of the refined Y, symmetric."""
    if form.n == 0:
        return np.zeros((0, 0))
    Y = inverse_riccati(form, (form.wind_scale / gamma) ** 2)
    if Y is None:
        raise CertificateError(f"eq. (16) has no stabilising solution at gamma = {gamma:.10g}")
    root = np.sqrt(np.abs(np.diag(Y)))
    scaled = np.linalg.inv(Y / np.outer(root, root))
    return 0.5 * (scaled + scaled.T) / np.outer(root, root)


def _scaled_eigenvalues(P: Matrix) -> Matrix:
    diagonal = np.sqrt(np.maximum(np.abs(np.diag(P)), np.finfo(float).tiny))
    return np.linalg.eigvalsh(P / np.outer(diagonal, diagonal))


def _abscissa(matrix: Matrix) -> float:
    if matrix.shape[0] == 0:
        return -np.inf
    return float(np.max(np.linalg.eigvals(matrix).real))
