# SPDX-License-Identifier: Apache-2.0
"""Matrices that depend rationally on named real parameters: linear fractional transformations.

F(delta) = D + C Delta (I - A Delta)^-1 B with Delta = diag of the parameters' deviations, one place
a channel; every sum, product, stack and inverse of such matrices is one again (Zhou, Doyle, Glover,
Robust and Optimal Control, 1996, ch. 10). A deviation of +-1 is the end of a parameter's range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag, solve_discrete_lyapunov, svd

from heli_core.central_controller import System
from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.mu import Matrix, root

# -------------------------------------------------------------------------------------------------
# Uncertain.
# -------------------------------------------------------------------------------------------------

uncertain_Matrix = NDArray[Any]
_RANK = 1e-12  # singular values below this share of the largest are rounding


@dataclass(frozen=True)
class Range:
    """A real parameter that lies between two ends; its nominal value is between them, too.

    Attributes
    ----------
    name : str
    nominal, low, high : float
        In the parameter's own unit; not symmetric in general.

    Raises
    ------
    RobustError
        BAD_RANGE: the range is upside down, not finite, or does not include the nominal value.
    """

    name: str
    nominal: float
    low: float
    high: float

    def __post_init__(self) -> None:
        bounds = f"{self.name}: {self.low:g} .. {self.high:g}"
        if not np.all(np.isfinite([self.nominal, self.low, self.high])):
            raise RobustError(
                RobustCause.BAD_RANGE, f"{bounds}, nominal {self.nominal:g}; all have to be finite"
            )
        if self.low >= self.high:
            raise RobustError(
                RobustCause.BAD_RANGE, f"{bounds}; the range has to go from low to high"
            )
        if not self.low < self.nominal < self.high:
            raise RobustError(
                RobustCause.BAD_RANGE,
                f"{bounds}; the nominal value {self.nominal:g} has to lie inside the range",
            )

    def value(self, delta: float) -> float:
        """Value at a deviation: -1 low, 0 nominal, 1 high, fractional linear between and beyond.

        One pole on the real axis and no kink, as the parameter has to enter rationally; straight
        where nominal is in the middle.
        """
        up, down = self.high - self.nominal, self.nominal - self.low
        skew = (up - down) / (up + down)
        return self.nominal + 2.0 * up * down / (up + down) * delta / (1.0 - skew * delta)

    @property
    def matrix(self) -> Uncertain:
        """The parameter as a matrix (1, 1) that depends on its deviation."""
        up, down = self.high - self.nominal, self.nominal - self.low
        one = np.eye(1)
        return Uncertain(
            (self.name,),
            (up - down) / (up + down) * one,
            one,
            2.0 * up * down / (up + down) * one,
            self.nominal * one,
        )


@dataclass(frozen=True)
class Uncertain:
    """F(delta) = D + C Delta (I - A Delta)^-1 B.

    Attributes
    ----------
    channels : tuple of str
        The parameter of each place in Delta.
    A, B, C, D : (n, n), (n, columns), (rows, n), (rows, columns) arrays
    """

    channels: tuple[str, ...]
    A: uncertain_Matrix
    B: uncertain_Matrix
    C: uncertain_Matrix
    D: uncertain_Matrix

    # So that numpy leaves `array @ uncertain` to this class.
    __array_ufunc__ = None

    @staticmethod
    def constant(D: ArrayLike) -> Uncertain:
        """A matrix that depends on nothing."""
        D = np.atleast_2d(np.asarray(D, dtype=np.float64))
        return Uncertain(
            (), np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((D.shape[0], 0)), D
        )

    @staticmethod
    def stacked(rows: Sequence[Sequence[Uncertain | ArrayLike]]) -> Uncertain:
        """The block matrix of the given rows of blocks."""
        parts = [[_as_uncertain(block) for block in row] for row in rows]
        heights = [row[0].D.shape[0] for row in parts]
        widths = [block.D.shape[1] for block in parts[0]]
        left = np.cumsum([0, *heights])
        top = np.cumsum([0, *widths])
        total = Uncertain.constant(np.zeros((left[-1], top[-1])))
        for i, row in enumerate(parts):
            for j, block in enumerate(row):
                up = np.zeros((left[-1], heights[i]))
                up[left[i] : left[i + 1]] = np.eye(heights[i])
                across = np.zeros((widths[j], top[-1]))
                across[:, top[j] : top[j + 1]] = np.eye(widths[j])
                total = total + up @ block @ across
        return total

    def __add__(self, other: Uncertain | ArrayLike) -> Uncertain:
        other = _as_uncertain(other)
        return Uncertain(
            self.channels + other.channels,
            block_diag(self.A, other.A),
            np.vstack([self.B, other.B]),
            np.hstack([self.C, other.C]),
            self.D + other.D,
        )

    __radd__ = __add__

    def __matmul__(self, other: Uncertain | ArrayLike) -> Uncertain:
        other = _as_uncertain(other)
        return Uncertain(
            self.channels + other.channels,
            np.block(
                [
                    [self.A, self.B @ other.C],
                    [np.zeros((len(other.channels), len(self.channels))), other.A],
                ]
            ),
            np.vstack([self.B @ other.D, other.B]),
            np.hstack([self.C, self.D @ other.C]),
            self.D @ other.D,
        )

    def __rmatmul__(self, other: ArrayLike) -> Uncertain:
        return _as_uncertain(other) @ self

    def inverse(self) -> Uncertain:
        """F(delta)^-1; the nominal matrix has to have one."""
        inverse = np.linalg.inv(self.D)
        return Uncertain(
            self.channels,
            self.A - self.B @ inverse @ self.C,
            self.B @ inverse,
            -inverse @ self.C,
            inverse,
        )

    def at(self, deltas: Mapping[str, float]) -> uncertain_Matrix:
        """F at the deviations of its parameters (those not named are nominal)."""
        delta = np.array([deltas.get(name, 0.0) for name in self.channels])
        n = len(self.channels)
        return self.D + self.C * delta @ np.linalg.solve(np.eye(n) - self.A * delta, self.B)

    def within(self, centre: Mapping[str, float], half: Mapping[str, float]) -> Uncertain:
        """The same dependence in deviations of +-1 from `centre`, `half` wide to each side.

        Every parameter is named in both.
        """
        c = np.array([centre[name] for name in self.channels])
        r = np.array([half[name] for name in self.channels])
        about = np.linalg.inv(np.eye(len(c)) - self.A * c)
        A, B = about @ (self.A * r), about @ self.B
        C, D = self.C * r + self.C * c @ A, self.D + self.C * c @ B
        return Uncertain(self.channels, A, B, C, D)

    def reduced(self, share: float = _RANK) -> Uncertain:
        """The same dependence with as few channels of each parameter as ranks allow.

        Channels of one parameter may be mixed, as its deviation is the same in all. Directions
        below `share` of a parameter's largest are dropped: at the default that is exact.
        """
        order = sorted(range(len(self.channels)), key=lambda i: self.channels[i])
        names = [self.channels[i] for i in order]
        A, B, C = self.A[np.ix_(order, order)], self.B[order], self.C[:, order]
        for name in dict.fromkeys(names):
            for rows in (True, False):
                place = np.array([i for i, other in enumerate(names) if other == name], dtype=int)
                rest = np.array([i for i, other in enumerate(names) if other != name], dtype=int)
                full = np.hstack([A, B])[place] if rows else np.vstack([A, C])[:, place].T
                U, sigma, _ = np.linalg.svd(full, full_matrices=False)
                keep = U[:, sigma > share * max(sigma.max(initial=0.0), np.finfo(float).tiny)]
                T = np.zeros((len(names), len(rest) + keep.shape[1]))
                T[rest, np.arange(len(rest))] = 1.0
                T[np.ix_(place, np.arange(len(rest), T.shape[1]))] = keep
                A, B, C = T.T @ A @ T, T.T @ B, C @ T
                names = [names[i] for i in rest] + [name] * keep.shape[1]
        return Uncertain(tuple(names), A, B, C, self.D)


def _as_uncertain(value: Uncertain | ArrayLike) -> Uncertain:
    return value if isinstance(value, Uncertain) else Uncertain.constant(value)


# -------------------------------------------------------------------------------------------------
# Balanced truncation of a stable sampled system (Moore, *IEEE Trans. Autom. Control* 26, 1981).
# -------------------------------------------------------------------------------------------------


def balancing(system: System) -> tuple[Matrix, Matrix, Matrix]:
    """Hankel singular values (n,), falling, and W, V with W V = I that balance the system.

    The system of order k is W[:k] A V[:, :k], W[:k] B, C V[:, :k], D; its error is at most twice
    the sum of the Hankel singular values that are left out.

    Raises
    ------
    RobustError
        UNSTABLE.
    """
    A, B, C, _ = system
    radius = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
    if radius >= 1.0:
        raise RobustError(RobustCause.UNSTABLE, f"a pole has the modulus {radius:.6g}, not below 1")
    reach = _half(solve_discrete_lyapunov(A, B @ B.T))
    observable = _half(solve_discrete_lyapunov(A.T, C.T @ C))
    left, hankel, right = svd(observable.T @ reach)
    part = np.sqrt(np.maximum(hankel, hankel[0] * np.finfo(float).eps))
    return hankel, (left / part).T @ observable.T, reach @ right.T / part


def truncated(system: System, W: Matrix, V: Matrix, order: int) -> System:
    """The system of an order, with W and V of `balancing`."""
    left, right = W[:order], V[:, :order]
    return System(left @ system.A @ right, left @ system.B, system.C @ right, system.D)


def _half(gramian: Matrix) -> Matrix:
    return root(0.5 * (gramian + gramian.T))
