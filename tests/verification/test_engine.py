# SPDX-License-Identifier: Apache-2.0
"""Rotor speed, engine, governor and fuel against momentum theory, balances and closed forms.

The formulas are written here a second time, from momentum theory (Leishman, Principles of
Helicopter Aerodynamics, ch. 2) and mechanics; nothing is shared with the package but parameters.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from heli_core.rows import NINE, PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters, ModelOptions
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.helicopter import derivative_kernel, same_air, specific_force
from heli_dynamics_sim.trim import TrimError, linearize, trim

ON = ModelOptions(rotor_speed=True)
VERTICAL = (PLANT.w, PLANT.omega, PLANT.governor, PLANT.engine)
"""States of the aircraft on a vertical line."""
HIGH = (0.0, 0.0, -1e4)
MAX_W, KP, J = 0.95 * 2200.0, 0.01, 0.1375


@pytest.fixture(scope="module")
def bare(helicopter):
    """The default aircraft with the term, without fuselage download, fins and feed-forward."""
    return replace(helicopter, terms=ON, drag_area_z_m2=0.0, hfin_area_m2=0.0,
                   governor_feed_forward=0.0)  # fmt: skip


@pytest.fixture(scope="module")
def on(helicopter):
    return replace(helicopter, terms=ON)


def line(aircraft, x0, d_col):
    """f(t, z): derivative of the vertical motion alone, from a state, collective held."""
    air, out, u = same_air(np.zeros(3)), np.empty(PLANT.size), np.zeros(4)
    x0 = x0.copy()
    x0[PLANT.down], x0[PLANT.servo_col] = -1e4, d_col

    def rates(_, z):
        x = x0.copy()
        x[list(VERTICAL)] = z
        derivative_kernel(x, u, air, aircraft.params, out)
        return out[list(VERTICAL)]

    return rates


def vertical(aircraft, x0, seconds, d_col):
    """Solution (VERTICAL over time) of the vertical motion alone."""
    start = x0[list(VERTICAL)]
    rates = line(aircraft, x0, d_col)
    return solve_ivp(rates, (0.0, seconds), start, rtol=1e-9, atol=1e-9, dense_output=True)


def settled(aircraft, x0, seconds, d_col, step=0.01):
    """VERTICAL after so long, by fixed steps: at a stop the governor's integrator switches."""
    z, f = x0[list(VERTICAL)], line(aircraft, x0, d_col)
    for _ in range(round(seconds / step)):
        middle = z + 0.5 * step * f(0.0, z)
        z = z + step * f(0.0, middle)
    return z


def momentum(rho, blade, omega, pitch, through, along=0.0):
    """(T, v_i, P) of a rotor in air that comes through its disc from above and along it, m/s."""
    radius, chord, blades, slope, drag = blade
    solidity = rho * omega * radius**2 * blades * chord
    disc = rho * np.pi * radius**2

    def mismatch(v):
        lift = solidity * slope / 4 * (2 / 3 * omega * radius * pitch - through - v)
        return 2 * disc * v * np.hypot(through + v, along) - lift

    v = brentq(mismatch, 0.0, 50.0, xtol=1e-14)
    thrust = 2 * disc * v * np.hypot(through + v, along)
    profile = solidity * drag / 8 * ((omega * radius) ** 2 + 4.6 * along**2)
    return thrust, v, thrust * (through + v) + profile


def rotors(p, omega, d_col, tail_pitch, climb):
    """(T, v_i, power of both rotors) on a vertical line."""
    main = (p.main_radius_m, p.main_chord_m, p.main_blades, p.main_lift_slope,
            p.main_drag_coefficient)  # fmt: skip
    pitch = p.collective_gain_rad * d_col + p.collective_offset_rad
    thrust, v, power = momentum(p.air_density_kgpm3, main, omega, pitch, climb)
    return thrust, v, power + tail_power(p, omega, tail_pitch, climb)


def tail_power(p, omega, pitch, along):
    """Power (W) of the tail rotor at the main rotor's speed, in air along its disc."""
    tail = (p.tail_radius_m, p.tail_chord_m, p.tail_blades, p.tail_lift_slope,
            p.tail_drag_coefficient)  # fmt: skip
    return momentum(p.air_density_kgpm3, tail, omega * p.tail_gear_ratio, pitch, 0.0, along)[2]


def tail_pitch_of(p, x):
    output = p.gyro_integral * x[PLANT.d_int]
    return p.pedal_gain * output + p.pedal_offset_rad


def test_governor_keeps_its_speed_and_the_engine_gives_what_the_rotors_take(bare):
    """Trim: governed speed, power of both rotors by momentum theory; 1e-9 of it."""
    hover = trim(bare)
    x = hover.x
    assert x[PLANT.omega] == bare.main_speed_radps
    level = replace(bare, hub_height_m=1e-6)  # the tail pushes, so the disc is never level
    thrust, _, power = rotors(
        level, x[PLANT.omega], x[PLANT.servo_col], tail_pitch_of(bare, x), 0.0
    )
    assert MAX_W * x[PLANT.engine] == pytest.approx(power, rel=1e-4)
    assert thrust == pytest.approx(9.75 * 9.781, rel=2e-3)
    assert bare.governor_integral * x[PLANT.governor] == pytest.approx(x[PLANT.engine], rel=1e-9)


@pytest.mark.parametrize("step", [-0.05, -0.1])
def test_speed_droops_in_a_climb_by_the_power_over_the_gain(bare, step):
    """Governor with its integral held. Steady climb after a step of the collective: thrust is
    weight, and eta P_max K_p (droop) is the power above hover, by momentum theory; 1e-6 of both."""
    held = replace(bare, governor_integral=1e-12)
    x = trim(bare).x.copy()
    x[PLANT.governor] = x[PLANT.engine] / held.governor_integral
    hover = MAX_W * x[PLANT.engine]
    x[PLANT.a_s] = x[PLANT.b_s] = 0.0
    x[PLANT.quat] = 1.0, 0.0, 0.0, 0.0
    d_col = x[PLANT.servo_col] + step
    w, omega, _, engine = vertical(held, x, 60.0, d_col).y[:, -1]
    assert w < -0.5
    thrust, _, power = rotors(held, omega, d_col, tail_pitch_of(held, x), -w)
    assert thrust == pytest.approx(9.75 * 9.781, rel=1e-6)
    droop = held.main_speed_radps - omega
    assert droop > 0.5
    assert hover + MAX_W * KP * droop == pytest.approx(power, rel=1e-6)
    assert engine == pytest.approx(power / MAX_W, rel=1e-6)


def test_power_of_a_slow_climb_grows_by_half_the_weight_per_speed(bare):
    """Momentum theory, constant thrust: dP/dV = W/2 at V = 0; 0.5 %."""
    p, h = bare, 0.02
    weight = p.mass_kg * p.gravity_mps2

    def needed(climb):
        def excess(d_col):
            return rotors(p, p.main_speed_radps, d_col, 0.0, climb)[0] - weight

        d_col = brentq(excess, -0.9, 0.3)
        x = make_state(HIGH)
        x[PLANT.w], x[PLANT.servo_col], x[PLANT.omega] = -climb, d_col, p.main_speed_radps
        out = np.empty(PLANT.size)
        derivative_kernel(x, np.zeros(4), same_air(np.zeros(3)), p.params, out)
        return -out[PLANT.omega] * J * p.main_speed_radps

    assert (needed(h) - needed(0.0)) / h == pytest.approx(weight / 2, rel=5e-3)


def test_the_governor_feeds_forward_what_hover_takes_per_pitch(on):
    """dP/dtheta of the main rotor at hover's thrust, by differences of momentum theory; 1e-5."""
    p, h = replace(on, tail_drag_coefficient=0.0), 1e-4
    weight = p.mass_kg * p.gravity_mps2

    def hover(d_col, pitch=0.0):
        return rotors(p, p.main_speed_radps, d_col, pitch, 0.0)

    d_col = brentq(lambda d: hover(d)[0] - weight, -0.9, 0.3, xtol=1e-14)
    slope = (hover(d_col - h)[2] - hover(d_col + h)[2]) / (2.0 * h * 0.165)
    assert MAX_W * p.params.engine.feed_forward == pytest.approx(slope, rel=1e-5)


def test_a_climb_beyond_the_engine_droops_until_power_is_enough(bare):
    """An engine of 1.2 kW; it gives all it has, and speed and climb settle where that is enough."""
    small = replace(bare, engine_power_w=1200.0)
    x = trim(small).x
    d_col = x[PLANT.servo_col] - 0.35
    w, omega, _, engine = settled(small, x, 30.0, d_col)
    _, _, power = rotors(small, omega, d_col, tail_pitch_of(small, x), max(-w, 0.0))
    assert engine == pytest.approx(1.0, abs=1e-4)
    assert power == pytest.approx(0.95 * 1200.0, rel=1e-4)
    assert omega < 0.97 * small.main_speed_radps


def test_energy_of_engine_is_that_of_motion_and_what_the_air_takes(bare):
    """Step of the collective, 6 s. Energy from the engine = change of kinetic and potential energy
    of aircraft and rotors + induced, profile and tail power by momentum theory; 1e-5 of it."""
    x = trim(bare).x.copy()
    x[PLANT.a_s] = x[PLANT.b_s] = 0.0
    x[PLANT.quat] = 1.0, 0.0, 0.0, 0.0
    d_col = x[PLANT.servo_col] - 0.08
    flown = vertical(bare, x, 6.0, d_col)
    t = np.linspace(0.0, 6.0, 6001)
    w, omega, _, engine = flown.sol(t)
    pitch = tail_pitch_of(bare, x)
    taken = []
    for climb, speed in zip(-w, omega, strict=True):
        thrust, _, power = rotors(bare, speed, d_col, pitch, climb)
        taken.append(power - thrust * climb)
    kinetic = 0.5 * 9.75 * w**2 + 0.5 * J * omega**2
    gained = kinetic[-1] - kinetic[0] - 9.75 * 9.781 * np.trapezoid(w, t)
    supplied = MAX_W * np.trapezoid(engine, t)
    assert -w[-1] > 1.0
    assert supplied == pytest.approx(gained + np.trapezoid(taken, t), rel=1e-5)


def test_angular_momentum_about_the_shaft_is_kept(on):
    """No air: what the engine spins up turns the fuselage the other way; 1e-9."""
    empty = replace(on, air_density_kgpm3=1e-30)
    x, out = make_state(HIGH), np.empty(PLANT.size)
    x[PLANT.omega], x[PLANT.engine] = 190.0, 0.4
    derivative_kernel(x, np.zeros(4), same_air(np.zeros(3)), empty.params, out)
    assert out[PLANT.omega] == pytest.approx(MAX_W * 0.4 / 190.0 / J, rel=1e-12)
    main = 2 * 0.055 * out[PLANT.omega]
    assert 0.787 * out[PLANT.r] == pytest.approx(-main, rel=1e-9)


def test_a_failed_engine_leaves_the_rotor_to_its_profile_drag(bare):
    """Flat pitch, no thrust: dOmega/dt = -c Omega^2, a hyperbola over time; 1e-6."""
    x = make_state(HIGH)
    x[PLANT.omega], x[PLANT.engine], x[PLANT.engine_out] = 190.0, 0.5, 1.0
    flat = 0.075 / 0.165
    still = replace(bare, pedal_offset_rad=1e-12, gravity_mps2=1e-9)
    omega = vertical(still, x, 2.0, flat).y[1, -1]
    profile = (
        1.29 * 0.01 / 8 * 2 * (0.062 * 0.705**4 + 0.029 * 0.128**4 * 4.65**3)
    )  # P = profile Omega^3
    assert omega == pytest.approx(190.0 / (1 + profile / J * 190.0 * 2.0), rel=1e-6)


def test_without_engine_and_air_the_freewheel_keeps_the_speed(on):
    empty = replace(on, air_density_kgpm3=1e-30)
    x = make_state(HIGH)
    x[PLANT.omega], x[PLANT.engine], x[PLANT.engine_out] = 150.0, 0.7, 1.0
    assert vertical(empty, x, 1.0, 0.0).y[1, -1] == pytest.approx(150.0, abs=1e-12)


def test_the_air_drives_the_rotor_in_a_steady_descent(bare):
    """Engine out, collective low: rotor speed and sink settle, thrust is weight, and the power of
    the air through the disc, T (V - v_i), is profile and tail power; 1e-6. The sink is 1.5 to 2.6
    times the induced velocity of hover, as rotors autorotate (Leishman, ch. 2 and 5)."""
    x = trim(bare).x.copy()
    x[PLANT.engine_out] = 1.0
    x[PLANT.a_s] = x[PLANT.b_s] = 0.0
    x[PLANT.quat] = 1.0, 0.0, 0.0, 0.0
    d_col = 0.25
    w, omega, _, _ = vertical(bare, x, 60.0, d_col).y[:, -1]
    weight = 9.75 * 9.781
    v_h = np.sqrt(weight / (2 * 1.29 * np.pi * 0.705**2))
    assert 1.5 < w / v_h < 2.6
    assert 120.0 < omega < 300.0
    pitch = -0.165 * d_col + 0.075
    # thrust is weight: the flow through the disc follows from the blades alone
    v_i = (
        w
        + 2 / 3 * omega * 0.705 * pitch
        - weight / (1.29 * omega * 0.705**2 * 5.52 * 2 * 0.062 / 4)
    )
    profile = 1.29 * omega**3 * 0.705**4 * 0.01 * 2 * 0.062 / 8
    tail = tail_power(bare, omega, tail_pitch_of(bare, x), w)
    assert weight * (w - v_i) == pytest.approx(profile + tail, rel=1e-6)


def test_with_the_term_the_linear_model_is_that_of_a_perfect_governor(helicopter, on):
    """Trim attitude and linear model agree with the source's where no power of climb enters."""
    a, b = (linearize(p, trim(p)) for p in (helicopter, on))
    assert b.x_trim == pytest.approx(a.x_trim, abs=2e-3)
    assert b.A[:6, :6] == pytest.approx(a.A[:6, :6], rel=1e-2, abs=1e-2)
    # E(r, w): no kink, near the climb side of the source's (0.021; 0.646 in descent)
    assert b.E[NINE.r, 2] == pytest.approx(0.02, abs=0.01)
    assert linearize(on, trim(on), side="climb").E == pytest.approx(b.E, abs=1e-9)


def test_trim_refuses_an_engine_that_is_too_weak(on):
    with pytest.raises(TrimError, match="no trim"):
        trim(replace(on, engine_power_w=500.0))


def test_fuel_is_what_the_engine_burns(helicopter):
    """1 min of hover power at a fixed state: 5e-7 kg/J of the engine's own power; 1e-9."""
    aircraft = replace(helicopter, terms=ModelOptions(rotor_speed=True, fuel=True))
    x, out = trim(aircraft).x.copy(), np.empty(PLANT.size)
    x[PLANT.down] = -1e4
    derivative_kernel(x, np.zeros(4), same_air(np.zeros(3)), aircraft.params, out)
    assert out[PLANT.fuel] == pytest.approx(5e-7 * 2200.0 * x[PLANT.engine], rel=1e-9)
    x[PLANT.fuel] = 0.5
    derivative_kernel(x, np.zeros(4), same_air(np.zeros(3)), aircraft.params, out)
    assert out[PLANT.fuel] == 0.0
    assert out[PLANT.omega] < -10.0  # the tank is empty, the engine stands


@pytest.mark.parametrize("burnt", [0.1, 0.4])
def test_burnt_fuel_makes_the_aircraft_lighter_and_drifts_its_trim(helicopter, burnt):
    """With so much burnt the aircraft rests in the trim of one that is so much lighter; 1e-9."""
    aircraft = replace(helicopter, terms=ModelOptions(fuel=True))
    light = trim(replace(helicopter, mass_kg=9.75 - burnt))
    x, out = light.x.copy(), np.empty(PLANT.size)
    x[PLANT.down], x[PLANT.fuel] = -1e4, burnt
    derivative_kernel(x, light.u, same_air(np.zeros(3)), aircraft.params, out)
    assert np.abs(out[PLANT.vel]).max() < 1e-9
    assert light.u[3] > trim(aircraft).u[3]  # up is negative: less collective
    force = np.empty(3)
    specific_force(x, same_air(np.zeros(3)), aircraft.params, force)
    assert np.linalg.norm(force) == pytest.approx(9.781, abs=1e-9)


def test_a_battery_keeps_its_mass(helicopter):
    electric = replace(
        HelicopterParameters.from_yaml("logo600.yaml"),
        terms=ModelOptions(*(True for _ in ModelOptions._fields)),
    )
    x, out = trim(electric).x, np.empty(PLANT.size)
    derivative_kernel(x, np.zeros(4), same_air(np.zeros(3)), electric.params, out)
    assert out[PLANT.fuel] == 0.0
    assert 0.1 < x[PLANT.engine] < 0.9


@pytest.mark.parametrize("share", [1.0, 0.95, 0.9, 0.899, 0.83, 0.7, 0.4, 0.1])
def test_no_speed_of_the_rotor_makes_the_disc_diverge(on, share):
    """Two by two of the flapping by differences: stable; couplings as 1/Omega down to 0.9."""
    point = trim(on)
    x = point.x.copy()
    x[PLANT.pos], x[PLANT.omega] = HIGH, share * x[PLANT.omega]
    air, u, out = same_air(np.zeros(3)), point.u, [np.empty(PLANT.size) for _ in range(2)]
    disc = [PLANT.a_s, PLANT.b_s]
    jacobian = np.empty((2, 2))
    for column, place in enumerate(disc):
        for sign, filled in zip((1.0, -1.0), out, strict=True):
            moved = x.copy()
            moved[place] += sign * 1e-4
            derivative_kernel(moved, u, air, on.params, filled)
        jacobian[:, column] = (out[0] - out[1])[disc] / 2e-4
    assert np.linalg.eigvals(jacobian).real.max() < 0.0
    flapping = on.params.flapping
    law = share if share >= 0.9 else 0.81 / share
    np.testing.assert_allclose(jacobian[0, 1], flapping.a_bs / law, rtol=1e-6)
    np.testing.assert_allclose(jacobian[1, 0], flapping.b_as / law, rtol=1e-6)
    np.testing.assert_allclose(np.diag(jacobian), -flapping.rate * share, rtol=1e-6)
