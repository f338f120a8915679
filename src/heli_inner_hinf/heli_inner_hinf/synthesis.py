# SPDX-License-Identifier: Apache-2.0
"""Suboptimal H-infinity state feedback u = F x + G (r - h_out_trim), eq. (15)-(17), with
certificate.

A Riccati solver may return a matrix with a tiny residual where no admissible solution exists; a
frequency sweep and the worst-case matrix can look right there too. So a solution counts only when
every condition of the acceptance rule holds, and each is kept with its number in the certificate.
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_core.errors import (
    CertificateError,
    FeedforwardError,
    InfeasibleGammaError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
    SynthesisError,
)
from heli_inner_hinf.regular_form import (
    Matrix,
    RegularForm,
    SplitProblem,
    balanced_hamiltonian,
    checked,
    checked_plant,
    double,
    lqr_solution,
    norm_of,
    regular_form,
    spectral_abscissa,
    split,
)

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
