# SPDX-License-Identifier: Apache-2.0
"""Sensors that fall silent or tell something false: found, reported, not followed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core.rows import MEAS, NAV
from heli_observer import layout as L
from heli_observer.fault_detection import forget
from heli_observer.layout import ObserverStatus
from support.synthetic_sensors import hover_path, synthesize, turning_path


def test_gps_outage_is_reported_and_ends(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 20.0, seed=6)
    rows = flight.y.copy()
    rows[500:1500, 18] = 0.0
    run = run_observer(parameters).fly(rows[:1400])
    assert run.health is ObserverStatus.GPS_TIMEOUT
    error = np.abs(run.out[1399, 0:2] - flight.pos[1399, 0:2])
    sigma = run.out[1399, 22:24]
    assert np.all(sigma > run.out[490, 22:24]) and np.all(error < 4.0 * sigma)
    run.fly(rows[1400:1600])
    assert run.health is ObserverStatus.OK


def test_persistent_gps_jump_is_rejected_and_reported(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=6)
    rows = flight.y.copy()
    rows[500:, 10] += 30.0
    run = run_observer(parameters).fly(rows)
    assert run.health is ObserverStatus.GPS_REJECTED
    behind = parameters["ekf.horizon_ticks"]
    fixes = (len(rows) - 1 - behind) // 20 * 20 - 500 + 15
    assert run.state.count[L.COUNT.gps_pos_rejected] == fixes // 20 + 1
    assert abs(run.out[-1, 0] - flight.pos[-1, 0]) < 4.0


def test_a_jump_of_the_receiver_is_taken_for_one_after_a_while(parameters, run_observer):
    """Its velocities agree all the time, so it is not the aircraft that is elsewhere."""
    flight = synthesize(hover_path(), parameters, 25.0, seed=6)
    rows = flight.y.copy()
    rows[500:, MEAS.gps_pos] += [30.0, -20.0, 10.0]
    run = run_observer(parameters).fly(rows[:1490])
    assert run.health is ObserverStatus.GPS_REJECTED and run.state.count[L.COUNT.gps_jumps] == 0
    run.fly(rows[1490:1560])
    refused = run.state.count[L.COUNT.gps_pos_rejected]
    run.fly(rows[1560:])
    assert run.health is ObserverStatus.OK and run.state.count[L.COUNT.gps_jumps] == 1
    assert run.state.count[L.COUNT.gps_pos_rejected] == refused
    assert np.abs(run.out[1400:, NAV.pos] - flight.pos[1400:]).max() < 4.0
    drift_m = flight.drift[-1 - run.params.horizon_ticks] + [30.0, -20.0, 10.0]
    assert np.abs(run.state.nominal[L.NOMINAL.drift : L.NOMINAL.drift + 3] - drift_m).max() < 4.0


def rolled_and_sure_of_it(parameters, run_observer, degrees):
    """Rolled by so much at 6 s, sure that it is not, what it knew before forgotten."""
    flight = synthesize(hover_path(), parameters, 25.0, seed=6)
    run = run_observer(parameters).fly(flight.y[:600])
    x = run.state.nominal
    rolled = Rotation.from_quat(
        np.roll(x[L.NOMINAL.quat : L.NOMINAL.quat + 4], -1)
    ) * Rotation.from_euler("X", degrees, degrees=True)
    x[L.NOMINAL.quat : L.NOMINAL.quat + 4] = np.roll(rolled.as_quat(), 1)
    run.state.P[:] = 1e-8 * np.eye(L.ERROR.size)
    forget(run.state.window)
    return flight, run


def test_a_filter_that_is_sure_of_a_wrong_attitude_aligns_anew(parameters, run_observer):
    """Rolled by so much that no doubt in its tilt explains what the fixes say."""
    flight, run = rolled_and_sure_of_it(parameters, run_observer, 120.0)
    run.fly(flight.y[600:1590])
    assert run.health is ObserverStatus.GPS_REJECTED and run.state.count[L.COUNT.realigned] == 0
    lost_m = np.abs(run.out[-1, NAV.pos] - flight.pos[1589]).max()
    run.fly(flight.y[1590:])
    assert run.health is ObserverStatus.OK and run.state.count[L.COUNT.realigned] == 1
    assert np.degrees(np.abs(flight.attitude_error(run.out, [len(flight.y) - 1])).max()) < 1.0
    assert lost_m > 20.0 and np.abs(run.out[-1, NAV.pos] - flight.pos[-1]).max() < 4.0


def test_a_filter_that_is_sure_of_a_tilt_doubts_it_when_the_contradiction_grows(
    parameters, run_observer
):
    """By 8 deg, which no receiver does: it begins anew with tilt and biases, and learns them."""
    flight, run = rolled_and_sure_of_it(parameters, run_observer, 8.0)
    run.fly(flight.y[600:800])
    assert run.state.count[L.COUNT.imu_doubts] == 1
    run.fly(flight.y[800:])
    assert run.state.count[L.COUNT.realigned] == 0
    assert run.health not in (ObserverStatus.GPS_REJECTED, ObserverStatus.NOT_FINITE)
    assert np.abs(run.out[1300:, NAV.vel] - flight.vel[1300:]).max() < 0.8
    assert np.abs(run.out[600:, NAV.pos] - flight.pos[600:]).max() < 4.0


@pytest.mark.parametrize("degrees", [12.0, 40.0, 170.0])
def test_magnetometer_fault_is_detected_and_not_followed(parameters, run_observer, degrees):
    """The field turns at 20 s; heading then stays on the gyro for a minute."""
    flight = synthesize(hover_path(), parameters, 80.0, seed=7)
    rows = flight.y.copy()
    turn = Rotation.from_euler("Z", degrees, degrees=True)
    rows[2000:, 6:9] = turn.apply(rows[2000:, 6:9])
    run = run_observer(parameters).fly(rows[:2100])
    run.fly(rows[2100:2150])
    assert run.health is ObserverStatus.MAG_REJECTED
    run.fly(rows[2150:])
    assert run.health is ObserverStatus.MAG_REJECTED
    error = flight.attitude_error(run.out, [len(rows) - 1])[0]
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
    before = flight.attitude_error(run.out, [6499])[0, 2]
    sigma = run.out[-1, NAV.sigma_att][2]
    assert abs(np.radians(40.0) + abs(before)) < 3.8 * sigma  # inside the 0.9999 gate
    run.fly(rows[6500:])
    assert run.health is ObserverStatus.MAG_REJECTED
    after = flight.attitude_error(run.out, [len(rows) - 1])[0, 2]
    assert abs(after - before) < np.radians(20.0)


def test_a_field_of_wrong_strength_is_a_fault(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=7)
    rows = flight.y.copy()
    rows[500:, 6:9] *= 1.5
    run = run_observer(parameters).fly(rows)
    assert run.health is ObserverStatus.MAG_REJECTED


@pytest.mark.parametrize("seed", range(3))
def test_a_receiver_that_repeats_itself_is_stuck_until_it_moves(parameters, run_observer, seed):
    flight = synthesize(hover_path(), parameters, 20.0, seed=seed)
    rows, at = flight.y.copy(), slice(MEAS.gps_pos.start, MEAS.gps_vel.stop)
    rows[500:1200, at] = rows[480, at]
    run = run_observer(parameters).fly(rows[:1190])
    assert run.health is ObserverStatus.GPS_STUCK
    assert run.state.count[L.COUNT.gps_repeated] > 60
    assert np.abs(run.out[-1, NAV.pos] - flight.pos[1189])[:2].max() < 10.0
    run.fly(rows[1190:])
    assert run.health is ObserverStatus.OK
    assert np.abs(run.out[-1, NAV.pos] - flight.pos[-1]).max() < 4.0


@pytest.mark.parametrize("seed", range(3))
def test_a_receiver_that_drifts_from_the_start_is_not_believed_in_the_end(
    parameters, run_observer, seed
):
    """2 m/s, its velocity, too: the inertial sensors have felt no step. True again, it is used."""
    flight = synthesize(hover_path(), parameters, 35.0, seed=seed)
    rows = flight.y.copy()
    rows[500:3000, MEAS.gps_vel.start] += 2.0
    rows[500:3000, MEAS.gps_pos.start] += 2.0 * 0.01 * np.arange(2500)
    run = run_observer(parameters).fly(rows[:900])
    assert run.health is ObserverStatus.GPS_REJECTED
    run.fly(rows[900:2990])
    assert run.health is ObserverStatus.GPS_REJECTED and run.state.count[L.COUNT.realigned] == 0
    assert run.state.count[L.COUNT.imu_doubts] == 0
    run.fly(rows[2990:])
    assert run.health is ObserverStatus.OK
    assert np.abs(run.out[-1, NAV.vel] - flight.vel[-1]).max() < 1.0


@pytest.mark.parametrize("what", ["frozen", "zero", "nan"])
def test_an_imu_that_stops_for_a_while_costs_little(parameters, run_observer, what):
    flight = synthesize(hover_path(), parameters, 12.0, seed=3)
    rows = flight.y.copy()
    rows[600:620, MEAS.imu] = {"frozen": rows[599, MEAS.imu], "zero": 0.0, "nan": np.nan}[what]
    run = run_observer(parameters).fly(rows[:618])
    nan = what == "nan"
    assert run.health is (ObserverStatus.IMU_TIMEOUT if nan else ObserverStatus.IMU_FROZEN)
    run.fly(rows[618:])
    assert run.health is ObserverStatus.OK
    assert 18 <= run.state.count[L.COUNT.imu_replaced] <= 20
    assert np.abs(run.out[600:, NAV.pos] - flight.pos[600:]).max() < 1.5
    assert np.abs(run.out[600:, NAV.vel] - flight.vel[600:]).max() < 0.5


@pytest.mark.parametrize(
    ("axis", "bias"), [(MEAS.rate.start, 0.1), (MEAS.rate.start + 1, -0.1), (MEAS.force.start, 1.0)]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_bias_that_jumps_is_learnt_from_the_fixes(parameters, run_observer, axis, bias, seed):
    flight = synthesize(hover_path(), parameters, 40.0, seed=seed)
    rows = flight.y.copy()
    rows[1000:, axis] += bias
    run = run_observer(parameters).fly(rows)
    assert run.state.count[L.COUNT.imu_doubts] >= 1 and run.state.count[L.COUNT.realigned] == 0
    assert run.health is ObserverStatus.OK
    assert np.abs(run.out[-1, NAV.vel] - flight.vel[-1]).max() < 0.5
    assert np.abs(run.out[-1, NAV.pos] - flight.pos[-1]).max() < 4.0


@pytest.mark.parametrize("path", [hover_path(), turning_path(0.35), hover_path(climb_mps=2.5)])
def test_healthy_sensors_are_never_doubted(parameters, run_observer, path):
    for seed in range(5):
        run = run_observer(parameters).fly(synthesize(path, parameters, 30.0, seed).y)
        doubts = (
            L.COUNT.imu_doubts,
            L.COUNT.imu_replaced,
            L.COUNT.gps_repeated,
            L.COUNT.gps_offset,
        )
        assert not run.state.count[list(doubts)].any()


@pytest.mark.parametrize(
    ("flag", "expected"), [(16, ObserverStatus.MAG_TIMEOUT), (17, ObserverStatus.BARO_TIMEOUT)]
)
def test_a_silent_sensor_is_reported(parameters, run_observer, flag, expected):
    flight = synthesize(hover_path(), parameters, 8.0, seed=1)
    rows = flight.y.copy()
    rows[300:, flag] = 0.0
    assert run_observer(parameters).fly(rows).health is expected


def test_every_status_has_a_sentence():
    for value in ObserverStatus:
        assert len(value.sentence) > 10
    assert len(set(L.COUNTER_NAMES.values())) == len(L.COUNTER_NAMES)
