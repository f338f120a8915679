# SPDX-License-Identifier: Apache-2.0
"""Samples that come late or not at all: the filter reads late ones as if they had come in time."""

import numpy as np
import pytest

from heli_core.rows import IMU, MEAS, NAV
from heli_core.ticks import TICK_S
from heli_observer import layout as L
from heli_observer.buffers import BRIDGED, hear_fix, hear_imu, interpolate_gap
from support.synthetic_sensors import Path, fade_in, hover_path, rotation_matrices, synthesize

BEGIN = 300


def late_by(run, rows, ticks):
    """Fly rows whose IMU comes so many ticks late from `BEGIN` on."""
    out = []
    for tick, row in enumerate(rows):
        y = row.copy()
        if tick >= BEGIN:
            y[MEAS.imu] = np.nan
            if tick - ticks >= BEGIN:
                sample = rows[tick - ticks, MEAS.imu].copy()
                hear_imu(run.state, tick, tick - ticks, sample, run.params, y)
        out.append(run.step(tick, y))
    run.out = np.array(out)
    return run


@pytest.mark.parametrize("ticks", [1, 3, 10])
def test_the_filter_reads_late_samples_as_if_they_had_come_in_time(parameters, run_observer, ticks):
    rows = synthesize(hover_path(climb_mps=2.5), parameters, 8.0, seed=3).y
    in_time, late = run_observer(parameters).fly(rows), run_observer(parameters)
    late_by(late, rows, ticks)
    np.testing.assert_array_equal(late.state.nominal, in_time.state.nominal)
    np.testing.assert_array_equal(late.state.P, in_time.state.P)
    assert late.state.count[L.COUNT.imu_mended] == len(rows) - BEGIN - ticks
    # Over the last ticks the newest sample is held.
    apart = np.abs(late.out - in_time.out)[BEGIN + 50 :]
    assert apart[:, NAV.pos].max() < 0.02 and apart[:, NAV.vel].max() < 0.25 * ticks / 10 + 0.05


def test_samples_older_than_the_horizon_are_of_no_use(parameters, run_observer):
    rows = synthesize(hover_path(), parameters, 6.0, seed=3).y
    run = run_observer(parameters)
    late_by(run, rows, run.params.horizon_ticks + 1)
    assert run.state.count[L.COUNT.imu_mended] == 0


def test_one_that_comes_twice_is_taken_once(parameters, run_observer):
    rows = synthesize(hover_path(), parameters, 4.0, seed=3).y
    run = run_observer(parameters).fly(rows[:BEGIN])
    y = rows[BEGIN].copy()
    hear_imu(run.state, BEGIN, BEGIN - 1, rows[BEGIN - 1, MEAS.imu].copy(), run.params, y)
    assert np.isnan(y[MEAS.imu]).all() and run.state.count[L.COUNT.imu_mended] == 0


def test_before_anything_is_known_a_late_sample_begins_the_alignment(parameters, run_observer):
    run, y = run_observer(parameters), np.zeros(MEAS.sensed)
    sample = np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
    hear_imu(run.state, 4, 1, sample, run.params, y)
    np.testing.assert_array_equal(y[MEAS.imu], sample)


def ring(samples, missing):
    imu = np.zeros((40, L.RING.size))
    imu[: len(samples), : IMU.size] = samples
    for tick in missing:
        imu[tick, L.RING.replaced] = 1.0
        imu[tick, : IMU.size] = 99.0
    return imu


@pytest.mark.parametrize("missing", [[12], [12, 13], [12, 13, 14, 15]])
def test_a_gap_on_a_straight_line_is_closed_exactly(missing):
    line = np.outer(np.arange(30.0), [0.1, 0.2, -0.3, 0.01, 0.02, 0.03])
    imu, P = ring(line, missing), np.zeros((L.ERROR.size, L.ERROR.size))
    for tick in missing:
        assert interpolate_gap(imu, tick, 29, 0.01, P)
        np.testing.assert_allclose(imu[tick, : IMU.size], line[tick], atol=1e-12)
        assert imu[tick, L.RING.replaced] == 1.0


def test_vibration_is_left_out_and_paid_for():
    """Noise about a mean: the slot gets the mean, the covariance its scatter, for each tick."""
    rng, slot_error, paid = np.random.default_rng(2), [], []
    sigma = np.array([2.0, 2.0, 2.0, 0.3, 0.3, 0.3])
    for _ in range(400):
        imu = ring(5.0 + sigma * rng.standard_normal((30, 6)), [12])
        P = np.zeros((L.ERROR.size, L.ERROR.size))
        assert interpolate_gap(imu, 12, 29, 0.01, P)
        slot_error.append(imu[12, : IMU.size] - 5.0)
        paid.append([P[L.ERROR.vel, L.ERROR.vel], P[L.ERROR.att, L.ERROR.att]])
        assert np.count_nonzero(P) == 6
    assert np.all(np.std(slot_error, axis=0) < 0.4 * sigma)
    np.testing.assert_allclose(
        np.mean(paid, axis=0), [(2.0 * 0.01) ** 2, (0.3 * 0.01) ** 2], rtol=0.1
    )


def test_longer_gaps_and_what_was_measured_stay_as_they_are():
    imu, P = ring(np.ones((30, 6)), range(10, 11 + BRIDGED)), np.zeros((L.ERROR.size, L.ERROR.size))
    before = imu.copy()
    assert not any(interpolate_gap(imu, tick, 29, 0.01, P) for tick in range(5, 25))
    np.testing.assert_array_equal(imu, before)
    assert not P.any()
    # A gap whose end has not come yet.
    imu = ring(np.ones((30, 6)), [27, 28, 29])
    assert not interpolate_gap(imu, 27, 29, 0.01, P)


def test_before_anything_is_known_a_late_fix_is_brought_to_the_horizon_by_its_velocity(
    parameters, run_observer
):
    run, y = run_observer(parameters), np.zeros(MEAS.sensed)
    tick, late = 500, 7
    horizon = tick - run.params.horizon_ticks

    def fix(by, velocity):
        y[MEAS.gps_pos], y[MEAS.gps_vel] = [10.0, 20.0, -10.0], velocity
        y[MEAS.gps_valid], y[MEAS.gps_tick] = 1.0, horizon - by
        hear_fix(run.state, tick, run.params, y)
        return y[MEAS.gps_tick], y[MEAS.gps_pos].copy()

    stamp, pos = fix(late, [3.0, -2.0, 1.0])
    assert stamp == horizon
    np.testing.assert_allclose(pos, [10.21, 19.86, -9.93], atol=1e-12)
    assert fix(0, [3.0, 0.0, 0.0])[1][0] == 10.0
    assert fix(late, [np.nan, 0.0, 0.0])[0] == horizon - late
    assert fix(21, [3.0, 0.0, 0.0])[0] == horizon - 21


def swinging_path():
    """3.2 m/s2 forth and back and 17 deg of roll at 1.3 Hz: a velocity changes by 0.4 m/s in 0.13 s
    and an antenna 0.3 m away moves by 0.7 m/s."""

    def swing(t):
        return fade_in(t, 4.0) * np.sin(8.0 * t)

    def position(t):
        return np.column_stack([0.05 * swing(t), 0.03 * swing(t), -10.0 + 0.0 * t])

    def euler(t):
        return np.column_stack([0.3 * swing(t), 0.1 * swing(t), 0.5 + 0.0 * t])

    return Path(position, euler)


@pytest.mark.parametrize("arm_m", [[0.0, 0.0, 0.0], [-0.3, 0.02, -0.2]])
@pytest.mark.parametrize("late", [1, 6, 13])
def test_a_late_fix_is_brought_to_the_horizon_by_what_was_measured_since(
    late, arm_m, parameters, run_observer
):
    parameters["ekf.gps.lever_arm_m"] = arm_m
    path = swinging_path()
    flight = synthesize(path, parameters, 8.0, seed=0, noise=0.0)
    R = rotation_matrices(path.euler(np.arange(len(flight.pos)) * TICK_S))
    around = np.cross(flight.rate, arm_m)
    pos = flight.pos + R @ np.array(arm_m)
    vel = flight.vel + np.einsum("nij,nj->ni", R, around)
    run, off_m, off_mps, moved_mps = run_observer(parameters), [], [], []
    y = np.zeros(MEAS.sensed)
    for tick, row in enumerate(flight.y):
        horizon = tick - run.params.horizon_ticks
        if tick > 600:
            y[MEAS.gps_pos], y[MEAS.gps_vel] = pos[horizon - late], vel[horizon - late]
            y[MEAS.gps_valid], y[MEAS.gps_tick] = 1.0, horizon - late
            hear_fix(run.state, tick, run.params, y)
            assert y[MEAS.gps_tick] == horizon
            off_m.append(y[MEAS.gps_pos] - pos[horizon])
            off_mps.append(y[MEAS.gps_vel] - vel[horizon])
            moved_mps.append(vel[horizon] - vel[horizon - late])
        row = row.copy()
        if row[MEAS.gps_valid] > 0.5:
            stamp = int(row[MEAS.gps_tick])
            row[MEAS.gps_pos] += pos[stamp] - flight.pos[stamp]
            row[MEAS.gps_vel] += vel[stamp] - flight.vel[stamp]
        run.step(tick, row)
    # By its own velocity alone it would be off by what it has moved.
    assert np.abs(off_m).max() < 5e-4
    assert np.abs(off_mps).max() < 6e-3
    assert np.abs(moved_mps).max() > 0.03 * late - 0.04
