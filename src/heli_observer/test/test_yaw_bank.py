# SPDX-License-Identifier: Apache-2.0
"""Heading from motion: known where there is motion, told where it contradicts the compass."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core.rows import MEAS
from heli_observer import layout as L
from heli_observer import yaw_bank
from heli_observer.layout import YAW, YAW_COUNT, ObserverStatus, YawState
from heli_observer.observer import ObserverConfig, initial_state
from support.synthetic_sensors import hover_path, synthesize

MOVES, RESTS = hover_path(amplitude_m=3.0), hover_path(amplitude_m=0.0)


def askew(flight, degrees):
    """Rows of a flight whose compass is built in wrong by an angle about the vertical axis."""
    rows = flight.y.copy()
    turn = Rotation.from_euler("Z", degrees, degrees=True)
    rows[:, MEAS.mag] = turn.apply(rows[:, MEAS.mag])
    return rows


def heading_error_deg(flight, run):
    last = len(run.out) - 1
    return np.degrees(flight.attitude_error(run.out, [last])[0, 2])


@pytest.mark.parametrize("degrees", [15.0, 20.0, 30.0, -90.0, 180.0])
def test_a_compass_wrong_from_the_start_is_told_and_left(parameters, run_observer, degrees):
    flight = synthesize(MOVES, parameters, 20.0, seed=3)
    run = run_observer(parameters).fly(askew(flight, degrees))
    count = run.state.yaw.count
    assert run.health is ObserverStatus.MAG_LEFT
    assert count[YAW_COUNT.left] == 1 and count[YAW_COUNT.resets] == 1
    assert abs(heading_error_deg(flight, run)) < 3.0
    told_deg = np.degrees(run.state.yaw.now[YAW.mag_error])
    assert abs((told_deg + degrees + 180.0) % 360.0 - 180.0) < 10.0


def test_the_disagreement_is_told_before_it_is_acted_on(parameters, run_observer):
    flight = synthesize(MOVES, parameters, 10.0, seed=3)
    run, told = run_observer(parameters), []
    for row in askew(flight, 90.0):
        told.append(run.fly([row]).health)
    first = told.index(ObserverStatus.HEADING_DISAGREES)
    left = told.index(ObserverStatus.MAG_LEFT)
    assert left - first == pytest.approx(100.0 * parameters["ekf.motion.hold_s"], abs=1)


@pytest.mark.parametrize("degrees", [0.0, 90.0])
def test_a_hover_without_movement_tells_no_heading(parameters, run_observer, degrees):
    """Not even of a compass that is wrong: it says so, and guesses nothing."""
    flight = synthesize(RESTS, parameters, 20.0, seed=4)
    run = run_observer(parameters).fly(askew(flight, degrees))
    bank = run.state.yaw
    assert bank.count[YAW_COUNT.state] == YawState.NOT_OBSERVABLE
    assert bank.count[YAW_COUNT.left] == bank.count[YAW_COUNT.resets] == 0
    assert bank.now[YAW.variance] > parameters["ekf.motion.sigma_rad"] ** 2


@pytest.mark.parametrize("seed", range(3))
def test_beside_a_sound_compass_it_changes_no_bit(parameters, run_observer, seed):
    flight = synthesize(MOVES, parameters, 20.0, seed=seed)
    run = run_observer(parameters).fly(flight.y)
    parameters["ekf.motion.difference_rad"] = 3.15
    off = run_observer(parameters).fly(flight.y)
    assert run.state.yaw.count[YAW_COUNT.state] == YawState.AGREES
    assert np.array_equal(run.out, off.out, equal_nan=True)
    n = len(flight.y) - 1 - run.params.horizon_ticks
    true = Rotation.from_quat(np.roll(flight.q[n], -1)).as_euler("ZYX")[0]
    off_rad = (run.state.yaw.now[YAW.heading] - true + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(off_rad) < 4.0 * np.sqrt(run.state.yaw.now[YAW.variance]) < 0.4


def test_a_heading_that_went_wrong_comes_back_to_a_sound_compass(parameters, run_observer):
    """The compass, refused for being 40 deg off, is what motion says: it is followed again."""
    flight = synthesize(MOVES, parameters, 30.0, seed=5)
    run = run_observer(parameters).fly(flight.y[:1500])
    at = slice(L.NOMINAL.quat, L.NOMINAL.quat + 4)
    turned = Rotation.from_euler("Z", 40.0, degrees=True) * Rotation.from_quat(
        np.roll(run.state.nominal[at], -1)
    )
    run.state.nominal[at] = np.roll(turned.as_quat(), 1)
    run.fly(flight.y[1500:])
    assert run.state.yaw.count[YAW_COUNT.resets] == 1 and run.state.yaw.count[YAW_COUNT.left] == 0
    assert run.health is ObserverStatus.OK
    assert abs(heading_error_deg(flight, run)) < 1.5


def test_prediction_matches_numeric_differentiation(parameters):
    k = ObserverConfig(parameters).params.ekf
    bank = initial_state(ObserverConfig(parameters)).yaw
    rng = np.random.default_rng(0)
    S = rng.standard_normal((5, 5))
    start = np.array([1.0, -2.0, 0.7, 0.2, -0.1])

    def predicted(x, P):
        bank.x[0], bank.P[0] = x, P
        bank.now[YAW.dv : YAW.dv + 2], bank.now[YAW.time] = (0.4, -0.3), 0.2
        yaw_bank._predict(bank, k)
        return bank.x[0].copy(), bank.P[0].copy()

    noise = predicted(start, np.zeros((5, 5)))[1]
    Phi = np.empty((5, 5))
    for j in range(5):
        step = 1e-6 * np.eye(5)[j]
        ends = [predicted(start + sign * step, S @ S.T)[0] for sign in (1.0, -1.0)]
        Phi[:, j] = (ends[0] - ends[1]) / 2e-6
    P = predicted(start, S @ S.T)[1]
    np.testing.assert_allclose(P, Phi @ S @ S.T @ Phi.T + noise, atol=1e-8)


def test_update_is_the_joint_kalman_update():
    rng = np.random.default_rng(1)
    S = rng.standard_normal((5, 5))
    x, P, fix, var = np.zeros(5), S @ S.T, np.array([0.3, -0.4, 9.0]), 0.04
    H = np.eye(5)[:2]
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + var * np.eye(2))
    expected = gain @ fix[:2], (np.eye(5) - gain @ H) @ P
    yaw_bank._update(x, P, fix, var)
    np.testing.assert_allclose(x, expected[0], atol=1e-12)
    np.testing.assert_allclose(P, expected[1], atol=1e-12)


def test_fixes_that_surprise_every_heading_begin_it_anew(parameters, run_observer):
    """A receiver that goes wild tells no heading."""
    flight = synthesize(MOVES, parameters, 20.0, seed=6)
    rows = flight.y.copy()
    rows[1500:, MEAS.gps_vel] += 20.0 * np.sin(0.7 * np.arange(len(rows) - 1500))[:, None]
    run = run_observer(parameters).fly(rows)
    assert run.state.yaw.count[YAW_COUNT.state] == YawState.NOT_OBSERVABLE
    assert run.state.yaw.count[YAW_COUNT.resets] == 0
