# SPDX-License-Identifier: Apache-2.0
"""IMU and antenna away from the centre of gravity: the estimate is that of the centre all the same.

The sensors are those of flights along the paths of the points where they sit.
"""

import numpy as np
import pytest

from heli_core.rows import MEAS, NAV
from heli_observer import layout as L
from heli_observer.ekf import move_fix_to_imu
from support.synthetic_sensors import Path, fade_in, hover_path, rotation_matrices, synthesize

IMU_ARM_M, GPS_ARM_M = np.array([0.1, -0.05, 0.05]), np.array([-0.3, 0.1, -0.2])
TICKS = 1000


def moved(path, arm_m):
    """The path of a point of the body."""
    return Path(lambda t: path.position(t) + rotation_matrices(path.euler(t)) @ arm_m, path.euler)


@pytest.fixture
def mounted(parameters):
    """A flight that rolls and pitches, as its sensors see it; ideal ones."""
    base = hover_path(climb_mps=2.5)

    def euler(t):
        swing = [0.15 * np.sin(3.0 * t), 0.1 * np.sin(4.0 * t), 0.3 * np.sin(1.5 * t)]
        return base.euler(t) + fade_in(t - 0.5, 2.0)[:, None] * np.column_stack(swing)

    path = Path(base.position, euler)
    flight = synthesize(path, parameters, 0.01 * TICKS, seed=0, noise=0.0)
    at_imu, at_antenna = (
        synthesize(moved(path, arm_m), parameters, 0.01 * TICKS, seed=0, noise=0.0).y
        for arm_m in (IMU_ARM_M, GPS_ARM_M)
    )
    rows = flight.y.copy()
    rows[:, MEAS.force] = at_imu[:, MEAS.force]
    rows[:, MEAS.gps_pos] = at_antenna[:, MEAS.gps_pos]
    rows[:, MEAS.gps_vel] = at_antenna[:, MEAS.gps_vel]
    return flight, rows


def told(parameters):
    arms = {"ekf.imu.lever_arm_m": IMU_ARM_M.tolist(), "ekf.gps.lever_arm_m": GPS_ARM_M.tolist()}
    return {**parameters, **arms}


def errors(flight, out):
    """Largest errors of position and velocity after the alignment has settled."""
    pos = out[200:, NAV.pos] - flight.pos[200 : len(out)]
    vel = out[200:, NAV.vel] - flight.vel[200 : len(out)]
    return np.abs(pos).max(), np.abs(vel).max()


def test_the_estimate_is_of_the_centre_of_gravity(parameters, run_observer, mounted):
    flight, rows = mounted
    plain = errors(flight, run_observer(parameters).fly(flight.y[:TICKS]).out)
    known = errors(flight, run_observer(told(parameters)).fly(rows[:TICKS]).out)
    unknown = errors(flight, run_observer(parameters).fly(rows[:TICKS]).out)
    for ideal, good, bad in zip(plain, known, unknown, strict=True):
        assert good < ideal + 0.01
        assert bad > 5.0 * good


def test_the_first_estimate_is_of_there_already(parameters, run_observer, mounted):
    flight, rows = mounted
    out = run_observer(told(parameters)).step(0, rows[0])
    assert out[NAV.pos] == pytest.approx(flight.pos[0], abs=0.02)
    far = run_observer(parameters).step(0, rows[0])
    assert np.abs(far[NAV.pos] - flight.pos[0]).max() > 0.2


def test_a_fix_is_moved_once(parameters, run_observer):
    """A filter that is lost aligns by a fix of the horizon's slot, which it has read already."""
    run = run_observer(told(parameters))
    row, level = np.zeros(L.AID.size), np.array([1.0, 0.0, 0.0, 0.0])
    at = slice(L.AID.gps_pos, L.AID.gps_pos + 3)
    for _ in range(2):
        move_fix_to_imu(level, np.zeros(3), np.zeros(6), row, run.params.ekf)
        assert row[at] == pytest.approx(IMU_ARM_M - GPS_ARM_M)
