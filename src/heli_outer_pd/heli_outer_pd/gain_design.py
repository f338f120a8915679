# SPDX-License-Identifier: Apache-2.0
"""Gains of the outer loop: stationary covariance in Dryden wind under a margin constraint.

One axis of the outer loop is linear: attitude (or thrust) loop -> acceleration -> speed ->
position, plus the law (21) with its disturbance observer. Driven by the Dryden spectrum of the
design wind and by the navigation's error, its stationary covariance follows from one Lyapunov
equation, so the peaks of a flight are predicted without flying: a Gaussian signal of rms sigma and
mean zero-crossing rate n per second exceeds sigma sqrt(2 ln(n T)) about once in T seconds (Rice
1945). The gains minimise the larger of the predicted peaks over the paper's bounds, with the
modulus margin (smallest distance of the loop's Nyquist curve to -1) kept above a floor.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

# A tenth of the law's 25 Hz Nyquist rate: beyond it the sampled observer is not the one analysed.
MAX_BANDWIDTH_RADPS = 7.5
# Slower than this the change of mean wind over the climb is not trimmed out before the upper hover
# phase is scored, 3 s after the climb.
MIN_BANDWIDTH_RADPS = 0.4


@dataclass(frozen=True)
class Axis:
    """What one axis looks like to the outer loop.

    Attributes
    ----------
    actuation : tuple of ndarray
        (A, B, C) from commanded to achieved acceleration at unit static gain: the attitude loop, or
        the collective servo.
    damping_per_s : float
        Linear drag: acceleration per air-relative speed, 1/s.
    gust_sigma_mps, gust_time_s : float
        Rms and correlation time of the wind along this axis.
    position_bound_m, speed_bound_mps : float
        The paper's figures for this axis.
    nav_sigma_mps, nav_time_s : float
        Rms and correlation time of the navigation's speed error; without it the best disturbance
        observer would be infinitely fast.
    delay_s : float
        Sampling, transport, servo and computation together.
    """

    actuation: tuple[np.ndarray, np.ndarray, np.ndarray]
    damping_per_s: float
    gust_sigma_mps: float
    gust_time_s: float
    position_bound_m: float
    speed_bound_mps: float
    nav_sigma_mps: float = 0.05
    nav_time_s: float = 1.0
    delay_s: float = 0.1


@dataclass(frozen=True)
class AxisResult:
    """Prediction for one set of gains."""

    K_P: float
    K_D: float
    bandwidth_radps: float
    sigma_pos_m: float
    sigma_speed_mps: float
    peak_pos_m: float
    peak_speed_mps: float
    modulus_margin: float
    stable: bool


def first_order_lag(time_constant_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit-gain lag as (A, B, C)."""
    return np.array([[-1.0 / time_constant_s]]), np.array([[1.0 / time_constant_s]]), np.eye(1)


def _pade(delay_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Second-order Pade approximation of a pure delay."""
    t = delay_s
    A = np.array([[0.0, 1.0], [-12.0 / t**2, -6.0 / t]])
    return A, np.array([[0.0], [1.0]]), np.array([[0.0, -12.0 / t]]), np.eye(1)


def _controller(K_P: float, K_D: float, w: float, zeta: float = 0.8):
    """Law (21) with observer: inputs (pos, speed, achieved acceleration), output commanded one."""
    l1, l2 = 2.0 * zeta * w, w * w
    A = np.array([[-l1, 1.0], [-l2, 0.0]])
    B = np.array([[0.0, l1, 1.0], [0.0, l2, 0.0]])
    return A, B, np.array([[0.0, -1.0]]), np.array([[-K_P, -K_D, 0.0]])


def _open_loop(axis: Axis, K_P: float, K_D: float, w: float):
    """Loop broken at the commanded acceleration: states, and B, C of the break and B of the wind.

    State order: actuation, delay, speed, position, controller.
    """
    Aa, Ba, Ca = axis.actuation
    Ad, Bd, Cd, Dd = _pade(axis.delay_s)
    Ac, Bc, Cc, Dc = _controller(K_P, K_D, w)
    na = Aa.shape[0]
    n = na + 2 + 2 + 2
    v, p, c = na + 2, na + 3, slice(na + 4, na + 6)
    A = np.zeros((n, n))
    A[:na, :na] = Aa
    A[:na, na : na + 2] = Ba @ Cd
    A[na : na + 2, na : na + 2] = Ad
    A[v, :na] = Ca[0]
    A[v, v] = -axis.damping_per_s
    A[p, v] = 1.0
    A[c, p] = Bc[:, 0]
    A[c, v] = Bc[:, 1]
    A[c, :na] = np.outer(Bc[:, 2], Ca[0])
    A[c, c] = Ac
    B = np.zeros((n, 1))
    B[:na] = Ba @ Dd
    B[na : na + 2] = Bd
    B_wind = np.zeros((n, 1))
    B_wind[v] = axis.damping_per_s
    C = np.zeros((1, n))
    C[0, p], C[0, v] = Dc[0, 0], Dc[0, 1]
    C[0, c] = Cc[0]
    return A, B, C, B_wind, v, p


def _peak(sigma: float, sigma_rate: float, duration_s: float) -> float:
    """Expected peak of a Gaussian signal (Rice): crossings per second are sigma_rate/(pi sigma)."""
    crossings = max(duration_s * sigma_rate / (np.pi * sigma), np.e)
    return sigma * np.sqrt(2.0 * np.log(crossings))


def evaluate(axis: Axis, K_P: float, K_D: float, w: float, duration_s: float = 50.0) -> AxisResult:
    """Predict rms and peak of position and speed, and the modulus margin, for one set of gains."""
    A, B, C, B_wind, v, p = _open_loop(axis, K_P, K_D, w)
    n = A.shape[0]
    closed = A + B @ C
    full = np.zeros((n + 2, n + 2))
    full[:n, :n] = closed
    full[:n, n : n + 1] = B_wind
    full[n, n] = -1.0 / axis.gust_time_s
    # The law sees speed plus error: wherever it reads the speed it reads the error too.
    full[:n, n + 1] = B[:, 0] * C[0, v]
    full[n - 2 : n, n + 1] += A[n - 2 : n, v]
    full[n + 1, n + 1] = -1.0 / axis.nav_time_s
    if np.linalg.eigvals(closed).real.max() >= -1e-3:
        return AxisResult(K_P, K_D, w, np.inf, np.inf, np.inf, np.inf, 0.0, False)
    Q = np.zeros_like(full)
    Q[n, n] = 2.0 * axis.gust_sigma_mps**2 / axis.gust_time_s
    Q[n + 1, n + 1] = 2.0 * axis.nav_sigma_mps**2 / axis.nav_time_s
    X = linalg.solve_continuous_lyapunov(full, -Q)
    sigma_p, sigma_v = np.sqrt(X[p, p]), np.sqrt(X[v, v])
    sigma_a = np.sqrt(full[v] @ X @ full[v])
    omega = np.geomspace(0.02, 100.0, 400)
    loop = np.array([-(C @ np.linalg.solve(1j * f * np.eye(n) - A, B))[0, 0] for f in omega])
    return AxisResult(
        K_P, K_D, w, sigma_p, sigma_v,
        _peak(sigma_p, sigma_v, duration_s), _peak(sigma_v, sigma_a, duration_s),
        float(np.abs(1.0 + loop).min()), True,
    )  # fmt: skip


def design(axis: Axis, margin_floor: float = 0.5) -> AxisResult:
    """Gains with the smallest predicted peak relative to the paper's bounds.

    Parameters
    ----------
    axis : Axis
    margin_floor : float
        Smallest modulus margin allowed; 0.5 means at least 6 dB of gain and 29 deg of phase margin.

    Returns
    -------
    AxisResult
    """

    def cost(log_gains: np.ndarray) -> float:
        r = evaluate(axis, *np.exp(log_gains))
        if not r.stable:
            return 1e3
        worst = max(r.peak_pos_m / axis.position_bound_m, r.peak_speed_mps / axis.speed_bound_mps)
        return worst + 50.0 * max(0.0, margin_floor - r.modulus_margin)

    starts = [(0.5, 1.0, 0.5), (1.0, 1.5, 0.8), (0.3, 1.0, 0.8)]
    bounds = np.log([(0.05, 4.0), (0.2, 6.0), (MIN_BANDWIDTH_RADPS, MAX_BANDWIDTH_RADPS)])
    runs = [
        optimize.minimize(
            cost, np.log(s), method="Nelder-Mead", bounds=bounds, options={"maxiter": 400}
        )
        for s in starts
    ]
    best = min(runs, key=lambda r: r.fun)
    return evaluate(axis, *np.exp(best.x))
