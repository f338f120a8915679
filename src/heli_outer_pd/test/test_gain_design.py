# SPDX-License-Identifier: Apache-2.0
"""The prediction behind the gains against a second method; its optimum against neighbours."""

import numpy as np
import pytest
from scipy import integrate

from heli_outer_pd import gain_design

ACTUATION_LAG_S = 0.4
AXIS = gain_design.Axis(
    gain_design.first_order_lag(ACTUATION_LAG_S),
    0.3,
    0.6,
    20.0,
    1.02,
    0.3,
    nav_sigma_mps=0.05,
    nav_time_s=1.0,
    nav_pos_sigma_m=0.1,
    nav_pos_time_s=3.0,
)


def spectral_densities(axis, K_P, K_D, bandwidth_radps, omega):
    """Two-sided spectral densities of position and speed, from scalar transfer functions.

    Written down block by block: no matrix, no Pade approximation, nothing of the code under test.
    Eliminating the observer's estimates from law (21) leaves the textbook form of a disturbance
    observer, u = -(K_P p + (K_D + s F) v) / (1 - F G_m), with F its low pass and G_m the modelled
    lag.
    """
    s = 1j * omega
    actuation = np.exp(-axis.delay_s * s) / (1.0 + ACTUATION_LAG_S * s)
    low_pass = bandwidth_radps**2 / (s**2 + 1.6 * bandwidth_radps * s + bandwidth_radps**2)
    gain = actuation / (1.0 - low_pass / (1.0 + axis.modelled_lag_s * s))
    on_speed = gain * (K_D + s * low_pass)
    return_difference = s + axis.damping_per_s + on_speed + gain * K_P / s
    speed = sum(
        np.abs(path / return_difference) ** 2 * 2.0 * sigma**2 / tau / (omega**2 + tau**-2)
        for path, sigma, tau in (
            (axis.damping_per_s, axis.gust_sigma_mps, axis.gust_time_s),
            (on_speed, axis.nav_sigma_mps, axis.nav_time_s),
            (gain * K_P, axis.nav_pos_sigma_m, axis.nav_pos_time_s),
        )
    )
    return speed / omega**2, speed


@pytest.mark.parametrize("gains", [(0.9, 1.3, 0.4), (0.3, 1.0, 0.8), (2.0, 2.5, 1.5)])
def test_predicted_rms_agrees_with_the_integral_over_the_spectrum(gains):
    """Second method: Parseval's integral with the true delay, the same on every processor.

    The tolerance is what the prediction's second-order Pade approximation leaves of a delay of
    0.1 s (8e-7); the grid and its ends are good for 1e-9.
    """
    predicted = gain_design.evaluate(AXIS, *gains)
    assert predicted.stable
    omega = np.geomspace(1e-6, 1e5, 40_001)
    sigma = [
        np.sqrt(integrate.simpson(density * omega, x=np.log(omega)) / np.pi)
        for density in spectral_densities(AXIS, *gains, omega)
    ]
    np.testing.assert_allclose([predicted.sigma_pos_m, predicted.sigma_speed_mps], sigma, rtol=1e-5)


def test_margin_of_a_known_loop():
    """A double integrator under plain PD with 0.2 s of delay: its Nyquist curve is known."""
    quick = gain_design.Axis(
        gain_design.first_order_lag(1e-4),
        0.0,
        0.6,
        20.0,
        1.0,
        0.3,
        delay_s=0.2,
        modelled_lag_s=1e-3,
    )
    result = gain_design.evaluate(quick, 1.0, 2.0, 0.01)
    omega = np.geomspace(0.02, 100, 4000)
    loop = (2j * omega + 1.0) / (1j * omega) ** 2 * np.exp(-0.2j * omega)
    assert abs(result.modulus_margin - np.abs(1 + loop).min()) < 0.02


def test_unstable_gains_are_called_unstable():
    assert not gain_design.evaluate(AXIS, 4.0, 0.2, 0.4).stable


def test_design_keeps_the_margin_and_no_neighbour_is_better():
    best = gain_design.design(AXIS, margin_floor=0.5)
    assert best.modulus_margin > 0.499

    def cost(r):
        return max(r.peak_pos_m / AXIS.position_bound_m, r.peak_speed_mps / AXIS.speed_bound_mps)

    for factor in ((1.15, 1, 1), (0.85, 1, 1), (1, 1.15, 1), (1, 0.85, 1), (1, 1, 1.15)):
        gains = np.array([best.K_P, best.K_D, best.bandwidth_radps]) * factor
        neighbour = gain_design.evaluate(AXIS, *gains)
        assert neighbour.modulus_margin < 0.5 or cost(neighbour) > cost(best) - 0.01
