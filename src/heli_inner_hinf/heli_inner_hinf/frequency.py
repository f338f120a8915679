# SPDX-License-Identifier: Apache-2.0
"""Frequency responses of python-control's systems as arrays, where to look, and the largest gain.

python-control's own norm (`control.system_norm`) needs slycot, a Fortran build, for sampled systems
with a delay and for any that have not as many inputs as outputs, and does not tell the frequency.
So the peak is searched for here; the tests compare it with python-control's where that can be had.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

if TYPE_CHECKING:
    import control


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
    end = top(system, 1e4)
    omega = np.concatenate([[1e-6], grid(modes(system), 1e-3, end, points)])

    def gain(at: np.ndarray) -> np.ndarray:
        return np.linalg.svd(response(system, at), compute_uv=False)[:, 0]

    values = gain(omega)
    i = int(np.argmax(values))
    low, high = omega[max(i - 1, 0)], omega[min(i + 1, omega.size - 1)]
    found = minimize_scalar(
        lambda w: -float(gain(np.array([w]))[0]),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-9 * high},
    )
    if -found.fun > values[i]:
        return float(-found.fun), float(found.x)
    return float(values[i]), float(omega[i])
