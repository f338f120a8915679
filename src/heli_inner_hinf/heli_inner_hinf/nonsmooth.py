# SPDX-License-Identifier: Apache-2.0
"""Descent of a function that is not smooth where it matters, under constraints of the same kind.

BFGS with a weak Wolfe line search (Lewis, Overton, "Nonsmooth optimization via quasi-Newton
methods", Math. Program. 141, 2013) on an exact penalty function, whose parameter is steered by a
quadratic program (Curtis, Mitchell, Overton, "A BFGS-SQP method for nonsmooth, nonconvex,
constrained optimization", Optim. Methods Softw. 32, 2017: GRANSO), then gradient sampling (Burke,
Lewis, Overton, SIAM J. Optim. 15, 2005). Value and gradient may be infinite where nothing is
defined, such as the norm of a loop that is not stable: the line search turns back there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize as smooth_minimize
from scipy.optimize import nnls

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_ARMIJO, _CURVATURE = 1e-4, 0.5
_LONGEST_SEARCH = 40
_STEERED, _LESS = 0.1, 0.5
_LEAST_WEIGHT = 1e-8
_CLOSE, _REMEMBERED = 1e-3, 30
_MOST_SAMPLED = 40
"""Gradients are sampled about the end for at most so many unknowns."""
_RADII = (1e-2, 1e-3, 1e-4)


class Evaluation(NamedTuple):
    """What is known at a place.

    Attributes
    ----------
    value : float
    gradient : (n,) array
    violations : (p,) array
        Constraints: kept at 0 and below.
    slopes : (p, n) array
        Their gradients.
    """

    value: float
    gradient: Vector
    violations: Vector
    slopes: Matrix


@dataclass(frozen=True)
class End:
    """Where the descent ended.

    Attributes
    ----------
    x : (n,) array
    point : Evaluation
    iterations, evaluations : int
    stationarity : float
        Norm of the shortest convex combination of gradients of the penalty function nearby: near
        0 at a local minimum.
    """

    x: Vector
    point: Evaluation
    iterations: int
    evaluations: int
    stationarity: float


class _Penalty:
    """weight * value + sum of violations, counted."""

    def __init__(self, evaluate: Callable[[Vector], Evaluation]) -> None:
        self._evaluate = evaluate
        self.weight = 1.0
        self.evaluations = 0

    def at(self, x: Vector) -> Evaluation:
        self.evaluations += 1
        return self._evaluate(x)

    def value(self, point: Evaluation) -> float:
        if not np.isfinite(point.value):
            return np.inf
        return self.weight * point.value + float(np.sum(np.maximum(point.violations, 0.0)))

    def gradient(self, point: Evaluation) -> Vector:
        broken = point.violations > 0.0
        return self.weight * point.gradient + np.sum(point.slopes[broken], axis=0)


def minimise(
    evaluate: Callable[[Vector], Evaluation],
    start: Vector,
    iterations: int = 300,
    tolerance: float = 1e-6,
    enough: float = -np.inf,
    seed: int = 0,
    progress: Callable[[int, Evaluation], None] = lambda done, point: None,
) -> End:
    """A local minimum of the value where no constraint is violated.

    Parameters
    ----------
    evaluate : callable
        Of x (n,); the value is inf where it is not defined.
    start : (n,) array
        With a finite value; sizes of order one.
    iterations : int
        At most.
    tolerance : float
        On the stationarity.
    enough : float
        A value at which, with no constraint violated, the descent may end.
    seed : int
        Of the gradient sampling.
    progress : callable
        Told after every iteration how many are done, and where it is.
    """
    penalty = _Penalty(evaluate)
    x, point = start, penalty.at(start)
    if not np.isfinite(point.value):
        return End(x, point, 0, penalty.evaluations, np.inf)
    best = x, point
    H, recent = np.eye(x.size), deque([(x, point)], maxlen=_REMEMBERED)
    first, stationarity, count = True, np.inf, 0
    while count < iterations:
        if point.value <= enough and not np.any(point.violations > 0.0):
            break
        direction = _steered(penalty, point, H)
        slope = float(penalty.gradient(point) @ direction)
        if not slope < 0.0:
            direction = -penalty.gradient(point)
            H = np.eye(x.size)
            slope = -float(direction @ direction)
        found = _search(penalty, x, point, direction, slope)
        if found is None:
            stationarity = _shortest(_near(recent, x, penalty))
            if first or stationarity <= tolerance:
                break
            H, first = np.eye(x.size), True
            continue
        count += 1
        new_x, new = found
        s, y = new_x - x, penalty.gradient(new) - penalty.gradient(point)
        curvature = float(s @ y)
        if curvature > 1e-14 * np.linalg.norm(s) * np.linalg.norm(y):
            if first:
                H = np.eye(x.size) * (curvature / float(y @ y))
            V = np.eye(x.size) - np.outer(s, y) / curvature
            H = V @ H @ V.T + np.outer(s, s) / curvature
            first = False
        x, point = new_x, new
        recent.append((x, point))
        best = _better(best, (x, point))
        progress(count, point)
        stationarity = _shortest(_near(recent, x, penalty))
        if stationarity <= tolerance:
            break
    if x.size <= _MOST_SAMPLED and not point.value <= enough:
        x, point, stationarity = _sampled(penalty, x, point, stationarity, seed)
        best = _better(best, (x, point))
    return End(*best, count, penalty.evaluations, stationarity)


_KEPT = 1e-6


def _better(
    one: tuple[Vector, Evaluation], other: tuple[Vector, Evaluation]
) -> tuple[Vector, Evaluation]:
    """What violates less; within `_KEPT` what is smaller."""

    def rank(point: Evaluation) -> tuple[float, float]:
        return max(float(np.max(point.violations, initial=0.0)), _KEPT), point.value

    return other if rank(other[1]) < rank(one[1]) else one


def _steered(penalty: _Penalty, point: Evaluation, H: Matrix) -> Vector:
    """The direction of the quadratic program, with the value's weight cut until it mends enough."""
    if not point.violations.size:
        return -H @ (penalty.weight * point.gradient)
    direction = _quadratic(penalty.weight, point, H)
    violated = float(np.sum(np.maximum(point.violations, 0.0)))
    if violated <= 0.0:
        return direction

    def mended(d: Vector) -> float:
        ahead = point.violations + point.slopes @ d
        return violated - float(np.sum(np.maximum(ahead, 0.0)))

    if mended(direction) < _STEERED * violated:
        most = mended(_quadratic(0.0, point, H))
        while mended(direction) < _STEERED * most and penalty.weight > _LEAST_WEIGHT:
            penalty.weight *= _LESS
            direction = _quadratic(penalty.weight, point, H)
    return direction


def _quadratic(weight: float, point: Evaluation, H: Matrix) -> Vector:
    """Minimiser of the penalty function's model, gradients and 1/2 d' inv(H) d, by its dual."""
    J, c = point.slopes, point.violations
    JH = J @ H
    Q, linear = JH @ J.T, weight * (JH @ point.gradient) - c

    def dual(multipliers: Vector) -> tuple[float, Vector]:
        curved = Q @ multipliers
        return float(multipliers @ (0.5 * curved + linear)), curved + linear

    start = np.clip(-linear / np.maximum(np.diag(Q), 1e-300), 0.0, 1.0)
    bounds = [(0.0, 1.0)] * c.size
    found = smooth_minimize(dual, start, jac=True, bounds=bounds, method="L-BFGS-B").x
    return -H @ (weight * point.gradient) - JH.T @ found


def _search(
    penalty: _Penalty, x: Vector, point: Evaluation, direction: Vector, slope: float
) -> tuple[Vector, Evaluation] | None:
    """Weak Wolfe by bisection and doubling; None where no step lessens the value."""
    value, low, high, step = penalty.value(point), 0.0, np.inf, 1.0
    lower: tuple[Vector, Evaluation] | None = None
    for _ in range(_LONGEST_SEARCH):
        new_x = x + step * direction
        new = penalty.at(new_x)
        if not penalty.value(new) <= value + _ARMIJO * step * slope:
            high = step
        elif float(penalty.gradient(new) @ direction) < _CURVATURE * slope:
            low, lower = step, (new_x, new)
        else:
            return new_x, new
        step = 2.0 * low if np.isinf(high) else 0.5 * (low + high)
        if step * np.max(np.abs(direction)) < 1e-13 * (1.0 + np.max(np.abs(x))):
            break
    return lower


def _near(recent: deque[tuple[Vector, Evaluation]], x: Vector, penalty: _Penalty) -> list[Vector]:
    close = [p for at, p in recent if np.linalg.norm(at - x) <= _CLOSE * (1.0 + np.linalg.norm(x))]
    return [penalty.gradient(one) for one in close]


def _shortest(gradients: list[Vector]) -> float:
    """Norm of the shortest convex combination."""
    return float(np.linalg.norm(_shortest_of(gradients)))


def _shortest_of(gradients: list[Vector]) -> Vector:
    G = np.array(gradients).T
    if G.shape[1] == 1:
        return G[:, 0]
    size = float(np.max(np.linalg.norm(G, axis=0))) or 1.0
    # min |G w|^2 over w >= 0 with sum one, the sum by a heavy row
    heavy = 1e3
    rows = np.vstack([G / size, np.full((1, G.shape[1]), heavy)])
    w, _ = nnls(rows, np.append(np.zeros(G.shape[0]), heavy))
    return np.asarray(G @ (w / np.sum(w)))


def _sampled(
    penalty: _Penalty, x: Vector, point: Evaluation, stationarity: float, seed: int
) -> tuple[Vector, Evaluation, float]:
    """Steps along the shortest combination of gradients sampled in balls that shrink."""
    rng = np.random.default_rng(seed)
    for radius in _RADII:
        for _ in range(3):
            gradients = [penalty.gradient(point)]
            for _ in range(min(x.size + 1, 2 * _MOST_SAMPLED)):
                away = rng.standard_normal(x.size)
                away *= radius * rng.uniform() ** (1.0 / x.size) / np.linalg.norm(away)
                near = penalty.at(x + away)
                if np.isfinite(near.value):
                    gradients.append(penalty.gradient(near))
            direction = -_shortest_of(gradients)
            stationarity = float(np.linalg.norm(direction))
            if stationarity < 1e-9:
                return x, point, stationarity
            step, value = radius / stationarity, penalty.value(point)
            while step > 1e-12:
                new = penalty.at(x + step * direction)
                if penalty.value(new) < value - _ARMIJO * step * stationarity**2:
                    x, point = x + step * direction, new
                    break
                step *= 0.5
            else:
                break
    return x, point, stationarity
