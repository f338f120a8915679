# SPDX-License-Identifier: Apache-2.0
"""Sampling, servos, delay and eq. (19) against python-control and against simulation."""

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from heli_core.linear import (
    diagonal_observer_gain,
    held,
    held_and_linear,
    held_late,
    reduced_order_observer,
    with_servos,
)

DT_S = 0.05
OMEGA = np.array([0.3, 2.0, 9.0, 40.0])
MEASURED, UNMEASURED = (0, 3, 4), (1, 2)


@pytest.fixture
def plant():
    rng = np.random.default_rng(4)
    return 3.0 * rng.standard_normal((5, 5)), rng.standard_normal((5, 2))


def of_states(A, B, dt=0.0):
    return control.ss(A, B, np.eye(A.shape[0]), np.zeros(B.shape), dt)


def response(system):
    return system(np.exp(1j * OMEGA * system.dt) if system.dt else 1j * OMEGA)


def test_held_is_the_zero_order_hold_of_python_control(plant):
    sampled = control.sample_system(of_states(*plant), DT_S, method="zoh")
    Phi, Gamma = held(*plant, DT_S)
    np.testing.assert_allclose(Phi, sampled.A, atol=1e-12)
    np.testing.assert_allclose(Gamma, sampled.B, atol=1e-12)


def test_linear_inputs_are_the_first_order_hold_of_python_control(plant):
    """Of the same states, so the responses agree: python-control's own state is another one."""
    A, B = plant
    Phi, Gu, G0, G1 = held_and_linear(A, B[:, :1], B[:, 1:], DT_S)
    z = np.exp(1j * OMEGA * DT_S)
    ours = [np.linalg.solve(x * np.eye(5) - Phi, G0 + x * G1) for x in z]
    foh = control.sample_system(of_states(A, B[:, 1:]), DT_S, method="foh")
    np.testing.assert_allclose(ours, np.moveaxis(response(foh), 2, 0), atol=1e-11)
    np.testing.assert_allclose(Gu, held(A, B[:, :1], DT_S)[1], atol=1e-13)


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.05, 0.1, 0.117])
def test_late_input_against_simulation(plant, delay_s):
    """x(n+1) from an adaptive integrator that switches the input when the delay says so."""
    A, B = plant
    late = held_late(A, B, DT_S, delay_s)
    rng = np.random.default_rng(5)
    commands, x = rng.standard_normal((6, 2)), rng.standard_normal(5)
    n = 5
    expected = late.Phi @ x + late.newer @ commands[n - late.ticks]
    expected += late.older @ commands[n - late.ticks - 1]
    edges = np.unique(np.clip([0.0, delay_s - late.ticks * DT_S, DT_S], 0.0, DT_S))
    for start, end in zip(edges[:-1], edges[1:], strict=True):
        acting = commands[n + int(np.floor((0.5 * (start + end) - delay_s) / DT_S))]

        def rates(_, v, acting=acting):
            return A @ v + B @ acting

        x = solve_ivp(rates, (start, end), x, rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(x, expected, atol=1e-9)


def test_servos_in_series_are_those_of_python_control(plant):
    A, B = plant
    servo = control.tf2ss([38.0**2], [1.0, 2.0 * 0.51 * 38.0, 38.0**2])
    expected = control.series(control.append(servo, servo), of_states(A, B))
    behind = with_servos(A, B, 38.0, 0.51)
    np.testing.assert_allclose(
        response(of_states(*behind))[:5], response(expected), rtol=1e-9, atol=1e-12
    )
    assert np.all(behind[0][5:, :5] == 0.0)


def test_error_of_the_observer_obeys_a_prime(plant):
    """d/dt (x_u - z - K y), from plant and observer separately, at a random point."""
    A, B = plant
    rng = np.random.default_rng(6)
    K, x, u = rng.standard_normal((2, 3)), rng.standard_normal(5), rng.standard_normal(2)
    z = rng.standard_normal(2)
    m, n = list(MEASURED), list(UNMEASURED)
    observer = reduced_order_observer(A, B, K, MEASURED, UNMEASURED)
    x_rate = A @ x + B @ u
    z_rate = observer.A @ z + observer.B @ x[m] + observer.H @ u
    error = x[n] - z - K @ x[m]
    np.testing.assert_allclose(x_rate[n] - z_rate - K @ x_rate[m], observer.A @ error, atol=1e-11)


@pytest.mark.parametrize("poles", [(-9.0, -4.0), (-5.0, -6.0)])
def test_gain_gives_the_poles_asked_for_and_is_the_smallest(plant, poles):
    """python-control places the same poles (another gain, as three outputs see two states)."""
    A, B = plant
    K = diagonal_observer_gain(A, poles, MEASURED, UNMEASURED)
    A_prime = reduced_order_observer(A, B, K, MEASURED, UNMEASURED).A
    np.testing.assert_allclose(A_prime, np.diag(poles), atol=1e-10)
    A_mu = A[np.ix_(MEASURED, UNMEASURED)]
    placed = control.place(A[np.ix_(UNMEASURED, UNMEASURED)].T, A_mu.T, poles).T
    other = reduced_order_observer(A, B, placed, MEASURED, UNMEASURED).A
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(other).real), np.sort(poles), rtol=1e-6)
    null = np.linalg.svd(A_mu.T)[2][-1]  # what can be added to K without a change of A'
    np.testing.assert_allclose(K @ null, 0.0, atol=1e-10)
