# SPDX-License-Identifier: Apache-2.0
"""The prediction of an axis' rms and margins against second methods."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy import integrate

from heli_outer_pd.axis_analysis import (
    Axis,
    Gains,
    analyse,
    dryden_across,
    dryden_along,
    law,
    modelled_heave_damping_per_s,
    plant,
)
from heli_outer_pd.config import outer_kernel
from heli_outer_pd.parameter_table import NODE_NAME, TABLE
from heli_parameters.locate import config_folder
from heli_parameters.parameters import load

ACTUATION_LAG_S = 0.4
GUSTS = ((0.6, 20.0), (0.4, 8.0))  # rms m/s and L / V, s: along and across
AXIS = Axis(
    actuation=control.tf2ss([1.0], [ACTUATION_LAG_S, 1.0]),
    delay_s=0.1,
    damping_per_s=0.3,
    modelled_lag_s=0.35,
    modelled_damping_per_s=0.0,
    gusts=(dryden_along(*GUSTS[0]), dryden_across(*GUSTS[1])),
)


def gains(K_P, K_D, bandwidth_radps):
    return Gains(K_P, K_D, 1.6 * bandwidth_radps, bandwidth_radps**2)


@pytest.fixture(scope="module")
def kernel():
    return outer_kernel(
        load(TABLE, [config_folder("heli_outer_pd") / "outer_loop.yaml"], NODE_NAME)
    )


def spectral_densities(axis, g, omega):
    """Two-sided spectral densities of position and speed, from scalar transfer functions.

    Written down block by block: no matrix, no Pade approximation, nothing of the code under test.
    Eliminating the observer's estimates from law (21) leaves the textbook form of a disturbance
    observer, u = -(K_P p + (K_D + (s + d_m) F) v) / (1 - F G_m), with F its low pass, G_m the
    modelled lag and d_m the modelled damping.
    """
    s = 1j * omega
    actuation = np.exp(-axis.delay_s * s) / (1.0 + ACTUATION_LAG_S * s)
    low_pass = g.l2 / (s**2 + g.l1 * s + g.l2) if g.l2 else 0.0 * s
    gain = actuation / (1.0 - low_pass / (1.0 + axis.modelled_lag_s * s))
    on_speed = gain * (g.K_D + (s + axis.modelled_damping_per_s) * low_pass)
    return_difference = s + axis.damping_per_s + on_speed + gain * g.K_P / s
    (sigma_u, t_u), (sigma_v, t_v) = GUSTS
    # MIL-F-8785C, as spectra over rad/s, two-sided with unit integral over 2 pi
    along = sigma_u**2 * 2.0 * t_u / (1.0 + (t_u * omega) ** 2)
    across = sigma_v**2 * t_v * (1.0 + 3.0 * (t_v * omega) ** 2) / (1.0 + (t_v * omega) ** 2) ** 2
    speed = np.abs(axis.damping_per_s / return_difference) ** 2 * (along + across)
    return speed / omega**2, speed


@pytest.mark.parametrize("g", [gains(0.9, 1.3, 0.4), gains(0.3, 1.0, 0.8), Gains(2.0, 2.5, 0, 0)])
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_predicted_rms_agrees_with_the_integral_over_the_spectrum(g, damping):
    """Second method: Parseval's integral with the true delay, the same on every processor."""
    axis = replace(AXIS, modelled_damping_per_s=damping)
    predicted = analyse(axis, g)
    assert predicted.stable
    omega = np.geomspace(1e-6, 1e5, 40_001)
    sigma = [
        np.sqrt(integrate.simpson(density * omega, x=np.log(omega)) / np.pi)
        for density in spectral_densities(axis, g, omega)
    ]
    found = [predicted.position_rms_m, predicted.speed_rms_mps]
    np.testing.assert_allclose(found, sigma, rtol=1e-5)


def test_margins_of_a_known_loop():
    """A double integrator under plain PD with 0.2 s of delay: its Nyquist curve is known."""
    quick = replace(
        AXIS, actuation=control.tf2ss([1.0], [1e-4, 1.0]), delay_s=0.2, damping_per_s=0.0
    )
    found = analyse(quick, Gains(1.0, 2.0, 0.0, 0.0))
    omega = np.geomspace(0.02, 100, 200_000)
    loop = (2j * omega + 1.0) / (1j * omega) ** 2 * np.exp(-0.2j * omega)
    assert found.modulus_margin == pytest.approx(np.abs(1 + loop).min(), abs=2e-3)
    at = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1.0)))[0]
    assert found.crossover_radps == pytest.approx(omega[at], rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(180 + np.degrees(np.angle(loop[at])), abs=0.1)
    turns = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[1:] < 0.0))
    decibels = np.min(np.abs(20.0 * np.log10(np.abs(loop[turns]))))
    assert found.gain_margin_db == pytest.approx(decibels, abs=0.02)


def test_unstable_gains_are_called_unstable():
    found = analyse(AXIS, gains(4.0, 0.2, 0.4))
    assert not found.stable and found.modulus_margin == 0.0 and np.isinf(found.position_rms_m)


def test_steady_wind_is_trimmed_out_with_the_observer_only():
    """Final value of the position in a step of the wind: d / K_P for the plain law, else zero."""
    for g, expected in ((gains(0.5, 1.0, 0.4), 0.0), (Gains(0.5, 1.0, 0, 0), 0.3 / 0.5)):
        closed = control.interconnect(
            [control.ss(plant(AXIS), name="plant"), law(g, AXIS)],
            inputs=["air"],
            outputs=["position"],
        )
        assert control.dcgain(closed) == pytest.approx(expected, abs=1e-9)


def test_gains_are_those_that_fly(kernel):
    assert Gains.of(kernel, 2) == Gains(6.0, 7.0, 1.6 * 0.2, 0.2**2)
    without = kernel._replace(wind_compensation=0.0)
    assert Gains.of(without, 1) == Gains(0.5, 1.8, 0.0, 0.0)


def test_heave_damping_is_that_of_momentum_theory(kernel):
    """T = s (w - v), v (v - w) = T / D differentiated by hand at w = 0; s: slope of the blades."""
    r = kernel.rotor
    slope = r.rho * r.omega * r.lift_slope * r.radius**2 * r.blades * r.chord / 4.0
    disk = 2.0 * r.rho * np.pi * r.radius**2
    inflow = np.sqrt(kernel.mass * kernel.g / disk)
    expected = 0.5 * slope / (1.0 + slope / (2.0 * inflow * disk)) / kernel.mass
    assert modelled_heave_damping_per_s(kernel) == pytest.approx(expected, rel=1e-6)
