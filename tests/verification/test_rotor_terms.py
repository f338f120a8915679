# SPDX-License-Identifier: Apache-2.0
"""Terms of the main rotor: dynamic inflow, ground effect, vortex ring; all together.

References: published formulas and published numbers. Flap-back: `test_flap_back.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters, ModelOptions, lock_number
from heli_dynamics_sim.helicopter import WORK_ROWS, airspeeds, rk4_step, same_air, state_derivative
from heli_dynamics_sim.main_rotor import (
    axial_ratio,
    induced_share,
    mass_flow,
    rotor_flow,
    solve_descent,
    solve_inflow,
)
from heli_dynamics_sim.trim import linearize, trim

STILL = (0.0, 0.0, 0.0)
OFF = HelicopterParameters.from_yaml("helion.yaml")


def with_terms(*names, aircraft=OFF, **changes):
    """The aircraft with these terms on."""
    return replace(aircraft, terms=ModelOptions()._replace(**dict.fromkeys(names, True)), **changes)


def test_settled_inflow_slows_the_flapping_by_what_the_readme_says():
    """A(a_s, a_s) with dynamic inflow over that without; 7 %; half a percent."""
    models = [linearize(p, trim(p)) for p in (OFF, with_terms("inflow"))]
    slow = models[1].A[4, 4] / models[0].A[4, 4]
    assert slow == pytest.approx(0.93, abs=0.005)


@pytest.mark.parametrize("wind", [STILL, (-3.0, -4.0, 0.0), (-3.0, 0.0, 2.0)])
def test_steady_dynamic_inflow_is_momentum_theory(wind):
    """Trim of a disc without coupling; mean by the quasi-steady law, 1e-9.

    Nothing but the wake's skew makes a gradient: v_c / v_0 = 15 pi/32 tan(chi/2), Pitt and Peters,
    Vertica 5, 1981; 1e-6.
    """
    p = with_terms("inflow", flap_a_bs_per_s=0.0, flap_b_as_per_s=0.0)
    x = trim(p, wind).x
    plain = replace(p, terms=ModelOptions())
    at = airspeeds(x, same_air(wind))[0]
    thrust, v_i, w_r, pitch = rotor_flow(x, at, plain.params)
    assert x[PLANT.inflow_mean] == pytest.approx(v_i, rel=1e-9)
    assert rotor_flow(x, at, p.params)[0] == pytest.approx(thrust, rel=1e-9)
    in_plane = np.hypot(at[0], at[1])
    if in_plane > 1.0:
        chi = np.arctan2(in_plane, v_i - w_r)
        gradient = np.array([x[PLANT.inflow_rear], -x[PLANT.inflow_right]])
        along = gradient @ np.array([at[0], at[1]]) / in_plane
        expected = 15.0 * np.pi / 32.0 * np.tan(0.5 * chi)
        assert along / v_i == pytest.approx(expected, rel=1e-6)


def test_apparent_mass_is_that_of_carpenter_and_fridovich():
    """Air that moves with the inflow; 63.7 % of the rotor's sphere, NACA TN 3315; 0.1 %."""
    p = with_terms("inflow")
    k, x = p.params, trim(p).x
    thrust, slope = rotor_flow(x, STILL, k)[0], k.rotor.thrust_slope
    step = 1e-4
    raised = x.copy()
    raised[PLANT.inflow_mean] += step
    rates = [state_derivative(s, s[PLANT.servo], STILL, p)[PLANT.inflow_mean] for s in (x, raised)]
    # m v' = T - 2 rho A v^2, T = T_0 - slope dv, dv'/dv = -(slope + 4 rho A v) / m
    v_i = x[PLANT.inflow_mean]
    mass = -(slope + 2.0 * k.rotor.disc * v_i) * step / (rates[1] - rates[0])
    sphere = 4.0 / 3.0 * np.pi * p.main_radius_m**3 * p.air_density_kgpm3
    assert thrust > 0.0
    assert mass == pytest.approx(0.637 * sphere, rel=1e-3)


def test_inflow_lowers_the_lock_number_as_curtiss_and_shupe_have_it():
    """Disc's lag without bar, inflow settled; gamma* = gamma / (1 + a sigma/(16 lambda)); 1e-6.

    Curtiss and Shupe (1971), as in Johnson, Helicopter Theory, 1980, sec. 5-3.
    """
    blades = 16.0 / (lock_number(OFF) * OFF.main_speed_radps)
    p = with_terms("inflow", flap_time_constant_s=blades, flap_a_bs_per_s=0.0,
                   flap_b_as_per_s=0.0)  # fmt: skip
    x = trim(p).x
    solidity = p.main_blades * p.main_chord_m / (np.pi * p.main_radius_m)
    inflow = x[PLANT.inflow_mean] / (p.main_speed_radps * p.main_radius_m)
    factor = 1.0 + p.main_lift_slope * solidity / (16.0 * inflow)
    tilt = 1e-3

    def rates(right, rear):
        y = x.copy()
        y[PLANT.a_s] += tilt
        y[PLANT.inflow_right], y[PLANT.inflow_rear] = right, rear
        return state_derivative(y, y[PLANT.servo], STILL, p)

    right, rear = fsolve(lambda v: rates(*v)[[PLANT.inflow_right, PLANT.inflow_rear]], (0.0, 0.0))
    assert rates(right, rear)[PLANT.a_s] == pytest.approx(-tilt / blades / factor, rel=1e-6)


@pytest.mark.parametrize("height_radii", [0.8, 1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("speed", [0.0, 2.0, 6.0])
def test_thrust_in_ground_effect_is_cheeseman_and_bennetts(height_radii, speed):
    """T/T_inf at the same induced power; 1/(1 - (R/4z)^2/(1 + (V/v_i)^2)), R&M 3021; 2 %."""
    p = with_terms("ground_effect")
    k, radius = p.params, p.main_radius_m

    def hover(d_col, z):
        x = np.zeros(PLANT.size)
        x[PLANT.servo_col] = d_col
        x[PLANT.down] = p.hub_height_m - z
        thrust, v_i, _, _ = rotor_flow(x, (speed, 0.0, 0.0), k)
        return thrust, thrust * v_i

    weight = p.mass_kg * p.gravity_mps2
    far = brentq(lambda d: hover(d, 1e6)[0] - weight, -0.9, 0.4)
    power = hover(far, 1e6)[1]
    near = brentq(lambda d: hover(d, height_radii * radius)[1] - power, -0.9, 0.4)
    ratio = hover(near, height_radii * radius)[0] / weight
    v_i = power / weight
    law = 1.0 / (1.0 - (1.0 / (4.0 * height_radii)) ** 2 / (1.0 + (speed / v_i) ** 2))
    assert ratio == pytest.approx(law, rel=0.02)


@pytest.mark.parametrize("height_radii", [0.8, 1.0, 1.5, 2.0])
def test_hayden_is_the_other_law_of_ground_effect(height_radii):
    """Induced velocity in hover; 1/(0.9926 + 0.0379 (2R/z)^2); 1e-12; never above 1."""
    k = with_terms("ground_effect", ground_effect="hayden").params.ground_effect
    share = induced_share(height_radii * k.radius - k.hub_height, 0.0, k)
    assert share == pytest.approx(1.0 / (0.9926 + 0.0379 * (2.0 / height_radii) ** 2), rel=1e-12)
    assert induced_share(1e4, 0.0, k) == 1.0


def test_vortex_ring_is_the_measured_curve():
    """v_i/v_h of the rotor's solution in axial descent; Leishman's quartic; 0.3 % down to x = -1.5.

    Measured peak, Castles and Gray (NACA TN 2474): about twice the hover's near x = -1.4.
    """
    p = with_terms("vortex_ring")
    k, weight = p.params, p.mass_kg * p.gravity_mps2
    v_h = np.sqrt(weight / k.rotor.disc)
    quartic = np.polynomial.Polynomial([1.0, -1.125, -1.372, -1.718, -0.655])
    for ratio in np.linspace(-1.5, -0.05, 30):
        x = np.zeros(PLANT.size)

        def lift(d_col, x=x, ratio=ratio):
            x[PLANT.servo_col] = d_col
            return rotor_flow(x, (0.0, 0.0, -ratio * v_h), k)[0] - weight

        brentq(lift, -0.9, 0.5, xtol=1e-14)
        _, v_i, _, _ = rotor_flow(x, (0.0, 0.0, -ratio * v_h), k)
        assert v_i / v_h == pytest.approx(quartic(ratio), rel=3e-3)
    peak = max(axial_ratio(r) for r in np.linspace(-2.0, 0.0, 401))
    assert 1.9 < peak < 2.2


def test_vortex_ring_joins_momentum_theory_at_both_ends():
    """x = 0: Glauert's at any speed; x = -2 and beyond: the windmill's, axial; 1e-9."""
    for mu_sq in (0.0, 1.0, 9.0, 100.0):
        hover_sq = 24.0
        flow = mass_flow(hover_sq, 1e-12, mu_sq)
        v_i = hover_sq / flow
        assert v_i * np.sqrt(mu_sq + v_i**2) == pytest.approx(hover_sq, rel=1e-9)
    assert axial_ratio(0.0) == 1.0
    assert axial_ratio(-2.0) == pytest.approx(1.0, abs=1e-12)
    assert axial_ratio(-2.0 + 1e-9) == pytest.approx(1.0, abs=1e-6)
    for x in (-2.2, -3.0, -6.0):
        f = axial_ratio(x)
        assert f * (-x - f) == pytest.approx(1.0, rel=1e-12)  # T = 2 rho A v (w - v)


def test_thrust_is_one_continuous_function_through_the_vortex_ring():
    """Thrust over descent and collective; one zero of the law, slope of T bounded; no jump.

    Where momentum theory has three answers, the measured curve has one.
    """
    k = with_terms("vortex_ring").params
    for mu_sq in (0.0, 0.5, 4.0, 40.0):
        for w_bl in (4.0, 8.0, 12.0, 20.0):
            speeds = np.linspace(1e-9, 18.0, 3601)
            thrust = np.array([solve_descent(w, w_bl, mu_sq, k.rotor)[1] for w in speeds])
            assert (thrust >= 0.0).all()
            assert np.abs(np.diff(thrust)).max() < 0.6
            climb = solve_inflow(0.0, w_bl, mu_sq, k.rotor)[1]
            assert thrust[0] == pytest.approx(climb, rel=1e-6)


def test_descent_in_the_vortex_ring_costs_thrust():
    """Blade pitch that carries the weight, sinking with 1.2 v_h; 0.5 deg more than by momentum."""
    p = with_terms("vortex_ring")
    weight = p.mass_kg * p.gravity_mps2

    def collective(aircraft, sinking):
        def lift(d_col):
            x = np.zeros(PLANT.size)
            x[PLANT.servo_col] = d_col
            return rotor_flow(x, (0.0, 0.0, sinking), aircraft.params)[0] - weight

        k = aircraft.params.main
        return k.pitch_gain * brentq(lift, -0.95, 0.6) + k.pitch_offset

    v_h = np.sqrt(weight / p.params.rotor.disc)
    assert collective(p, 1.2 * v_h) > collective(OFF, 1.2 * v_h) + np.radians(0.5)


@pytest.mark.parametrize("name", ["helion", "xcell60", "logo600"])
def test_all_rotor_terms_together_trim_and_stay_there(name):
    """Trim with all four in 5 m/s; residual 1e-9; ten steps of the integrator leave it; 1e-9."""
    aircraft = HelicopterParameters.from_yaml(f"{name}.yaml")
    p = with_terms("flap_back", "inflow", "ground_effect", "vortex_ring", aircraft=aircraft)
    wind = (-3.0, -4.0, 0.0)
    hover = trim(p, wind)
    x, work = hover.x.copy(), np.zeros((WORK_ROWS, PLANT.size))
    x[PLANT.down] = -1000.0
    start = x.copy()
    for _ in range(10):
        rk4_step(x, hover.u, same_air(wind), p.params, 0.002, work)
    assert np.abs(x - start).max() < 1e-9


def test_trim_near_the_ground_takes_the_induced_velocity_of_the_law():
    """Trim at 1.2 m; thrust the same, v_i by Cheeseman and Bennett's power; less pitch."""
    p = with_terms("ground_effect")
    far, near = trim(p).x, trim(p, altitude_m=1.2).x
    near[PLANT.down] = -1.2
    far[PLANT.down] = -1000.0
    (thrust_far, v_far, _, pitch_far), (thrust, v_i, _, pitch) = (
        rotor_flow(x, STILL, p.params) for x in (far, near)
    )
    z = (1.2 + p.hub_height_m) / p.main_radius_m
    law = (1.0 - 1.0 / (4.0 * z) ** 2) ** 1.5
    assert thrust == pytest.approx(thrust_far, rel=2e-3)  # the fuselage meets less downwash
    assert v_i / np.sqrt(thrust) == pytest.approx(law * v_far / np.sqrt(thrust_far), rel=1e-5)
    assert pitch < pitch_far


def test_no_term_makes_a_finite_state_not_finite():
    """2000 random states up to 100 m/s, on the ground, without rotor speed; all finite."""
    rng = np.random.default_rng(1)
    aircraft = [
        replace(OFF, terms=ModelOptions(*(True for _ in ModelOptions._fields))),
        with_terms("vortex_ring", "ground_effect"),
    ]
    for i in range(2000):
        size = 10.0 ** rng.uniform(-6.0, 2.0)
        x = np.zeros(PLANT.size)
        x[PLANT.down] = -rng.uniform(-0.5, 30.0)
        x[PLANT.vel] = rng.normal(0.0, size, 3) if i % 3 else 0.0
        x[PLANT.quat] = rng.normal(size=4)
        x[PLANT.quat] /= np.linalg.norm(x[PLANT.quat])
        x[PLANT.rate] = rng.normal(0.0, min(size, 20.0), 3)
        x[PLANT.rotor] = rng.uniform(-0.5, 0.5, 3)
        x[PLANT.servo] = rng.uniform(-1.0, 1.0, 4)
        x[PLANT.inflow] = rng.normal(0.0, min(size, 30.0), 3)
        x[PLANT.omega] = rng.choice([0.0, 1e-3, 50.0, 194.0, 400.0])
        wind = rng.normal(0.0, size, 3) * (i % 2)
        for p in aircraft:
            assert np.isfinite(state_derivative(x, x[PLANT.servo], wind, p)).all()
