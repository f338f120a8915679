# SPDX-License-Identifier: Apache-2.0
"""The observer by ticks: alignment, lost, late, repeated and useless measurements."""

import numpy as np
import pytest

from heli_core.parameters import load
from heli_core.rows import MEAS
from heli_observer import layout as L
from heli_observer.layout import ObserverStatus
from heli_observer.parameters import NODE_NAME, TABLE
from support.synthetic_sensors import hover_path, synthesize


def test_aligns_at_the_first_tick_from_sensors_alone(parameters, run_observer, exact_sensors):
    run = run_observer(parameters)
    assert run.health is ObserverStatus.ALIGNING
    out = run.step(0, exact_sensors.y[0])
    assert run.health is ObserverStatus.OK
    np.testing.assert_allclose(out[0:3], exact_sensors.pos[0], atol=1e-9)
    np.testing.assert_allclose(out[3:6], exact_sensors.vel[0], atol=1e-9)
    assert np.max(np.abs(exact_sensors.attitude_error(out[None], [0]))) < 2e-4
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
            if run.health is not ObserverStatus.ALIGNING:
                break
        assert tick >= wait and np.isfinite(out[:10]).all()
        tilts[wait] = np.degrees(
            np.abs(exact_sensors.attitude_error(np.tile(out, (tick + 1, 1)), [tick])).max()
        )
    assert tilts[0] > 12.0 and tilts[17] < 2.0


def test_a_tipped_first_sample_is_put_right_by_a_precise_receiver(
    parameters, run_observer, exact_sensors, config_folder
):
    """Tipped by 14 deg and shaken once: nothing before the first sample was integrated with it."""
    rtk = load(TABLE, [config_folder / "observer.yaml", config_folder / "gps_rtk.yaml"], NODE_NAME)
    rows = exact_sensors.y[:101].copy()
    rows[0, MEAS.imu] += [2.0, -2.0, 0.0, 0.1, -0.1, 0.0]
    run = run_observer({**rtk, "ekf.initial.level_rad": 0.08}).fly(rows)
    error = np.degrees(np.abs(exact_sensors.attitude_error(run.out, [0, 100])).max(axis=1))
    assert error[0] > 14.0 and error[1] < 0.5
    assert run.state.count[[L.COUNT.gps_pos_rejected, L.COUNT.gps_vel_rejected]].tolist() == [0, 0]


@pytest.mark.parametrize("psi", [-3.1, -1.0, 0.0, 2.0, 3.1])
def test_alignment_knows_every_heading(parameters, run_observer, psi):
    path = hover_path()
    still = type(path)(path.position, lambda t: np.tile([0.1, -0.05, psi], (len(t), 1)))
    flight = synthesize(still, parameters, 0.1, seed=0, noise=0.0)
    out = run_observer(parameters).step(0, flight.y[0])
    assert np.max(np.abs(flight.attitude_error(out[None], [0]))) < 1e-6


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
    assert b.state.count[L.COUNT.gps_fused] == a.state.count[L.COUNT.gps_fused]
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
    assert a.state.count[L.COUNT.gps_late] == 1 and a.state.count[L.COUNT.gps_future] == 1
    assert b.state.count[L.COUNT.gps_late] == 0
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
    assert run.health is ObserverStatus.OK
    count = run.state.count
    assert count[L.COUNT.imu_dropped] == 6
    if np.isfinite(bad):
        assert count[L.COUNT.mag_rejected] == 3 and count[L.COUNT.baro_rejected] == 1
        assert count[L.COUNT.gps_pos_rejected] == 3 and count[L.COUNT.gps_vel_rejected] == 3
    else:
        assert count[L.COUNT.mag_dropped] == 3 and count[L.COUNT.baro_dropped] == 1
        assert count[L.COUNT.gps_dropped] == 7
    good = run_observer(parameters).fly(flight.y)
    assert np.max(np.abs(run.out[-1, 0:6] - good.out[-1, 0:6])) < 0.1


def test_actuators_that_are_not_finite_are_held(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=4)
    run = run_observer(parameters)
    for n, row in enumerate(flight.y):
        out = run.step(n, row, u=[np.nan, 0.0, np.inf, 0.0] if n == 50 else None)
        assert np.all(np.isfinite(out))
    assert run.state.count[L.COUNT.actuator_dropped] == 2


def test_lost_imu_samples_are_reported(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 3.0, seed=1)
    rows = flight.y.copy()
    rows[200:210, 0:6] = np.nan
    run = run_observer(parameters).fly(rows[:210])
    assert run.health is ObserverStatus.IMU_TIMEOUT
    assert run.fly(rows[210:]).health is ObserverStatus.OK


def test_lost_ticks_are_filled_in(parameters, run_observer):
    """Nine of ten ticks lost for two seconds (real time under load): navigation goes on."""
    flight = synthesize(hover_path(), parameters, 10.0, seed=8)
    run = run_observer(parameters)
    for n, row in enumerate(flight.y):
        if 400 < n < 600 and n % 10:
            continue
        out = run.step(n, row)
        assert np.all(np.isfinite(out))
    assert run.state.count[L.COUNT.tick_gaps] == 20
    assert np.all(np.abs(out[3:6] - flight.vel[-1]) < 0.15)


def test_a_long_gap_aligns_again(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 10.0, seed=8)
    run = run_observer(parameters).fly(flight.y[:300])
    out = run.step(400, flight.y[400])
    assert np.all(np.isfinite(out)) and run.state.count[L.COUNT.realigned] == 1
    out = run.step(610, flight.y[610])  # no fix comes with this one
    assert np.all(np.isnan(out)) and run.health is ObserverStatus.ALIGNING
    for n in range(611, 641):
        out = run.step(n, flight.y[n])
    assert np.all(np.isfinite(out)) and run.health is ObserverStatus.OK


def test_a_repeated_tick_changes_nothing(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    run = run_observer(parameters).fly(flight.y)
    again = run.step(len(flight.y) - 1, flight.y[-1])
    np.testing.assert_array_equal(again, run.out[-1])
    assert run.state.count[L.COUNT.tick_repeated] == 1


def test_a_first_sample_that_is_not_finite_waits(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    rows = flight.y.copy()
    rows[0, 4] = np.nan
    run = run_observer(parameters).fly(rows[:1])
    assert np.all(np.isnan(run.out)) and run.health is ObserverStatus.ALIGNING
    run.fly(rows[1:])
    assert np.all(np.isfinite(run.out[-1])) and run.health is ObserverStatus.OK


def test_truth_columns_of_the_plants_row_are_never_read(parameters, run_observer):
    flight = synthesize(hover_path(), parameters, 1.0, seed=8)
    wide = np.hstack([flight.y, np.full((len(flight.y), 3), np.nan)])
    a, b = run_observer(parameters).fly(flight.y), run_observer(parameters).fly(wide)
    np.testing.assert_array_equal(a.out, b.out)
