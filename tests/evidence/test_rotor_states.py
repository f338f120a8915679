# SPDX-License-Identifier: Apache-2.0
"""Eq. (19) on a recorded flight, and with constant disturbances of flapping beside it."""

import numpy as np
import pytest

from evidence.experiments.rotor_states import STATES, estimates, with_disturbances
from heli_core.linear import held
from heli_core.rows import ACTUATOR, MEASURED, UNMEASURED
from heli_core.ticks import TICK_S
from heli_flight.settings import resolve
from heli_observer.reduced_order import (
    reduced_order_model,
    reduced_order_params,
    rotor_output,
    rotor_start,
    rotor_step,
)


@pytest.fixture(scope="module")
def p():
    return resolve("hover", "rtk").nodes["observer"]


def matrices(p):
    return np.reshape(p["model.A"], (9, 9)), np.reshape(p["model.B"], (9, 3))


def test_what_is_told_again_is_what_flies(p):
    """The array form and the observer's kernel give the same states from the same rows."""
    A, B = matrices(p)
    model = reduced_order_model(A, B, p["K"])
    rng = np.random.default_rng(1)
    y, u = 0.01 * rng.standard_normal((50, 6)), 0.1 * rng.standard_normal((50, 3))
    servo = p["servo.frequency_radps"], p["servo.damping"]
    delay = int(p["u_delay_ticks"])
    k = reduced_order_params(model, np.zeros(9), np.zeros(4), delay, *servo)
    commands = np.zeros((50, ACTUATOR.size))
    commands[:, ACTUATOR.attitude] = np.vstack([u[:1]] * delay + [u[: len(u) - delay]])
    w, out, made = np.zeros(9), np.zeros(3), []
    rotor_start(w, y[0], np.zeros(4), k)
    for i in range(50):
        if i > 0:
            rotor_step(w, y[i - 1], y[i], commands[i - 1], k)
        rotor_output(w, y[i], k, out)
        made.append(out.copy())
    np.testing.assert_allclose(estimates(model, y, u, delay, servo), made, rtol=1e-9, atol=1e-12)


def test_constant_disturbances_are_found(p):
    """Poles -w twice and those of A' + w I; the error of a_s and b_s under a constant rate dies."""
    A, B = matrices(p)
    plain, w = reduced_order_model(A, B, p["K"]), 1.0
    model = with_disturbances(plain, A, B, w)
    poles = np.sort(np.linalg.eigvals(model.A_prime).real)
    np.testing.assert_allclose(poles, [-9.0, -9.0, -5.0, -w, -w], atol=0.01)
    # x' = A x + push from rest for 6 s, commands at trim: the states drift, the outputs tell.
    push = np.zeros(9)
    push[list(UNMEASURED)[:2]] = 0.01, -0.02
    Phi, step = held(A, push[:, None], TICK_S)
    x = np.zeros((601, 9))
    for i in range(600):
        x[i + 1] = Phi @ x[i] + step[:, 0]
    y, none = x[:, list(MEASURED)], np.zeros((601, 3))
    truth = x[-1, list(UNMEASURED)]
    blind = estimates(plain, y, none, 0, (0.0, 0.0))[-1] - truth
    told = estimates(model, y, none, 0, (0.0, 0.0))[-1] - truth
    assert STATES[:2] == ("a_s", "b_s")
    assert np.abs(blind[:2]).min() > 5e-4
    assert np.abs(told[:2]).max() < 0.05 * np.abs(blind[:2]).min()
