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
    nav_pos_sigma_m, nav_pos_time_s : float
        The same of the position estimate's wander.
    modelled_lag_s, modelled_damping_per_s : float
        What the law's own model knows of actuation and damping (thrust map: heave damping).
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
    nav_time_s: float = 2.0
    nav_pos_sigma_m: float = 0.1
    nav_pos_time_s: float = 5.0
    modelled_lag_s: float = 0.4
    modelled_damping_per_s: float = 0.0
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


def _controller(K_P: float, K_D: float, w: float, axis: Axis, zeta: float = 0.8):
    """Law (21) with observer: inputs (pos, speed), output the commanded acceleration.

    States: speed estimate, disturbance estimate, commanded acceleration behind the modelled lag.
    """
    l1, l2, rate = 2.0 * zeta * w, w * w, 1.0 / axis.modelled_lag_s
    C, D = np.array([[0.0, -1.0, 0.0]]), np.array([[-K_P, -K_D]])
    A = np.array([[-l1, 1.0, 1.0], [-l2, 0.0, 0.0], [0.0, 0.0, -rate]])
    B = np.array([[0.0, l1 - axis.modelled_damping_per_s], [0.0, l2], [0.0, 0.0]])
    A[2] += rate * C[0]
    B[2] += rate * D[0]
    return A, B, C, D


def _open_loop(axis: Axis, K_P: float, K_D: float, w: float):
    """Loop broken at the commanded acceleration: A, B, C, B of the wind, speed and position row.

    State order: actuation, delay, speed, position, controller.
    """
    Aa, Ba, Ca = axis.actuation
    Ad, Bd, Cd, Dd = _pade(axis.delay_s)
    Ac, Bc, Cc, Dc = _controller(K_P, K_D, w, axis)
    na = Aa.shape[0]
    v, p, c = na + 2, na + 3, slice(na + 4, na + 7)
    n = na + 7
    A = np.zeros((n, n))
    A[:na, :na] = Aa
    A[:na, na : na + 2] = Ba @ Cd
    A[na : na + 2, na : na + 2] = Ad
    A[v, :na] = Ca[0]
    A[v, v] = -axis.damping_per_s
    A[p, v] = 1.0
    A[c, p] = Bc[:, 0]
    A[c, v] = Bc[:, 1]
    A[c, c] = Ac
    B = np.zeros((n, 1))
    B[:na] = Ba @ Dd
    B[na : na + 2] = Bd
    B_wind = np.zeros((n, 1))
    B_wind[v] = axis.damping_per_s
    C = np.zeros((1, n))
    C[0, p], C[0, v] = Dc[0]
    C[0, c] = Cc[0]
    return A, B, C, B_wind, v, p


def _with_noise(axis: Axis, A, B, C, B_wind, v: int, p: int):
    """Closed loop with its wind and navigation errors as states, and their noise intensity.

    The law reads speed and position with an error each: wherever it reads the one it reads the
    other.
    """
    n = A.shape[0]
    sources = (
        (B_wind[:, 0], axis.gust_sigma_mps, axis.gust_time_s),
        (None, axis.nav_sigma_mps, axis.nav_time_s),
        (None, axis.nav_pos_sigma_m, axis.nav_pos_time_s),
    )
    full, Q = np.zeros((n + 3, n + 3)), np.zeros((n + 3, n + 3))
    full[:n, :n] = A + B @ C
    for i, (column, sigma, tau) in enumerate(sources):
        state = (v, v, p)[i]
        if column is None:
            column = B[:, 0] * C[0, state]
            column[n - 3 :] += A[n - 3 :, state]
        full[:n, n + i] = column
        full[n + i, n + i] = -1.0 / tau
        Q[n + i, n + i] = 2.0 * sigma**2 / tau
    return full, Q


def _peak(sigma: float, sigma_rate: float, duration_s: float) -> float:
    """Expected peak of a Gaussian signal (Rice): crossings per second are sigma_rate/(pi sigma)."""
    crossings = max(duration_s * sigma_rate / (np.pi * sigma), np.e)
    return sigma * np.sqrt(2.0 * np.log(crossings))


def evaluate(axis: Axis, K_P: float, K_D: float, w: float, duration_s: float = 50.0) -> AxisResult:
    """Predict rms and peak of position and speed, and the modulus margin, for one set of gains."""
    A, B, C, B_wind, v, p = _open_loop(axis, K_P, K_D, w)
    n = A.shape[0]
    if np.linalg.eigvals(A + B @ C).real.max() >= -1e-3:
        return AxisResult(K_P, K_D, w, np.inf, np.inf, np.inf, np.inf, 0.0, False)
    full, Q = _with_noise(axis, A, B, C, B_wind, v, p)
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
