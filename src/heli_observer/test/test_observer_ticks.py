# SPDX-License-Identifier: Apache-2.0
"""The observer by ticks: alignment, delay, lost, late, wrong and missing measurements, faults."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from heli_math.rows import MEAS, NAV
from heli_observer import layout as L
from heli_observer.ins_ekf import predict
from heli_observer.observer import ObserverStatus, status
from heli_observer.testing.synthetic import hover_path, synthesize, turning_path


def rotation(q):
    return Rotation.from_quat(np.roll(q, -1))


def attitude_error(flight, out, ticks):
    """Rotation vectors (n, 3) from the estimated to the true attitude, rad."""
    return np.array(
        [(rotation(flight.q[n]) * rotation(out[n, 6:10]).inv()).as_rotvec() for n in ticks]
    )


def rms(error):
    return np.sqrt(np.mean(np.square(error), axis=0))


def health(run):
    return ObserverStatus(status(run.state, run.kernel))


@pytest.fixture
def exact_sensors(parameters):
    """A flight with ideal sensors; the parameters still say that they are noisy."""
    return synthesize(hover_path(climb_mps=2.5), parameters, 30.0, seed=0, noise=0.0)


def test_aligns_at_the_first_tick_from_sensors_alone(parameters, run_observer, exact_sensors):
    run = run_observer(parameters)
    assert health(run) is ObserverStatus.ALIGNING
    out = run.step(0, exact_sensors.y[0])
    assert health(run) is ObserverStatus.OK
    np.testing.assert_allclose(out[0:3], exact_sensors.pos[0], atol=1e-9)
    np.testing.assert_allclose(out[3:6], exact_sensors.vel[0], atol=1e-9)
    assert np.max(np.abs(attitude_error(exact_sensors, out[None], [0]))) < 2e-4
    np.testing.assert_allclose(out[10:13], exact_sensors.rate[0], atol=1e-12)


def test_a_vibrating_imu_is_levelled_by_the_mean_of_the_samples_that_are_waited_for(
    parameters, run_observer, exact_sensors
):
    """2.5 m/s2 at 30.8 Hz: a single sample is up to 14 deg off, the horizon's mean under 1 deg."""
    tilts = {}
    for wait in (0, 17):
        run = run_observer({**parameters, "ekf.initial.align_ticks": wait})
        for tick in range(60):
            y = exact_sensors.y[tick].copy()
            y[MEAS.imu][1] += 2.5 * np.cos(2.0 * np.pi * 30.8 * 0.01 * tick)
            out = run.step(tick, y)
            if health(run) is not ObserverStatus.ALIGNING:
                break
        assert tick >= wait and np.isfinite(out[:10]).all()
        tilts[wait] = np.degrees(
            np.abs(attitude_error(exact_sensors, np.tile(out, (tick + 1, 1)), [tick])).max()
        )
    assert tilts[0] > 12.0 and tilts[17] < 2.0


@pytest.mark.parametrize("psi", [-3.1, -1.0, 0.0, 2.0, 3.1])
def test_alignment_knows_every_heading(parameters, run_observer, psi):
    path = hover_path()
    still = type(path)(path.position, lambda t: np.tile([0.1, -0.05, psi], (len(t), 1)))
    flight = synthesize(still, parameters, 0.1, seed=0, noise=0.0)
    out = run_observer(parameters).step(0, flight.y[0])
    assert np.max(np.abs(attitude_error(flight, out[None], [0]))) < 1e-6


def test_with_ideal_sensors_the_output_is_the_truth(parameters, run_observer, exact_sensors):
    """The output belongs to the tick of its newest IMU sample, not to the delayed horizon."""
    run = run_observer(parameters).fly(exact_sensors.y)
    ticks = np.arange(500, len(exact_sensors.y))
    assert np.max(np.abs(run.out[ticks, 0:3] - exact_sensors.pos[ticks])) < 0.01
    assert np.max(np.abs(run.out[ticks, 3:6] - exact_sensors.vel[ticks])) < 0.005
    assert np.max(np.abs(attitude_error(exact_sensors, run.out, ticks))) < 1e-3
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
        errors["a"].append(attitude_error(flight, run.out, ticks[::10]))
        arrived = np.flatnonzero(flight.y[:, 18] * (np.arange(len(flight.y)) >= 500))
        fixes.append(flight.y[arrived, 10:13] - flight.pos[arrived - 15])
        assert health(run) is ObserverStatus.OK
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
    seen, blind = (run_observer(parameters).fly(y).out for y in (flight.y, rows))
    roll, yaw = NAV.sigma_att.start, NAV.sigma_att.stop - 1
    assert np.degrees(seen[-1, yaw]) < 0.5
    assert blind[-1, yaw] > 3.0 * seen[-1, yaw]
    assert np.all(np.diff(blind[1000::100, yaw]) > 0.0)  # it only grows
    # the tilt is seen by the GPS
    assert blind[-1, roll] < 1.1 * seen[-1, roll]


def test_published_sigmas_are_the_covariance_carried_to_now(parameters, run_observer):
    """Sent with the newest tick; P propagated over the horizon tick by tick; 1 %, 2 % early on."""
    parameters |= {"ekf.imu.gyro_noise_density": 0.02, "ekf.imu.accel_noise_density": 0.1}
    flight = synthesize(turning_path(0.35), parameters, 20.0, seed=1)
    run = run_observer(parameters)
    for ticks, tolerance in ((300, 0.02), (1700, 0.01)):
        run.fly(flight.y[len(run.out) : len(run.out) + ticks])
        P, x, k = run.state.P.copy(), run.state.nominal.copy(), run.kernel
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


def test_a_fix_that_comes_early_is_fused_at_its_own_time(parameters, run_observer):
    """Fixes in time order or not, early or at the last moment: the same numbers."""
    flight = synthesize(hover_path(), parameters, 8.0, seed=2)
    early = flight.y.copy()
    arrivals = np.flatnonzero(flight.y[:, 18])[1:]
    early[arrivals, 18] = 0.0
    for n in arrivals:
        early[n - 9, 10:20] = flight.y[n, 10:20] * 1.0
        early[n - 9, 16:18] = flight.y[n - 9, 16:18]
        early[n - 9, 18:20] = [1.0, n - 15]
    a, b = run_observer(parameters).fly(flight.y), run_observer(parameters).fly(early)
    assert b.state.count[L.C_GPS_FUSED] == a.state.count[L.C_GPS_FUSED]
    np.testing.assert_array_equal(a.out[arrivals], b.out[arrivals])


def test_out_of_order_fixes_are_fused_in_time_order(parameters, run_observer):
    parameters["ekf.horizon_ticks"] = 40
    flight = synthesize(hover_path(), parameters, 8.0, seed=2)
    swapped = flight.y.copy()
    first, second = 400, 420
    for n, other in ((first + 21, first), (second, second)):
        swapped[n, 10:16] = flight.y[other, 10:16]
        swapped[n, 18:20] = flight.y[other, 18:20]
    swapped[first, 18] = 0.0
    a, b = run_observer(parameters).fly(flight.y), run_observer(parameters).fly(swapped)
    np.testing.assert_array_equal(a.out[460:], b.out[460:])


def test_late_and_future_fixes_are_dropped_and_counted(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 4.0, seed=2)
    rows = flight.y.copy()
    # a tick older than the horizon
    rows[200, 19] = 200 - parameters["ekf.horizon_ticks"] - 1
    rows[220, 19] = 221
    without = flight.y.copy()
    without[[200, 220], 18] = 0.0
    a, b = run_observer(parameters).fly(rows), run_observer(parameters).fly(without)
    assert a.state.count[L.C_GPS_LATE] == 1 and a.state.count[L.C_GPS_FUTURE] == 1
    assert b.state.count[L.C_GPS_LATE] == 0
    np.testing.assert_array_equal(a.out, b.out)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_components_that_are_not_finite_never_enter(parameters, run_observer, bad):
    """Every measurement component once, at a tick where its sensor speaks."""
    flight = synthesize(hover_path(), parameters, 6.0, seed=4)
    rows = flight.y.copy()
    for j in range(16):
        rows[220 + 20 * j, j] = bad
    rows[540, 19] = bad
    run = run_observer(parameters).fly(rows)
    assert np.all(np.isfinite(run.out))
    assert health(run) is ObserverStatus.OK
    count = run.state.count
    assert count[L.C_IMU_DROPPED] == 6
    if np.isfinite(bad):
        assert count[L.C_MAG_REJECTED] == 3 and count[L.C_BARO_REJECTED] == 1
        assert count[L.C_GPS_POS_REJECTED] == 3 and count[L.C_GPS_VEL_REJECTED] == 3
    else:
        assert count[L.C_MAG_DROPPED] == 3 and count[L.C_BARO_DROPPED] == 1
        assert count[L.C_GPS_DROPPED] == 7
    good = run_observer(parameters).fly(flight.y)
    assert np.max(np.abs(run.out[-1, 0:6] - good.out[-1, 0:6])) < 0.1


def test_actuators_that_are_not_finite_are_held(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=4)
    run = run_observer(parameters)
    for n, row in enumerate(flight.y):
        out = run.step(n, row, u=[np.nan, 0.0, np.inf, 0.0] if n == 50 else None)
        assert np.all(np.isfinite(out))
    assert run.state.count[L.C_ACTUATOR_DROPPED] == 2


def test_gps_outage_is_reported_and_ends(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 20.0, seed=6)
    rows = flight.y.copy()
    rows[500:1500, 18] = 0.0
    run = run_observer(parameters).fly(rows[:1400])
    assert health(run) is ObserverStatus.GPS_TIMEOUT
    error = np.abs(run.out[1399, 0:2] - flight.pos[1399, 0:2])
    sigma = run.out[1399, 22:24]
    assert np.all(sigma > run.out[490, 22:24]) and np.all(error < 4.0 * sigma)
    run.fly(rows[1400:1600])
    assert health(run) is ObserverStatus.OK


def test_persistent_gps_jump_is_rejected_and_reported(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=6)
    rows = flight.y.copy()
    rows[500:, 10] += 30.0
    run = run_observer(parameters).fly(rows)
    assert health(run) is ObserverStatus.GPS_REJECTED
    behind = parameters["ekf.horizon_ticks"]
    fixes = (len(rows) - 1 - behind) // 20 * 20 - 500 + 15
    assert run.state.count[L.C_GPS_POS_REJECTED] == fixes // 20 + 1
    assert abs(run.out[-1, 0] - flight.pos[-1, 0]) < 4.0


@pytest.mark.parametrize("degrees", [12.0, 40.0, 170.0])
def test_magnetometer_fault_is_detected_and_not_followed(parameters, run_observer, degrees):
    """The field turns at 20 s; heading then stays on the gyro for a minute."""
    flight = synthesize(hover_path(), parameters, 80.0, seed=7)
    rows = flight.y.copy()
    turn = Rotation.from_euler("Z", degrees, degrees=True)
    rows[2000:, 6:9] = turn.apply(rows[2000:, 6:9])
    run = run_observer(parameters).fly(rows[:2100])
    run.fly(rows[2100:2150])
    assert health(run) is ObserverStatus.MAG_REJECTED
    run.fly(rows[2150:])
    assert health(run) is ObserverStatus.MAG_REJECTED
    error = attitude_error(flight, run.out, [len(rows) - 1])[0]
    assert abs(np.degrees(error[2])) < 1.5
    assert np.all(np.abs(np.degrees(error[:2])) < 0.4)


def test_an_unsure_heading_does_not_let_a_fault_in(parameters, run_observer):
    """No field for a minute, a poor gyro: chi-square alone would take a heading 40 deg off."""
    flight = synthesize(hover_path(), parameters, 70.0, seed=7)
    parameters["ekf.imu.gyro_noise_density"] = 0.2
    rows = flight.y.copy()
    rows[500:6500, 16] = 0.0
    turn = Rotation.from_euler("Z", 40.0, degrees=True)
    rows[6500:, 6:9] = turn.apply(rows[6500:, 6:9])
    run = run_observer(parameters).fly(rows[:6500])
    before = attitude_error(flight, run.out, [6499])[0, 2]
    sigma = run.out[-1, NAV.sigma_att][2]
    assert abs(np.radians(40.0) + abs(before)) < 3.8 * sigma  # inside the 0.9999 gate
    run.fly(rows[6500:])
    assert health(run) is ObserverStatus.MAG_REJECTED
    after = attitude_error(flight, run.out, [len(rows) - 1])[0, 2]
    assert abs(after - before) < np.radians(20.0)


def test_a_field_of_wrong_strength_is_a_fault(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=7)
    rows = flight.y.copy()
    rows[500:, 6:9] *= 1.5
    run = run_observer(parameters).fly(rows)
    assert health(run) is ObserverStatus.MAG_REJECTED


@pytest.mark.parametrize(
    ("flag", "expected"), [(16, ObserverStatus.MAG_TIMEOUT), (17, ObserverStatus.BARO_TIMEOUT)]
)
def test_a_silent_sensor_is_reported(parameters, run_observer, flag, expected):
    flight = synthesize(hover_path(), parameters, 8.0, seed=1)
    rows = flight.y.copy()
    rows[300:, flag] = 0.0
    assert health(run_observer(parameters).fly(rows)) is expected


def test_lost_imu_samples_are_reported(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 3.0, seed=1)
    rows = flight.y.copy()
    rows[200:210, 0:6] = np.nan
    run = run_observer(parameters).fly(rows[:210])
    assert health(run) is ObserverStatus.IMU_TIMEOUT
    assert health(run.fly(rows[210:])) is ObserverStatus.OK


def test_lost_ticks_are_filled_in(parameters, run_observer):
    """Nine of ten ticks lost for two seconds (real time under load): navigation goes on."""
    flight = synthesize(hover_path(), parameters, 10.0, seed=8)
    run = run_observer(parameters)
    for n, row in enumerate(flight.y):
        if 400 < n < 600 and n % 10:
            continue
        out = run.step(n, row)
        assert np.all(np.isfinite(out))
    assert run.state.count[L.C_TICK_GAPS] == 20
    assert np.all(np.abs(out[3:6] - flight.vel[-1]) < 0.15)


def test_a_long_gap_aligns_again(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=8)
    run = run_observer(parameters).fly(flight.y[:300])
    out = run.step(400, flight.y[400])
    assert np.all(np.isfinite(out)) and run.state.count[L.C_REALIGNED] == 1
    out = run.step(610, flight.y[610])  # no fix comes with this one
    assert np.all(np.isnan(out)) and health(run) is ObserverStatus.ALIGNING
    for n in range(611, 641):
        out = run.step(n, flight.y[n])
    assert np.all(np.isfinite(out)) and health(run) is ObserverStatus.OK


def test_a_repeated_tick_changes_nothing(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    run = run_observer(parameters).fly(flight.y)
    again = run.step(len(flight.y) - 1, flight.y[-1])
    np.testing.assert_array_equal(again, run.out[-1])
    assert run.state.count[L.C_TICK_REPEATED] == 1


def test_a_first_sample_that_is_not_finite_waits(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    rows = flight.y.copy()
    rows[0, 4] = np.nan
    run = run_observer(parameters).fly(rows[:1])
    assert np.all(np.isnan(run.out)) and health(run) is ObserverStatus.ALIGNING
    run.fly(rows[1:])
    assert np.all(np.isfinite(run.out[-1])) and health(run) is ObserverStatus.OK


def test_truth_columns_of_the_plants_row_are_never_read(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    wide = np.hstack([flight.y, np.full((len(flight.y), 3), np.nan)])
    a, b = run_observer(parameters).fly(flight.y), run_observer(parameters).fly(wide)
    np.testing.assert_array_equal(a.out, b.out)


def test_every_status_has_a_sentence():
    for value in ObserverStatus:
        assert len(value.sentence) > 10
    assert len(set(L.COUNTER_NAMES.values())) == len(L.COUNTER_NAMES)
