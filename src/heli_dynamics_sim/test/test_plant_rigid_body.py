# SPDX-License-Identifier: Apache-2.0
"""Rigid body: torque-free motion against Jacobi's elliptic functions, conservation, free fall."""

import numpy as np
import pytest
from scipy.special import ellipj

from heli_dynamics_sim.state import make_state
from heli_math.rotations import quat_from_euler, quat_to_R_nb

J = np.array([0.251, 0.548, 0.787])
HIGH = (0.0, 0.0, -1e5)


def elliptic_rates(t, p0, r0):
    """Body rates of a torque-free body started with q = 0; Landau-Lifshitz, Mechanics, par. 37."""
    i1, i2, i3 = J
    energy2 = i1 * p0**2 + i3 * r0**2
    m2 = (i1 * p0) ** 2 + (i3 * r0) ** 2
    assert m2 > energy2 * i2
    tau = t * np.sqrt((i3 - i2) * (m2 - energy2 * i1) / (i1 * i2 * i3))
    modulus = (i2 - i1) * (energy2 * i3 - m2) / ((i3 - i2) * (m2 - energy2 * i1))
    sn, cn, dn, _ = ellipj(tau, modulus)
    return np.array(
        [
            np.sqrt((energy2 * i3 - m2) / (i1 * (i3 - i1))) * cn,
            np.sqrt((energy2 * i3 - m2) / (i2 * (i3 - i2))) * sn,
            np.sqrt((m2 - energy2 * i1) / (i3 * (i3 - i1))) * dn,
        ]
    )


@pytest.fixture(scope="module")
def tumble(vacuum, fly):
    x = make_state(HIGH, 0.3, -0.2, 1.0)
    x[3:6] = 5.0, -3.0, 2.0
    x[10], x[12] = 1.5, 2.0
    return x, fly(x, np.zeros(4), vacuum, 5.0, dt_s=0.0005)


def test_torque_free_rates_are_elliptic_functions(tumble):
    _, end = tumble
    assert end[10:13] == pytest.approx(elliptic_rates(5.0, 1.5, 2.0), abs=1e-9)


def test_angular_momentum_and_energy_are_conserved(tumble):
    start, end = tumble
    momentum = [quat_to_R_nb(x[6:10]) @ (J * x[10:13]) for x in (start, end)]
    assert momentum[1] == pytest.approx(momentum[0], abs=1e-9)
    energy = [0.5 * (J * x[10:13] ** 2).sum() for x in (start, end)]
    assert energy[1] == pytest.approx(energy[0], abs=1e-9)
    assert np.linalg.norm(end[6:10]) == pytest.approx(1.0, abs=1e-15)


def test_the_centre_of_gravity_falls_freely(tumble):
    start, end = tumble
    velocity = quat_to_R_nb(start[6:10]) @ start[3:6]
    fall = np.array([0.0, 0.0, 9.781])
    assert end[0:3] - start[0:3] == pytest.approx(velocity * 5.0 + fall * 12.5, abs=1e-6)
    assert quat_to_R_nb(end[6:10]) @ end[3:6] == pytest.approx(velocity + fall * 5.0, abs=1e-7)


@pytest.mark.parametrize("angle", [np.pi / 2, 2.0, 2 * np.pi])
def test_pitching_through_the_vertical(vacuum, fly, angle):
    x = make_state(HIGH)
    x[11] = 1.0
    end = fly(x, np.zeros(4), vacuum, angle, dt_s=angle / 1000)
    c, s = np.cos(angle), np.sin(angle)
    assert quat_to_R_nb(end[6:10]) == pytest.approx(
        np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), abs=1e-11
    )


def test_cardinal_directions(vacuum, fly):
    """Nose east, moving forward: east. Rolled right by 90 deg, gravity pulls to the right."""
    x = make_state(HIGH, 0.0, 0.0, np.pi / 2)
    x[3] = 10.0
    end = fly(x, np.zeros(4), vacuum, 0.1)
    assert end[0:2] == pytest.approx([0.0, 1.0], abs=1e-9)
    x = make_state(HIGH)
    x[6:10] = quat_from_euler(np.pi / 2, 0.0, 0.0)
    end = fly(x, np.zeros(4), vacuum, 0.1)
    assert end[3:6] == pytest.approx([0.0, 0.9781, 0.0], abs=1e-9)
