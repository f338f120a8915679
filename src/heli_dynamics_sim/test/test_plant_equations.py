# SPDX-License-Identifier: Apache-2.0
"""The whole derivative against a second, plain implementation of the source's equations.

Written from Cai, Chen, Lee (2011), ch. 6 with vectors and matrices, the inflow by bracketing
on the printed law; no code is shared with the package but the parameters.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_core.rows import PLANT
from heli_dynamics_sim.helicopter import same_air, specific_force, state_derivative


def rotation(q):
    """Body to NED: the matrix of v -> q v q*."""
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def rotor(p, blade, w_r, in_plane_sq, pitch):
    """(T, v_i) by bisection on the printed pair of laws, thrust up."""
    omega, radius, chord, number, slope = blade
    rho = p.air_density_kgpm3
    w_bl = w_r + 2 / 3 * omega * radius * pitch

    def thrust(v_i):
        return rho * omega * radius**2 * slope * number * chord / 4 * (w_bl - v_i)

    def mismatch(v_i):
        v2 = in_plane_sq + w_r * (w_r - 2 * v_i)
        t = thrust(v_i) / (2 * rho * np.pi * radius**2)
        return v_i**2 - (np.sqrt((v2 / 2) ** 2 + t**2) - v2 / 2)

    v_i = brentq(mismatch, 0.0, w_bl, xtol=1e-15, rtol=1e-14)
    return thrust(v_i), v_i


def fin(p, area, slope, across, u_a):
    rho = p.air_density_kgpm3
    ratio = abs(across) / abs(u_a)
    attached = -rho / 2 * slope * area * across * abs(u_a)
    stalled = -rho / 2 * area * across * abs(across)
    if ratio <= 0.3:
        return attached
    if ratio >= 0.6:
        return stalled
    s = (ratio - 0.3) / 0.3
    return (1 - (3 * s**2 - 2 * s**3)) * attached + (3 * s**2 - 2 * s**3) * stalled


def loads(p, airs, rates, a_s, b_s, d_col, tail_pitch):
    """Force and moment of the air, body; airs: what main rotor, tail and fuselage meet."""
    (ua, va, wa), (ut, vt, wt), (uf, vf, wf) = airs
    pp, q, r = rates
    rho, omega, radius = p.air_density_kgpm3, p.main_speed_radps, p.main_radius_m
    main = (omega, radius, p.main_chord_m, p.main_blades, p.main_lift_slope)
    pitch = p.collective_gain_rad * d_col + p.collective_offset_rad
    T, v_i = rotor(p, main, wa + a_s * ua - b_s * va, ua**2 + va**2, pitch)
    tail = (omega * p.tail_gear_ratio, p.tail_radius_m, p.tail_chord_m, p.tail_blades,
            p.tail_lift_slope)  # fmt: skip
    D, H = p.tail_arm_m, p.tail_height_m
    T_tr, _ = rotor(p, tail, vt - r * D + pp * H, (wt + q * D) ** 2 + ut**2, tail_pitch)
    wf = wf - v_i
    X = -rho / 2 * p.drag_area_x_m2 * uf * max(v_i, abs(uf))
    Y = -rho / 2 * vf * np.hypot(p.wash_area_y_m2 * v_i, p.drag_area_y_m2 * vf)
    Z = -rho / 2 * p.drag_area_z_m2 * wf * max(v_i, abs(wf))
    side = fin(p, p.vfin_area_m2, p.vfin_lift_slope, vt - r * p.vfin_arm_m, ut)
    lift = fin(p, p.hfin_area_m2, p.hfin_lift_slope, wt + q * p.hfin_arm_m - v_i, ut)
    blades = p.main_drag_coefficient * p.main_blades * p.main_chord_m
    power = rho * omega * radius**2 * blades / 8 * ((omega * radius) ** 2 + 4.6 * (ua**2 + va**2))
    power += T * v_i + abs(X * uf) + abs(Y * vf) + abs(Z * wf)
    if wa < 0:
        power += -p.mass_kg * p.gravity_mps2 * wa
    rotor_force = np.array([-T * np.sin(a_s), T * np.sin(b_s), -T * np.cos(a_s) * np.cos(b_s)])
    points = (  # force, where it acts
        (np.array([X, Y, Z]), np.zeros(3)),
        (np.array([0, -T_tr, 0]), np.array([-D, 0, -H])),
        (np.array([0, side, 0]), np.array([-p.vfin_arm_m, 0, -p.vfin_height_m])),
        (np.array([0, 0, lift]), np.array([-p.hfin_arm_m, 0, 0])),
    )
    force = rotor_force + sum(f for f, _ in points)
    moment = sum(np.cross(where, f) for f, where in points)
    hub = p.hub_stiffness_nmprad + T * p.hub_height_m
    return force, moment + [hub * np.sin(b_s), hub * np.sin(a_s), -power / omega]


def derivative(p, x, u, wind):
    R = rotation(x[6:10])
    rates, d_int = x[10:13], x[15]
    J = np.diag([p.inertia_xx_kgm2, p.inertia_yy_kgm2, p.inertia_zz_kgm2])
    error = p.gyro_pedal_gain_radps * x[18] - rates[2]
    pitch = p.pedal_gain * (p.gyro_proportional_s * error + p.gyro_integral * d_int)
    airs = [x[3:6] - R.T @ w for w in np.resize(wind, (3, 3))]
    force, moment = loads(p, airs, rates, x[13], x[14], x[19], pitch + p.pedal_offset_rad)
    omega = np.block([[np.zeros(1), -rates], [rates[:, None], -np.cross(np.eye(3), -rates).T]])
    lateral, longitudinal, tau = x[16], x[17], p.flap_time_constant_s
    theta_a = p.flap_lon_from_lon_rad * longitudinal + p.flap_lon_from_lat_rad * lateral
    theta_b = p.flap_lat_from_lat_rad * lateral + p.flap_lat_from_lon_rad * longitudinal
    wn, zeta = p.servo_bandwidth_radps, p.servo_damping
    return np.concatenate([
        R @ x[3:6],
        force / p.mass_kg + R.T @ [0, 0, p.gravity_mps2] - np.cross(rates, x[3:6]),
        0.5 * omega @ x[6:10],
        np.linalg.solve(J, moment - np.cross(rates, J @ rates)),
        [-rates[1] - x[13] / tau + p.flap_a_bs_per_s * x[14] + theta_a / tau],
        [-rates[0] - x[14] / tau + p.flap_b_as_per_s * x[13] + theta_b / tau],
        [error],
        x[20:24],
        wn**2 * (u - x[16:20]) - 2 * zeta * wn * x[20:24],
        np.zeros(PLANT.size - 24),
    ])  # fmt: skip


def random_case(rng):
    """A state in brisk flight, thrust of both rotors up, outside the vortex ring."""
    x = np.zeros(PLANT.size)
    x[0:3] = rng.normal(0, 10, 3) - [0, 0, 1000]
    x[3:6] = rng.normal(0, 3, 3) * [1, 0.7, 0.5]
    x[6:10] = rng.normal(0, 1, 4)
    x[6:10] /= np.linalg.norm(x[6:10])
    x[10:13] = rng.normal(0, 0.6, 3)
    x[13:15] = rng.normal(0, 0.05, 2)
    x[15] = rng.normal(0, 0.01)
    x[16:20] = rng.normal(0, 0.05, 4) - [0, 0, 0, 0.2]
    x[20:24] = rng.normal(0, 0.5, 4)
    return x, x[16:20] + rng.normal(0, 0.1, 4), rng.normal(0, 1.5, 3)


@pytest.mark.parametrize("seed", range(60))
def test_every_derivative_agrees(helicopter, seed):
    x, u, wind = random_case(np.random.default_rng(seed))
    expected = derivative(helicopter, x, u, wind)
    assert state_derivative(x, u, wind, helicopter) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_every_derivative_agrees_with_other_air_at_each_part(helicopter, seed):
    """Main rotor, tail and fuselage in air of their own; the air does not turn."""
    rng = np.random.default_rng(seed)
    x, u, wind = random_case(rng)
    air = np.concatenate([np.tile(wind, 3) + rng.normal(0, 0.2, 9), np.zeros(3)])
    expected = derivative(helicopter, x, u, air[:9])
    assert state_derivative(x, u, air, helicopter) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_air_that_turns_tilts_the_disc_and_nothing_else(helicopter):
    x, u, wind = random_case(np.random.default_rng(98))
    air = same_air(wind)
    still = state_derivative(x, u, air, helicopter)
    assert still.tobytes() == state_derivative(x, u, wind, helicopter).tobytes()
    air[9:12] = 0.4, -0.3, 0.2
    changed = state_derivative(x, u, air, helicopter) - still
    pull = np.array([0.4, 0.3]) / helicopter.main_speed_radps / helicopter.flap_time_constant_s
    assert changed[13:15] == pytest.approx(pull, abs=1e-12)
    assert not np.delete(changed, [13, 14]).any()


def test_air_of_another_length_is_refused(helicopter):
    with pytest.raises(ValueError, match=r"wind_ned_mps .*\(4,\).*\(3,\)"):
        state_derivative(np.zeros(PLANT.size), np.zeros(4), np.zeros(4), helicopter)


def test_specific_force_is_acceleration_without_gravity(helicopter):
    x, u, wind = random_case(np.random.default_rng(99))
    rates = state_derivative(x, u, wind, helicopter)
    felt = rates[3:6] + np.cross(x[10:13], x[3:6]) - rotation(x[6:10]).T @ [0, 0, 9.781]
    out = np.zeros(3)
    specific_force(x, same_air(wind), helicopter.params, out)
    assert out == pytest.approx(felt, abs=1e-10)
