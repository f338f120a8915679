# SPDX-License-Identifier: Apache-2.0
"""Hovers with IMU and antenna away from the centre of gravity: known to the observer, and not."""

import functools

import numpy as np
import pytest

from heli_flight import loop as closed_loop
from heli_flight.settings import resolve

IMU_ARM_M, GPS_ARM_M = [0.1, 0.0, 0.05], [-0.3, 0.0, -0.2]
MOUNTED = {"sensors.imu.lever_arm_m": IMU_ARM_M, "sensors.gps.lever_arm_m": GPS_ARM_M}
UNKNOWN = {"ekf.imu.lever_arm_m": [0.0] * 3, "ekf.gps.lever_arm_m": [0.0] * 3}


def settings(plant, observer, seed=1):
    over = {"plant": plant, "observer": observer}
    return resolve("hover", "rtk", seed, 20.0, world="honest", overrides=over)


@functools.cache
def errors(seed, mounted, known):
    """Root mean squares of the estimate's position (m) and velocity (m/s) error after 5 s."""
    flown = settings(MOUNTED if mounted else {}, {} if known else UNKNOWN, seed)
    flight = closed_loop.fly_loop(closed_loop.build(flown), flown)
    assert flight.status == 0, flight.sentence
    r = flight.record
    pos = (r.nav_pos_ned_m - r.truth_pos_ned_m)[500:]
    vel = (r.nav_vel_ned_mps - r.truth_vel_ned_mps)[500:]
    return tuple(float(np.sqrt((off**2).sum(axis=1).mean())) for off in (pos, vel))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_known_arms_cost_little_and_unknown_ones_much(seed):
    without, known, unknown = (
        errors(seed, mounted, told)
        for mounted, told in ((False, True), (True, True), (True, False))
    )
    for plain, good in zip(without, known, strict=True):
        assert good < 1.5 * plain
    # A hover turns slowly: what an unknown arm costs is its place, and a little velocity.
    assert unknown[0] > 5.0 * known[0] and unknown[1] > 1.05 * known[1]


def test_the_observer_is_told_what_the_plant_has():
    observer = settings(MOUNTED, {}).nodes["observer"]
    assert np.array_equal(observer["ekf.imu.lever_arm_m"], IMU_ARM_M)
    assert np.array_equal(observer["ekf.gps.lever_arm_m"], GPS_ARM_M)


def test_its_own_value_may_be_another(tmp_path):
    """By an override and by a file; of a file that gives both the same, an override moves both."""
    other = settings(MOUNTED, {"ekf.gps.lever_arm_m": [0.0, 0.0, 0.1]}).nodes["observer"]
    assert np.array_equal(other["ekf.gps.lever_arm_m"], [0.0, 0.0, 0.1])
    assert np.array_equal(other["ekf.imu.lever_arm_m"], IMU_ARM_M)
    file = tmp_path / "own.yaml"
    for of_plant, flown in (([0.2, 0.0, 0.0], IMU_ARM_M), ([0.3, 0.0, 0.0], [0.2, 0.0, 0.0])):
        file.write_text(
            "observer:\n  ros__parameters:\n    ekf.imu.lever_arm_m: [0.2, 0.0, 0.0]\n"
            f"plant:\n  ros__parameters:\n    sensors.imu.lever_arm_m: {of_plant}\n"
        )
        given = resolve("hover", "rtk", 1, 20.0, params=[file], overrides={"plant": MOUNTED})
        assert np.array_equal(given.nodes["observer"]["ekf.imu.lever_arm_m"], flown)
