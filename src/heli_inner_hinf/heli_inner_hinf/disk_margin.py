# SPDX-License-Identifier: Apache-2.0
"""Disk margins with all channels at once, from a loop's frequency response.

python-control's `disk_margins` needs slycot, a Fortran build, for more than one channel, so the
structured singular value is computed here; the tests compare one channel with python-control's.
"""

from dataclasses import dataclass

import numpy as np

from heli_inner_hinf.regular_form import Matrix


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


def disk_margins(L: np.ndarray) -> np.ndarray:
    """Disk margin (m,) at each frequency of an open loop L (m, n, n); the smallest is the loop's.

    Holds for a loop that is stable; the sign of L is such that stability is about 1 + L.
    """
    eye = np.eye(L.shape[1])
    return 1.0 / mu_bounds(np.linalg.inv(eye + L) - 0.5 * eye)


def smallest(L: np.ndarray, omega: np.ndarray) -> DiskMargin:
    """The disk margin of a stable loop's response L (m, n, n) at omega (m,), rad/s."""
    alpha = disk_margins(L)
    worst = int(np.argmin(alpha))
    return DiskMargin(float(alpha[worst]), float(omega[worst]))


def of_state_feedback(A: Matrix, B: Matrix, F: Matrix) -> DiskMargin:
    """At the plant input of the stable loop u = F x; what a node says of its design in flight."""
    modes = np.abs(np.linalg.eigvals(A + B @ F))
    near = (modes[:, None] * np.linspace(0.8, 1.2, 21)).ravel()
    omega = np.unique(np.concatenate([np.geomspace(1e-2, 1e3, 400), near]))
    resolvent = 1j * omega[:, None, None] * np.eye(A.shape[0]) - A
    right = np.broadcast_to(B.astype(complex), (omega.size, *B.shape))
    return smallest(-F @ np.linalg.solve(resolvent, right), omega)


def mu_bounds(M: np.ndarray) -> np.ndarray:
    """Upper bound (m,) of the structured singular value of each M (m, n, n) for diagonal complex
    blocks.

    min over D of the largest singular value of D M D^-1: Osborne scaling everywhere, then the
    convex minimisation over log D at the frequencies that can still be the worst.
    """
    d = np.ones(M.shape[:2])
    size = np.abs(M)
    n = M.shape[1]
    off = size * (1.0 - np.eye(n))
    for _ in range(30):
        scaled = d[:, :, None] * off / d[:, None, :]
        row, column = np.linalg.norm(scaled, axis=2), np.linalg.norm(scaled, axis=1)
        ratio = np.where((row > 0.0) & (column > 0.0), column / np.where(row > 0.0, row, 1.0), 1.0)
        d = d * np.where(ratio > 0.0, ratio, 1.0) ** 0.25
    bounds = np.linalg.svd(d[:, :, None] * M / d[:, None, :], compute_uv=False)[:, 0]
    floor = np.max(np.abs(np.linalg.eigvals(M)), axis=1)
    settled = float(np.max(floor))
    for i in np.argsort(-bounds):
        if bounds[i] <= settled * (1.0 + 1e-6):
            break
        bounds[i] = min(bounds[i], _minimised(M[i], d[i]))
        settled = max(settled, bounds[i])
    return bounds


def _minimised(M: np.ndarray, d: np.ndarray) -> float:
    from scipy.optimize import minimize

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        scale = np.exp(np.concatenate([[0.0], x]))
        u, sigma, vh = np.linalg.svd(scale[:, None] * M / scale[None, :])
        slope = sigma[0] * (np.abs(u[:, 0]) ** 2 - np.abs(vh[0]) ** 2)
        return float(sigma[0]), slope[1:]

    start = np.log(d[1:] / d[0])
    return float(minimize(cost, start, jac=True, method="BFGS", options={"maxiter": 60}).fun)
