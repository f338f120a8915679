# SPDX-License-Identifier: Apache-2.0
"""Rotor: momentum theory in hover, axial and forward flight; the inflow solution everywhere."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_dynamics_sim.helicopter import main_rotor_power
from heli_dynamics_sim.rotor import (
    MAX_ITERATIONS,
    flapping_rates,
    inflow_residual,
    main_rotor,
    ring_term,
    solve_inflow,
)
from heli_dynamics_sim.trim import trim

SPEEDS = np.linspace(-10.0, 15.0, 11)
COLLECTIVE = np.linspace(-1.0, 1.0, 9)


def blade_flow(k, w_r, d_col):
    return w_r + k.rotor.blade_speed * (k.main.pitch_gain * d_col + k.main.pitch_offset)


def grid(k):
    """(w_r, w_bl, mu_sq) over the speeds and collectives, vortex ring and windmill included."""
    for u, v, w in itertools.product(SPEEDS, SPEEDS, SPEEDS):
        for d_col in COLLECTIVE:
            yield w, blade_flow(k, w, d_col), u * u + v * v
    for w, d_col in itertools.product(np.linspace(-10.0, 15.0, 101), COLLECTIVE):
        yield w, blade_flow(k, w, d_col), 0.0


@pytest.fixture(scope="module")
def k(helicopter):
    return helicopter.kernel


def test_inflow_converges_everywhere_with_a_small_residual(k):
    for rotor in (k.rotor, k.tail):
        kappa = rotor.thrust_slope / rotor.disc
        for w_r, w_bl, mu_sq in grid(k):
            v_i, thrust, iterations = solve_inflow(w_r, w_bl, mu_sq, rotor)
            assert iterations < MAX_ITERATIONS
            assert np.isfinite(thrust)
            assert abs(inflow_residual(v_i, w_r, w_bl, mu_sq, kappa)) <= 1e-10


def test_inflow_agrees_with_brents_method(k):
    kappa = k.rotor.thrust_slope / k.rotor.disc
    points = list(grid(k))[::97]
    for w_r, w_bl, mu_sq in points:
        v_i, _, _ = solve_inflow(w_r, w_bl, mu_sq, k.rotor)
        low, high = sorted((0.0, w_bl))
        other = brentq(
            inflow_residual, low - 1e-9, high + 1e-9, (w_r, w_bl, mu_sq, kappa), xtol=1e-14
        )
        assert v_i == pytest.approx(other, abs=1e-11)


def test_printed_law_holds_outside_fast_descent(k):
    # v_i^2 = sqrt((v2/2)^2 + (T/(2 rho pi R^2))^2) - v2/2, v2 = u^2 + v^2 + w_r (w_r - 2 v_i)
    kappa = k.rotor.thrust_slope / k.rotor.disc
    checked = 0
    for w_r, w_bl, mu_sq in grid(k):
        if w_r > kappa and w_bl > 0.0 or w_r < -kappa and w_bl < 0.0:
            continue
        v_i, thrust, _ = solve_inflow(w_r, w_bl, mu_sq, k.rotor)
        half = 0.5 * (mu_sq + w_r * (w_r - 2.0 * v_i))
        # sqrt(half^2 + t^2) - half, written without cancellation for half > 0
        t_sq = (thrust / k.rotor.disc) ** 2
        root = np.hypot(half, abs(thrust) / k.rotor.disc)
        square = t_sq / (root + half) if half > 0.0 else root - half
        assert v_i * v_i == pytest.approx(square, abs=1e-9)
        checked += 1
    assert checked > 5000


def test_solution_is_unique_and_continuous_through_the_vortex_ring(k):
    kappa = k.rotor.thrust_slope / k.rotor.disc
    w = np.arange(-10.0, 25.0, 0.01)
    for d_col in COLLECTIVE:
        thrust = np.array([solve_inflow(x, blade_flow(k, x, d_col), 0.0, k.rotor)[1] for x in w])
        # dT/dw is bounded by the slope times |1 - dv/dw|; a jump would be tens of newtons
        assert np.abs(np.diff(thrust)).max() < 10.0 * k.rotor.thrust_slope * 0.01
    for w_r, w_bl in itertools.product(np.linspace(-20.0, 20.0, 41), np.linspace(-25.0, 35.0, 31)):
        v = np.linspace(min(0.0, w_bl), max(0.0, w_bl), 200)
        g = [inflow_residual(x, w_r, w_bl, 0.0, kappa) for x in v]
        assert (np.diff(g) >= -1e-12).all()


def test_without_the_ring_term_thrust_would_be_ambiguous(k):
    """The term is there for a reason: momentum theory alone has three solutions here."""
    kappa = k.rotor.thrust_slope / k.rotor.disc
    w_r, w_bl = 14.0, 14.5
    v = np.linspace(0.0, w_bl, 4000)
    plain = v * np.abs(w_r - v) - kappa * (w_bl - v)
    assert (np.diff(np.sign(plain)) != 0).sum() == 3
    assert ring_term(w_r, w_bl, kappa) > 0.0
    assert ring_term(-w_r, w_bl, kappa) == 0.0


@pytest.mark.parametrize("climb", [0.0, 1.0, 2.5, 5.0])
def test_axial_climb_is_momentum_theory(k, climb):
    v_i, thrust, _ = solve_inflow(-climb, blade_flow(k, -climb, -0.3), 0.0, k.rotor)
    hover_sq = thrust / k.rotor.disc
    assert v_i == pytest.approx(-climb / 2 + np.sqrt(climb**2 / 4 + hover_sq), rel=1e-12)


def test_fast_forward_flight_is_a_wing(k):
    v_i, thrust, _ = solve_inflow(0.0, blade_flow(k, 0.0, -0.3), 60.0**2, k.rotor)
    assert v_i == pytest.approx(thrust / k.rotor.disc / 60.0, rel=1e-3)


def test_hover_thrust_and_power_of_the_default_aircraft(helicopter, k):
    # published class: T about 96.8 N, v_i about 4.9 m/s, power about 840 W
    x = trim(helicopter).x
    thrust, v_i = main_rotor(0.0, 0.0, 0.0, x[13], x[14], x[19], k.rotor, k.main)
    power = main_rotor_power(0.0, 0.0, 0.0, v_i, thrust, (0.0, 0.0, k.fuselage.z * v_i * v_i), k)
    assert thrust == pytest.approx(96.8, abs=0.1)
    assert v_i == pytest.approx(4.9, abs=0.05)
    assert power == pytest.approx(840.0, abs=5.0)
    # profile power by hand: rho Omega R^2 C_D0 b c / 8 (Omega R)^2
    profile = 1.29 * 193.73 * 0.705**2 * 0.01 * 2 * 0.062 / 8 * (193.73 * 0.705) ** 2
    assert power - thrust * v_i == pytest.approx(profile, rel=0.03)


def test_climb_power_acts_in_climb_only(k):
    weight = k.body.mass * k.body.gravity
    level = main_rotor_power(0.0, 0.0, 0.0, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    up = main_rotor_power(0.0, 0.0, -2.0, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    down = main_rotor_power(0.0, 0.0, 2.0, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    assert up - level == pytest.approx(2.0 * weight)
    assert down == level


def test_flap_back_tilts_the_disc_away_from_the_air_speed(k):
    flapping = k.flapping._replace(flap_back=0.002)
    a, b = flapping_rates(0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, flapping)
    assert a == pytest.approx(0.002 * 5.0 / 0.29756) and b == 0.0
    a, b = flapping_rates(0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, flapping)
    assert a == 0.0 and b == pytest.approx(-0.002 * 5.0 / 0.29756)
    assert flapping_rates(0.0, 0.0, 0.0, 0.0, 5.0, 5.0, 0.0, 0.0, k.flapping) == (0.0, 0.0)
