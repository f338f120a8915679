# SPDX-License-Identifier: Apache-2.0
"""A low-order model with delay of one measured response: rate per input of one axis.

First order: g e^(-s tau) / (1 + s / a), the rate of a rigid helicopter. Second order:
g e^(-s tau) w^2 / (s^2 + 2 z w s + w^2), where the rotor or its stabiliser bar moves with the body.
Lines are weighed by their own standard deviation; the second order is taken only if the Bayesian
information criterion asks for it. Source: Tischler and Remple, Aircraft and Rotorcraft System
Identification, 2nd ed. (AIAA 2012), ch. 11 (transfer functions with an equivalent delay).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from heli_analysis.identification.spectra import Array, ComplexArray
from heli_core.errors import IdentificationCause, IdentificationError

LEAST_LINES = 6
_LONGEST_S = 0.3
_SLOWEST, _FASTEST = 0.05, 500.0  # rad/s
_FIRST, _SECOND = ("gain", "pole_radps", "delay_s"), ("gain", "pole_radps", "delay_s", "damping")


@dataclass(frozen=True)
class AxisModel:
    """A fitted response.

    Attributes
    ----------
    order : int
        1 or 2.
    gain : float
        Steady rate per unit of input.
    pole_radps : float
        a of the first order, w of the second.
    delay_s : float
        What the order does not explain as well: rotor, servos, filters, transport.
    damping : float or None
        z of the second order.
    sigma : dict of str to float
        Standard deviation of each, by its name; scaled up where the model misses the lines by more.
    misfit : float
        RMS distance to the lines over their standard deviation; 1 where the model is right.
    """

    order: int
    gain: float
    pole_radps: float
    delay_s: float
    damping: float | None
    sigma: dict[str, float]
    misfit: float

    def response(self, omega_radps: Array) -> ComplexArray:
        """Response (L,) at frequencies, rad/s."""
        values = [self.gain, self.pole_radps, self.delay_s]
        return _response(omega_radps, np.array(values + [self.damping] * (self.order - 1)))


def _response(omega_radps: Array, x: Array) -> ComplexArray:
    gain, pole, delay, *damping = x
    s = 1j * omega_radps
    late = gain * np.exp(-s * delay)
    if not damping:
        return np.asarray(late / (1.0 + s / pole))
    return np.asarray(late * pole**2 / (s**2 + 2.0 * damping[0] * pole * s + pole**2))


def fit_axis(omega_radps: Array, value: ComplexArray, sigma: Array) -> AxisModel:
    """Fit both orders to lines (L,) with the standard deviation of their real and imaginary part.

    Raises
    ------
    IdentificationError
        TOO_FEW_LINES or NOT_CONVERGED.
    """
    if omega_radps.size < LEAST_LINES:
        raise IdentificationError(
            IdentificationCause.TOO_FEW_LINES,
            f"{omega_radps.size} usable lines, at least {LEAST_LINES} are needed",
        )
    fits = [_fitted(omega_radps, value, sigma, names) for names in (_FIRST, _SECOND)]
    first, second = fits
    asked = first[1] - second[1] > np.log(2.0 * omega_radps.size) * max(1.0, second[0].misfit ** 2)
    return second[0] if asked else first[0]


def _fitted(
    omega: Array, value: ComplexArray, sigma: Array, names: tuple[str, ...]
) -> tuple[AxisModel, float]:
    def left(x: Array) -> Array:
        error = (_response(omega, x) - value) / sigma
        return np.concatenate([error.real, error.imag])

    low = np.array([-np.inf, _SLOWEST, -0.05, 0.02][: len(names)])
    high = np.array([np.inf, _FASTEST, _LONGEST_S, 5.0][: len(names)])
    size = float(np.abs(value[: max(2, value.size // 4)]).mean())
    sign = 1.0 if np.cos(np.angle(value)).sum() >= 0.0 else -1.0
    best = None
    for pole in np.geomspace(max(omega.min(), 0.2), omega.max(), 5):
        for turned in (sign, -sign):
            start = np.array([turned * size, pole, 0.02, 0.6][: len(names)])
            found = least_squares(left, start, bounds=(low, high), x_scale="jac", max_nfev=200)
            best = found if best is None or found.cost < best.cost else best
    if best is None or not np.all(np.isfinite(best.x)):
        raise IdentificationError(IdentificationCause.NOT_CONVERGED, "the axis' fit did not settle")
    cost, free = 2.0 * float(best.cost), 2 * omega.size - len(names)
    misfit = float(np.sqrt(cost / free))
    spread = np.linalg.pinv(best.jac.T @ best.jac) * max(1.0, misfit**2)
    sigmas = dict(zip(names, np.sqrt(np.maximum(np.diag(spread), 0.0)).tolist(), strict=True))
    x = dict(zip(names, best.x.tolist(), strict=True))
    return AxisModel(len(names) - 2, **{"damping": None, **x}, sigma=sigmas, misfit=misfit), cost
