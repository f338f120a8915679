# SPDX-License-Identifier: Apache-2.0
"""Lever arms of IMU and antenna: what a point of the body feels as the body moves.

The reference is that motion itself: the path of the point `pos + R r`, differentiated by time. No
formula of the product for angular acceleration or centripetal terms is part of it.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim.airframe import LeverArm, add_lever_acceleration
from heli_dynamics_sim.helicopter import WORK_ROWS, rk4_step, same_air
from heli_dynamics_sim.linear_plant import LinearPlant, linear_step
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.plant import initial_state, measure
from heli_flight.settings import resolve

IMU_ARM_M, GPS_ARM_M = [0.1, -0.04, 0.05], [-0.3, 0.02, -0.2]
GRAVITY_MPS2 = 9.781
EXACT = {
    "wind__turbulence": False,
    "wind__profile_speed_mps": [0.0, 0.0, 0.0],
    "sensors__imu__gyro_noise_density": 0.0,
    "sensors__imu__gyro_bias_sigma_radps": 0.0,
    "sensors__imu__accel_noise_density": 0.0,
    "sensors__imu__accel_bias_sigma_mps2": 0.0,
    "sensors__gps__white_m": 0.0,
    "sensors__gps__drift_m": 0.0,
    "sensors__gps__velocity_mps": 0.0,
    "sensors__gps__latency_ticks": 0,
}
ARMS = {"sensors__imu__lever_arm_m": IMU_ARM_M, "sensors__gps__lever_arm_m": GPS_ARM_M}
TURNING = (0.8, -0.6, 1.1)


def turn(x):
    """Put an aircraft in hover into a bank, moving and turning about all axes."""
    x[PLANT.quat] = np.roll(Rotation.from_euler("ZYX", [0.7, -0.2, 0.3]).as_quat(), 1)
    x[PLANT.vel], x[PLANT.rate] = [2.0, -1.0, 0.5], TURNING


def body_to_ned(x):
    return Rotation.from_quat(np.roll(x[PLANT.quat], -1)).as_matrix()


def felt(x, step, arm_m, h_s=2e-4):
    """Specific force, body, m/s2, of a point: its path's second difference, less gravity."""
    path = []
    for ahead_s in (-h_s, 0.0, h_s):
        then = x.copy()
        if ahead_s != 0.0:
            step(then, ahead_s)
        path.append(then[PLANT.pos] + body_to_ned(then) @ arm_m)
    acceleration = (path[0] - 2.0 * path[1] + path[2]) / h_s**2
    return body_to_ned(x).T @ (acceleration - [0.0, 0.0, GRAVITY_MPS2])


def read(config):
    """Measurement row of a turning aircraft at tick 0, and its state."""
    state = initial_state(config, 1)
    turn(state.x)
    y = np.zeros(MEAS.size)
    measure(state, 0, np.zeros(NOISE.size), config.params, y)
    return y, state.x


def test_a_turntable_that_spins_up():
    """Known angle, rate and acceleration about down: centripetal and tangential, nothing else."""
    force = np.zeros(3)
    add_lever_acceleration((0.0, 0.0, 3.0), (0.0, 0.0, 5.0), LeverArm(True, 0.2, 0.0, 0.7), force)
    assert force == pytest.approx([-(3.0**2) * 0.2, 5.0 * 0.2, 0.0], abs=1e-15)


def test_the_imu_feels_the_motion_of_its_place(plant_config):
    config = plant_config(**EXACT, **ARMS)
    y, x = read(config)
    u, air, work = x[PLANT.servo].copy(), same_air(np.zeros(3)), np.zeros((WORK_ROWS, PLANT.size))

    def step(then, dt_s):
        rk4_step(then, u, air, config.params.aircraft, dt_s, work)

    expected = felt(x, step, np.array(IMU_ARM_M))
    assert y[MEAS.force] == pytest.approx(expected, abs=2e-5)
    assert np.linalg.norm(expected - felt(x, step, np.zeros(3))) > 0.1


def test_the_imu_of_a_linear_aircraft_feels_the_same():
    plain = {key.replace("__", "."): value for key, value in (EXACT | ARMS).items()}
    del plain["sensors.gps.latency_ticks"]
    nodes = resolve("hover", "rtk", 1, 2.0, overrides={"plant": plain}).nodes
    plant = LinearPlant("heli600")
    plant.reset(np.random.default_rng(1), 0.01, nodes)
    turn(plant.state)
    y, truth, x = np.zeros(MEAS.size), np.zeros(19), plant.state
    plant.measure(0, y, truth)
    u, air, work = x[PLANT.servo].copy(), same_air(np.zeros(3)), np.zeros((WORK_ROWS, PLANT.size))

    def step(then, dt_s):
        linear_step(then, u, air, plant._linear, dt_s, work)

    down = body_to_ned(x).T @ [0.0, 0.0, plant._linear.gravity - GRAVITY_MPS2]
    expected = felt(x, step, np.array(IMU_ARM_M)) - down
    assert y[MEAS.force] == pytest.approx(expected, abs=2e-5)
    assert np.linalg.norm(expected + down - felt(x, step, np.zeros(3))) > 0.1


def test_a_fix_is_that_of_the_antenna(plant_config):
    y, x = read(plant_config(**EXACT, **ARMS))
    R, arm_m, h_s = body_to_ned(x), np.array(GPS_ARM_M), 1e-4
    path = [
        h * R @ x[PLANT.vel] + R @ Rotation.from_rotvec(h * np.array(TURNING)).as_matrix() @ arm_m
        for h in (-h_s, h_s)
    ]
    assert y[MEAS.gps_valid] == 1.0
    assert y[MEAS.gps_pos] == pytest.approx(x[PLANT.pos] + R @ arm_m, abs=1e-12)
    assert y[MEAS.gps_vel] == pytest.approx((path[1] - path[0]) / (2.0 * h_s), abs=1e-7)


def test_an_arm_moves_nothing_but_its_sensor(plant_config):
    """To the last bit; and none at all is off."""
    still, _ = read(plant_config(**EXACT))
    moved, _ = read(plant_config(**EXACT, **ARMS))
    changed = set(np.flatnonzero(still != moved))
    mine = {*range(MEAS.size)[MEAS.force], *range(MEAS.size)[MEAS.gps_pos]}
    assert changed == mine | {*range(MEAS.size)[MEAS.gps_vel]}
    sensors = plant_config(**EXACT).params.sensors
    assert not sensors.imu.arm.on and not sensors.gps.arm.on


def test_a_second_imu_sits_beside_the_first(plant_config):
    y, _ = read(plant_config(**EXACT, **ARMS, sensors__imu2__enabled=True))
    assert (y[MEAS.force2] == y[MEAS.force]).all()
