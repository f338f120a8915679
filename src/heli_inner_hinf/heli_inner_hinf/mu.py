# SPDX-License-Identifier: Apache-2.0
"""Disk margins with all channels at once, from a loop's frequency response.

python-control's `disk_margins` needs slycot, a Fortran build, for more than one channel, so the
structured singular value is computed here; the tests compare one channel with python-control's.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DiskMargin:
    """Balanced (skew 0) disk margin, Seiler, Packard, Gahinet (2020).

    Attributes
    ----------
    alpha : float
        The loop survives every diagonal complex factor (1 + d/2) / (1 - d/2), |d| < alpha, in all
        channels at once; 0 if the loop itself is unstable. For up to three channels exact,
        otherwise a guaranteed lower bound.
    frequency : float
        Where it is smallest, rad/s.
    """

    alpha: float
    frequency: float

    @property
    def gain_db(self) -> float:
        """Gain margin that it guarantees, dB (inf from alpha = 2 on)."""
        if self.alpha >= 2.0:
            return np.inf
        return float(20.0 * np.log10((2.0 + self.alpha) / (2.0 - self.alpha)))

    @property
    def phase_deg(self) -> float:
        """Phase margin that it guarantees, deg."""
        return float(np.degrees(2.0 * np.arctan(self.alpha / 2.0)))


def disk_margins(L: np.ndarray, exact: bool = True) -> np.ndarray:
    """Disk margin (m,) at each frequency of an open loop L (m, n, n); the smallest is the loop's.

    Holds for a loop that is stable; the sign of L is such that stability is about 1 + L. Not exact:
    a lower bound, some percent below, in a tenth of the time.
    """
    eye = np.eye(L.shape[1])
    M = np.linalg.inv(eye + L) - 0.5 * eye
    return 1.0 / (mu_bounds(M) if exact else _scaled(M)[0])


def smallest(L: np.ndarray, omega: np.ndarray) -> DiskMargin:
    """The disk margin of a stable loop's response L (m, n, n) at omega (m,), rad/s."""
    alpha = disk_margins(L)
    worst = int(np.argmin(alpha))
    return DiskMargin(float(alpha[worst]), float(omega[worst]))


def mu_bounds(M: np.ndarray) -> np.ndarray:
    """Upper bound (m,) of the structured singular value of each M (m, n, n) for diagonal complex
    blocks.

    min over D of the largest singular value of D M D^-1: Osborne scaling everywhere, then the
    convex minimisation over log D at the frequencies that can still be the worst.
    """
    bounds, d = _scaled(M)
    floor = np.max(np.abs(np.linalg.eigvals(M)), axis=1)
    settled = float(np.max(floor))
    for i in np.argsort(-bounds):
        if bounds[i] <= settled * (1.0 + 1e-6):
            break
        bounds[i] = min(bounds[i], _minimised(M[i], d[i]))
        settled = max(settled, bounds[i])
    return bounds


def _scaled(M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bound (m,) by Osborne scaling, and the scaling (m, n)."""
    off = np.abs(M) ** 2 * (1.0 - np.eye(M.shape[1]))
    d2 = np.ones(M.shape[:2])
    for _ in range(30):
        row = d2 * (off @ (1.0 / d2)[:, :, None])[:, :, 0]
        column = (d2[:, None, :] @ off)[:, 0] / d2
        ratio = np.where((row > 0.0) & (column > 0.0), column / np.where(row > 0.0, row, 1.0), 1.0)
        d2 = d2 * ratio**0.25
    d = np.sqrt(d2)
    scaled = d[:, :, None] * M / d[:, None, :]
    return np.linalg.svd(scaled, compute_uv=False)[:, 0], d


def _minimised(M: np.ndarray, d: np.ndarray) -> float:
    from scipy.optimize import minimize

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        scale = np.exp(np.concatenate([[0.0], x]))
        u, sigma, vh = np.linalg.svd(scale[:, None] * M / scale[None, :])
        slope = sigma[0] * (np.abs(u[:, 0]) ** 2 - np.abs(vh[0]) ** 2)
        return float(sigma[0]), slope[1:]

    start = np.log(d[1:] / d[0])
    return float(minimize(cost, start, jac=True, method="BFGS", options={"maxiter": 60}).fun)
