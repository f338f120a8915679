# SPDX-License-Identifier: Apache-2.0
"""Rigid body: closed forms of free motion, conservation laws, NESC check cases, the vertical.

The air is set aside by parameters (`in_vacuum`), the equations are those that fly.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipkinc

from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_dynamics_sim.airframe import make_state
from heli_flight.loop import simulate
from heli_flight.settings import resolve

J = np.array([0.251, 0.548, 0.787])
HIGH = (0.0, 0.0, -1e5)
G = 9.781
FOOT, SLUG = 0.3048, 14.593903
SLUG_FT2 = SLUG * FOOT**2


def elliptic_rates(t, inertia, rates):
    """Body rates of a torque-free body, J1 < J2 < J3, started with all rates >= 0.

    Landau and Lifshitz, Mechanics, par. 37; where M^2 < 2 E J2 the axes 1 and 3 change places.
    """
    energy2, m2 = (inertia * rates**2).sum(), ((inertia * rates) ** 2).sum()
    flip = m2 < energy2 * inertia[1]
    i1, i2, i3 = inertia[::-1] if flip else inertia
    start = rates[::-1] if flip else rates
    size = np.sqrt(
        [
            (energy2 * i3 - m2) / (i1 * (i3 - i1)),
            (energy2 * i3 - m2) / (i2 * (i3 - i2)),
            (m2 - energy2 * i1) / (i3 * (i3 - i1)),
        ]
    )
    speed = np.sqrt((i3 - i2) * (m2 - energy2 * i1) / (i1 * i2 * i3))
    modulus = (i2 - i1) * (energy2 * i3 - m2) / ((i3 - i2) * (m2 - energy2 * i1))
    phase = ellipkinc(np.arctan2(start[1] / size[1], start[0] / size[0]), modulus)
    sn, cn, dn, _ = ellipj(phase + speed * t, modulus)
    sorted_rates = size * [cn, sn, dn]
    return sorted_rates[::-1] if flip else sorted_rates


def independent_attitude(inertia, rates, R_nb, seconds):
    """Rotation matrix and rates after free motion: SciPy's DOP853 on the matrix equations."""

    def slope(_, z):
        R, w = z[:9].reshape(3, 3), z[9:]
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.concatenate([(R @ cross).ravel(), -np.cross(w, inertia * w) / inertia])

    z = np.concatenate([R_nb.ravel(), rates])
    end = solve_ivp(slope, (0.0, seconds), z, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return end[:9].reshape(3, 3), end[9:]


@pytest.fixture(scope="module")
def tumble(vacuum, fly):
    x = make_state(HIGH, 0.3, -0.2, 1.0)
    x[3:6] = 5.0, -3.0, 2.0
    x[10], x[12] = 1.5, 2.0
    return x, fly(x, np.zeros(4), vacuum, 5.0, dt_s=0.0005)


@pytest.mark.parametrize(
    "rates", [(1.5, 0.0, 2.0), (0.3, 1.0, 2.0), (2.5, 0.4, 0.3), (1.0, 2.0, 0.05)]
)
@pytest.mark.parametrize("seconds", [1.0, 5.0])
def test_torque_free_triaxial_body_is_jacobis_solution(vacuum, fly, rates, seconds):
    """Torque-free tri-axial body; Jacobi's elliptic functions, both regimes; 1e-9 rad/s."""
    x = make_state(HIGH)
    x[10:13] = rates
    end = fly(x, np.zeros(4), vacuum, seconds, dt_s=0.0005)
    assert end[10:13] == pytest.approx(elliptic_rates(seconds, J, np.array(rates)), abs=1e-9)


def test_torque_free_attitude_agrees_with_the_matrix_equations(tumble):
    """Attitude of the same body; rotation matrix by DOP853; 1e-9."""
    start, end = tumble
    R, rates = independent_attitude(J, start[10:13], quat_to_R_nb(start[6:10]), 5.0)
    assert quat_to_R_nb(end[6:10]) == pytest.approx(R, abs=1e-9)
    assert end[10:13] == pytest.approx(rates, abs=1e-9)


def test_angular_momentum_and_energy_are_conserved(tumble):
    """Free motion; conservation of R J w, of the rotational energy, of |q|; 1e-9, 1e-9, 1e-15."""
    start, end = tumble
    momentum = [quat_to_R_nb(x[6:10]) @ (J * x[10:13]) for x in (start, end)]
    assert momentum[1] == pytest.approx(momentum[0], abs=1e-9)
    energy = [0.5 * (J * x[10:13] ** 2).sum() for x in (start, end)]
    assert energy[1] == pytest.approx(energy[0], abs=1e-9)
    assert np.linalg.norm(end[6:10]) == pytest.approx(1.0, abs=1e-15)


def test_the_centre_of_gravity_falls_freely(tumble):
    """Tumbling body in gravity; parabola; 1e-6 m and 1e-7 m/s after 5 s, energy to 1e-6 J."""
    start, end = tumble
    velocity = quat_to_R_nb(start[6:10]) @ start[3:6]
    fall = np.array([0.0, 0.0, G])
    assert end[0:3] - start[0:3] == pytest.approx(velocity * 5.0 + fall * 12.5, abs=1e-6)
    assert quat_to_R_nb(end[6:10]) @ end[3:6] == pytest.approx(velocity + fall * 5.0, abs=1e-7)
    gain = 0.5 * (end[3:6] @ end[3:6] - start[3:6] @ start[3:6]) - G * (end[2] - start[2])
    assert gain == pytest.approx(0.0, abs=1e-6)


def test_dropped_sphere_without_drag(in_vacuum, fly):
    """A sphere of 1 slug and 3.6 slug ft2 dropped from 30 000 ft for 30 s.

    In the manner of NASA/TM-2015-218675, atmospheric check case 1. The case has a round, turning
    earth; ours is flat and at rest, so the reference is the parabola, g t^2 / 2; 1e-9 relative.
    """
    inertia = 3.6 * SLUG_FT2
    body = in_vacuum(
        mass_kg=SLUG, inertia_xx_kgm2=inertia, inertia_yy_kgm2=inertia, inertia_zz_kgm2=inertia
    )
    x = make_state((0.0, 0.0, -30_000.0 * FOOT))
    end = fly(x, np.zeros(4), body, 30.0)
    assert end[2] - x[2] == pytest.approx(0.5 * G * 900.0, rel=1e-9)
    assert end[3:6] == pytest.approx([0.0, 0.0, G * 30.0], rel=1e-9, abs=1e-12)
    assert end[0:2] == pytest.approx([0.0, 0.0], abs=1e-20)
    assert end[6:13] == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-20)


def test_tumbling_brick_without_damping(in_vacuum, fly):
    """The brick of NASA/TM-2015-218675, atmospheric check case 2: 10, 20, 30 deg/s for 30 s.

    Mass 0.155404754 slug, inertias 0.00189422, 0.006211019, 0.007194665 slug ft2, from 30 000 ft.
    References on our flat earth: Jacobi's solution for the rates (1e-9 rad/s), DOP853 on the
    rotation matrix (1e-9), the parabola for the fall (1e-6 m).
    """
    inertia = np.array([0.00189422, 0.006211019, 0.007194665]) * SLUG_FT2
    body = in_vacuum(
        mass_kg=0.155404754 * SLUG,
        inertia_xx_kgm2=inertia[0],
        inertia_yy_kgm2=inertia[1],
        inertia_zz_kgm2=inertia[2],
    )
    x = make_state((0.0, 0.0, -30_000.0 * FOOT))
    x[10:13] = np.radians([10.0, 20.0, 30.0])
    end = fly(x, np.zeros(4), body, 30.0)
    assert end[10:13] == pytest.approx(elliptic_rates(30.0, inertia, x[10:13]), abs=1e-9)
    R, _ = independent_attitude(inertia, x[10:13], np.eye(3), 30.0)
    assert quat_to_R_nb(end[6:10]) == pytest.approx(R, abs=1e-9)
    assert end[0:3] - x[0:3] == pytest.approx([0.0, 0.0, 0.5 * G * 900.0], abs=1e-6)


@pytest.mark.parametrize("angle", [np.pi / 2, 2.0, 2 * np.pi])
def test_pitching_to_and_through_the_vertical(vacuum, fly, angle):
    """Constant pitch rate to, across and beyond theta = 90 deg; rotation about y; 1e-11."""
    x = make_state(HIGH)
    x[11] = 1.0
    end = fly(x, np.zeros(4), vacuum, angle, dt_s=angle / 1000)
    c, s = np.cos(angle), np.sin(angle)
    assert quat_to_R_nb(end[6:10]) == pytest.approx(
        np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), abs=1e-11
    )


@pytest.mark.parametrize("theta", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("rates", [(0.7, 0.0, 0.0), (0.0, 0.0, 0.7), (0.5, -0.4, 0.8)])
def test_turning_about_any_axis_at_the_vertical(in_vacuum, fly, theta, rates):
    """A spherical body at theta = +-90 deg, where Euler rates are infinite; R0 exp(w t); 1e-11."""
    body = in_vacuum(inertia_xx_kgm2=0.5, inertia_yy_kgm2=0.5, inertia_zz_kgm2=0.5)
    x = make_state(HIGH, 0.3, theta, -0.4)
    x[10:13] = rates
    end = fly(x, np.zeros(4), body, 1.5)
    expected = quat_to_R_nb(x[6:10]) @ Rotation.from_rotvec(np.multiply(rates, 1.5)).as_matrix()
    assert quat_to_R_nb(end[6:10]) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("seconds", [60.0, pytest.param(3600.0, marks=pytest.mark.nightly)])
def test_quaternion_norm_in_flight(seconds):
    """Norm over an hour of hover in turbulence (60 s in CI); 1; 1e-15 * 4 in plant and filter."""
    flight = simulate(resolve("hover", seed=1, duration_s=seconds))
    assert flight.sentence == ""
    for q in (flight.record.truth_q_nb, flight.record.nav_q_nb):
        assert q.shape[0] == round(seconds * 100)
        assert np.abs(np.linalg.norm(q, axis=1) - 1.0).max() <= 4e-15


def test_cardinal_directions(vacuum, fly):
    """Nose east, moving forward: east. Rolled right by 90 deg: gravity pulls to the right; 1e-9."""
    x = make_state(HIGH, 0.0, 0.0, np.pi / 2)
    x[3] = 10.0
    end = fly(x, np.zeros(4), vacuum, 0.1)
    assert end[0:2] == pytest.approx([0.0, 1.0], abs=1e-9)
    x = make_state(HIGH)
    x[6:10] = quat_from_euler(np.pi / 2, 0.0, 0.0)
    end = fly(x, np.zeros(4), vacuum, 0.1)
    assert end[3:6] == pytest.approx([0.0, 0.9781, 0.0], abs=1e-9)
