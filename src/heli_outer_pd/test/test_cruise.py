# SPDX-License-Identifier: Apache-2.0
"""A velocity that is kept for a time: limits by differences, ways by closed forms."""

import numpy as np
import pytest

from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.guidance import Cruise, FlightPath, MotionLimits, PathError, divert


def test_a_cruise_is_reached_kept_and_halted_within_the_limits():
    """Differences of the way points against limits; the way against the velocity's integral."""
    limits = MotionLimits(3.0, 1.5, 1.5, 1.5, 0.8, 1.0, 2.0)
    vel = np.array([2.0, -1.0, 0.5])
    before = Trajectory.hover(np.array([1.0, 2.0, -20.0]), 0.3)
    way = divert(before, 2 * NS_PER_S, NS_PER_S, Cruise(vel, -0.4, 6.0), limits)
    times, pos = way.times_ns[1:] / NS_PER_S, way.points[1:, REFERENCE.pos]
    v = np.diff(pos, axis=0) / np.diff(times)[:, None]
    steady = (times[:-1] > 2.0 + 4.0) & (times[:-1] < 2.0 + 5.9)
    assert steady.sum() > 40
    np.testing.assert_allclose(v[steady], np.broadcast_to(vel, v[steady].shape), atol=1e-9)
    a = np.diff(v[:-1], axis=0) / 0.04
    along = vel / np.linalg.norm(vel)
    assert np.abs(a @ along).max() < limits.acceleration_mps2 + 1e-6
    assert np.abs(a - np.outer(a @ along, along)).max() < 1e-6, "a straight line"
    assert np.abs(np.diff(a, axis=0)).max() / 0.04 < limits.jerk_mps3 + 1e-3
    # From rest to v takes v / a + a / j, half of it lost; the halt the same: v T altogether.
    speed = np.linalg.norm(vel)
    np.testing.assert_allclose(np.linalg.norm(pos[-1] - pos[0]), 6.0 * speed, rtol=1e-6)
    turned = np.unwrap(way.points[:, REFERENCE.psi])
    assert turned[-1] - turned[0] == pytest.approx(-0.4 * 6.0, abs=1e-6)


def test_a_cruise_that_is_cut_short_halts_from_what_it_has():
    limits = MotionLimits(3.0, 1.5, 1.5, 1.5, 0.8, 1.0, 2.0)
    path = FlightPath(np.zeros(3), 0.0, limits).cruise(np.array([3.0, 0.0, 0.0]), 0.0, 0.5).stop()
    way = path.trajectory()
    v = np.diff(way.points[:, 0]) / np.diff(way.times_ns) * NS_PER_S
    # Jerk 1.5 for half a second: 0.19 m/s, and as much again while the acceleration goes back.
    assert v.max() == pytest.approx(1.5 * 0.25 / 2 * 2, abs=0.01)
    assert np.abs(v[-1]) < 0.02
    with pytest.raises(PathError, match="not finite"):
        FlightPath(np.zeros(3), 0.0, limits).cruise(np.array([np.nan, 0.0, 0.0]), 0.0, 0.5)
