# SPDX-License-Identifier: Apache-2.0
"""How good the observer is: errors, biases, what it says of them, what its delay is worth."""

import numpy as np
import pytest
from scipy.stats import chi2

from heli_core.rows import NAV
from heli_observer.ekf import predict
from heli_observer.layout import ObserverStatus
from support.synthetic_sensors import hover_path, synthesize, turning_path


def rms(error):
    return np.sqrt(np.mean(np.square(error), axis=0))


def test_with_ideal_sensors_the_output_is_the_truth(parameters, run_observer, exact_sensors):
    """The output belongs to the tick of its newest IMU sample, not to the delayed horizon."""
    run = run_observer(parameters).fly(exact_sensors.y)
    ticks = np.arange(500, len(exact_sensors.y))
    assert np.max(np.abs(run.out[ticks, 0:3] - exact_sensors.pos[ticks])) < 0.01
    assert np.max(np.abs(run.out[ticks, 3:6] - exact_sensors.vel[ticks])) < 0.005
    assert np.max(np.abs(exact_sensors.attitude_error(run.out, ticks))) < 1e-3
    # one tick late would be seen: 2.5 m/s climb is 2.5 cm a tick
    late = run.out[ticks, 2] - exact_sensors.pos[ticks - 1, 2]
    assert np.max(np.abs(late)) > 0.02


def test_fusion_errors_are_inside_the_targets(parameters, run_observer):
    """Attitude < 0.5 deg, velocity < 0.1 m/s, position below the GPS's own error; three seeds."""
    errors, fixes = {"p": [], "v": [], "a": []}, []
    for seed in range(3):
        flight = synthesize(hover_path(climb_mps=2.5), parameters, 60.0, seed)
        run = run_observer(parameters).fly(flight.y)
        ticks = np.arange(500, len(flight.y))
        errors["p"].append(run.out[ticks, 0:3] - flight.pos[ticks])
        errors["v"].append(run.out[ticks, 3:6] - flight.vel[ticks])
        errors["a"].append(flight.attitude_error(run.out, ticks[::10]))
        arrived = np.flatnonzero(flight.y[:, 18] * (np.arange(len(flight.y)) >= 500))
        fixes.append(flight.y[arrived, 10:13] - flight.pos[arrived - 15])
        assert run.health is ObserverStatus.OK
    p, v, a = (np.concatenate(errors[name]) for name in "pva")
    assert np.all(rms(p) < rms(np.concatenate(fixes)))
    assert np.all(rms(v) < 0.1)
    assert np.degrees(np.sqrt(np.mean(np.sum(a * a, axis=1)))) < 0.5


def test_biases_converge(parameters, run_observer):
    """A turn makes tilt and accelerometer bias distinguishable; known biases are then found."""
    flight = synthesize(turning_path(0.35), parameters, 60.0, seed=5, noise=0.0)
    gyro, accel = np.array([6e-4, -5e-4, 4e-4]), np.array([0.03, -0.02, 0.025])
    rows = flight.y.copy()
    rows[:, 3:6] += gyro
    rows[:, 0:3] += accel
    run = run_observer(parameters).fly(rows)
    np.testing.assert_allclose(run.out[-1, 16:19], gyro, atol=6e-5)
    np.testing.assert_allclose(run.out[-1, 19:22], accel, atol=4e-3)
    np.testing.assert_allclose(run.out[-1, 10:13], flight.rate[-1], atol=6e-5)


@pytest.mark.slow
def test_biases_converge_in_noise(parameters, run_observer):
    """Twenty turning flights with all errors on: what is left, in units of what was drawn.

    Initial sigma 5e-4 rad/s and 0.02 m/s2; the filter must end with errors as its own sigma says
    (chi-square, 0.999), below half of the initial ones.
    """
    start, left, sigma = [], [], []
    for seed in range(20):
        flight = synthesize(turning_path(0.35), parameters, 40.0, seed)
        run = run_observer(parameters).fly(flight.y)
        true = np.concatenate([flight.gyro_bias, flight.accel_bias], axis=1)
        start.append(true[0])
        left.append(true[-1] - run.out[-1, 16:22])
        sigma.append(np.sqrt(np.diag(run.state.P)[9:15]))
    share = rms(np.array(left)) / rms(np.array(start))
    assert np.all(share < 0.5)
    scaled = np.sum((np.array(left) / np.array(sigma)) ** 2)
    assert chi2.ppf(0.0005, 120) < scaled < chi2.ppf(0.9995, 120)


def test_heading_in_hover_is_seen_by_the_magnetometer_only(parameters, run_observer):
    """Still hover for a minute, with and without the field: the published sigma of the yaw."""
    flight = synthesize(hover_path(amplitude_m=0.0, tilt_rad=0.0), parameters, 60.0, seed=3)
    rows = flight.y.copy()
    rows[100:, 16] = 0.0
    with_mag, blind = (run_observer(parameters).fly(y).out for y in (flight.y, rows))
    roll, yaw = NAV.sigma_att.start, NAV.sigma_att.stop - 1
    assert np.degrees(with_mag[-1, yaw]) < 0.5
    assert blind[-1, yaw] > 3.0 * with_mag[-1, yaw]
    assert np.all(np.diff(blind[1000::100, yaw]) > 0.0)  # it only grows
    # the tilt is seen by the GPS
    assert blind[-1, roll] < 1.1 * with_mag[-1, roll]


def test_published_sigmas_are_the_covariance_carried_to_now(parameters, run_observer):
    """Sent with the newest tick; P propagated over the horizon tick by tick; 1 %, 2 % early on."""
    parameters |= {"ekf.imu.gyro_noise_density": 0.02, "ekf.imu.accel_noise_density": 0.1}
    flight = synthesize(turning_path(0.35), parameters, 20.0, seed=1)
    run = run_observer(parameters)
    for ticks, tolerance in ((300, 0.02), (1700, 0.01)):
        run.fly(flight.y[len(run.out) : len(run.out) + ticks])
        P, x, k = run.state.P.copy(), run.state.nominal.copy(), run.params
        size, now = len(run.state.imu), len(run.out) - 1
        for tick in range(now - k.horizon_ticks, now):
            predict(x, P, run.state.imu[tick % size], run.state.imu[(tick + 1) % size], k.ekf)
        expected = np.sqrt(np.diag(P)[:9])
        np.testing.assert_allclose(run.out[-1, 22:31], expected, rtol=tolerance)


def test_gps_latency_is_compensated(parameters, run_observer):
    """The same fixes, once with their stamps, once stamped with their arrival."""
    parameters |= {
        "ekf.gps.position_horizontal_m": 0.02,
        "ekf.gps.position_vertical_m": 0.03,
        "ekf.gps.velocity_horizontal_mps": 0.03,
        "ekf.gps.velocity_vertical_mps": 0.03,
        "ekf.gps.drift_horizontal_m": 0.01,
        "ekf.gps.drift_vertical_m": 0.015,
        "ekf.gate_probability": 1.0 - 1e-12,
    }
    flight = synthesize(hover_path(amplitude_m=1.5), parameters, 40.0, seed=3)
    ignorant = flight.y.copy()
    ignorant[:, 19] = np.arange(len(ignorant))
    ticks = np.arange(1000, len(flight.y))
    position, velocity = [], []
    for rows in (flight.y, ignorant):
        run = run_observer(parameters).fly(rows)
        position.append(rms(run.out[ticks, 0:3] - flight.pos[ticks])[:2])
        velocity.append(rms(run.out[ticks, 3:6] - flight.vel[ticks])[:2])
    assert np.all(position[0] < 0.03) and np.all(position[1] > 3.0 * position[0])
    assert np.all(velocity[0] < 0.02) and np.all(velocity[1] > 3.0 * velocity[0])
