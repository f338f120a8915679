# SPDX-License-Identifier: Apache-2.0
"""Sensors as the plant reads them: Allan deviation, schedule, latency, correlation, signs, iron.

References: IEEE Std 952 (Allan deviation of white noise and of a random walk), first-order
Gauss-Markov statistics, ISA. Tolerances: standard errors of the estimates; rounding otherwise.
"""

import numpy as np
import pytest

from heli_core.atmosphere import altitude_m
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_dynamics_sim.plant import initial_state

CALM = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
SIGMAS = 3.5
IMU_AXES = {"gyro": (3, 4, 5), "accel": (0, 1, 2)}
LENGTHS = [2000, pytest.param(14_400, marks=pytest.mark.nightly)]


def allan_deviation(rate, ticks):
    """Allan deviation (not overlapping) of rate samples over an averaging time of `ticks`."""
    n = rate.size // ticks
    means = rate[: n * ticks].reshape(n, ticks).mean(axis=1)
    return np.sqrt(0.5 * (np.diff(means) ** 2).mean())


@pytest.fixture(scope="module")
def imu(plant_config, record):
    """imu(seconds, factor): readings at rest, bias walks `factor` times the packaged ones."""
    kept = {}

    def build(seconds, factor):
        if (seconds, factor) not in kept:
            values = {
                f"sensors__imu__{kind}_bias_walk": factor * walk
                for kind, walk in (("gyro", 1e-6), ("accel", 1e-5))
            }
            kept[seconds, factor] = record(plant_config(**CALM, **values), seconds * 100, seed=5)
        return kept[seconds, factor]

    return build


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize(("kind", "density"), [("gyro", 1e-4), ("accel", 1e-3)])
@pytest.mark.parametrize("ticks", [1, 10, 100, 1000])
def test_allan_deviation_of_the_white_noise(imu, seconds, kind, density, ticks):
    """Packaged IMU at rest, 0.01 to 10 s; N / sqrt(T); 3.5 standard errors, 1/sqrt(2 n)."""
    y = imu(seconds, 1.0)
    error = 1.0 / np.sqrt(2.0 * (seconds * 100 // ticks - 1))
    walk = density / 100.0
    for axis in IMU_AXES[kind]:
        time_s = ticks / 100.0
        expected = np.hypot(density / np.sqrt(time_s), walk * np.sqrt(time_s / 3.0))
        deviation = allan_deviation(y[:, axis], ticks)
        assert abs(deviation / expected - 1.0) < SIGMAS * error, axis


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize(("kind", "walk"), [("gyro", 1e-4), ("accel", 1e-3)])
def test_allan_deviation_of_the_bias_walk(imu, seconds, kind, walk):
    """Bias walk 100 times the packaged one, at 20 s; K sqrt(T / 3) and the rest of the white noise.

    Tolerance: 3.5 standard errors over three axes; neighbours of a random walk's Allan differences
    are correlated by 1/4, which widens it by sqrt(1 + 2/16).
    """
    y, ticks = imu(seconds, 100.0), 2000
    expected = np.hypot(walk * np.sqrt(20.0 / 3.0), walk / np.sqrt(20.0))
    variance = np.mean([allan_deviation(y[:, axis], ticks) ** 2 for axis in IMU_AXES[kind]])
    error = np.sqrt(1.125 / (2.0 * 3.0 * (seconds // 20 - 1)))
    assert abs(np.sqrt(variance) / expected - 1.0) < SIGMAS * error


# --- GPS -----------------------------------------------------------------------------------------


def test_gps_rate_and_latency(plant_config, record):
    """5 Hz, 0.15 s late, in motion; tick of validity and position then; exact, 1e-9 m."""
    silent = {f"sensors__gps__{key}": 0.0 for key in ("white_m", "drift_m", "velocity_mps")}
    y = record(plant_config(**CALM, **silent), 1001, velocity_ned=(3.0, -1.0, 0.5))
    arrivals = np.flatnonzero(y[:, 18])
    assert arrivals.tolist() == list(range(0, 1001, 20))
    assert (arrivals - y[arrivals, 19]).tolist() == [15.0] * arrivals.size
    valid = y[arrivals[1:], 19] / 100.0
    expected = [0.0, 0.0, -10.0] + np.outer(valid, [3.0, -1.0, 0.5])
    assert y[arrivals[1:], 10:13] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seconds", [4000, pytest.param(40_000, marks=pytest.mark.nightly)])
def test_gps_drift_has_its_correlation_time_and_size(plant_config, record, seconds):
    """Gauss-Markov drift, tau 20 s, sigma 1, 1, 1.5 m; regression on the last fix; 3.5 s.e.

    Standard errors of an AR(1): sqrt(1 - a^2) / sqrt(n) of a = exp(-T/tau) over three axes;
    variance sqrt(2 tau / time).
    """
    tau = 20.0
    config = plant_config(**CALM, sensors__gps__white_m=0.0, sensors__gps__drift_tau_s=tau)
    y = record(config, seconds * 100, seed=8)
    fixes = y[y[:, 18] == 1.0, 10:13] - [0.0, 0.0, -10.0]
    scaled = fixes[1:] / [1.0, 1.0, 1.5]
    a = (scaled[1:] * scaled[:-1]).sum() / (scaled[:-1] ** 2).sum()
    expected = np.exp(-0.2 / tau)
    assert abs(a - expected) < SIGMAS * np.sqrt((1.0 - expected**2) / (3.0 * scaled.shape[0]))
    error = np.sqrt(2.0 * tau / seconds)
    assert np.abs((scaled**2).mean(axis=0) - 1.0).max() < SIGMAS * error


# --- barometer and magnetometer ------------------------------------------------------------------


def test_barometer_sign_and_lag(plant_config, record):
    """Climb at 2.5 m/s; ISA pressure of the altitude at the same tick: falls, no lag; 1e-6 m."""
    quiet = {"sensors__baro__white_pa": 0.0, "sensors__baro__drift_pa": 0.0}
    y = record(plant_config(**CALM, **quiet), 401, velocity_ned=(0.0, 0.0, -2.5))
    ticks = np.flatnonzero(y[:, 17])
    assert ticks.tolist() == list(range(0, 401, 5))
    pressure = y[ticks, 9]
    assert (np.diff(pressure) < 0.0).all()
    # hydrostatics: rho g of ISA at 60 m is 11.95 Pa/m
    assert pressure[-1] - pressure[0] == pytest.approx(-10.0 * 11.95, rel=2e-3)
    altitudes = [altitude_m(p) for p in pressure]
    assert altitudes == pytest.approx(60.0 + 0.025 * ticks, abs=1e-6)


@pytest.mark.parametrize("psi_deg", [-170.0, -60.0, 0.0, 45.0, 135.0])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.2)])
def test_heading_from_the_magnetometer(plant_config, record, psi_deg, tilt):
    """Levelled field after removing the iron; heading + declination; 1e-12 rad.

    Sign: nose east of north puts north on the left. Lag: none, a turn is seen at its tick.
    """
    config = plant_config(**CALM, sensors__mag__white_t=0.0)
    mag = config.sensors.mag
    declination = np.arctan2(mag.field_ned_t[1], mag.field_ned_t[0])
    state = initial_state(config, 1)
    state.x[6:10] = quat_from_euler(*tilt, np.radians(psi_deg))
    y = record(config, 1, state=state)
    body = np.linalg.solve(mag.soft_iron, y[0, 6:9] - mag.hard_iron_t)
    level = quat_to_R_nb(quat_from_euler(*tilt, 0.0)) @ body
    heading = np.arctan2(-level[1], level[0]) + declination
    assert np.angle(np.exp(1j * (heading - np.radians(psi_deg)))) == pytest.approx(0.0, abs=1e-12)


def test_iron_makes_an_ellipsoid_off_centre(plant_config, record):
    """Turned through many attitudes: the readings lie on the ellipsoid of soft and hard iron.

    Reference: a least-squares ellipsoid, its centre the hard iron and its shape (S S')^-1; 1e-6.
    """
    config = plant_config(
        **CALM,
        sensors__mag__white_t=0.0,
        sensors__mag__hard_iron_t=[4e-6, -3e-6, 2e-6],
        sensors__mag__soft_iron=[1.1, 0.05, 0.0, 0.02, 0.9, -0.03, 0.0, 0.04, 1.05],
    )
    mag, rng, readings = config.sensors.mag, np.random.default_rng(2), []
    for _ in range(60):
        state = initial_state(config, 1)
        q = rng.standard_normal(4)
        state.x[6:10] = q / np.linalg.norm(q)
        readings.append(record(config, 1, state=state)[0, 6:9])
    m = np.array(readings) / 5e-5
    x, y, z = m.T
    columns = np.column_stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z])
    c = np.linalg.lstsq(columns, np.ones(60), rcond=None)[0]
    shape = np.array([[c[0], c[3], c[4]], [c[3], c[1], c[5]], [c[4], c[5], c[2]]])
    centre = -0.5 * np.linalg.solve(shape, c[6:9])
    assert centre * 5e-5 == pytest.approx(mag.hard_iron_t, abs=1e-11)
    expected = np.linalg.inv(mag.soft_iron @ mag.soft_iron.T)
    ratio = shape / np.trace(shape), expected / np.trace(expected)
    assert ratio[0] == pytest.approx(ratio[1], abs=1e-6)
