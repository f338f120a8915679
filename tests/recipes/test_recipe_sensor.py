# SPDX-License-Identifier: Apache-2.0
"""CONTRIBUTING, "To add a sensor": a Doppler radar, velocity over ground in body axes, 10 Hz.

All of it stands here: the sensor, and an estimator that holds the packaged observer and fuses what
the sensor says.
"""

import math

import numpy as np
import pytest

import heli
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import NAV, TRUTH

SIGMA_MPS, PERIOD_TICKS = 0.05, 10
SEEDS = range(11, 15)
FLIGHT = {"scenario": "hover", "gps": "standalone", "duration_s": 40.0, "quiet": True}
_SETTLED_S = 15.0


class Doppler:
    """Velocity over ground, body axes, m/s, with white noise on each axis."""

    def reset(self, rng, tick_s, nodes):
        self.rng, self.errors = rng, []

    def step(self, tick, time_s, truth, y):
        if tick % PERIOD_TICKS:
            return None
        true_mps = quat_to_R_nb(truth[TRUTH.quat]).T @ truth[TRUTH.vel]
        self.errors.append(SIGMA_MPS * self.rng.standard_normal(3))
        return true_mps + self.errors[-1]


class WithDoppler(heli.Observer):
    """The packaged observer, into which the radar's velocity is fused as well."""

    def reset(self, rng, tick_s, nodes):
        super().reset(rng, tick_s, nodes)
        self.innovations = []

    def step(self, tick, time_s, y, u, readings):
        nav = super().step(tick, time_s, y, u, readings)
        if "Doppler" in readings and np.isfinite(nav[NAV.quat]).all():
            vel_ned_mps = quat_to_R_nb(nav[NAV.quat]) @ readings["Doppler"]
            nis = self.fuse_velocity(vel_ned_mps, SIGMA_MPS)
            if time_s > _SETTLED_S:
                self.innovations.append(nis)
        return nav


def velocity_error_mps(flight):
    after = flight.time_s > _SETTLED_S
    off = (flight.nav.vel_ned_mps - flight.truth.vel_ned_mps)[after]
    return math.sqrt(np.mean(np.sum(off**2, axis=1)))


@pytest.fixture(scope="module")
def flown():
    """Per seed the flight without and with the radar, the radar, and its estimator."""
    rows = []
    for seed in SEEDS:
        radar, estimator = Doppler(), WithDoppler()
        with_radar = heli.fly(seed=seed, sensors=[radar], estimator=estimator, **FLIGHT)
        rows.append((heli.fly(seed=seed, **FLIGHT), with_radar, radar, estimator))
    return rows


def test_it_says_what_its_sigma_says(flown):
    errors = np.concatenate([radar.errors for _, _, radar, _ in flown])
    assert errors.shape == (len(SEEDS) * 400, 3)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(SIGMA_MPS, rel=0.05)


def test_the_other_sensors_say_what_they_said(flown):
    # Until the filter has aligned and the radar's next reading is fused nothing flies another way.
    for plain, with_radar, _, _ in flown:
        np.testing.assert_array_equal(with_radar.truth.q_nb[:25], plain.truth.q_nb[:25])
        imu, before = with_radar._flown.record.imu, plain._flown.record.imu
        np.testing.assert_array_equal(imu[:25], before[:25])


def test_the_velocity_is_known_better_on_each_seed(flown):
    for plain, with_radar, _, _ in flown:
        assert not with_radar.lost and velocity_error_mps(with_radar) < 0.8 * velocity_error_mps(
            plain
        )


def test_its_innovations_are_of_the_size_that_the_filter_expects(flown):
    nis = np.concatenate([estimator.innovations for *_, estimator in flown])
    # Three degrees of freedom; the attitude's error, which turns the reading, is not in its sigma.
    assert 2.0 < np.mean(nis) < 4.5
