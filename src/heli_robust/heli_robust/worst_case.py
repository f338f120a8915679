# SPDX-License-Identifier: Apache-2.0
"""The worst member of a family of loops: parameters that destabilise it, or make its gain large.

Lower bounds of what `certificate` bounds from above, each with the parameters that prove it. The
search is the power iteration of real parameters, made with eigenvalues: with y, x the left and
right eigenvectors of the mode that is nearest to instability, every parameter goes to the end to
which Re(y* dA x / y* x) points, until no sign changes. Then a descent of the smallest damping ratio
from starts all over a slightly smaller box: the worst member may lie inside of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from heli_robust.uncertain import Matrix, Uncertain

Complex = NDArray[np.complex128]
_ROUNDS = 12
_FIRST_CROSSING = 60
_TO_ONSET = 1e-10
_STARTS = 24
_INSIDE, _CLIMBS, _SHRUNK = 40, 25, 0.98


@dataclass(frozen=True)
class Onset:
    """The smallest deviations found at which a loop loses its stability.

    Attributes
    ----------
    size : float
        Largest deviation, in units of the ranges; the stability margin is not above it. inf if
        nothing up to the largest size looked at destabilises.
    deltas : dict of str to float
        The deviations there; empty if there are none.
    frequency_radps : float
        Of the mode on the imaginary axis.
    """

    size: float
    deltas: Mapping[str, float]
    frequency_radps: float


class Family:
    """A state matrix A(delta) that depends rationally on named real parameters."""

    def __init__(self, A: Uncertain) -> None:
        self.A = A
        self.names = tuple(dict.fromkeys(A.channels))
        self._of = np.array([self.names.index(name) for name in A.channels], dtype=int)

    def matrix(self, delta: NDArray[np.float64]) -> Matrix:
        """The state matrix at deviations (k,) in the order of `names`."""
        return self.A.at(dict(zip(self.names, delta, strict=True)))

    def abscissa(self, delta: NDArray[np.float64]) -> float:
        """Largest real part of the modes."""
        return float(np.max(np.linalg.eigvals(self.matrix(delta)).real))

    def slopes(self, delta: NDArray[np.float64]) -> tuple[Complex, Complex]:
        """All modes (n,) and their slopes (n, k), complex."""
        F, n = self.A, len(self.A.channels)
        d = delta[self._of]
        modes, right = np.linalg.eig(self.matrix(delta))
        left = np.linalg.inv(right)
        into = np.linalg.solve(np.eye(n) - F.A * d, F.B @ right)
        out = np.linalg.solve((np.eye(n) - d[:, None] * F.A).T, F.C.T).T
        each = (left @ out) * into.T
        slopes = np.zeros((len(modes), len(self.names)), complex)
        np.add.at(slopes.T, self._of, each.T)
        return modes, slopes

    def onset(self, most: float) -> Onset:
        """The smallest destabilising deviations that the search finds, none above `most`."""
        modes, slopes = self.slopes(np.zeros(len(self.names)))
        # Modes by how far the box can push them: the share of their distance to the axis.
        reach = np.sum(np.abs(slopes.real), axis=1) / np.maximum(-modes.real, 1e-9)
        likely = np.argsort(-reach)[: 2 * _STARTS : 2]
        best = Onset(np.inf, {}, 0.0)
        seen: set[tuple[float, ...]] = set()
        for mode in likely:
            pattern = _signs(slopes[mode].real)
            for _ in range(_ROUNDS):
                if tuple(pattern) in seen:
                    break
                seen.add(tuple(pattern))
                size = self._along(pattern, min(most, best.size))
                reached = size if np.isfinite(size) else 0.9 * min(most, best.size)
                now, now_slopes = self.slopes(reached * pattern)
                critical = int(np.argmax(now.real))
                if size < best.size:
                    named = dict(zip(self.names, (size * pattern).tolist(), strict=True))
                    best = Onset(size, named, abs(float(now[critical].imag)))
                pattern = _signs(now_slopes[critical].real)
        return self._smaller(best, most)

    def _smaller(self, best: Onset, most: float) -> Onset:
        """Smaller deviations than the best so far, from starts all over a box that is smaller.

        The worst member need not lie at a corner: a local search for the largest real part inside.
        """
        starts = np.random.default_rng(1).uniform(-1.0, 1.0, (_INSIDE, len(self.names)))
        for start in starts:
            size = _SHRUNK * min(best.size, most)
            found = minimize(
                self._downhill,
                size * start,
                jac=True,
                bounds=[(-size, size)] * len(start),
                method="L-BFGS-B",
                options={"maxiter": _CLIMBS},
            )
            if found.fun >= 0.0:
                continue
            pattern = found.x / np.max(np.abs(found.x))
            size = self._along(pattern, size)
            if size < best.size:
                modes = np.linalg.eigvals(self.matrix(size * pattern))
                named = dict(zip(self.names, (size * pattern).tolist(), strict=True))
                frequency = abs(float(modes[int(np.argmax(modes.real))].imag))
                best = Onset(size, named, frequency)
        return best

    def _downhill(self, delta: Matrix) -> tuple[float, Matrix]:
        """The smallest damping ratio of the modes, negative if one grows, and its slopes."""
        modes, slopes = self.slopes(delta)
        size = np.abs(modes)
        worst = int(np.argmax(modes.real / size))
        mode, slope, length = modes[worst], slopes[worst], size[worst]
        turn = mode.real * (mode.conjugate() * slope).real / length**3 - slope.real / length
        return -float(mode.real / length), turn

    def _along(self, pattern: NDArray[np.float64], most: float) -> float:
        """First size up to `most` at which a mode along a pattern reaches the axis; inf if none."""
        sizes = np.linspace(0.0, most, _FIRST_CROSSING + 1)[1:]
        good = 0.0
        for size in sizes:
            if self.abscissa(size * pattern) >= 0.0:
                bad = size
                break
            good = size
        else:
            return np.inf
        while bad - good > _TO_ONSET * bad:
            middle = 0.5 * (good + bad)
            good, bad = (good, middle) if self.abscissa(middle * pattern) >= 0.0 else (middle, bad)
        return float(bad)


def _signs(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(slopes >= 0.0, 1.0, -1.0)
