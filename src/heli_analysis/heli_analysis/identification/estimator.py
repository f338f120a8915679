# SPDX-License-Identifier: Apache-2.0
"""Errors-in-variables maximum likelihood in the frequency domain.

At each excited line the equation error `e = Y - G(theta) X` of measured rates Y and measured inputs
X (actuators, gust, velocity) is weighed by its own covariance. Noise in Y and X is correlated by
the feedback; the covariance `V C V'`, V = [I, -G(theta)], of e holds that and depends on theta,
which is why the estimate is consistent in the closed loop (Pintelon and Schoukens, System
Identification, 2nd ed., ch. 9 and 12: sample maximum likelihood). C comes from the noise bins
beside the line. The cost is first minimised with the weights of the previous round, then with the
weights' own dependence on theta. Practice on rotorcraft: Tischler and Remple, Aircraft and
Rotorcraft System Identification, 2nd ed. (AIAA 2012), ch. 11 to 13.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from heli_identification.errors import Cause, IdentificationError
from heli_identification.experiment import Array
from heli_identification.response import FastModel, transfer
from heli_identification.spectra import INPUTS, ComplexArray, Spectra, Y
from heli_identification.structure import DAMPING, DELAY, SERVO, assemble, place_of

N_RATE = 3
_ROUNDS = 6
_SETTLED = 0.1  # of a parameter's sigma, RMS
_COARSE, _FINE = 1e-4, 1e-7  # relative change of the cost
_EVALUATIONS = 60
_AROUND = 6  # lines to either side
_STEP = {"A": 1e-3, "B": 1e-3, "E": 1e-4}
_BOUNDS = {SERVO: (3.0, 250.0), DAMPING: (0.05, 3.0), DELAY: (0.0, 0.15)}
LONGEST_DELAY_S = _BOUNDS[DELAY][1]


@dataclass(frozen=True)
class Estimate:
    """Result of a fit.

    Attributes
    ----------
    names : tuple of str
    values : (n,) array
    covariance : (n, n) array
        Inverse of the Fisher information.
    distortion : float
        What the model leaves unexplained beyond the noise, over the response's local RMS.
    cost : float
        Sum of squared whitened residuals.
    expected_cost, cost_sigma : float
        Its mean and standard deviation if the model is right.
    residual : (L, 3) complex array
        Whitened residual of p, q, r at each line; unit variance if the model is right.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    distortion: float
    cost: float
    expected_cost: float
    cost_sigma: float
    residual: ComplexArray

    @property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


class Problem:
    """Residuals and their derivative for a list of free parameters on several experiments.

    Parameters
    ----------
    spectra : sequence of Spectra
    names : sequence of str
        Free parameters.
    base : FastModel, optional
        Where the other parameters stand; default: zero.
    distortion : float
        What the linear model leaves unexplained because the aircraft is not linear, as a part of
        the response's local RMS; acts as noise that is added to the measured one.
    prior_sigma : (n,) array, optional
        Standard deviations around zero that are believed beforehand; infinite: none.
    """

    def __init__(
        self,
        spectra: Sequence[Spectra],
        names: Sequence[str],
        base: FastModel | None,
        distortion: float = 0.0,
        prior_sigma: Array | None = None,
    ) -> None:
        self.spectra = tuple(spectra)
        self.names = tuple(names)
        self.base = base
        self.distortion = distortion
        self.prior_sigma = prior_sigma

    def model(self, values: Array) -> FastModel:
        """Model at `values`."""
        return assemble(self.names, values, self.base)

    def errors(self, values: Array) -> list[ComplexArray]:
        """Equation errors (L, 3) at the lines, one array per experiment."""
        model = self.model(values)
        return [_error(model, s.omega_radps, s.z) for s in self.spectra]

    def whiteners(self, values: Array) -> list[ComplexArray]:
        """Inverse Cholesky factors (L, 3, 3) of the covariance of the errors."""
        model = self.model(values)
        result: list[ComplexArray] = []
        for s in self.spectra:
            noise = _error(model, s.noise_omega_radps, s.noise_z)[s.neighbours]
            spread = np.einsum("lki,lkj->lij", noise, noise.conj()) / noise.shape[1]
            extra = self.distortion**2 * _local_power(s) + 1e-24
            extra += 1e-9 * np.trace(spread, axis1=1, axis2=2).real[:, None]
            spread += extra[:, :, None] * np.eye(N_RATE)
            result.append(np.asarray(np.linalg.inv(np.linalg.cholesky(spread)), np.complex128))
        return result

    def residual(self, values: Array, whiteners: list[ComplexArray] | None = None) -> Array:
        """Whitened residual as real numbers; weights at `values` unless given."""
        weights = self.whiteners(values) if whiteners is None else whiteners
        pairs = zip(weights, self.errors(values), strict=True)
        data = _as_real([(w @ e[:, :, None])[:, :, 0] for w, e in pairs])
        return data if self.prior_sigma is None else np.append(data, values / self.prior_sigma)

    def jacobian(self, values: Array, whiteners: list[ComplexArray] | None = None) -> Array:
        """Derivative of `residual`, central differences."""
        columns = []
        for i, name in enumerate(self.names):
            place = place_of(name)
            least = 1e-3 if place is None else _STEP[place.matrix]
            step = 1e-4 * max(abs(values[i]), least * 10.0)
            plus, minus = values.copy(), values.copy()
            plus[i] += step
            minus[i] -= step
            difference = self.residual(plus, whiteners) - self.residual(minus, whiteners)
            columns.append(difference / (2.0 * step))
        return np.column_stack(columns)

    @property
    def expected(self) -> tuple[float, float]:
        """Mean and sigma of the cost, with the price of a covariance from few noise bins."""
        mean, variance = -float(len(self.names)), 0.0
        for s in self.spectra:
            n, inflation = N_RATE, s.dof / (s.dof - N_RATE)
            mean += 2.0 * n * s.omega_radps.size * inflation
            variance += 4.0 * n * s.omega_radps.size * inflation**3
        return mean, float(np.sqrt(variance))


def _error(model: FastModel, omega: Array, z: ComplexArray) -> ComplexArray:
    return z[:, Y] - (transfer(model, omega) @ z[:, INPUTS, None])[:, :, 0]


def _local_power(spectra: Spectra) -> Array:
    """Mean squared response (L, 3) over the lines around each: distortion spreads between lines."""
    power = np.abs(spectra.z[:, Y]) ** 2
    width = min(2 * _AROUND + 1, power.shape[0])
    first = np.clip(np.arange(power.shape[0]) - _AROUND, 0, power.shape[0] - width)
    return np.asarray(power[first[:, None] + np.arange(width)].mean(axis=1))


def _as_real(parts: list[ComplexArray]) -> Array:
    """Complex residuals of unit variance as real ones of unit variance."""
    flat = np.concatenate([part.ravel() for part in parts]) * np.sqrt(2.0)
    return np.concatenate([flat.real, flat.imag])


def distortion_of(problem: Problem, values: Array) -> float:
    """The distortion with which the cost at `values` is what is expected; 0 if noise explains it.

    Bisection: the cost falls as the distortion rises.
    """
    before = problem.distortion
    mean, sigma = problem.expected
    low, high = 0.0, 1.0
    problem.distortion = 0.0
    if np.sum(problem.residual(values) ** 2) < mean + 2.0 * sigma:
        return 0.0
    for _ in range(30):
        problem.distortion = 0.5 * (low + high)
        if np.sum(problem.residual(values) ** 2) > mean:
            low = problem.distortion
        else:
            high = problem.distortion
    problem.distortion = before
    return 0.5 * (low + high)


def _minimise(
    problem: Problem, start: Array, whiteners: list[ComplexArray] | None, tolerance: float
) -> tuple[Array, Array, bool]:
    """(values, Jacobian, converged) of one SciPy least-squares run."""
    lower = np.array([_BOUNDS.get(name, (-np.inf, np.inf))[0] for name in problem.names])
    upper = np.array([_BOUNDS.get(name, (-np.inf, np.inf))[1] for name in problem.names])
    inside = np.clip(start, lower + 1e-6, upper - 1e-6)

    def residual(values: Array) -> Array:
        return problem.residual(values, whiteners)

    def jacobian(values: Array) -> Array:
        return problem.jacobian(values, whiteners)

    result = least_squares(
        residual, inside, jac=jacobian, bounds=(lower, upper), x_scale="jac", method="trf",
        max_nfev=_EVALUATIONS, ftol=tolerance, xtol=1e-9, gtol=1e-12,
    )  # fmt: skip
    return result.x, result.jac, bool(result.status > 0)


def estimate(
    problem: Problem,
    start: Array,
    fine: bool = True,
    joint: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Estimate:
    """Maximum likelihood estimate from a start.

    Parameters
    ----------
    problem : Problem
    start : (n,) array
    fine : bool
        False: a first look with a loose tolerance.
    joint : bool
        Minimise also over the weights' dependence on the parameters. Without, the bias by noise in
        the inputs is that noise's power over the line's; right where the inputs are known well.
    progress : callable, optional
        Told in a few words how far it is.

    Raises
    ------
    IdentificationError
        NOT_CONVERGED with the parameter that still moves.
    """
    values = np.asarray(start, dtype=np.float64)
    tolerance = _FINE if fine else _COARSE
    for number in range(_ROUNDS):
        before, distortion = values, problem.distortion
        values, jacobian, _ = _minimise(problem, before, problem.whiteners(before), tolerance)
        if progress is not None:
            progress(f"{values.size} parameters, round {number + 1}")
        problem.distortion = distortion_of(problem, values)
        settled = np.linalg.norm(jacobian @ (values - before)) < _SETTLED * np.sqrt(values.size)
        if settled and abs(problem.distortion - distortion) <= 0.1 * distortion:
            break
    if joint:
        before = values
        values, _, converged = _minimise(problem, values, None, tolerance)
        if not converged or not np.all(np.isfinite(values)):
            raise IdentificationError(
                Cause.NOT_CONVERGED,
                f"the fit of {values.size} parameters did not settle: "
                f"{problem.names[int(np.argmax(np.abs(values - before)))]} still moves",
            )
    return summary(problem, values)


def summary(problem: Problem, values: Array) -> Estimate:
    """Covariance, cost and residuals at `values`."""
    whiteners = problem.whiteners(values)
    jacobian = problem.jacobian(values, whiteners)
    # the weights are estimates themselves, which costs a factor dof / (dof - 3)
    inflation = float(np.mean([s.dof / (s.dof - N_RATE) for s in problem.spectra]))
    information = jacobian.T @ jacobian / inflation
    scale = np.sqrt(np.diag(information))
    scale[scale == 0.0] = 1e-12
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-14, hermitian=True)
    pairs = zip(whiteners, problem.errors(values), strict=True)
    whitened = [(w @ e[:, :, None])[:, :, 0] for w, e in pairs]
    mean, sigma = problem.expected
    return Estimate(
        names=problem.names,
        values=values,
        covariance=inverse / np.outer(scale, scale),
        distortion=problem.distortion,
        cost=float(np.sum(_as_real(whitened) ** 2)),
        expected_cost=mean,
        cost_sigma=sigma,
        residual=np.concatenate(whitened),
    )
