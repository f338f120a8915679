# SPDX-License-Identifier: Apache-2.0
"""Rotor: momentum theory in hover, axial and forward flight; the inflow solution everywhere.

The grid is -10 to 15 m/s in all axes over the whole collective, vortex ring and windmill included.
"""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_core.rows import PLANT
from heli_dynamics_sim.helicopter import main_rotor_power
from heli_dynamics_sim.main_rotor import (
    MAX_ITERATIONS,
    flapping_rates,
    ring_term,
    rotor_flow,
    solve_inflow,
)
from heli_dynamics_sim.trim import trim

SPEEDS = np.linspace(-10.0, 15.0, 11)
COLLECTIVE = np.linspace(-1.0, 1.0, 9)
STILL = (0.0, 0.0, 0.0)


def blade_flow(k, w_r, d_col):
    return w_r + k.rotor.blade_speed * (k.main.pitch_gain * d_col + k.main.pitch_offset)


def inflow_residual(v_i, w_r, w_bl, mu_sq, kappa):
    """g(v_i), m2/s2, of the text of `rotor`, with the fast-descent term."""
    flow = np.sqrt(mu_sq + ring_term(w_r, w_bl, kappa) + (w_r - v_i) ** 2)
    return v_i * flow - kappa * (w_bl - v_i)


def grid(k):
    """(w_r, w_bl, mu_sq) over the speeds and collectives, vortex ring and windmill included."""
    for u, v, w in itertools.product(SPEEDS, SPEEDS, SPEEDS):
        for d_col in COLLECTIVE:
            yield w, blade_flow(k, w, d_col), u * u + v * v
    for w, d_col in itertools.product(np.linspace(-10.0, 15.0, 101), COLLECTIVE):
        yield w, blade_flow(k, w, d_col), 0.0


@pytest.fixture(scope="module")
def k(helicopter):
    return helicopter.params


def test_inflow_converges_everywhere_with_a_small_residual(k):
    """Inflow of both rotors over the grid; the law's residual; 1e-10, converged, finite."""
    for rotor in (k.rotor, k.tail):
        kappa = rotor.thrust_slope / rotor.disc
        for w_r, w_bl, mu_sq in grid(k):
            v_i, thrust, iterations = solve_inflow(w_r, w_bl, mu_sq, rotor)
            assert iterations < MAX_ITERATIONS
            assert np.isfinite(thrust)
            assert abs(inflow_residual(v_i, w_r, w_bl, mu_sq, kappa)) <= 1e-10


def test_inflow_agrees_with_brents_method(k):
    """The same; SciPy's brentq on the same law; 1e-11 m/s."""
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
    """The source's printed pair of laws, outside the vortex ring; v_i^2 to 1e-9 m2/s2."""
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
    """Descent through the vortex ring; one solution, thrust without a jump at steps of 1 cm/s."""
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
    """Axial climb; v = -c/2 + sqrt(c^2/4 + T/(2 rho A)); 1e-12."""
    v_i, thrust, _ = solve_inflow(-climb, blade_flow(k, -climb, -0.3), 0.0, k.rotor)
    hover_sq = thrust / k.rotor.disc
    assert v_i == pytest.approx(-climb / 2 + np.sqrt(climb**2 / 4 + hover_sq), rel=1e-12)


def test_fast_forward_flight_is_a_wing(k):
    """60 m/s; Glauert's v = T / (2 rho A V); 0.1 %."""
    v_i, thrust, _ = solve_inflow(0.0, blade_flow(k, 0.0, -0.3), 60.0**2, k.rotor)
    assert v_i == pytest.approx(thrust / k.rotor.disc / 60.0, rel=1e-3)


def test_hover_thrust_and_power_of_the_default_aircraft(helicopter, k):
    """Hover trim; 96.8 N, 4.9 m/s, 840 W, profile power by hand; 0.1 N, 0.05 m/s, 5 W, 3 %."""
    x = trim(helicopter).x
    thrust, v_i, _, _ = rotor_flow(x, STILL, k)
    power = main_rotor_power(STILL, STILL, v_i, thrust, (0.0, 0.0, k.fuselage.z * v_i * v_i), k)
    assert thrust == pytest.approx(96.8, abs=0.1)
    assert v_i == pytest.approx(4.9, abs=0.05)
    assert power == pytest.approx(840.0, abs=5.0)
    # profile power by hand: rho Omega R^2 C_D0 b c / 8 (Omega R)^2
    profile = 1.29 * 193.73 * 0.705**2 * 0.01 * 2 * 0.062 / 8 * (193.73 * 0.705) ** 2
    assert power - thrust * v_i == pytest.approx(profile, rel=0.03)


@pytest.mark.parametrize("d_col", np.linspace(-0.8, 0.2, 11))
def test_hover_is_ideal_momentum_theory(k, d_col):
    """Hover over the collective; v = sqrt(T/(2 rho A)), P = T^1.5/sqrt(2 rho A) + profile; 1e-12.

    rho A and the profile power by hand from the aircraft's numbers. Figure of merit: below 1.
    """
    x = np.zeros(PLANT.size)
    x[PLANT.servo_col] = d_col
    thrust, v_i, _, _ = rotor_flow(x, STILL, k)
    assert thrust > 0.0
    disc = 2.0 * 1.29 * np.pi * 0.705**2
    assert v_i == pytest.approx(np.sqrt(thrust / disc), rel=1e-12)
    ideal = thrust**1.5 / np.sqrt(disc)
    profile = 1.29 * 193.73 * 0.705**2 * 0.01 * 2 * 0.062 / 8 * (193.73 * 0.705) ** 2
    power = main_rotor_power(STILL, STILL, v_i, thrust, (0.0, 0.0, 0.0), k)
    assert power == pytest.approx(ideal + profile, rel=1e-12)
    if d_col < -0.1:
        assert 0.4 < ideal / power < 0.9


def test_thrust_is_continuous_in_all_inputs(k):
    """Random straight paths through the grid; |dT| <= 2 slope (|dw| + |dw_bl|) + in-plane part.

    A thousand steps each; a jump between branches of the inflow would be tens of newtons.
    """
    rng = np.random.default_rng(4)
    for rotor in (k.rotor, k.tail):
        for _ in range(40):
            low, high = rng.uniform(-10.0, 15.0, (2, 3))
            pitch = np.linspace(*rng.uniform(-0.25, 0.25, 2), 1001)
            path = low + np.linspace(0.0, 1.0, 1001)[:, None] * (high - low)
            thrust = np.array([
                solve_inflow(w, w + rotor.blade_speed * a, u * u + v * v, rotor)[1]
                for (u, v, w), a in zip(path, pitch, strict=True)
            ])  # fmt: skip
            step = np.abs(np.diff(path, axis=0)).sum(axis=1)
            step = step + rotor.blade_speed * np.abs(np.diff(pitch))
            assert (np.abs(np.diff(thrust)) <= 2.0 * rotor.thrust_slope * step).all()


def test_extreme_inputs_stay_finite(k):
    """Far outside the flight envelope; a finite thrust; no NaN."""
    for w_r, w_bl, mu_sq in itertools.product(
        (-1e6, -50.0, 0.0, 1e-300, 50.0, 1e6), (-1e6, 0.0, 1e-300, 1e6), (0.0, 1e-300, 1e12)
    ):
        assert np.isfinite(solve_inflow(w_r, w_bl, mu_sq, k.rotor)[:2]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_inflow_that_has_no_solution_says_so(k, bad):
    """What is not finite cannot be solved: the count of iterations says so, and it ends."""
    assert solve_inflow(bad, 1.0, 0.0, k.rotor)[2] == MAX_ITERATIONS
    assert solve_inflow(1.0, bad, 0.0, k.rotor)[2] == MAX_ITERATIONS


def test_climb_power_acts_in_climb_only(k):
    """Climb of 2 m/s; weight times speed, none in descent; 1e-6."""
    weight = k.body.mass * k.body.gravity
    level = main_rotor_power(STILL, STILL, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    up = main_rotor_power((0.0, 0.0, -2.0), STILL, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    down = main_rotor_power((0.0, 0.0, 2.0), STILL, 4.9, 95.0, (0.0, 0.0, 0.0), k)
    assert up - level == pytest.approx(2.0 * weight)
    assert down == level


def test_flap_back_tilts_the_disc_away_from_the_air_speed(k):
    """Switch flap_back: back in forward flight, left flying right; slope speed / tau; 1e-6."""
    flapping = k.flapping._replace(flap_back=0.002)
    a, b = flapping_rates(0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, flapping)
    assert a == pytest.approx(0.002 * 5.0 / 0.29756) and b == 0.0
    a, b = flapping_rates(0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, flapping)
    assert a == 0.0 and b == pytest.approx(-0.002 * 5.0 / 0.29756)
    assert flapping_rates(0.0, 0.0, 0.0, 0.0, 5.0, 5.0, 0.0, 0.0, k.flapping) == (0.0, 0.0)
