# SPDX-License-Identifier: Apache-2.0
"""An upper bound of the (skewed) structured singular value that holds at every frequency.

Scalings found at one frequency hold about it as far as Psi stays negative definite. How far that
is tells a Hamiltonian matrix: Psi is singular at omega exactly if j omega is an eigenvalue of it
(Roos, Biannic, Int. J. Robust Nonlinear Control 20, 2010; Ferreres, Biannic 2001). The intervals
are laid side by side until they cover 0 to infinity: there is no grid to slip through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from heli_robust.blocks import Block
from heli_robust.errors import Cause, RobustError
from heli_robust.scalings import Complex, Scalings, Structure
from heli_robust.uncertain import Matrix

_LOWEST = 1e-9
_STATIC = 1e-3  # rad/s; a gap that ends below is looked at from 0
_SHARES = np.array([0.05, 0.35, 0.65, 0.95])
"""Where in a cell, by ratio of its ends, Psi is looked at besides the end itself."""
_STEP_UP = 1.003
_MOST_INTERVALS = 2000
_NARROW = 1e-9


class System(NamedTuple):
    """M(s) = D + C (s I - A)^-1 B, continuous and stable; w to z of the structure."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    def balanced(self) -> System:
        """The same system in states scaled such that eigenvalues can be trusted."""
        n, m = self.B.shape
        full = np.block([[self.A, self.B], [self.C, np.zeros((len(self.C), m))]])
        square = np.zeros((max(full.shape),) * 2)
        square[: full.shape[0], : full.shape[1]] = full
        scale = np.asarray(matrix_balance(square, permute=False, separate=True)[1][0])[:n]
        return System(
            self.A * scale / scale[:, None], self.B / scale[:, None], self.C * scale, self.D
        )

    def response(self, omega: float) -> Complex:
        """M(j omega); omega in rad/s, may be inf."""
        if np.isinf(omega):
            return self.D.astype(complex)
        n = len(self.A)
        return self.C @ np.linalg.solve(1j * omega * np.eye(n) - self.A, self.B) + self.D


class Piece(NamedTuple):
    """Scalings that hold from low to high, rad/s."""

    low_radps: float
    high_radps: float
    scalings: Scalings


@dataclass(frozen=True)
class Certificate:
    """A level that holds at every frequency, with what proves it.

    Attributes
    ----------
    level : float
        No Delta with scaled blocks below 1 / level and fixed blocks up to 1 makes I - M Delta
        singular on the imaginary axis.
    pieces : tuple of Piece
        From 0 to infinity without a gap.
    """

    level: float
    pieces: tuple[Piece, ...]

    def largest_psi(self, system: System, per_piece: int = 7) -> float:
        """Largest eigenvalue of Psi, relative to W, at points inside every piece; below 0 it holds.

        A second look that uses no Hamiltonian matrix.
        """
        worst = -np.inf
        for piece in self.pieces:
            low = max(piece.low_radps, 1e-3 * min(1.0, piece.high_radps))
            high = min(piece.high_radps, 1e3 * max(1.0, low))
            cells = np.geomspace(low, high, per_piece + 1)
            for omega in np.sqrt(cells[:-1] * cells[1:]):
                worst = max(worst, piece.scalings.largest(system.response(omega)))
        return worst


def certify(
    system: System, blocks: Sequence[Block], low: float, most: float = np.inf
) -> Certificate:
    """The smallest level, from `low` on, that scalings certify at every frequency.

    Parameters
    ----------
    system : System
    blocks : sequence of Block
    low : float
        A level from which to look, such as a lower bound times 1.01.
    most : float
        Give up above.

    Raises
    ------
    RobustError
        UNSTABLE: M is not stable. NO_CERTIFICATE: no scalings hold up to the level `most`.
    """
    pole = float(np.max(np.linalg.eigvals(system.A).real))
    if pole >= 0.0:
        raise RobustError(
            Cause.UNSTABLE, f"the nominal loop has a pole with real part {pole:.4g}, not below 0"
        )
    system = system.balanced()
    structure = Structure(blocks)
    level, pieces = low, list[Piece]()
    gaps = [(0.0, np.inf)]
    while gaps:
        a, b = gaps.pop()
        if b - a <= _NARROW * max(a, 1.0) or len(pieces) > _MOST_INTERVALS:
            raise RobustError(
                Cause.NO_CERTIFICATE, f"near {a:.6g} rad/s scalings hold at one frequency only"
            )
        omega = _inside(a, b)
        M = system.response(omega)
        scalings = structure.scalings(M, level)
        while scalings.slack <= 0.0:
            # All pieces so far hold for a higher level, too: W grows, Psi falls.
            level = _STEP_UP * structure.upper(M, low=_STEP_UP * level)
            if not (level <= most and np.isfinite(level)):
                raise RobustError(
                    Cause.NO_CERTIFICATE,
                    f"at {omega:.6g} rad/s no scalings hold up to the level {most:.6g}",
                )
            scalings = structure.scalings(M, level)
        below, above = valid_about(system, scalings, omega)
        pieces.append(Piece(below, above, scalings))
        gaps = [
            (low_gap, high_gap)
            for gap_a, gap_b in [*gaps, (a, b)]
            for low_gap, high_gap in ((gap_a, min(gap_b, below)), (max(gap_a, above), gap_b))
            if low_gap < high_gap
        ]
    return Certificate(level, tuple(sorted(pieces, key=lambda piece: piece.low_radps)))


def valid_about(system: System, scalings: Scalings, omega: float) -> tuple[float, float]:
    """The frequencies about omega up to which Psi is negative definite; 0 and inf if everywhere.

    Psi can change its sign only where an eigenvalue of the Hamiltonian is imaginary. Rounding moves
    eigenvalues off the axis, so the imaginary parts of all of them, not only of those on it, divide
    the axis into cells; each is entered only after a look at Psi at several points of it.
    """
    places = np.abs(np.linalg.eigvals(_hamiltonian(system, scalings)).imag)
    near = places[places > _LOWEST * max(omega, 1.0)]
    above = np.unique(np.append(near[near > omega], [omega, 2.0 * max(near.max(initial=0), omega)]))
    below = np.unique(np.append(near[near < omega], omega))[::-1]
    high = _negative_until(system, scalings, above, np.inf)
    low = _negative_until(system, scalings, below, 0.0)
    return low, high


def _negative_until(
    system: System, scalings: Scalings, edges: NDArray[np.float64], end: float
) -> float:
    """Where Psi stops to be negative definite on the way along edges, then to the end."""
    looks = [
        (a, np.concatenate([a * (b / a) ** _SHARES, [b]]))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    last = edges[-1]
    looks.append(
        (
            last,
            np.array([2.0, 10.0, 100.0, np.inf]) * last
            if np.isinf(end)
            else np.array([0.5, 0.1, 0.01, 0.0]) * last,
        )
    )
    reached = edges[0]
    for _, points in looks:
        for point in points:
            if scalings.largest(system.response(point)) >= 0.0:
                return _between(system, scalings, reached, point)
            reached = point
    return end


def _between(system: System, scalings: Scalings, good: float, bad: float) -> float:
    """A frequency between good and bad near the sign change of Psi, on the good side."""
    bad = min(bad, 1e6 * max(good, 1.0))
    for _ in range(40):
        middle = 0.5 * (good + bad)
        if scalings.largest(system.response(middle)) < 0.0:
            good = middle
        else:
            bad = middle
    return good


def _hamiltonian(system: System, scalings: Scalings) -> Complex:
    """Psi(omega) is singular exactly if j omega is an eigenvalue of this."""
    A, B, C, D = system
    Q, S = scalings.D_z, -1j * scalings.G.conj().T
    R_inverse = np.linalg.inv(scalings.psi(D.astype(complex)))
    right = C.T @ (Q @ D + S)
    F = A - B @ R_inverse @ right.conj().T
    corner = right @ R_inverse @ right.conj().T - C.T @ Q @ C
    return np.block([[F, -B @ R_inverse @ B.T], [corner, -F.conj().T]])


def _inside(a: float, b: float) -> float:
    """A frequency inside the gap a .. b: by ratios, from 1 rad/s where it is open."""
    if a == 0.0:
        return min(1.0, 0.5 * b) if b > _STATIC else 0.0
    return float(np.sqrt(a * b)) if np.isfinite(b) else 2.0 * a
