# SPDX-License-Identifier: Apache-2.0
"""Reduced-order observer, eq. (19): algebra, discretisation, convergence, inside the tick loop."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

from heli_core.linear import diagonal_observer_gain, held_and_linear
from heli_core.rows import MEASURED, NAV, UNMEASURED
from heli_core.ticks import TICK_S
from heli_observer.observer import ObserverConfig, initial_state, observe
from heli_observer.reduced_order import (
    ReducedOrderError,
    continuous_system,
    reduced_order_model,
    reduced_order_params,
    rotor_output,
    rotor_start,
    rotor_step,
)
from support.synthetic_sensors import synthesize, turning_path

M, U = list(MEASURED), list(UNMEASURED)
TRIM_X, TRIM_U = np.zeros(9), np.zeros(4)


@pytest.fixture
def plant(parameters):
    return np.array(parameters["model.A"]), np.array(parameters["model.B"])


@pytest.fixture
def model(parameters, plant):
    return reduced_order_model(*plant, parameters["K"])


def command(t):
    """Three smooth commands."""
    return np.array([0.02 * np.sin(3.0 * t), 0.015 * np.cos(2.0 * t), 0.03 * np.sin(t + 0.4)])


def test_error_obeys_a_prime_whatever_y_and_u_do(plant, model):
    """d/dt (x_u - z - K y) computed from plant and observer separately, at random points."""
    A, B = plant
    rng = np.random.default_rng(0)
    for _ in range(20):
        x, u, z = rng.standard_normal(9), rng.standard_normal(3), rng.standard_normal(3)
        dx = A @ x + B @ u
        dz = model.A_prime @ z + model.B_prime @ x[M] + model.H_prime @ u
        error = x[U] - (z + model.K @ x[M])
        d_error = dx[U] - (dz + model.K @ dx[M])
        np.testing.assert_allclose(d_error, model.A_prime @ error, atol=1e-9)


def test_whole_loop_has_the_plants_poles_and_those_of_a_prime(plant, model):
    A, _ = plant
    whole = np.zeros((12, 12))
    whole[:9, :9] = A
    whole[9:, 9:] = model.A_prime
    whole[np.ix_(range(9, 12), M)] = model.B_prime
    # plant with its unstable input-free dynamics beside the observer: block triangular by design
    T = np.eye(12)
    T[np.ix_(range(9, 12), M)] = model.K
    T[np.ix_(range(9, 12), U)] -= np.eye(3)
    error_form = T @ whole @ np.linalg.inv(T)
    np.testing.assert_allclose(error_form[9:, 9:], model.A_prime, atol=1e-9)
    np.testing.assert_allclose(error_form[9:, :9], 0.0, atol=1e-9)


def test_packaged_gain_has_the_poles_that_its_comment_names(model):
    """The comment above K in observer.yaml: -10, -10, -5 rad/s."""
    characteristic = np.poly(np.linalg.eigvals(model.A_prime))
    np.testing.assert_allclose(characteristic, np.poly([-10.0, -10.0, -5.0]), rtol=1e-3)


def test_discretisation_equals_lsim_for_linear_outputs(model):
    """SciPy's lsim interpolates its input linearly: exact for y; u is constant here."""
    F, G_u, G_y = continuous_system(model, 38.0, 0.51)
    Phi, Gu, G0, G1 = held_and_linear(F, G_u, G_y, TICK_S)
    rng = np.random.default_rng(1)
    y = rng.standard_normal((21, 6)).cumsum(axis=0) * 0.01
    u = np.array([0.1, -0.2, 0.05])
    t = np.arange(21) * 0.01
    inputs = np.hstack([np.tile(u, (21, 1)), y])
    _, _, states = lsim((F, np.hstack([G_u, G_y]), np.eye(9), np.zeros((9, 9))), inputs, t)
    w = np.zeros(9)
    for n in range(1, 21):
        w = Phi @ w + Gu @ u + G0 @ y[n - 1] + G1 @ y[n]
        np.testing.assert_allclose(w, states[n], atol=1e-11)


def test_kernels_equal_the_matrices(model):
    k = reduced_order_params(model, TRIM_X + 0.1, TRIM_U + 0.05, 1, 38.0, 0.51)
    rng = np.random.default_rng(2)
    w, y0, y1, u = (rng.standard_normal(n) for n in (9, 6, 6, 4))
    expected = k.Phi @ w + k.Gu @ (u[:3] - 0.05) + k.G0 @ y0 + k.G1 @ y1
    rotor_step(w, y0, y1, u, k)
    np.testing.assert_allclose(w, expected, atol=1e-12)
    out = np.empty(3)
    rotor_output(w, y1, k, out)
    np.testing.assert_allclose(out, 0.1 + w[:3] + k.K @ y1, atol=1e-14)
    rotor_start(w, y0, u, k)
    rotor_output(w, y0, k, out)
    np.testing.assert_allclose(out, 0.1, atol=1e-14)


def luenberger(plant, model, x0, z0, seconds):
    """Plant and eq. (19) integrated together by SciPy; states at every tick."""
    A, B = plant

    def derivative(t, s):
        x, z, u = s[:9], s[9:], command(t)
        dz = model.A_prime @ z + model.B_prime @ x[M] + model.H_prime @ u
        return np.concatenate([A @ x + B @ u, dz])

    t = np.arange(round(seconds * 100) + 1) * 0.01
    start = np.concatenate([x0, z0])
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12, "t_eval": t}
    return t, solve_ivp(derivative, (0.0, seconds), start, **options).y.T


def test_continuous_error_converges_exactly_as_the_exponential(plant, model):
    x0 = np.array([0.02, -0.01, 0.0, 0.0, 0.01, -0.01, 0.1, 0.02, 0.0])
    t, s = luenberger(plant, model, x0, np.zeros(3), 1.0)
    error = s[:, U] - (s[:, 9:] + s[:, M] @ model.K.T)
    for n in (10, 50, 100):
        np.testing.assert_allclose(error[n], expm(model.A_prime * t[n]) @ error[0], atol=1e-8)


def test_ticks_match_a_luenberger_simulation(plant, model):
    """Against SciPy's continuous simulation; what is left is the hold of y and u over a tick."""
    x0 = np.array([0.02, -0.01, 0.0, 0.0, 0.001, -0.001, 0.0, 0.002, 0.0])
    k = reduced_order_params(model, TRIM_X, TRIM_U, 0, 0.0, 0.51)
    z0 = -model.K @ x0[M]
    t, s = luenberger(plant, model, x0, z0, 2.0)
    w = np.zeros(9)
    rotor_start(w, np.ascontiguousarray(s[0, M]), TRIM_U, k)
    out = np.empty((len(t), 3))
    rotor_output(w, np.ascontiguousarray(s[0, M]), k, out[0])
    for n in range(1, len(t)):
        u = np.append(command(t[n] - 0.005), 0.0)
        y0, y1 = np.ascontiguousarray(s[n - 1, M]), np.ascontiguousarray(s[n, M])
        rotor_step(w, y0, y1, u, k)
        rotor_output(w, y1, k, out[n])
    estimate = s[:, 9:] + s[:, M] @ model.K.T
    size = np.max(np.abs(s[:, U]), axis=0)
    assert np.all(np.max(np.abs(out - estimate), axis=0) < 0.01 * size)


def test_estimates_follow_a_linear_plant_with_servos_and_delay(plant, model):
    """Linear aircraft with servos and one tick of delay, commands held: the error dies out."""
    A, B = plant
    F = np.zeros((15, 15))
    F[:9, :9], F[:9, 9:12] = A, B
    F[9:12, 12:15] = np.eye(3)
    F[12:15, 9:12], F[12:15, 12:15] = -(38.0**2) * np.eye(3), -2 * 0.51 * 38.0 * np.eye(3)
    G = np.zeros((15, 3))
    G[12:15] = 38.0**2 * np.eye(3)
    step = expm(np.block([[F, G], [np.zeros((3, 18))]]) * 0.01)[:15]
    residue = {}
    for delay, servo in ((1, 38.0), (0, 38.0), (1, 0.0)):
        k = reduced_order_params(model, TRIM_X, TRIM_U, delay, servo, 0.51)
        x, w = np.zeros(15), np.zeros(9)
        x[[4, 5, 7]] = [0.002, -0.002, 0.003]
        history = np.zeros((3, 4))
        rotor_start(w, np.ascontiguousarray(x[M]), history[0], k)
        errors = []
        for n in range(1, 301):
            acting = history[0, :3]  # computed at n - 2, acts during [n - 1, n)
            history = np.vstack([np.append(command(0.01 * (n - 1)), 0.0), history[:2]])
            y0 = np.ascontiguousarray(x[M])
            x = step @ np.concatenate([x, acting])
            y1, out = np.ascontiguousarray(x[M]), np.empty(3)
            rotor_step(w, y0, y1, history[delay], k)
            rotor_output(w, y1, k, out)
            errors.append(out - x[U])
        residue[delay, servo] = np.max(np.abs(errors[200:]))
    assert residue[1, 38.0] < 1e-4
    assert residue[0, 38.0] > 5.0 * residue[1, 38.0]
    assert residue[1, 0.0] > 5.0 * residue[1, 38.0]


def test_heading_through_180_degrees_leaves_no_jump(parameters):
    """A K with a heading column shows whether psi is unwrapped; it turns twice around."""
    K = np.array(parameters["K"])
    K[:, 5] = [0.01, -0.02, 0.03]
    parameters["K"] = K
    config = ObserverConfig(parameters)
    state = initial_state(config)
    flight = synthesize(turning_path(0.6), parameters, 25.0, seed=0, noise=0.0)
    u = np.array(parameters["trim.u"])
    out = np.empty((len(flight.y), NAV.size))
    for n, row in enumerate(flight.y):
        observe(state, n, row, u, config.params, out[n])
    turned = state.y[0, 5] - 0.3
    assert turned == pytest.approx(0.6 * 25.0, abs=0.3)
    jumps = np.abs(np.diff(out[500:, NAV.rotor], axis=0))
    assert np.max(jumps) < 2e-3


def test_u_delay_takes_the_command_of_that_many_ticks_before(parameters):
    """A single pulse on the lateral command reaches z so many ticks later."""
    first = {}
    for delay in (0, 1, 2):
        config = ObserverConfig(parameters | {"u_delay_ticks": delay, "servo.frequency_radps": 0.0})
        flight = synthesize(turning_path(0.0), parameters, 0.4, seed=0, noise=0.0)
        runs = []
        for pulse in (0.0, 0.1):
            state = initial_state(config)
            rows = []
            for n, row in enumerate(flight.y):
                u = np.array(parameters["trim.u"])
                u[0] += pulse * (n == 20)
                out = np.empty(NAV.size)
                observe(state, n, row, u, config.params, out)
                rows.append(out[NAV.rotor].copy())
            runs.append(np.array(rows))
        first[delay] = int(np.flatnonzero(np.any(runs[0] != runs[1], axis=1))[0])
    assert first == {0: 20, 1: 21, 2: 22}


def test_wrong_matrices_are_refused_by_name(plant):
    A, B = plant
    with pytest.raises(ReducedOrderError, match=r"model\.A .*80"):
        reduced_order_model(A.ravel()[:80], B, np.zeros((3, 6)))
    with pytest.raises(ReducedOrderError, match="^K .*finite"):
        reduced_order_model(A, B, np.full((3, 6), np.nan))
    with pytest.raises(ReducedOrderError, match="unstable"):
        reduced_order_model(A, B, -diagonal_observer_gain(A, (-9.0, -19.0, -4.0), M, U))
