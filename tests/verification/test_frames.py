# SPDX-License-Identifier: Apache-2.0
"""Frames: what leaves the plant on topics, in ENU and FLU, against the published sign checks.

Reference: robot_localization, "Preparing Your Sensor Data" (signs of an IMU by REP-103): level, the
accelerometer reads +9.81 m/s2 on z; rolled +90 deg, left side up, +9.81 on y; pitched +90 deg, nose
down, -9.81 on x; turned counter-clockwise, the yaw increases. Here g is 9.781 m/s2.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core.rows import MEAS
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.plant import initial_state
from heli_msgs_bridge.frames import (
    frd_to_flu,
    ned_to_enu,
    quat_enu_flu_to_ned_frd,
    quat_ned_frd_to_enu_flu,
)

G = 9.781
CALM = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
QUIET = {
    f"sensors__imu__{key}": 0.0
    for key in (
        "gyro_noise_density",
        "gyro_bias_walk",
        "gyro_bias_sigma_radps",
        "accel_noise_density",
        "accel_bias_walk",
        "accel_bias_sigma_mps2",
    )
}


def flu(vector):
    out = np.empty(3)
    frd_to_flu(np.ascontiguousarray(vector), out)
    return out


def orientation(q_nb):
    """Attitude as a message has it, FLU -> ENU."""
    q = np.empty(4)
    quat_ned_frd_to_enu_flu(np.ascontiguousarray(q_nb), q)
    return Rotation.from_quat(q)


def at_rest(plant_config, vacuum, record, R_enu_flu):
    """IMU reading (specific force, FLU) at rest on the ground in an attitude FLU -> ENU."""
    config = plant_config(**CALM, **QUIET)
    q_nb = np.empty(4)
    quat_enu_flu_to_ned_frd(R_enu_flu.as_quat(), q_nb)
    # six contact points at the c.g. that carry the weight at a depth of 1 m
    body = vacuum.body._replace(mass=1.0)
    ground = vacuum.ground._replace(points=np.zeros((6, 3)), stiffness=G / 6, damping=0.0)
    kernel = config.params._replace(aircraft=vacuum._replace(body=body, ground=ground))
    state = initial_state(config, 1)
    state.x[:] = make_state((0.0, 0.0, 1.0))
    state.x[6:10] = q_nb
    return flu(record(config, 1, state=state, kernel=kernel)[0, 0:3])


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.0, G]),  # level
        ([90.0, 0.0, 0.0], [0.0, G, 0.0]),  # rolled, left side up
        ([0.0, 90.0, 0.0], [-G, 0.0, 0.0]),  # pitched, nose down
        ([0.0, 0.0, 90.0], [0.0, 0.0, G]),  # turned: no change
        ([180.0, 0.0, 0.0], [0.0, 0.0, -G]),  # upside down
    ],
)
def test_imu_signs_at_rest(plant_config, vacuum, record, axis, expected):
    """IMU at rest in attitudes given in FLU -> ENU; robot_localization's signs; 1e-9 m/s2."""
    turned = Rotation.from_rotvec(np.radians(axis))
    assert at_rest(plant_config, vacuum, record, turned) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("euler_ned_deg", "axis", "sign"),
    [
        ((10.0, 0.0, 0.0), 0, 1.0),  # right side down: positive roll in FLU, too
        ((0.0, 10.0, 0.0), 1, -1.0),  # nose up: negative pitch in FLU
        ((0.0, 0.0, 10.0), 2, -1.0),  # to the right, clockwise: negative yaw in ENU
    ],
)
def test_attitude_and_rates_turn_the_same_way(euler_ned_deg, axis, sign):
    """A small turn from nose east, level; ENU/FLU angle and FLU rate of the same sign; 1e-12."""
    phi, theta, psi = np.radians(euler_ned_deg)
    east = Rotation.from_euler("ZYX", [np.pi / 2 + psi, theta, phi])
    q_nb = np.roll(east.as_quat(), 1)
    angle = np.radians(10.0)
    expected = np.zeros(3)
    expected[axis] = sign * angle
    assert orientation(q_nb).as_rotvec() == pytest.approx(expected, abs=1e-12)
    rates_frd = np.zeros(3)
    rates_frd[axis] = angle
    assert flu(rates_frd) == pytest.approx(expected, abs=0.0)


def test_nose_north_is_a_quarter_turn_from_east():
    """REP-103: yaw 0 is east; nose north is +90 deg; 1e-15."""
    assert orientation([1.0, 0.0, 0.0, 0.0]).as_rotvec() == pytest.approx([0, 0, np.pi / 2])


@pytest.mark.parametrize(
    ("towards_deg", "enu"), [(0.0, [0, 3, 0]), (90.0, [3, 0, 0]), (180.0, [0, -3, 0])]
)
def test_wind_is_where_the_air_goes(plant_config, record, towards_deg, enu):
    """Wind "towards" as a vector on the topic, ENU; 90 deg is east; 1e-12 m/s.

    And physics agree: still over the ground, air going east pushes the aircraft east.
    """
    config = plant_config(wind__turbulence=False, wind__towards_deg=towards_deg, **QUIET)
    state = initial_state(config, 1)
    state.x[6:10] = 1.0, 0.0, 0.0, 0.0
    state.x[13:15] = 0.0
    y = record(config, 1, state=state)
    out = np.empty(3)
    ned_to_enu(y[0, MEAS.wind], out)
    assert out == pytest.approx(np.array(enu, dtype=float), abs=1e-12)
    calm_state = initial_state(plant_config(**CALM, **QUIET), 1)
    calm_state.x[:] = state.x
    calm = record(plant_config(**CALM, **QUIET), 1, state=calm_state)
    push = np.empty(3)
    ned_to_enu((y - calm)[0, 0:3].copy(), push)  # level, nose north: body axes are NED
    assert push[:2] @ out[:2] > 0.05
