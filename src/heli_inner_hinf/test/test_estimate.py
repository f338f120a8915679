# SPDX-License-Identifier: Apache-2.0
"""The estimate of now: to the last bit if it is of now, by the model if not, none if too old."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from heli_core.rows import NINE, UNMEASURED
from heli_core.ticks import TICK_S
from heli_inner_hinf.estimate import commanded, estimate, estimate_params, hear, initial_estimate
from heli_inner_hinf.node import InnerLoopNode

VALUES = InnerLoopNode.SPEC.resolve()
K = estimate_params(VALUES)
ROTOR = list(UNMEASURED)


def off_trim(scale=0.02):
    rng = np.random.default_rng(3)
    return K.x_trim + scale * rng.standard_normal(9)


def now(state, tick):
    x9 = np.zeros(9)
    estimate(state, tick, K, x9)
    return x9


def test_one_of_this_tick_is_flown_to_the_last_bit():
    state, estimate_x9 = initial_estimate(K), off_trim()
    hear(state, 7, estimate_x9.copy(), 7, K)
    np.testing.assert_array_equal(now(state, 7), estimate_x9)


def test_before_the_first_there_is_none():
    assert np.isnan(now(initial_estimate(K), 0)).all()


def reference(estimate_x9, commands, first, last):
    """The same by SciPy's integrator: eq. (9), servos of second order, delay of `K.delay_ticks`."""
    A, B = (np.array(VALUES[f"model.{m}"], float) for m in ("A", "B"))
    A, B = A.reshape(9, 9), B.reshape(9, 3)
    w, zeta = VALUES["servo.frequency_radps"], VALUES["servo.damping"]
    state = np.zeros(15)
    for tick in range(last):
        u = commands[max(tick - K.delay_ticks, 0)] - K.u_trim
        if tick - K.delay_ticks < 0:
            u = np.zeros(3)
        if tick == first:
            state[:9] = estimate_x9 - K.x_trim

        def rate(_, s, u=u):
            x, pos, vel = s[:9], s[9:12], s[12:]
            return np.concatenate((A @ x + B @ pos, vel, w * w * (u - pos) - 2 * zeta * w * vel))

        state = solve_ivp(rate, (0.0, TICK_S), state, rtol=1e-10, atol=1e-12).y[:, -1]
    return state[:9] + K.x_trim


@pytest.mark.parametrize("age", [1, 3, 10])
def test_an_old_one_is_carried_on_as_the_model_does_behind_delay_and_servos(age):
    estimate_x9, first = off_trim(), 12
    commands = K.u_trim + 0.1 * np.random.default_rng(1).standard_normal((first + age, 3))
    state = initial_estimate(K)
    for tick in range(first + age):
        if tick == first:
            hear(state, tick, estimate_x9.copy(), tick, K)
        commanded(state, tick, commands[tick], K)
    expected = reference(estimate_x9, commands, first, first + age)
    carried = now(state, first + age)
    # The servos' way within a tick counts by its mean.
    np.testing.assert_allclose(carried, expected, atol=2e-3 * age)
    assert np.abs(carried - estimate_x9).max() > 20 * np.abs(carried - expected).max()


def test_an_older_one_than_is_known_changes_nothing_and_a_late_one_is_carried():
    state, estimate_x9 = initial_estimate(K), off_trim()
    for tick in range(10):
        commanded(state, tick, K.u_trim, K)
    hear(state, 8, estimate_x9.copy(), 8, K)
    at_10 = now(state, 10)
    hear(state, 6, off_trim(0.5), 6, K)
    hear(state, 8, off_trim(0.5), 8, K)
    np.testing.assert_array_equal(now(state, 10), at_10)


def test_one_that_is_too_old_is_none():
    state = initial_estimate(K)
    hear(state, 0, off_trim(), 0, K)
    assert np.isfinite(now(state, K.timeout_ticks)).all()
    assert np.isnan(now(state, K.timeout_ticks + 1)).all()
    assert K.timeout_ticks == 50


def test_rotor_states_that_are_missing_are_those_of_the_model():
    state, estimate_x9 = initial_estimate(K), off_trim()
    hear(state, 0, estimate_x9.copy(), 0, K)
    for tick in range(3):
        commanded(state, tick, K.u_trim, K)
    model, measured = now(state, 3), off_trim(0.01)
    measured[ROTOR] = np.nan
    hear(state, 3, measured.copy(), 0, K)
    completed = now(state, 3)
    np.testing.assert_array_equal(completed[ROTOR], model[ROTOR])
    others = [i for i in range(9) if i not in ROTOR]
    np.testing.assert_array_equal(completed[others], measured[others])
    # Nobody has said anything before: the trim's.
    fresh = initial_estimate(K)
    hear(fresh, 3, measured.copy(), 0, K)
    np.testing.assert_array_equal(now(fresh, 3)[ROTOR], K.x_trim[ROTOR])


def test_heading_goes_on_round_the_compass():
    state, estimate_x9 = initial_estimate(K), K.x_trim.copy()
    estimate_x9[NINE.psi], estimate_x9[NINE.r] = np.pi - 0.001, 2.0
    hear(state, 0, estimate_x9, 0, K)
    commanded(state, 0, K.u_trim, K)
    assert now(state, 1)[NINE.psi] < -3.0


def test_what_is_not_finite_is_not_taken():
    state, estimate_x9 = initial_estimate(K), off_trim()
    estimate_x9[NINE.p] = np.nan
    hear(state, 4, estimate_x9, 4, K)
    assert np.isnan(now(state, 4)).all()
