# SPDX-License-Identifier: Apache-2.0
"""Stability margins of a loop: disk margins with all channels at once, and one channel at a
time."""

from dataclasses import dataclass, replace

import numpy as np

from heli_inner_hinf.loops import (
    TICK_S,
    Actuation,
    Loop,
    Model,
    ObserverInput,
    flown_loop,
    sampled_plant,
)


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


@dataclass(frozen=True)
class ChannelMargin:
    """Classical margins of one channel, the others closed.

    Attributes
    ----------
    gain_up_db, gain_down_db : float
        Largest and smallest (negative) gain change, dB; inf if none destabilises.
    phase_deg : float
        Smallest phase lag, deg; inf if the loop gain never crosses one.
    delay_s : float
        Smallest additional delay, s.
    """

    gain_up_db: float
    gain_down_db: float
    phase_deg: float
    delay_s: float


def frequency_grid(loop: Loop, points: int = 400) -> np.ndarray:
    """Frequencies (m,), rad/s: 0.01 to 1000 or the Nyquist frequency, denser at the loop's
    modes."""
    top = 0.9999 * np.pi / loop.dt if loop.dt else 1e3
    modes = np.linalg.eigvals(loop.closed().A)
    if loop.dt:
        modes = np.log(np.where(np.abs(modes) > 1e-9, modes, 1e-9).astype(complex)) / loop.dt
    near = np.abs(modes)[:, None] * np.linspace(0.9, 1.1, 9)
    grid = np.concatenate([np.geomspace(1e-2, top, points), near.ravel()])
    return np.unique(np.clip(grid, 1e-2, top))


def disk_margin(loop: Loop, where: str, omega: np.ndarray | None = None) -> DiskMargin:
    """Multi-channel disk margin at `where` = "input" (3 channels) or "output" of the plant."""
    if loop.stability() >= 0.0:
        return DiskMargin(0.0, 0.0)
    omega = frequency_grid(loop) if omega is None else omega
    L = loop.at_input(omega) if where == "input" else loop.at_output(omega)
    M = np.linalg.inv(np.eye(L.shape[1]) + L) - 0.5 * np.eye(L.shape[1])
    bounds = mu_bounds(M)
    peak = int(np.argmax(bounds))
    return DiskMargin(float(1.0 / bounds[peak]), float(omega[peak]))


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


def channel_margins(loop: Loop, where: str = "input") -> list[ChannelMargin]:
    """Gain, phase and delay margin of each channel at `where`, one at a time, the others closed."""
    omega = frequency_grid(loop, 4000)
    L = loop.at_input(omega) if where == "input" else loop.at_output(omega)
    S = np.linalg.inv(np.eye(L.shape[1]) + L)
    return [channel_margin(1.0 / S[:, i, i] - 1.0, omega) for i in range(L.shape[1])]


def channel_margin(single: np.ndarray, omega: np.ndarray) -> ChannelMargin:
    """Margins of a scalar open loop (m,) by linear interpolation between grid points."""
    imag, real = single.imag, single.real
    flips = np.nonzero(np.sign(imag[1:]) != np.sign(imag[:-1]))[0]
    share = imag[flips] / (imag[flips] - imag[flips + 1])
    crossing = real[flips] + share * (real[flips + 1] - real[flips])
    negative = -crossing[crossing < -1e-9]
    up = -20.0 * np.log10(np.max(negative[negative < 1.0])) if np.any(negative < 1.0) else np.inf
    down = -20.0 * np.log10(np.min(negative[negative > 1.0])) if np.any(negative > 1.0) else -np.inf
    size = np.log(np.abs(single))
    hits = np.nonzero(np.sign(size[1:]) != np.sign(size[:-1]))[0]
    if hits.size == 0:
        return ChannelMargin(float(up), float(down), np.inf, np.inf)
    share = size[hits] / (size[hits] - size[hits + 1])
    at = omega[hits] + share * (omega[hits + 1] - omega[hits])
    value = single[hits] + share * (single[hits + 1] - single[hits])
    lag = np.mod(np.angle(value) + np.pi, 2.0 * np.pi)
    both = np.minimum(lag, 2.0 * np.pi - lag)
    return ChannelMargin(
        float(up), float(down), float(np.degrees(np.min(both))), float(np.min(lag / at))
    )


def further_delay_s(
    model: Model,
    K: np.ndarray,
    prediction_s: float = 0.0,
    feed: ObserverInput | None = None,
    actuation: Actuation | None = None,
    longest_s: float = 0.08,
) -> float:
    """Further transport delay (s), in all channels at once, up to which the loop as flown is
    stable.

    Exact discretisation for every delay; first crossing on a 2 ms grid, then bisected to 0.05 ms.
    """

    actuation = actuation or Actuation()
    loop = flown_loop(model, K, prediction_s, feed, actuation)

    def stable(extra: float) -> bool:
        later = replace(actuation, delay_s=actuation.delay_s + extra)
        return replace(loop, plant=sampled_plant(model, later)).stability() < 0.0

    if not stable(0.0):
        return 0.0
    good, step = 0.0, 0.2 * TICK_S
    while good < longest_s and stable(good + step):
        good += step
    if good >= longest_s:
        return longest_s
    bad = good + step
    while bad - good > 5e-5:
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if stable(middle) else (good, middle)
    return good
