# SPDX-License-Identifier: Apache-2.0
"""The offset-free target of the linear laws: what it removes, its bounds, what it costs."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.rows import MEASURED
from heli_inner_hinf.controller_state import (
    INTEGRAL,
    SHIFT_LIMIT_RAD,
    Actuation,
    AttitudeStatus,
    ObserverInput,
    initial_law_state,
)
from heli_inner_hinf.controllers import attitude_law, swap_bumpless
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import disk_margin, flown_loop, sampled_plant
from heli_inner_hinf.tuning import diagonal_gain, model_of

RATE = 0.5
MOMENT = np.array([0.0, 0.0, 0.5, -0.8, 0.0, 0.0, 0.2, 0.0, 0.0])  # rad/s2 on p, q, r


def config_of(parameters, rate, controller="hinf", **changes):
    return AttitudeConfig.from_parameters(
        {**parameters, "offset_free_radps": rate, "controller": controller, **changes}
    )


def command(k):
    return k.x_trim[[0, 1, 8]].copy()


def settled(config, ticks=3000):
    """Angles (3,), rad, that a lasting moment leaves; every state measured, servo and delay on."""
    k = config.params
    model = model_of(config)
    with_moment = replace(model, E=np.column_stack([MOMENT, np.zeros((9, 2))]))
    plant = sampled_plant(with_moment, Actuation())
    x, state, u3 = np.zeros(plant.A.shape[0]), initial_law_state(k), np.zeros(3)
    for _ in range(ticks):
        attitude_law(k.x_trim + x[:9], command(k), k, state, u3)
        x = plant.A @ x + plant.B @ np.r_[1.0, np.zeros(5), u3 - k.u_trim]
    return x[[0, 1, 8]]


@pytest.mark.parametrize("controller", ["hinf", "lqr"])
def test_lasting_moment_leaves_no_error(parameters, controller):
    without = settled(config_of(parameters, 0.0, controller))
    assert np.abs(without[:2]).min() > 1e-3
    assert np.abs(settled(config_of(parameters, RATE, controller))).max() < 1e-5


def test_error_without_it_is_what_the_model_says(parameters):
    """(A + BF) x + d = 0 with the moment d: the closed form of what state feedback leaves."""
    config = config_of(parameters, 0.0, prediction_s=0.0)
    x = -np.linalg.solve(config.A + config.B @ config.synthesis.F, MOMENT)
    assert np.allclose(settled(config), x[[0, 1, 8]], atol=1e-7)


def test_shift_is_bounded_and_waits_at_the_limit(parameters):
    k = config_of(parameters, RATE).params
    state, u3 = initial_law_state(k), np.zeros(3)
    x9 = k.x_trim.copy()
    x9[1] -= 0.1
    for _ in range(1000):
        attitude_law(x9, command(k), k, state, u3)
    assert state[INTEGRAL + 1] == SHIFT_LIMIT_RAD and state[INTEGRAL] == 0.0
    x9[1] -= 3.0
    before = state.copy()
    x9[0] += 0.01
    assert attitude_law(x9, command(k), k, state, u3) == AttitudeStatus.SATURATED
    assert np.array_equal(state[INTEGRAL : INTEGRAL + 3], before[INTEGRAL : INTEGRAL + 3])


def test_off_is_eq_17_and_keeps_no_memory(parameters):
    k = config_of(parameters, 0.0).params
    state, u3 = initial_law_state(k), np.zeros(3)
    for _ in range(10):
        attitude_law(k.x_trim + 0.01, command(k), k, state, u3)
    assert np.all(state[INTEGRAL : INTEGRAL + 3] == 0.0)


def test_swap_in_flight_has_no_jump(parameters):
    k = config_of(parameters, RATE).params
    state, u3 = initial_law_state(k), np.zeros(3)
    for _ in range(100):
        attitude_law(k.x_trim + 0.01, command(k), k, state, u3)
    flown = u3.copy()
    swap_bumpless(state, k)
    attitude_law(k.x_trim + 0.01, command(k), k, state, u3)
    assert np.allclose(u3, flown, atol=2e-3)


@pytest.mark.parametrize("u_delay_ticks", [0, 1, 2])
def test_analysed_controller_is_the_flown_law(parameters, u_delay_ticks):
    """The controller that the margins are told by against the compiled law behind the same
    observer."""
    config = config_of(parameters, RATE)
    bare = config_of(parameters, 0.0)
    K = diagonal_gain(config.A, (-10.0, -10.0, -5.0))
    feed = ObserverInput(u_delay_ticks=u_delay_ticks)
    analysed = flown_loop(model_of(config), K, config.prediction_s, feed).controller
    law = flown_loop(model_of(bare), K, config.prediction_s, feed).controller
    inputs = np.random.default_rng(5).standard_normal((30, 9)) * 0.01  # y, then the command
    at = [MEASURED.index(i) for i in (0, 1, 8)]
    w, v, shift = np.zeros(analysed.A.shape[0]), np.zeros(law.A.shape[0]), np.zeros(3)
    extra = analysed.A[: law.A.shape[0], law.A.shape[0] :]
    for y in inputs:
        u = law.C @ v + law.D @ y + config.synthesis.G @ shift
        assert np.allclose(analysed.C @ w + analysed.D @ y, u, atol=1e-13)
        w = analysed.A @ w + analysed.B @ y
        v = law.A @ v + law.B @ y + extra @ shift
        shift = shift + 0.01 * RATE * (y[6:] - y[at])
    # what the shift adds to the command is what the observer and the delay line are told
    servos = 9
    assert np.allclose(extra[servos : servos + 3], config.synthesis.G)


def test_margins_that_it_costs(parameters):
    """At the documented rate the loop as flown keeps the wanted 0.5 at input and output."""
    K = diagonal_gain(config_of(parameters, 0.0).A, (-10.0, -10.0, -5.0))
    margins = {}
    for rate in (0.0, RATE):
        config = config_of(parameters, rate)
        loop = flown_loop(model_of(config), K, config.prediction_s)
        assert loop.stability() < 0.0
        margins[rate] = [disk_margin(loop, where).alpha for where in ("input", "output")]
    assert min(margins[RATE]) >= 0.6
    assert np.all(np.array(margins[RATE]) <= np.array(margins[0.0]))
