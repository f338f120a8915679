# SPDX-License-Identifier: Apache-2.0
"""Kernels of the filter: strapdown, Jacobians, scalar updates, against independent computations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from heli_core.atmosphere import pressure_pa
from heli_core.rotations import fill_from_rotvec, quat_from_euler, quat_multiply
from heli_core.rows import MEAS
from heli_observer import ekf as ins_ekf
from heli_observer import layout as L
from heli_observer.observer import ObserverConfig

GRAVITY = 9.781


def error_between(x_true, x):
    """Error state (20,) such that x (+) error = x_true, with SciPy's rotations."""
    e = np.zeros(L.ERROR.size)
    e[0:6] = x_true[0:6] - x[0:6]
    R_true = Rotation.from_quat(np.roll(x_true[6:10], -1))
    e[6:9] = (R_true * Rotation.from_quat(np.roll(x[6:10], -1)).inv()).as_rotvec()
    e[9:20] = x_true[10:21] - x[10:21]
    return e


def disturbed(x, e):
    """x (+) e."""
    z = x.copy()
    z[0:6] += e[0:6]
    turn = np.empty(4)
    fill_from_rotvec(e[6:9], turn)
    z[6:10] = quat_multiply(turn, x[6:10])
    z[10:21] += e[9:20]
    return z


@pytest.fixture
def kernel(parameters):
    return ObserverConfig(parameters).params.ekf


@pytest.fixture
def some_state():
    x = np.zeros(L.NOMINAL.size)
    x[0:6] = [10.0, -4.0, -12.0, 1.0, -2.0, 0.5]
    x[6:10] = quat_from_euler(0.2, -0.3, 2.0)
    x[10:13] = [0.01, -0.02, 0.03]
    x[13:16] = [0.1, -0.2, 0.15]
    x[16:21] = [0.5, -0.7, 1.0, 12.0, 0.02]
    return x


IMU0 = np.array([0.5, -0.4, -9.5, 0.3, -0.2, 0.5])
IMU1 = np.array([0.7, -0.1, -9.9, 0.4, -0.1, 0.3])


def integrated(x0, dt):
    """Nominal state after dt of IMU samples that vary linearly from IMU0 to IMU1, by DOP853."""

    def derivative(t, x):
        imu = IMU0 + (IMU1 - IMU0) * t / dt
        w = imu[3:6] - x0[10:13]
        R = Rotation.from_quat(np.roll(x[6:10] / np.linalg.norm(x[6:10]), -1)).as_matrix()
        dq = 0.5 * quat_multiply(x[6:10], np.array([0.0, *w]))
        a = R @ (imu[0:3] - x0[13:16]) + [0.0, 0.0, GRAVITY]
        return np.concatenate([x[3:6], a, dq])

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    return solve_ivp(derivative, (0.0, dt), x0[:10], **options).y[:, -1]


def test_strapdown_matches_integration_of_linearly_varying_imu(some_state):
    """Against DOP853; the trapezoidal rule in velocity leaves an error of order dt^3 in a tick."""
    errors = []
    for dt in (0.01, 0.005):
        x = some_state.copy()
        ins_ekf.strapdown(x, IMU0, IMU1, GRAVITY, dt, np.zeros(3), np.zeros((3, 3)))
        exact = integrated(some_state, dt)
        errors.append(np.max(np.abs(x[3:6] - exact[3:6])))
        assert np.max(np.abs(x[6:10] - exact[6:10])) < 1e-10
        assert np.max(np.abs(x[0:3] - exact[0:3])) < 1e-6
        assert np.array_equal(x[10:], some_state[10:])
    assert errors[0] < 2e-5
    # the rotation's share of the error is dt^3 for fixed end values, its change's dt^2
    assert errors[0] / errors[1] > 3.5


def test_transition_matches_numeric_differentiation_of_the_nominal(some_state, kernel):
    base = some_state.copy()
    scratch = np.zeros((L.ERROR.size, L.ERROR.size))
    ins_ekf.predict(base, scratch, IMU0, IMU1, kernel)
    a_ned, R = np.zeros(3), np.zeros((3, 3))
    ins_ekf.strapdown(some_state.copy(), IMU0, IMU1, kernel.gravity_mps2, 0.01, a_ned, R)
    numeric = np.zeros((L.ERROR.size, L.ERROR.size))
    analytic = np.zeros((L.ERROR.size, L.ERROR.size))
    for j in range(L.ERROR.size):
        unit = np.zeros(L.ERROR.size)
        unit[j] = 1.0
        ends = []
        for eps in (1e-4, -1e-4):
            x = disturbed(some_state, eps * unit)
            ins_ekf.predict(x, scratch, IMU0, IMU1, kernel)
            ends.append(error_between(x, base))
        numeric[:, j] = (ends[0] - ends[1]) / 2e-4
        ins_ekf.apply_transition(unit, R, a_ned, kernel)
        analytic[:, j] = unit
    # left out: how a_ned and R vary within the tick; half dt^2 g is 5e-4
    assert np.max(np.abs(numeric - analytic)) < 2e-5
    # the couplings themselves are 1e-2 (dt) to 1e-1 (g dt)
    assert abs(analytic[3, 7]) > 0.09 and abs(analytic[6, 9]) > 1e-3


def test_propagated_covariance_equals_the_dense_product(some_state, kernel):
    rng = np.random.default_rng(0)
    S = rng.standard_normal((L.ERROR.size, L.ERROR.size))
    P0 = S @ S.T
    a_ned, R = np.zeros(3), np.zeros((3, 3))
    ins_ekf.strapdown(some_state.copy(), IMU0, IMU1, kernel.gravity_mps2, 0.01, a_ned, R)
    Phi = np.eye(L.ERROR.size)
    for j in range(L.ERROR.size):
        column = Phi[:, j].copy()
        ins_ekf.apply_transition(column, R, a_ned, kernel)
        Phi[:, j] = column
    q = np.zeros(L.ERROR.size)
    q[3:6], q[6:9] = kernel.var_vel_step, kernel.var_att_step
    q[9:12], q[12:15] = kernel.var_gyro_bias_step, kernel.var_accel_bias_step
    q[15:17], q[17] = kernel.var_drift_step_horizontal, kernel.var_drift_step_vertical
    q[18], q[19] = kernel.var_baro_bias_step, kernel.var_mag_error_step
    P = P0.copy()
    ins_ekf.propagate_covariance(P, R, a_ned, kernel)
    np.testing.assert_allclose(P, Phi @ P0 @ Phi.T + np.diag(q), rtol=1e-12, atol=1e-12)
    assert np.array_equal(P, P.T)


def test_sequential_scalar_updates_equal_the_joint_update():
    """State, covariance (against Joseph's form), sum of normalised innovations squared."""
    rng = np.random.default_rng(1)
    S = rng.standard_normal((L.ERROR.size, L.ERROR.size))
    P0 = S @ S.T
    H = np.zeros((3, L.ERROR.size))
    for i in range(3):
        H[i, i], H[i, 15 + i] = 1.0, 1.0
    variances = np.array([0.3, 0.4, 0.9])
    residual = rng.standard_normal(3)
    innovation = H @ P0 @ H.T + np.diag(variances)
    gain = P0 @ H.T @ np.linalg.inv(innovation)
    keep = np.eye(L.ERROR.size) - gain @ H
    P, dx = P0.copy(), np.zeros((2, L.ERROR.size))
    nis = 0.0
    for i in range(3):
        nis += ins_ekf.scalar_update(
            P, dx, i, 1.0, 15 + i, 1.0, 0, 0.0, 0, 0.0, residual[i], variances[i]
        )
    np.testing.assert_allclose(dx[0], gain @ residual, atol=1e-12)
    joseph = keep @ P0 @ keep.T + gain @ np.diag(variances) @ gain.T
    np.testing.assert_allclose(P, joseph, atol=1e-11)
    assert nis == pytest.approx(residual @ np.linalg.solve(innovation, residual), rel=1e-12)
    assert np.array_equal(P, P.T)


def test_start_scalar_is_the_limit_of_an_unbounded_prior():
    rng = np.random.default_rng(2)
    S = rng.standard_normal((L.ERROR.size, L.ERROR.size))
    P0 = S @ S.T
    wide = P0.copy()
    wide[8, :] = wide[:, 8] = 0.0
    wide[8, 8] = 1e9
    ins_ekf.scalar_update(
        wide, np.zeros((2, L.ERROR.size)), 8, 1.0, 6, -0.7, 7, 0.3, 19, 1.0, 0.0, 0.01
    )
    P = P0.copy()
    ins_ekf.start_scalar(P, 8, 6, -0.7, 7, 0.3, 19, 1.0, 0.01)
    np.testing.assert_allclose(P, wide, atol=1e-5)


def test_heading_derivatives_match_numeric_differentiation(kernel):
    q = quat_from_euler(0.2, -0.15, 2.5)
    R = Rotation.from_quat(np.roll(q, -1))
    mag = R.inv().apply(kernel.field_ned_t)
    residual, horizontal = ins_ekf.heading_innovation(q, mag, kernel.field_ned_t)
    north, east, local = ins_ekf.heading_derivatives(kernel.field_ned_t)
    assert abs(residual) < 1e-12
    assert horizontal == pytest.approx(np.hypot(*kernel.field_ned_t[:2]), rel=1e-12)
    assert local == pytest.approx(horizontal, rel=1e-12)
    expected = [north, east, 1.0]
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-6
        ends = []
        for sign in (1.0, -1.0):
            true = Rotation.from_rotvec(sign * step) * R
            measured = true.inv().apply(kernel.field_ned_t)
            ends.append(ins_ekf.heading_innovation(q, measured, kernel.field_ned_t)[0])
        assert (ends[0] - ends[1]) / 2e-6 == pytest.approx(expected[i], rel=1e-6, abs=1e-9)


def test_heading_innovation_is_wrapped(kernel):
    field = kernel.field_ned_t
    mag = Rotation.from_euler("Z", np.pi - 0.01).inv().apply(field)
    q = quat_from_euler(0.0, 0.0, -np.pi + 0.02)
    assert ins_ekf.heading_innovation(q, mag, field)[0] == pytest.approx(-0.03, abs=1e-9)


def test_baro_slope_matches_numeric_differentiation():
    for altitude in (-100.0, 0.0, 60.0, 2500.0):
        numeric = (pressure_pa(altitude + 0.5) - pressure_pa(altitude - 0.5)) / 1.0
        assert ins_ekf.baro_slope(altitude) == pytest.approx(numeric, rel=1e-7)
    # sea level: -rho g of the standard atmosphere
    assert ins_ekf.baro_slope(0.0) == pytest.approx(-1.2250 * 9.80665, rel=1e-4)


def test_injection_undoes_a_known_error(some_state):
    e = np.zeros(L.ERROR.size)
    e[:] = np.linspace(-0.02, 0.03, L.ERROR.size)
    x, dx = some_state.copy(), np.zeros((2, L.ERROR.size))
    dx[0] = e
    ins_ekf.inject(x, dx)
    np.testing.assert_allclose(error_between(x, some_state), e, atol=1e-14)


def test_covariance_stays_positive_over_ten_minutes(parameters, run_observer):
    """Ten minutes at rest, every update on: symmetric and positive definite to the end."""
    run = run_observer(parameters)
    field = np.array(parameters["ekf.mag.field_ned_t"])
    y = np.zeros(MEAS.sensed)
    y[2], y[6:9], y[9] = -GRAVITY, field, pressure_pa(60.0)
    for tick in range(60_000):
        y[16:19] = [tick % 2 == 0, tick % 5 == 0, tick % 20 == 0]
        y[12], y[19] = -10.0, tick - 15
        run.step(tick, y)
    assert np.array_equal(run.state.P, run.state.P.T)
    scale = 1.0 / np.sqrt(np.diag(run.state.P))
    assert np.linalg.eigvalsh(run.state.P * scale[:, None] * scale).min() > 1e-9
