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

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from heli_analysis.identification.model import (
    FastModel,
    assemble,
    empty_model,
    place_of,
    transfer,
    values_of,
)
from heli_analysis.identification.spectra import (
    GUST,
    INPUTS,
    VEL,
    Array,
    ComplexArray,
    Spectra,
    U,
    Y,
)
from heli_analysis.identification.structure import (
    DAMPING,
    DELAY,
    FAST_NAMES,
    FLAPPING,
    FULL,
    SERVO,
    STATE,
    ModelStructure,
    Rotor,
)
from heli_core.errors import IdentificationCause, IdentificationError
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES
from heli_core.rows import WIND_NAMES as VELOCITY_NAMES
from heli_core.ticks import TICK_S

# -------------------------------------------------------------------------------------------------
# Estimator.
# -------------------------------------------------------------------------------------------------

N_RATE = 3
_ROUNDS = 6
_SETTLED = 0.1  # of a parameter's sigma, RMS
_COARSE, _FINE = 1e-4, 1e-7  # relative change of the cost
_EVALUATIONS = 60
_AROUND = 6  # lines to either side
_STEP = {"A": 1e-3, "B": 1e-3, "E": 1e-4}
BOUNDS = {SERVO: (3.0, 250.0), DAMPING: (0.05, 3.0), DELAY: (0.0, 0.15)}
DAMPED, DAMPED_BY_1PS = ("A(p,p)", "A(q,q)", "A(r,r)"), (-300.0, 10.0)
"""Of a quasi-static rotor."""
LONGEST_DELAY_S = BOUNDS[DELAY][1]


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
    base : FastModel
        Where the other parameters stand, and the structure.
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
        base: FastModel,
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
    # a body that follows at once, through the servos' lag alone, is no helicopter
    rigid = {} if FLAPPING in problem.names else dict.fromkeys(DAMPED, DAMPED_BY_1PS)
    bounds = [(BOUNDS | rigid).get(name, (-np.inf, np.inf)) for name in problem.names]
    lower, upper = np.array(bounds, np.float64).reshape(-1, 2).T
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


@contextmanager
def _of_numbers(problem: Problem, values: Array) -> Iterator[None]:
    """SciPy and LAPACK refuse what is not finite by a ValueError: here it is a named cause."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            yield
    except IdentificationError:
        raise
    except ValueError as error:
        raise _beyond(problem, values) from error


def _beyond(problem: Problem, values: Array) -> IdentificationError:
    """The refusal of a model whose response is beyond any number."""
    fastest = float(np.max(np.linalg.eigvals(np.nan_to_num(problem.model(values).A)).real))
    largest = problem.names[int(np.argmax(np.abs(np.nan_to_num(values, nan=np.inf))))]
    return IdentificationError(
        IdentificationCause.NOT_CONVERGED,
        f"from this start the response is no number any more: the model grows with {fastest:.3g} "
        f"1/s, and {largest} is its largest entry",
    )


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
        with _of_numbers(problem, before):
            whiteners = problem.whiteners(before)
            values, jacobian, _ = _minimise(problem, before, whiteners, tolerance)
        if progress is not None:
            progress(f"{values.size} parameters, round {number + 1}")
        with _of_numbers(problem, values):
            problem.distortion = distortion_of(problem, values)
        settled = np.linalg.norm(jacobian @ (values - before)) < _SETTLED * np.sqrt(values.size)
        if settled and abs(problem.distortion - distortion) <= 0.1 * distortion:
            break
    if joint:
        before = values
        with _of_numbers(problem, before):
            values, _, converged = _minimise(problem, values, None, tolerance)
        if not converged or not np.all(np.isfinite(values)):
            raise IdentificationError(
                IdentificationCause.NOT_CONVERGED,
                f"the fit of {values.size} parameters did not settle: "
                f"{problem.names[int(np.argmax(np.abs(values - before)))]} still moves",
            )
    return summary(problem, values)


def summary(problem: Problem, values: Array) -> Estimate:
    """Covariance, cost and residuals at `values`.

    Raises
    ------
    IdentificationError
        NOT_CONVERGED: the response at `values` is no number.
    """
    with _of_numbers(problem, values):
        found = _summary(problem, values)
    if not np.isfinite(found.cost):
        raise _beyond(problem, values)
    return found


def _summary(problem: Problem, values: Array) -> Estimate:
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


# -------------------------------------------------------------------------------------------------
# Which entries of eq. (10) the data tell from zero.
#
# Small entries resemble larger ones (A(p,p) and the flapping rate, A(q,b_s) and B(a_s,d_lat)):
# left
# free all at once, they drag each other far from zero together. So the fit begins with the entries
# that the physics of eq. (6) to (8) demands and takes in another one only if the data ask for it,
# the
# most urgent first, as long as the Bayesian information criterion falls: if it lowers the cost by
# more than ln(number of real residuals) (Schwarz, Annals of Statistics 6, 1978). Those that have
# become superfluous by later ones are dropped by the same rule. It is Efroymson's stepwise
# regression on the linearised residual, with a fit in between.
# -------------------------------------------------------------------------------------------------


def urgent(
    problem: Problem, values: Array, names: tuple[str, ...], limit: float
) -> tuple[tuple[str, ...], Array]:
    """Names to take in beside the problem's own, and start values for all of them together.

    Greedy on the residual linearised at `values` with the weights there.
    """
    live = [*problem.names, *(name for name in names if name not in problem.names)]
    n = len(problem.names)
    wide = Problem(problem.spectra, live, problem.base, problem.distortion)
    at = np.concatenate([values, np.zeros(len(live) - n)])
    whiteners = wide.whiteners(at)
    J, r = wide.jacobian(at, whiteners), wide.residual(at, whiteners)
    taken = list(range(n))
    while True:
        Q = np.linalg.qr(J[:, taken])[0]
        left = r - Q @ (Q.T @ r)
        others = [i for i in range(len(live)) if i not in taken]
        if not others:
            break
        free = J[:, others] - Q @ (Q.T @ J[:, others])
        length = np.maximum(np.sum(free**2, axis=0), 1e-12 * np.sum(J[:, others] ** 2, axis=0))
        gain = (free.T @ left) ** 2 / np.maximum(length, 1e-300)
        best = int(np.argmax(gain))
        if gain[best] <= limit:
            break
        taken.append(others[best])
    step = np.linalg.lstsq(J[:, taken], -r, rcond=1e-10)[0] if len(taken) > n else np.zeros(n)
    return tuple(live[i] for i in taken), at[taken] + step


def superfluous(fit: Estimate, limit: float, kept: frozenset[str] = FULL.kept) -> tuple[str, ...]:
    """Names but the kept ones whose loss raises the cost by less than `limit`, least needed first.

    One by one.
    """
    values, covariance = fit.values.copy(), fit.covariance.copy()
    live = [i for i, name in enumerate(fit.names) if name not in kept]
    dropped = []
    while live:
        ratios = [values[i] ** 2 / max(covariance[i, i], 1e-300) for i in live]
        worst = int(np.argmin(ratios))
        if ratios[worst] >= limit:
            break
        i = live.pop(worst)
        gain = covariance[:, i] / max(covariance[i, i], 1e-300)
        values = values - gain * values[i]
        covariance = covariance - np.outer(gain, covariance[i])
        dropped.append(fit.names[i])
    return tuple(dropped)


def select(
    spectra: Spectra,
    names: tuple[str, ...],
    first: FastModel,
    structure: ModelStructure = FULL,
    progress: Callable[[str], None] | None = None,
) -> Estimate:
    """A loosely converged fit of the entries that the data ask for.

    Parameters
    ----------
    spectra : Spectra
    names : tuple of str
        All that may be free.
    first : FastModel
        Start.
    structure : ModelStructure
    """
    limit = float(np.log(6 * spectra.omega_radps.size))
    kept = tuple(name for name in names if name in structure.kept)
    start = values_of(kept, first)
    distortion = 0.0
    if structure != FULL:
        # what lags there are beyond the structure is no noise: weighed as noise it drives the first
        # round to a model that is noisier than the record, where all is explained
        problem = Problem([spectra], kept, empty_model(structure))
        with _of_numbers(problem, start):
            distortion = distortion_of(problem, start)
    tried = set()
    for _ in range(_ROUNDS):
        problem = Problem([spectra], kept, empty_model(structure), distortion)
        fit = estimate(problem, start, fine=False, joint=False, progress=progress)
        distortion = fit.distortion
        tried.add(frozenset(kept))
        drop = superfluous(fit, limit, structure.kept)
        if drop:
            kept = tuple(name for name in kept if name not in drop)
            start = fit.values[[fit.names.index(name) for name in kept]]
        else:
            with _of_numbers(problem, fit.values):
                kept, start = urgent(problem, fit.values, names, limit)
        if frozenset(kept) in tried:
            break
    return fit


# -------------------------------------------------------------------------------------------------
# Start values from the measured spectra alone: equation error with separated parameters.
#
# Given servos, delay and the flapping matrix, every row of p', q', r' in eq. (10) is linear in the
# rest: the unmeasured states follow from measured rates and commands, b_s = (s - M)^-1 (-p + ...)
# and d_int = (K_a d_ped - r)/s. So only the few numbers of servos, delay and flapping are searched
# for, from several places, and the others are solved for at each step (variable projection: Golub
# and Pereyra, SIAM J. Numer. Anal. 10, 1973). Equation error is biased by noise; it is a start.
# Moments of a rotor with flapping states act through the disc, so p and q themselves are left out
# of their rows: A(p,p) and A(q,q) could hardly be told from the flapping rate here. A rotor that
# follows at once has no flapping matrix: servos and delay are all that is searched for.
# -------------------------------------------------------------------------------------------------

_SERVOS_RADPS = (20.0, 45.0, 90.0)
_FLAPPING_1PS = (2.0, 6.0, 20.0)
_LOWEST_RADPS = 1.0  # below, turbulence and drift weigh more than they tell


_TINY = 1e-9
_MOST_GROWTH_1PS, _MOST_ENTRY = 10.0, 1e6


def _is_believable(model: FastModel) -> bool:
    """True of a start from which a response is a number: no entry beyond measure, no explosion."""
    entries = np.concatenate([m.ravel() for m in (model.A, model.B, model.E)])
    if not np.all(np.abs(entries) < _MOST_ENTRY):
        return False
    return float(np.max(np.linalg.eigvals(model.A).real)) < _MOST_GROWTH_1PS


class _Search(NamedTuple):
    """What is searched for (6,); of a rotor that follows at once (3,)."""

    servo: int = 0  # log of rad/s
    damping: int = 1  # log
    delay: int = 2  # s
    flapping: int = 3  # A(a_s,a_s) and A(b_s,b_s)
    a_by_b: int = 4  # A(a_s,b_s)
    b_by_a: int = 5  # A(b_s,a_s)


_X = _Search()
_ACTUATION = 3
_LOWER = np.array([np.log(3.0), np.log(0.05), 0.0, -200.0, -50.0, -50.0])
_UPPER = np.array([np.log(250.0), np.log(3.0), 0.15, 0.0, 50.0, 50.0])
_DISC, _PEDAL = "disc", "pedal through d_int"


@dataclass(frozen=True)
class _Row:
    """One solved row: coefficients by the name of what they multiply, and what is left."""

    coefficients: dict[str, float]
    left: Array


def _solve(rhs: ComplexArray, columns: dict[str, ComplexArray], weight: Array) -> _Row:
    M = np.column_stack(list(columns.values())) * weight[:, None]
    b = rhs * weight
    M, b = np.vstack([M.real, M.imag]), np.concatenate([b.real, b.imag])
    scale = np.linalg.norm(M, axis=0)
    scale[scale == 0.0] = 1.0
    x = np.linalg.lstsq(M / scale, b, rcond=1e-8)[0]
    return _Row(dict(zip(columns, (x / scale).tolist(), strict=True)), M / scale @ x - b)


class StartSearch:
    """Equation error on the excited lines as a function of servos, delay and flapping."""

    def __init__(self, spectra: Spectra, structure: ModelStructure = FULL) -> None:
        keep = spectra.omega_radps > _LOWEST_RADPS
        self.structure = structure
        self.s = 1j * spectra.omega_radps[keep]
        z = spectra.z[keep]
        self.y, self.u = z[:, Y], z[:, U]
        self.wind = z[:, GUST] - z[:, VEL]
        noise = np.sqrt(spectra.noise_covariance()[keep][:, range(3), range(3)].real)
        self.weight = 1.0 / np.abs(self.s)[:, None] / np.maximum(noise, 1e-3 * np.abs(self.y).max())

    def inputs(self, servo: float, damping: float, delay_s: float) -> ComplexArray:
        """Servo positions (L, 4)."""
        s = self.s
        hold = -np.expm1(-s * TICK_S) / (s * TICK_S)
        lag = servo**2 / (s**2 + 2.0 * damping * servo * s + servo**2)
        return np.asarray(self.u * (np.exp(-s * delay_s) * hold * lag)[:, None])

    def rows(self, x: Array) -> tuple[_Row, _Row, _Row]:
        """Solved rows p, q, r for x, places of `_Search`."""
        u = self.inputs(np.exp(x[_X.servo]), np.exp(x[_X.damping]), x[_X.delay])
        p, q, r = self.y.T
        s, w = self.s, self.weight.T
        lat, lon, ped, col = u.T
        gyro = {"d_int": -r / s, _PEDAL: ped / s} if self.structure.yaw_gyro else {}
        wind = dict(zip(VELOCITY_NAMES, self.wind.T, strict=True))
        rest = {"r": r, **gyro, "d_ped": ped, "d_col": col, **wind}
        if self.structure.rotor is Rotor.QUASI_STATIC:
            rest |= {"p": p, "q": q, "d_lat": lat, "d_lon": lon}
            found = [_solve(s * y, rest, weight) for y, weight in zip((p, q, r), w, strict=True)]
            return found[0], found[1], found[2]
        a, b, c, d = x[_X.flapping], x[_X.a_by_b], x[_X.b_by_a], x[_X.flapping]
        determinant = (s - a) * (s - d) - b * c
        # (s - M)^-1 by rows
        aa, ab, ba, bb = (s - d), b, c, (s - a)
        known_a = (-aa * q - ab * p) / determinant
        known_b = (-ba * q - bb * p) / determinant
        by_a = {"d_lat to a_s": aa * lat, "d_lon to a_s": aa * lon,
                "d_lat to b_s": ab * lat, "d_lon to b_s": ab * lon}  # fmt: skip
        by_b = {"d_lat to a_s": ba * lat, "d_lon to a_s": ba * lon,
                "d_lat to b_s": bb * lat, "d_lon to b_s": bb * lon}  # fmt: skip
        return (
            _solve(s * p, {_DISC: known_b, **_over(by_b, determinant), **rest}, w[0]),
            _solve(s * q, {_DISC: known_a, **_over(by_a, determinant), **rest}, w[1]),
            _solve(s * r, rest, w[2]),
        )

    def residual(self, x: Array) -> Array:
        """What the linear rows leave."""
        return np.concatenate([row.left for row in self.rows(x)])

    def best(self) -> FastModel:
        """Best model over all places to start from.

        Raises
        ------
        IdentificationError
            NOT_CONVERGED: from no place does the search lead to numbers.
        """
        full = self.structure.rotor is Rotor.FULL
        size = len(_X) if full else _ACTUATION
        models: list[tuple[float, FastModel]] = []
        for servo in _SERVOS_RADPS:
            for flapping in _FLAPPING_1PS if full else _FLAPPING_1PS[:1]:
                at = np.array([np.log(servo), np.log(0.7), 0.02, -flapping, 0.1, 0.1])[:size]
                try:
                    fit = least_squares(
                        self.residual, at, bounds=(_LOWER[:size], _UPPER[:size]), x_scale="jac",
                        max_nfev=40,
                    )  # fmt: skip
                    models.append((float(fit.cost), self.model(fit.x)))
                except ValueError:  # what is not finite, by SciPy or LAPACK
                    continue
        models.sort(key=lambda one: one[0])
        if not models:
            raise IdentificationError(
                IdentificationCause.NOT_CONVERGED,
                f"from none of {len(_SERVOS_RADPS)} servo frequencies does the search for a start "
                f"lead to numbers with the states {', '.join(self.structure.states)}",
            )
        ranked = [model for _, model in models]
        return next((model for model in ranked if _is_believable(model)), ranked[0])

    def model(self, x: Array) -> FastModel:
        """The fast model of the solved rows; what nothing tells of the yaw gyro is small, not 0."""
        rows = dict(zip(("p", "q", "r"), (row.coefficients for row in self.rows(x)), strict=True))
        A, B, E = self.structure.empty_matrices()
        for name, c in rows.items():
            row = FAST_NAMES.index(name)
            for column, value in c.items():
                if column in FAST_NAMES:
                    A[row, FAST_NAMES.index(column)] = value
                elif column in ACTUATOR_NAMES:
                    B[row, ACTUATOR_NAMES.index(column)] = value
                elif column in VELOCITY_NAMES:
                    E[row, VELOCITY_NAMES.index(column)] = value
        if self.structure.yaw_gyro:
            by_gyro = rows["r"]["d_int"] or _TINY
            B[STATE.d_int, ACTUATOR.ped] = rows["r"][_PEDAL] / by_gyro
        if self.structure.rotor is Rotor.FULL:
            a_s, b_s = STATE.a_s, STATE.b_s
            A[a_s, a_s] = A[b_s, b_s] = x[_X.flapping]
            A[a_s, b_s], A[b_s, a_s] = x[_X.a_by_b], x[_X.b_by_a]
            for rate, disc, tilt in (("p", b_s, "b_s"), ("q", a_s, "a_s")):
                gain = A[FAST_NAMES.index(rate), disc] = rows[rate][_DISC]
                for i, command in ((ACTUATOR.lat, "d_lat"), (ACTUATOR.lon, "d_lon")):
                    B[disc, i] = rows[rate][f"{command} to {tilt}"] / (gain or _TINY)
        servo, damping = np.exp(x[_X.servo]), np.exp(x[_X.damping])
        return FastModel(A, B, E, float(servo), float(damping), float(x[_X.delay]))


def _over(columns: dict[str, ComplexArray], divisor: ComplexArray) -> dict[str, ComplexArray]:
    return {name: column / divisor for name, column in columns.items()}
