# SPDX-License-Identifier: Apache-2.0
"""Consistency of the navigation filter: are its errors as large as its covariance says?

Physics: an INS/GPS filter on synthetic flights with known truth (hover with gust-like motion and a
climb), all errors drawn from the statistics it is configured for. Reference: Y. Bar-Shalom,
X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section
5.4: NEES and NIS are chi-square distributed. Tolerance: two-sided bounds of probability 0.999. The
same holds for what is published: errors now, over the standard deviations that are sent with them.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from heli_msgs_bridge.locate import config_folder
from heli_msgs_bridge.parameters import load
from heli_observer import layout as L
from heli_observer.observer import ObserverConfig, initial_state, observe
from heli_observer.parameter_table import NODE_NAME, TABLE
from heli_observer.synthetic import Flight, hover_path, synthesize

SECONDS = 60.0
CHECKS_S = (2, 5, 10, 20, 30, 40, 50, 60)
CONFIG: Path = config_folder("heli_observer")


ABSOLUTE = {"ekf.initial.gps_drift_fraction": 1.0}


def packaged(overlay: str) -> dict:
    return dict(load(TABLE, [CONFIG / "observer.yaml", CONFIG / overlay], NODE_NAME))


def error_state(flight: Flight, tick: int, x: np.ndarray) -> np.ndarray:
    """Truth minus nominal state x at a tick, in the filter's error coordinates (20,)."""
    true = Rotation.from_quat(np.roll(flight.q[tick], -1))
    attitude = (true * Rotation.from_quat(np.roll(x[6:10], -1)).inv()).as_rotvec()
    return np.concatenate(
        [
            flight.pos[tick] - x[0:3],
            flight.vel[tick] - x[3:6],
            attitude,
            flight.gyro_bias[tick] - x[10:13],
            flight.accel_bias[tick] - x[13:16],
            flight.drift[tick] - x[16:19],
            [flight.baro_bias[tick] - x[19], flight.mag_error[tick] - x[20]],
        ]
    )


@dataclass
class Statistics:
    """Sums over seeds: NEES at the checked times, NIS per sensor."""

    nees: np.ndarray  # (checks,)
    nees_navigation: np.ndarray  # (checks,) position, velocity, attitude only
    output: np.ndarray  # (checks, 3) squares of position, velocity, attitude as sent, over sigma
    nis: np.ndarray  # (4,) GPS position, GPS velocity, magnetometer, barometer
    dof: np.ndarray  # (4,)
    rejected: int


def collect(
    overlay: str,
    seeds: range,
    filter_changes: dict | None = None,
    world_changes: dict | None = None,
) -> Statistics:
    """Fly the seeds with sensors and filter as configured or changed."""
    parameters = packaged(overlay) | (world_changes or {})
    config = ObserverConfig(parameters | (filter_changes or {}))
    k, horizon = config.kernel, config.kernel.horizon_ticks
    u, out = np.array(parameters["trim.u"]), np.empty(L.N_NAV)
    n = len(CHECKS_S)
    total = Statistics(np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros(4), np.zeros(4), 0)
    fused_at = [L.C_GPS_FUSED, L.C_GPS_FUSED, L.C_MAG_FUSED, L.C_BARO_FUSED]
    nis_at = [L.D_NIS_POS, L.D_NIS_VEL, L.D_NIS_MAG, L.D_NIS_BARO]
    for seed in seeds:
        flight = synthesize(hover_path(climb_mps=2.5), parameters, SECONDS, seed)
        state = initial_state(config)
        before = state.count[fused_at].copy()
        for tick in range(len(flight.y)):
            observe(state, tick, flight.y[tick], u, k, out)
            fused = state.count[fused_at] - before
            before = state.count[fused_at].copy()
            if tick > 0:
                total.nis += fused * state.diag[nis_at]
                total.dof += fused * [3, 3, 1, 1]
            if tick % 100 == 0 and tick // 100 in CHECKS_S:
                i = CHECKS_S.index(tick // 100)
                e = error_state(flight, tick - horizon, state.nominal)
                total.nees[i] += e @ np.linalg.solve(state.P, e)
                total.nees_navigation[i] += e[:9] @ np.linalg.solve(state.P[:9, :9], e[:9])
                sent = error_state(flight, tick, np.concatenate([out[:10], np.zeros(11)]))[:9]
                scaled = sent / out[L.OUT_SIGMA_POS : L.OUT_SIGMA_ATT + 3]
                total.output[i] += (scaled**2).reshape(3, 3).sum(axis=1)
        events = [L.C_MAG_REJECTED, L.C_BARO_REJECTED, L.C_GPS_POS_REJECTED, L.C_GPS_VEL_REJECTED]
        total.rejected += int(state.count[events].sum())
    return total


def inside(value: np.ndarray, dof: np.ndarray | int, probability: float = 0.999) -> np.ndarray:
    """Whether sums that are chi-square distributed with dof lie in their two-sided bounds."""
    tail = 0.5 * (1.0 - probability)
    return (chi2.ppf(tail, dof) <= value) & (value <= chi2.ppf(1.0 - tail, dof))


def judge(s: Statistics, runs: int) -> None:
    assert np.all(inside(s.nees, L.N_ERROR * runs)), s.nees / (L.N_ERROR * runs)
    assert np.all(inside(s.nees_navigation, 9 * runs)), s.nees_navigation / (9 * runs)
    # the gates cut the tails off: less than 0.3 % of the mean at probability 0.9999
    assert np.all(inside(s.nis, s.dof) | (np.abs(s.nis / s.dof - 1.0) < 0.02)), s.nis / s.dof
    # the three axes of each are all but independent; 0.999 is for all the bounds together
    each = 1.0 - 0.001 / s.output.size
    assert np.all(inside(s.output, 3 * runs, each)), s.output / (3 * runs)
    samples = s.dof @ [1 / 3, 1 / 3, 1, 1]
    assert s.rejected < 10 * 1e-4 * samples


@pytest.mark.parametrize("overlay", ["gps_standalone.yaml", "gps_rtk.yaml"])
@pytest.mark.parametrize("world", [{}, ABSOLUTE], ids=["from home", "absolute"])
def test_nees_and_nis_are_inside_chi_square_bounds_10_seeds(overlay, world):
    judge(collect(overlay, range(10), world_changes=world), 10)


@pytest.mark.nightly
@pytest.mark.parametrize("overlay", ["gps_standalone.yaml", "gps_rtk.yaml"])
@pytest.mark.parametrize("world", [{}, ABSOLUTE], ids=["from home", "absolute"])
def test_nees_and_nis_are_inside_chi_square_bounds_50_seeds(overlay, world):
    judge(collect(overlay, range(100, 150), world_changes=world), 50)


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
        judge(collect("gps_standalone.yaml", range(6), change), 6)
