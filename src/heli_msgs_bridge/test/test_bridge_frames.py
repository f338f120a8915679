# SPDX-License-Identifier: Apache-2.0
"""Frame conversions: cardinal cases, several axes at once, round trips, second methods."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_msgs_bridge import frames

# Forward, right, down to forward, left, up; its own inverse.
R_FLU_FRD = np.diag([1.0, -1.0, -1.0])
ANGLES = st.floats(-math.pi, math.pi)
PITCHES = st.floats(-1.5, 1.5)


def enu_flu(phi, theta, psi):
    """Yaw, pitch, roll (deg) of the ENU/FLU attitude that belongs to NED/FRD Euler angles (deg)."""
    q = np.empty(4)
    radians = [math.radians(angle) for angle in (phi, theta, psi)]
    frames.quat_ned_frd_to_enu_flu(quat_from_euler(*radians), q)
    R = quat_to_R_nb(np.array([q[3], q[0], q[1], q[2]]))
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.asin(max(-1.0, min(1.0, -R[2, 0])))
    return np.degrees([yaw, pitch, math.atan2(R[2, 1], R[2, 2])])


def test_world_vectors():
    v = np.empty(3)
    frames.ned_to_enu(np.array([1.0, 2.0, 3.0]), v)
    np.testing.assert_array_equal(v, [2.0, 1.0, -3.0])
    frames.enu_to_ned(np.array([1.0, 2.0, 3.0]), v)
    np.testing.assert_array_equal(v, [2.0, 1.0, -3.0])


def test_body_vectors():
    v = np.empty(3)
    frames.frd_to_flu(np.array([1.0, 2.0, 3.0]), v)
    np.testing.assert_array_equal(v, [1.0, -2.0, -3.0])
    frames.flu_to_frd(np.array([1.0, 2.0, 3.0]), v)
    np.testing.assert_array_equal(v, [1.0, -2.0, -3.0])


def test_vectors_convert_in_place_and_agree_with_the_matrices():
    v = np.array([0.1, -0.2, 0.3])
    for convert, R in (
        (frames.ned_to_enu, frames.R_ENU_NED),
        (frames.frd_to_flu, R_FLU_FRD),
    ):
        w = v.copy()
        convert(w, w)
        np.testing.assert_array_equal(w, R @ v)
        np.testing.assert_array_equal(R @ R, np.eye(3))
        assert np.linalg.det(R) == pytest.approx(1.0)


CARDINAL = [
    # NED roll, pitch, yaw -> ENU yaw, pitch, roll (deg)
    ((0, 0, 0), (90, 0, 0)),  # facing north
    ((0, 0, 90), (0, 0, 0)),  # facing east
    ((0, 0, 180), (-90, 0, 0)),  # facing south
    ((0, 0, -90), (180, 0, 0)),  # facing west
    ((0, 10, 90), (0, -10, 0)),  # nose up is negative pitch in FLU
    ((10, 0, 90), (0, 0, 10)),  # right wing down is positive roll in both
    ((-25, 12, 37), (53, -12, -25)),
]


@pytest.mark.parametrize(("ned", "enu"), CARDINAL)
def test_attitude_cardinal_cases(ned, enu):
    np.testing.assert_allclose(enu_flu(*ned), enu, atol=1e-12)


@given(ANGLES, PITCHES, ANGLES)
def test_attitude_agrees_with_matrices_and_returns(phi, theta, psi):
    q_nb = quat_from_euler(phi, theta, psi)
    q, back = np.empty(4), np.empty(4)
    frames.quat_ned_frd_to_enu_flu(q_nb, q)
    R = quat_to_R_nb(np.array([q[3], q[0], q[1], q[2]]))
    expected = frames.R_ENU_NED @ quat_to_R_nb(q_nb) @ R_FLU_FRD
    np.testing.assert_allclose(R, expected, atol=1e-15 * 10)
    frames.quat_enu_flu_to_ned_frd(q, back)
    np.testing.assert_allclose(back, q_nb, rtol=0, atol=4e-16)


SPECIFIC_FORCE_G = [
    # robot_localization's sign checks: attitude of the level, rolled and pitched aircraft at rest.
    # roll and pitch are rotations of the FLU body (REP-103): roll right, nose down positive.
    ((0.0, 0.0), (0.0, 0.0, 1.0)),
    ((90.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 90.0), (-1.0, 0.0, 0.0)),
]


@pytest.mark.parametrize(("roll_pitch_flu_deg", "expected_g"), SPECIFIC_FORCE_G)
def test_imu_at_rest_reads_gravity_as_rep_145_and_robot_localization_say(
    roll_pitch_flu_deg, expected_g
):
    g = 9.81
    roll, pitch = np.radians(roll_pitch_flu_deg)
    # nose down in FLU is negative theta in FRD
    R_nb = quat_to_R_nb(quat_from_euler(roll, -pitch, 0.4))
    specific_force_frd = R_nb.T @ np.array([0.0, 0.0, -g])
    specific_force_flu = np.empty(3)
    frames.frd_to_flu(specific_force_frd, specific_force_flu)
    np.testing.assert_allclose(specific_force_flu, g * np.array(expected_g), atol=1e-12)


def ecef(lat_deg, lon_deg, alt_m):
    """Earth-centred position in extended precision (second method for the tangent plane)."""
    one = np.longdouble(1.0)
    lat, lon = np.deg2rad(one * lat_deg), np.deg2rad(one * lon_deg)
    f = one / np.longdouble("298.257223563")
    e2 = f * (2 - f)
    n = np.longdouble(6378137) / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    xy = (n + alt_m) * np.cos(lat)
    return np.array([xy * np.cos(lon), xy * np.sin(lon), (n * (1 - e2) + alt_m) * np.sin(lat)])


@pytest.mark.parametrize(
    "origin", [(47.397742, 8.545594, 488.0), (-33.9, 151.2, 0.0), (0.0, 180.0, 5.0)]
)
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (3.0, -4.0, -10.0), (-2000.0, 1500.0, -300.0)])
def test_tangent_plane_round_trip_and_against_ecef(origin, offset):
    d = frames.datum(*origin)
    geodetic, back = np.empty(3), np.empty(3)
    frames.ned_to_geodetic(np.array(offset), d, geodetic)
    frames.geodetic_to_ned(geodetic, d, back)
    resolution = 2.0 * math.radians(np.spacing(abs(geodetic[1]))) * 6.4e6
    np.testing.assert_allclose(back, offset, rtol=0, atol=max(1e-9, resolution))
    lat, lon = np.radians(origin[0]), np.radians(origin[1])
    R_ne = np.array(
        [
            [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)],
            [-math.sin(lon), math.cos(lon), 0.0],
            [-math.cos(lat) * math.cos(lon), -math.cos(lat) * math.sin(lon), -math.sin(lat)],
        ]
    )
    difference = (ecef(*geodetic) - ecef(*origin)).astype(np.float64)
    np.testing.assert_allclose(R_ne @ difference, offset, rtol=0, atol=5e-9)


def test_tangent_plane_known_values():
    """One minute of latitude at 45 deg is 1852.2 m (meridian radius 6367.4 km), up is up."""
    d = frames.datum(45.0, 10.0, 100.0)
    out = np.empty(3)
    frames.geodetic_to_ned(np.array([45.0 + 1.0 / 60.0, 10.0, 100.0]), d, out)
    assert out[0] == pytest.approx(1852.2, abs=0.2)
    assert out[1] == 0.0
    frames.geodetic_to_ned(np.array([45.0, 10.0, 112.5]), d, out)
    np.testing.assert_allclose(out, [0.0, 0.0, -12.5], atol=1e-9)
    frames.geodetic_to_ned(np.array([45.0, 10.001, 100.0]), d, out)
    assert out[1] > 78.0 and abs(out[2]) < 1e-3


@pytest.mark.parametrize(
    "wrong", [(86.0, 0.0, 0.0), (0.0, 181.0, 0.0), (math.nan, 0.0, 0.0), (0, 0, math.inf)]
)
def test_impossible_datum_is_refused(wrong):
    with pytest.raises(ValueError, match="datum"):
        frames.datum(*wrong)
