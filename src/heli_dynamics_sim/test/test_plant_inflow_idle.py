# SPDX-License-Identifier: Apache-2.0
"""The gradients of the dynamic inflow where hardly any air flows through the disc, and in hover."""

import numpy as np
import pytest

from heli_dynamics_sim.main_rotor import inflow_rates

SIDE = 0.3


def settled(flow, v_0, k):
    """Gradient (m/s) at which its rate vanishes: linear in it, so two points tell."""
    zero, one = (
        inflow_rates(np.array([v_0, v_s, 0.0]), (0.0, 0.0), flow, (0.0, SIDE, 0.0), k)[1]
        for v_s in (0.0, 1.0)
    )
    return zero / (zero - one)


def test_a_moment_without_through_flow_has_a_bounded_gradient(helicopter):
    k = helicopter.params.inflow
    assert settled(0.0, 0.0, k) == pytest.approx(2.0 * SIDE / k.least_flow, rel=1e-9)


def test_in_hover_the_gradient_is_that_of_momentum_theory(helicopter):
    """2 C / V_m with V_m = 2 v_i: no floor is felt."""
    k = helicopter.params
    v_i = np.sqrt(k.body.mass * k.body.gravity / k.rotor.disc)
    assert settled(v_i, v_i, k.inflow) == pytest.approx(2.0 * SIDE / (2.0 * v_i), rel=1e-9)
    assert k.inflow.least_flow == pytest.approx(0.5 * v_i, rel=1e-12)
