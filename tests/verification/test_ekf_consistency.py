# SPDX-License-Identifier: Apache-2.0
"""Consistency of the navigation filter: are its errors as large as its covariance says?

Physics: an INS/GPS filter on synthetic flights with known truth (hover with gust-like motion and a
climb), all errors drawn from the statistics it is configured for. Reference: Y. Bar-Shalom,
X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section
5.4: NEES and NIS are chi-square distributed. Tolerance: two-sided bounds of probability 0.999. The
same holds for what is published: errors now, over the standard deviations that are sent with them.
"""

from pathlib import Path

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_core.parameters import load
from heli_observer import layout as L
from heli_observer.parameters import NODE_NAME, TABLE
from support.estimator_consistency import DOF, Statistics, bounds, collect

CONFIG: Path = config_folder("heli_observer")
ABSOLUTE = {"ekf.initial.drift_at_alignment_fraction": 1.0}


def packaged(overlay: str) -> dict:
    return dict(load(TABLE, [CONFIG / "observer.yaml", CONFIG / overlay], NODE_NAME))


def inside(value, dof, probability: float = 0.999):
    """Whether sums that are chi-square distributed with dof lie in their two-sided bounds."""
    low, high = bounds(dof, probability)
    return (low <= value) & (value <= high)


def judge(s: Statistics) -> None:
    runs = s.runs
    assert np.all(inside(s.nees, L.ERROR.size * runs)), s.nees / (L.ERROR.size * runs)
    assert np.all(inside(s.nees_navigation, 9 * runs)), s.nees_navigation / (9 * runs)
    # the gates cut the tails off: less than 0.3 % of the mean at probability 0.9999
    assert np.all(inside(s.nis, s.dof) | (np.abs(s.nis / s.dof - 1.0) < 0.02)), s.nis / s.dof
    # the three axes of each are all but independent; 0.999 is for all the bounds together
    each = 1.0 - 0.001 / s.output.size
    assert np.all(inside(s.output, 3 * runs, each)), s.output / (3 * runs)
    samples = (s.dof / DOF).sum()
    assert s.rejected < 10 * 1e-4 * samples


@pytest.mark.parametrize("overlay", ["gps_standalone.yaml", "gps_rtk.yaml"])
@pytest.mark.parametrize("world", [{}, ABSOLUTE], ids=["from home", "absolute"])
def test_nees_and_nis_are_inside_chi_square_bounds_10_seeds(overlay, world):
    judge(collect(packaged(overlay) | world, range(10)))


@pytest.mark.nightly
@pytest.mark.parametrize("overlay", ["gps_standalone.yaml", "gps_rtk.yaml"])
@pytest.mark.parametrize("world", [{}, ABSOLUTE], ids=["from home", "absolute"])
def test_nees_and_nis_are_inside_chi_square_bounds_50_seeds(overlay, world):
    judge(collect(packaged(overlay) | world, range(100, 150)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"ekf.gps.drift_horizontal_m": 0.001, "ekf.gps.drift_vertical_m": 0.001},
        {"ekf.imu.gyro_noise_density": 2e-5},
        {"ekf.gps.velocity_horizontal_mps": 0.2},
        {"ekf.mag.heading_error_rad": 1e-6},
        {"ekf.gravity_mps2": 9.84},
    ],
    ids=["no drift state", "gyro too good", "velocity too poor", "no iron", "wrong gravity"],
)
def test_a_filter_with_a_wrong_model_is_found_out(change):
    """The bounds have teeth: each single wrong assumption leaves them."""
    with pytest.raises(AssertionError):
        judge(collect(packaged("gps_standalone.yaml"), range(6), change))
