# SPDX-License-Identifier: Apache-2.0
"""Rotations against SciPy's, by cardinal cases, and at the singularity."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core import atmosphere, rotations


def scipy_rotation(q):
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


@pytest.fixture
def quaternions():
    rng = np.random.default_rng(1)
    q = rng.standard_normal((200, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


def test_matrix_and_product_agree_with_scipy(quaternions):
    for a, b in zip(quaternions[:-1], quaternions[1:], strict=True):
        R = rotations.quat_to_R_nb(a)
        np.testing.assert_allclose(R, scipy_rotation(a).as_matrix(), atol=1e-14)
        product = rotations.quat_to_R_nb(rotations.quat_multiply(a, b))
        np.testing.assert_allclose(product, R @ rotations.quat_to_R_nb(b), atol=1e-14)


def test_euler_angles_agree_with_scipy_and_return(quaternions):
    for q in quaternions:
        psi, theta, phi = scipy_rotation(q).as_euler("ZYX")
        np.testing.assert_allclose(rotations.euler_from_quat(q), (phi, theta, psi), atol=1e-12)
        back = rotations.quat_from_euler(phi, theta, psi)
        assert abs(abs(back @ q) - 1.0) < 1e-14


def test_paper_row_one_is_nose_direction():
    """Eq. (2), corrected: row 1 of NED -> body is [c_th c_ps, c_th s_ps, -s_th]."""
    theta, psi = 0.3, -2.0
    R_bn = rotations.quat_to_R_nb(rotations.quat_from_euler(0.7, theta, psi)).T
    expected = [
        math.cos(theta) * math.cos(psi),
        math.cos(theta) * math.sin(psi),
        -math.sin(theta),
    ]
    np.testing.assert_allclose(R_bn[0], expected, atol=1e-15)


@pytest.mark.parametrize("theta", [math.pi / 2, -math.pi / 2])
def test_euler_at_gimbal_lock_reproduces_the_rotation(theta):
    q = rotations.quat_from_euler(0.4, theta, 1.1)
    again = rotations.quat_from_euler(*rotations.euler_from_quat(q))
    assert abs(abs(again @ q) - 1.0) < 1e-12


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1e-5, 9.9e-5, 1.01e-4, 0.1, 3.0])
def test_rotation_vector_is_exact_across_the_series_branch(scale):
    v = scale * np.array([0.6, -0.48, 0.64])
    expected = Rotation.from_rotvec(v).as_quat()[[3, 0, 1, 2]]
    quat = np.empty(4)
    rotations.fill_from_rotvec(v, quat)
    np.testing.assert_allclose(quat, expected, atol=1e-16, rtol=1e-14)


def test_wrap_crosses_plus_minus_180_degrees():
    for turns in range(-3, 4):
        assert rotations.wrap_pi(0.5 + 2 * math.pi * turns) == pytest.approx(0.5, abs=1e-14)
    assert rotations.wrap_pi(math.radians(181.0)) == pytest.approx(math.radians(-179.0))
    assert rotations.wrap_pi(math.pi) == -math.pi


def test_array_euler_angles_agree_with_the_kernel():
    rng = np.random.default_rng(5)
    q = rng.standard_normal((50, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    np.testing.assert_allclose(
        rotations.euler_angles(q), [rotations.euler_from_quat(row) for row in q], atol=1e-12
    )


def test_rotation_between_is_scipys():
    """Random attitudes, either sign of the quaternion, nearly equal ones; SciPy; 1e-12."""
    rng = np.random.default_rng(3)
    first = Rotation.random(50, random_state=4)
    turn = Rotation.from_rotvec(rng.normal(size=(50, 3)) * np.geomspace(1e-9, 1.0, 50)[:, None])
    second = turn * first
    sign = rng.choice([-1.0, 1.0], (50, 1))
    rotvec = rotations.rotation_between(
        np.roll(first.as_quat(), 1, axis=1), sign * np.roll(second.as_quat(), 1, axis=1)
    )
    assert rotvec == pytest.approx(turn.as_rotvec(), abs=1e-12)


def test_equal_attitudes_and_missing_ones():
    q = np.array([[0.5, 0.5, -0.5, 0.5], [np.nan] * 4])
    rotvecs = rotations.rotation_between(q, q)
    assert rotvecs[0] == pytest.approx(np.zeros(3), abs=1e-15) and np.isnan(rotvecs[1]).all()


def test_standard_atmosphere_table():
    """ICAO Doc 7488: 0 m 101325 Pa, 1000 m 89874.6 Pa, 5000 m 54019.9 Pa."""
    for altitude, pressure in ((0.0, 101325.0), (1000.0, 89874.6), (5000.0, 54019.9)):
        assert atmosphere.pressure_pa(altitude) == pytest.approx(pressure, rel=1e-5)
        assert atmosphere.altitude_m(atmosphere.pressure_pa(altitude)) == pytest.approx(
            altitude, abs=1e-8
        )
