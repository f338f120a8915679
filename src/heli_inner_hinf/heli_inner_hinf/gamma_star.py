# SPDX-License-Identifier: Apache-2.0
"""gamma*: the infimum of the H-infinity norm wind -> h over all stabilising state feedback.

Two things can end feasibility as gamma falls:

- eigenvalues of the Hamiltonian matrix of (16) reach the imaginary axis, at
  `gamma_0 = max_w sqrt(lambda_max Phi(w))`: what even a controller that knows the future wind could
  not beat. Found by the level-set iteration of Boyd, Balakrishnan (1990) and Bruinsma, Steinbuch
  (1990), which converges quadratically;
- before that, P grows without bound (Scherer, "H-infinity control by state feedback and fast
  algorithms for the computation of optimal H-infinity norms", IEEE TAC 35(10), 1990). In the split
  of `riccati` this is `lambda_max(M Z) = 1`, convex and decreasing in gamma^2: a tangent meets one
  before the root and a chord behind it, so that Newton and secant steps close a bracket from both
  sides.

Every bound is certified by a test of its own: the lower one by a frequency at which `lambda_max
Phi` reaches it or by a tangent; the upper one by a stabilising Z with `lambda_max(M Z) < 1`, which
makes P >= 0.
"""

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.errors import CertificateError
from heli_inner_hinf.regular_form import checked_plant, regular_form
from heli_inner_hinf.riccati import SplitProblem, balanced_hamiltonian, double, norm_of, split

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
