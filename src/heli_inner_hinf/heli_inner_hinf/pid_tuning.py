# SPDX-License-Identifier: Apache-2.0
"""Gains of a PID from the linear model alone, by a rule: the most integral gain at a given
robustness. What is packaged for the default aircraft is searched for (`attitude_search`).

For each axis the loop as flown is taken (servo, transport delay, 100 Hz; angle for P and I, body
rate for D). At a crossover w_c and a phase margin the complex equation L(w_c) = exp(j (margin -
pi)) has one pair K_P, K_D, with K_I = K_P w_c times a share of 0.1 to 0.5 (at 0.2 the integrator
costs 11 degrees at crossover). Over a grid of all three, the one with the most integral gain whose
sensitivity peak max |S| stays below `PEAK` wins: the rule of Astrom, Panagopoulos, Hagglund
(Automatica 34(5), 1998: load disturbance rejection at a given robustness).
"""

import cmath
import math
from dataclasses import dataclass
from itertools import product

import control
import numpy as np

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.frequency import response
from heli_inner_hinf.loops import Model, sampled_plant
from heli_inner_hinf.weights import N_U
from heli_math.state_names import INPUT_NAMES
from heli_math.ticks import TICK_S

PEAK = 1.7
"""Largest |S| of each axis: a modulus margin of 0.59."""
AXES = ("roll", "pitch", "yaw")
_ANGLE = ("phi", "theta", "psi")
_RATE = ("p", "q", "r")
_INTEGRAL_SHARES = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True)
class AxisGains:
    """Gains of one axis: K_P 1/rad, K_I 1/(rad s), K_D s/rad; crossover rad/s, margin deg, max
    |S|."""

    axis: str
    K_P: float
    K_I: float
    K_D: float
    crossover_radps: float
    phase_margin_deg: float
    peak: float


def tune_pid(
    model: Model, actuation: Actuation | None = None, peak: float = PEAK
) -> tuple[AxisGains, AxisGains, AxisGains]:
    """Gains of roll, pitch, yaw by the module's rule.

    Parameters
    ----------
    model : Model
        Its F, G, C, D do not matter.
    actuation : Actuation, optional
    peak : float
        Bound on max |S| of each axis.

    Raises
    ------
    ValueError
        No pair on the grid reaches the bound; names the axis.
    """
    plant = sampled_plant(model, actuation or Actuation())
    roll, pitch, yaw = (_tune_axis(plant, axis, peak) for axis in range(N_U))
    return roll, pitch, yaw


def gains_of(axes: tuple[AxisGains, ...]) -> dict[str, np.ndarray]:
    """K_P, K_I, K_D (3,) by name, as the YAML holds them."""
    return {
        "K_P": np.array([a.K_P for a in axes]),
        "K_I": np.array([a.K_I for a in axes]),
        "K_D": np.array([a.K_D for a in axes]),
    }


def _tune_axis(plant: control.StateSpace, axis: int, peak: float) -> AxisGains:
    single = plant[[_ANGLE[axis], _RATE[axis]], [INPUT_NAMES[axis]]]
    grid = np.geomspace(0.05, 0.999 * np.pi / TICK_S, 1500)
    over_grid = response(single, grid)[:, :, 0]
    best: AxisGains | None = None
    for crossover in np.geomspace(0.3, 30.0, 140):
        at = response(single, np.array([crossover]))[0, :, 0]
        trials = product(np.arange(35.0, 86.0, 5.0), _INTEGRAL_SHARES)
        for margin, share in trials:
            gains = _pair(at, crossover, margin, share)
            if gains is None or (best is not None and abs(gains[1]) <= abs(best.K_I)):
                continue
            L = _open_loop(over_grid, grid, *gains)
            top = float(np.max(1.0 / np.abs(1.0 + L)))
            if top <= peak and _stable(single, *gains):
                best = AxisGains(AXES[axis], *gains, float(crossover), float(margin), top)
    if best is None:
        raise ValueError(f"no PID of the {AXES[axis]} axis keeps max |S| below {peak:g}")
    return best


def _pair(
    at: np.ndarray, crossover: float, margin_deg: float, share: float
) -> tuple[float, float, float] | None:
    """K_P, K_I, K_D for which L(crossover) has gain one and the phase margin; None for K_D against
    K_P."""
    step = TICK_S / (1.0 - cmath.exp(-1j * crossover * TICK_S))
    angle, rate = complex(at[0] * (1.0 + share * crossover * step)), complex(at[1])
    target = cmath.exp(1j * (math.radians(margin_deg) - math.pi))
    # Cramer's rule for K_P angle + K_D rate = target, real and imaginary part
    determinant = angle.real * rate.imag - angle.imag * rate.real
    if determinant == 0.0:
        return None
    K_P = (target.real * rate.imag - target.imag * rate.real) / determinant
    K_D = (angle.real * target.imag - angle.imag * target.real) / determinant
    if K_P * K_D < 0.0:
        return None
    return float(K_P), float(share * crossover * K_P), float(K_D)


def _open_loop(at: np.ndarray, omega: np.ndarray, K_P: float, K_I: float, K_D: float) -> np.ndarray:
    step = TICK_S / (1.0 - np.exp(-1j * omega * TICK_S))
    return at[:, 0] * (K_P + K_I * step) + at[:, 1] * K_D


def _stable(single: control.StateSpace, K_P: float, K_I: float, K_D: float) -> bool:
    """Whether the axis is stable with this PID, apart from modes that it does not reach."""
    row = (K_P + TICK_S * K_I) * single.C[0] + K_D * single.C[1]
    n = single.A.shape[0]
    A = np.zeros((n + 1, n + 1))
    A[:n, :n] = single.A - np.outer(single.B[:, 0], row)
    A[:n, n] = single.B[:, 0]
    A[n, :n] = -TICK_S * K_I * single.C[0]
    A[n, n] = 1.0
    return bool(np.max(np.abs(np.linalg.eigvals(A))) <= 1.0 + 1e-7)
