# SPDX-License-Identifier: Apache-2.0
"""The prediction behind the gains against time simulation; its optimum against neighbours."""

import numpy as np
from scipy import signal

from heli_outer_pd import gain_design

AXIS = gain_design.Axis(
    gain_design.first_order_lag(0.4),
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


def test_predicted_rms_agrees_with_a_long_simulation():
    """Second method: the same loop as a transfer function, driven by sampled coloured noise."""
    gains = (0.9, 1.3, 0.4)
    predicted = gain_design.evaluate(AXIS, *gains)
    A, B, C, B_wind, v, p = gain_design._open_loop(AXIS, *gains)
    rng, dt, n = np.random.default_rng(3), 0.01, 1_500_000
    columns, inputs = [B_wind[:, 0]], []
    for state in (v, p):
        columns.append(B[:, 0] * C[0, state])
        columns[-1][-3:] += A[-3:, state]
    for sigma, tau in ((AXIS.gust_sigma_mps, AXIS.gust_time_s), (0.05, 1.0), (0.1, 3.0)):
        decay = np.exp(-dt / tau)
        white = sigma * np.sqrt(1 - decay**2) * rng.standard_normal(n)
        inputs.append(signal.lfilter([1.0], [1.0, -decay], white))
    rows = np.eye(A.shape[0])[[p, v]]
    system = signal.StateSpace(A + B @ C, np.column_stack(columns), rows, np.zeros((2, 3)))
    discrete = system.to_discrete(dt)
    sigma = np.zeros(2)
    for i, row in enumerate(rows):
        y = 0.0
        for j, u in enumerate(inputs):
            num, den = signal.ss2tf(discrete.A, discrete.B, row[None], np.zeros((1, 3)), input=j)
            y = y + signal.lfilter(num[0], den, u)
        sigma[i] = np.std(y[100_000:])
    np.testing.assert_allclose(sigma, [predicted.sigma_pos_m, predicted.sigma_speed_mps], rtol=0.08)


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
