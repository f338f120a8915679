# SPDX-License-Identifier: Apache-2.0
"""Disk margins with all channels at once, from a loop's frequency response.

python-control's `disk_margins` needs slycot, a Fortran build, for more than one channel, so the
structured singular value is computed here; the tests compare one channel with python-control's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from heli_core.errors import RobustCause, RobustError

if TYPE_CHECKING:
    import control


# -------------------------------------------------------------------------------------------------
# Disk margin.
# -------------------------------------------------------------------------------------------------


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


# -------------------------------------------------------------------------------------------------
# Frequency responses of python-control's systems as arrays, where to look, and the largest gain.
#
# python-control's own norm (`control.system_norm`) needs slycot, a Fortran build, for sampled
# systems
# with a delay and for any that have not as many inputs as outputs, and does not tell the
# frequency.
# So the peak is searched for here; the tests compare it with python-control's where that can be
# had.
# -------------------------------------------------------------------------------------------------


def response(system: control.StateSpace, omega: np.ndarray) -> np.ndarray:
    """Frequency response (m, n_y, n_u), complex, at omega (m,), rad/s."""
    s = 1j * np.asarray(omega, dtype=np.float64)
    values = system(np.exp(s * system.dt) if system.dt else s, squeeze=False)
    return np.moveaxis(values, 2, 0)


def modes(system: control.StateSpace) -> np.ndarray:
    """Modes (n,), complex, rad/s; of a sampled system the logarithms of its poles over the tick."""
    return logarithms(system.poles(), system.dt) if system.dt else system.poles()


def logarithms(poles: np.ndarray, dt_s: float) -> np.ndarray:
    """Modes (n,), complex, rad/s, of the poles of a system sampled with dt_s."""
    return np.log(np.where(np.abs(poles) > 1e-9, poles, 1e-9).astype(complex)) / dt_s


def top(system: control.StateSpace, continuous_radps: float) -> float:
    """Highest frequency worth looking at, rad/s: Nyquist's, or `continuous_radps`."""
    return 0.9999 * np.pi / system.dt if system.dt else continuous_radps


def grid(
    modes_radps: np.ndarray, low_radps: float, top_radps: float, points: int, near: int = 21
) -> np.ndarray:
    """Frequencies (m,), rad/s: `points` log-spaced from low to top, and `near` about each mode."""
    about = np.abs(modes_radps)[:, None] * np.linspace(0.8, 1.2, near)
    omega = np.concatenate([np.geomspace(low_radps, top_radps, points), about.ravel()])
    return np.unique(np.clip(omega, low_radps, top_radps))


def peak_gain(system: control.StateSpace, points: int = 300) -> tuple[float, float]:
    """Largest singular value of a stable system's response, and its frequency, rad/s.

    By a grid that is denser at the system's modes, then a bounded search about the best point;
    relative accuracy 1e-6 or better for modes with a damping above 1e-3.
    """
    from scipy.optimize import minimize_scalar

    end = top(system, 1e4)
    omega = np.concatenate([[1e-6], grid(modes(system), 1e-3, end, points)])

    def gain(at: np.ndarray) -> np.ndarray:
        return np.linalg.svd(response(system, at), compute_uv=False)[:, 0]

    values = gain(omega)
    i = int(np.argmax(values))
    low, high = omega[max(i - 1, 0)], omega[min(i + 1, omega.size - 1)]
    peak = minimize_scalar(
        lambda w: -float(gain(np.array([w]))[0]),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-9 * high},
    )
    if -peak.fun > values[i]:
        return float(-peak.fun), float(peak.x)
    return float(values[i]), float(omega[i])


# -------------------------------------------------------------------------------------------------
# Upper bound of mu for complex numbers and one full block, with its scalings, at many M at once.
#
# min over D of the largest singular value of D M D^-1: Osborne's balancing, then steps down the
# gradient in log D, in which the problem is convex. Whatever D comes out, the bound holds.
# -------------------------------------------------------------------------------------------------

_BALANCING = 40
_DESCENT = 149
_TINY = 1e-300


def scaled_mu(
    M: NDArray[np.complex128], scalars: int, descent: int = _DESCENT
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Upper bound (m,) of mu and the scalings (m, scalars) of the numbers, that of the rest 1.

    Parameters
    ----------
    M : (m, n_z, n_w) array
        The first `scalars` places of z and of w belong to the numbers, the others to a full block.
    scalars : int
    descent : int
        Steps after the balancing.
    """
    log_d = _balanced(np.abs(M) ** 2, scalars)
    best, best_log_d = np.full(len(M), np.inf), log_d.copy()
    for step in range(descent + 1):
        d = np.exp(log_d)
        scaled = M.copy()
        scaled[:, :scalars] *= d[:, :, None]
        scaled[:, :, :scalars] /= d[:, None, :]
        left, sizes, right = np.linalg.svd(scaled)
        better = sizes[:, 0] < best
        best = np.where(better, sizes[:, 0], best)
        best_log_d[better] = log_d[better]
        slope = np.abs(left[:, :scalars, 0]) ** 2 - np.abs(right[:, 0, :scalars]) ** 2
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        log_d = log_d - slope / np.maximum(size, 1.0 / 3.0) * (0.5 / (1.0 + 0.15 * step))
    return best, np.exp(best_log_d)


def _balanced(size: NDArray[np.float64], scalars: int) -> NDArray[np.float64]:
    """log D (m, scalars) for which what goes into each number's row equals what goes out."""
    k = scalars
    grouped = np.zeros((len(size), k + 1, k + 1))
    grouped[:, :k, :k] = size[:, :k, :k]
    grouped[:, :k, k] = size[:, :k, k:].sum(axis=2)
    grouped[:, k, :k] = size[:, k:, :k].sum(axis=1)
    grouped[:, range(k), range(k)] = 0.0
    log_d = np.zeros((len(size), k + 1))
    for _ in range(_BALANCING):
        for i in range(k):
            out = (grouped[:, i] * np.exp(-2.0 * log_d)).sum(axis=1) + _TINY
            into = (grouped[:, :, i] * np.exp(2.0 * log_d)).sum(axis=1) + _TINY
            log_d[:, i] = 0.25 * np.log(into / out)
    return log_d[:, :k]


# -------------------------------------------------------------------------------------------------
# H-infinity norm of a stable discrete-time system, with its angle on the unit circle.
# -------------------------------------------------------------------------------------------------

Matrix = NDArray[np.float64]

REL_TOL = 1e-10
_NEAR_CIRCLE = 1e-5
"""Eigenvalues this near the circle are tried as crossings: a false one costs a trial only."""


def root(square: Matrix) -> Matrix:
    """F (n, n) with F F' the positive part of a symmetric matrix (n, n)."""
    values, vectors = np.linalg.eigh(square)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def discrete_norm(A: Matrix, B: Matrix, C: Matrix, D: Matrix) -> tuple[float, float]:
    """max over the unit circle of the largest singular value of D + C (z I - A)^-1 B.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, n_u), (n_y, n), (n_y, n_u) arrays

    Returns
    -------
    norm, angle : float
        Relative accuracy 1e-10 (Bruinsma, Steinbuch 1990, on the circle); angle of z, rad.

    Raises
    ------
    RobustError
        NOT_FINITE or UNSTABLE.
    """
    for name, matrix in zip("ABCD", (A, B, C, D), strict=True):
        if not np.all(np.isfinite(matrix)):
            raise RobustError(RobustCause.NOT_FINITE, f"{name} holds a value that is not finite")
    poles = np.linalg.eigvals(A)
    radius = float(np.max(np.abs(poles), initial=0.0))
    if radius >= 1.0:
        raise RobustError(RobustCause.UNSTABLE, f"a pole has the modulus {radius:.6g}, not below 1")

    def gain(angle: float) -> float:
        inside = np.exp(1j * angle) * np.eye(A.shape[0]) - A
        return float(np.linalg.norm(D + C @ np.linalg.solve(inside, B), 2))

    best, where = max((gain(t), t) for t in np.concatenate([[0.0, np.pi], np.angle(poles)]))
    for _ in range(60):
        if best == 0.0:
            break
        level = best * (1.0 + REL_TOL)
        crossing = np.unique(np.append(_crossings(A, B, C, D, level), 0.0))
        trial = np.append(crossing, 0.5 * (crossing[1:] + crossing[:-1]))
        largest, at = max((gain(t), t) for t in trial)
        if largest <= level:
            break
        best, where = largest, at
    return best, abs(float(where))


def _crossings(A: Matrix, B: Matrix, C: Matrix, D: Matrix, level: float) -> Matrix:
    """Angles in [0, pi] where a singular value equals `level`.

    G~ G u = level^2 u as a generalised eigenproblem in (x, costate, u), nothing inverted.
    """
    n, m = B.shape
    left, right = np.zeros((2 * n + m, 2 * n + m)), np.zeros((2 * n + m, 2 * n + m))
    left[:n, :n], left[:n, 2 * n :] = A, B
    left[n : 2 * n, n : 2 * n] = np.eye(n)
    left[2 * n :] = np.hstack([-D.T @ C / level, -B.T, level * np.eye(m) - D.T @ D / level])
    right[:n, :n] = np.eye(n)
    right[n : 2 * n] = np.hstack([C.T @ C / level, A.T, C.T @ D / level])
    values = eigvals(left, right)
    values = values[np.isfinite(values)]
    return np.abs(np.angle(values[np.abs(np.abs(values) - 1.0) < _NEAR_CIRCLE]))
