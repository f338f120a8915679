# SPDX-License-Identifier: Apache-2.0
"""The navigation filter on the nonlinear aircraft in turbulence, the loop closed through it.

Physics: the paper's hover test with the plant's sensors (iron in the magnetometer and a stationary
pressure drift included, which the filter only knows by their size). Reference: ground truth.
Tolerance: attitude < 0.5 deg RMS, velocity < 0.1 m/s RMS, position below the GPS's own error.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_hover_test.closed_loop import simulate
from heli_hover_test.settings import resolve

SETTLED = slice(500, None)
# The receiver's own error is about the true origin; by default the filter counts from home.
ABSOLUTE = {"observer": {"ekf.initial.gps_drift_fraction": 1.0}}


def rms(error):
    return np.sqrt(np.mean(np.square(error), axis=0))


@pytest.mark.parametrize("gps", ["standalone", "rtk"])
def test_errors_on_the_plant_are_inside_the_targets(gps):
    position, velocity, attitude = [], [], []
    for seed in (1, 2, 3, 4):
        flight = simulate(resolve("hover", gps=gps, seed=seed, overrides=ABSOLUTE))
        assert flight.sentence == ""
        r = flight.record
        position.append((r.nav_pos_ned_m - r.truth_pos_ned_m)[SETTLED])
        velocity.append((r.nav_vel_ned_mps - r.truth_vel_ned_mps)[SETTLED])
        true = Rotation.from_quat(np.roll(r.truth_q_nb[SETTLED], -1, axis=1))
        nav = Rotation.from_quat(np.roll(r.nav_q_nb[SETTLED], -1, axis=1))
        attitude.append((true * nav.inv()).as_rotvec())
    plant = resolve("hover", gps=gps, seed=1).nodes["plant"]
    gps_rms = np.hypot(plant["sensors.gps.white_m"], plant["sensors.gps.drift_m"])
    limit = gps_rms * np.array([1.0, 1.0, plant["sensors.gps.vertical_factor"]])
    # four seeds are four draws of the drift: its mean square scatters by sqrt(2 / 4)
    limit *= 1.0 if gps == "rtk" else np.sqrt(1.0 + np.sqrt(2.0 / 4.0))
    assert np.all(rms(np.concatenate(position)) < limit)
    assert np.all(rms(np.concatenate(velocity)) < 0.1)
    total = np.sqrt(np.mean(np.sum(np.square(np.concatenate(attitude)), axis=1)))
    assert np.degrees(total) < 0.5
