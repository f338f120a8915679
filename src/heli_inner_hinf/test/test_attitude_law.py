# SPDX-License-Identifier: Apache-2.0
"""The compiled attitude law: eq. (17), heading wrap, limits, NaN, bumpless swaps, PID."""

import functools
import math
from pathlib import Path

import numpy as np
import pytest

from heli_core.parameters import load
from heli_inner_hinf.controller_state import (
    CONTROLLERS,
    INTEGRAL,
    LAST_U,
    N_LAW_STATE,
    STATE_FEEDBACK,
    Actuation,
    AttitudeStatus,
    initial_law_state,
)
from heli_inner_hinf.controller_template import user_law
from heli_inner_hinf.controllers import attitude_law, swap_bumpless
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Model, pid_as_output_law, sampled_plant
from heli_inner_hinf.parameters import NODE_NAME, TABLE

NAMES = tuple(CONTROLLERS)
YAML = Path(__file__).parents[1] / "config/inner_loop.yaml"


@pytest.fixture(scope="module")
def kernel_of():
    """Kernels of the packaged parameters but for the changes, each designed once."""
    parameters = load(TABLE, [YAML], NODE_NAME)
    law = pid_as_output_law(*(parameters[f"pid.K_{part}"] for part in "PID"))
    values = {**parameters, **{f"law.{part}": getattr(law, part) for part in law._fields}}

    @functools.cache
    def make(controller, **changes):
        return AttitudeConfig.from_parameters(
            {**values, "controller": controller, **changes}
        ).params

    return make


def fly(k, state, x9, r3):
    u3 = np.full(3, np.nan)
    status = attitude_law(np.asarray(x9, float), np.asarray(r3, float), k, state, u3)
    return AttitudeStatus(status), u3


def commanded_trim(k):
    return k.x_trim[[0, 1, 8]].copy()


@pytest.mark.parametrize("controller", NAMES)
def test_trim_is_held_by_the_trim_command(kernel_of, controller):
    k = kernel_of(controller)
    state = initial_law_state(k)
    for _ in range(5):
        status, u3 = fly(k, state, k.x_trim, commanded_trim(k))
        assert status is AttitudeStatus.OK
        assert np.allclose(u3, k.u_trim, atol=1e-15)


@pytest.mark.parametrize("controller", ["hinf", "lqr"])
def test_law_is_eq_17(parameters, controller):
    """Without prediction: u = u_trim + F (x - x_trim) + G (r - h_out_trim), by plain matrices."""
    config = AttitudeConfig.from_parameters(
        {**parameters, "controller": controller, "prediction_s": 0.0}
    )
    gains = config.lqr if controller == "lqr" else config.synthesis
    rng = np.random.default_rng(2)
    k = config.params
    for _ in range(20):
        x9 = k.x_trim + 0.05 * rng.standard_normal(9)
        r3 = commanded_trim(k) + 0.05 * rng.standard_normal(3)
        _, u3 = fly(k, initial_law_state(k), x9, r3)
        expected = k.u_trim + gains.F @ (x9 - k.x_trim) + gains.G @ (r3 - commanded_trim(k))
        assert np.allclose(u3, expected, atol=1e-10)


def test_prediction_is_the_state_ahead(config):
    """u = F x(t + prediction), the model driven by the last command, integrated by small steps."""
    k = config.params
    rng = np.random.default_rng(4)
    x, last = 0.01 * rng.standard_normal(9), 0.05 * rng.standard_normal(3)
    state = initial_law_state(k)
    state[LAST_U : LAST_U + 3] = k.u_trim + last
    _, u3 = fly(k, state, k.x_trim + x, commanded_trim(k))
    steps = 4000
    h = config.prediction_s / steps
    for _ in range(steps):
        half = x + 0.5 * h * (config.A @ x + config.B @ last)
        x = x + h * (config.A @ half + config.B @ last)
    assert np.allclose(u3 - k.u_trim, config.synthesis.F @ x, atol=1e-7)


@pytest.mark.parametrize("controller", NAMES)
@pytest.mark.parametrize(("heading", "wanted"), [(-179.0, 179.0), (179.0, -179.0), (540.0, 182.0)])
def test_heading_error_takes_the_short_way(kernel_of, controller, heading, wanted):
    k = kernel_of(controller)
    x9, r3 = k.x_trim.copy(), commanded_trim(k)
    x9[8], r3[2] = math.radians(heading), math.radians(wanted)
    near, near_r = k.x_trim.copy(), commanded_trim(k)
    error = (heading - wanted + 180.0) % 360.0 - 180.0
    assert abs(error) <= 2.0
    near[8] = math.radians(error)
    near_r[2] = 0.0
    wrapped = fly(k, initial_law_state(k), x9, r3)[1]
    assert np.allclose(wrapped, fly(k, initial_law_state(k), near, near_r)[1], atol=1e-12)


@pytest.mark.parametrize("controller", NAMES)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_actuators_stay_inside_the_open_interval(kernel_of, controller, sign):
    k = kernel_of(controller)
    x9 = k.x_trim + sign * np.array([3, 3, 20, 20, 1, 1, 20, 1, 3.0])
    state = initial_law_state(k)
    # A law with memory may take some ticks.
    flown = [fly(k, state, x9, commanded_trim(k)) for _ in range(10)]
    assert AttitudeStatus.SATURATED in [status for status, _ in flown]
    u3 = np.array([u for _, u in flown])
    assert np.all(np.abs(u3) <= k.limit) and k.limit < 1.0


@pytest.mark.parametrize("controller", NAMES)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["state", "command"])
def test_not_finite_repeats_the_last_good_command(kernel_of, controller, bad, where):
    k = kernel_of(controller)
    state = initial_law_state(k)
    x9, r3 = k.x_trim + 0.02, commanded_trim(k) - 0.01
    _, good = fly(k, state, x9, r3)
    memory = state.copy()
    for i in range(9 if where == "state" else 3):
        bad_x, bad_r = x9.copy(), r3.copy()
        (bad_x if where == "state" else bad_r)[i] = bad
        status, u3 = fly(k, state, bad_x, bad_r)
        assert status is AttitudeStatus.NOT_FINITE and "not finite" in status.sentence
        assert np.array_equal(u3, good)
    assert np.array_equal(state, memory)
    assert fly(k, state, x9, r3)[0] is AttitudeStatus.OK


def test_before_any_good_input_the_trim_is_flown(kernel_of):
    k = kernel_of("hinf")
    _, u3 = fly(k, initial_law_state(k), np.full(9, np.nan), np.zeros(3))
    assert np.array_equal(u3, k.u_trim)


@pytest.mark.parametrize("before", NAMES)
@pytest.mark.parametrize("after", NAMES)
def test_swap_has_no_jump_and_fades(kernel_of, before, after):
    old, new = kernel_of(before), kernel_of(after, gamma=0.08)
    state = initial_law_state(old)
    x9, r3 = old.x_trim + 0.03, commanded_trim(old) + 0.02
    for _ in range(50):
        _, flown = fly(old, state, x9, r3)
    swap_bumpless(state, new)
    _, first = fly(new, state, x9, r3)
    drift = 0.01 * np.abs(new.K_I) * 0.02 + 1e-12 if after == "pid" else 1e-12
    assert np.all(np.abs(first - flown) <= drift)
    if new.controller != STATE_FEEDBACK:
        return  # they integrate: in this lasting error they go on
    for _ in range(1500):
        _, settled = fly(new, state, x9, r3)
    fresh = initial_law_state(new)
    for _ in range(1500):
        _, alone = fly(new, fresh, x9, r3)
    assert np.allclose(settled, alone, atol=1e-9)


def test_engaging_starts_from_what_is_flown(kernel_of):
    for controller in NAMES:
        k = kernel_of(controller)
        state = initial_law_state(k)
        flown = np.array([0.2, -0.1, 0.3])
        swap_bumpless(state, k, flown)
        assert np.allclose(fly(k, state, k.x_trim, commanded_trim(k))[1], flown, atol=1e-12)


@pytest.mark.parametrize("controller", NAMES)
def test_closed_loop_settles_at_the_command(kernel_of, config, controller):
    """The compiled law, all states measured, on the sampled linear plant with servo and delay."""
    k = kernel_of(controller)
    model = Model(config.A, config.B, config.E, config.C, config.D, k.F, k.G)
    plant = sampled_plant(model, Actuation())
    x, state = np.zeros(plant.A.shape[0]), initial_law_state(k)
    step = np.array([0.06, -0.05, 0.3])
    for _ in range(2500):
        _, u3 = fly(k, state, k.x_trim + x[:9], commanded_trim(k) + step)
        x = plant.A @ x + plant.B[:, -3:] @ (u3 - k.u_trim)
    assert np.allclose(x[[0, 1, 8]], step, atol=1e-4)


class TestPid:
    def test_integrator_stands_still_at_the_limit(self, kernel_of):
        k = kernel_of("pid")
        state = initial_law_state(k)
        far = k.x_trim.copy()
        far[0] -= 2.5
        for _ in range(1000):
            status, u3 = fly(k, state, far, commanded_trim(k))
        assert status is AttitudeStatus.SATURATED and u3[0] == k.limit
        assert abs(state[INTEGRAL]) < 0.02
        _, back = fly(k, state, k.x_trim, commanded_trim(k))
        assert abs(back[0] - k.u_trim[0]) < 0.02

    def test_integrator_comes_off_the_limit(self, kernel_of):
        k = kernel_of("pid")
        state = initial_law_state(k)
        state[INTEGRAL] = 5.0
        over = k.x_trim.copy()
        over[0] += 0.1
        _, u3 = fly(k, state, over, commanded_trim(k))
        assert u3[0] == k.limit and state[INTEGRAL] < 5.0

    def test_derivative_is_on_the_measurement(self, kernel_of):
        k = kernel_of("pid")
        plain = k._replace(K_I=np.zeros(3))
        r3 = commanded_trim(k) + np.array([0.1, 0.0, 0.0])
        kick = fly(plain, initial_law_state(k), k.x_trim, r3)[1] - k.u_trim
        assert kick[0] == pytest.approx(0.1 * k.K_P[0], rel=1e-12)
        turning = k.x_trim.copy()
        turning[[2, 3, 6]] = 0.2, 0.3, 0.1
        damped = fly(plain, initial_law_state(k), turning, commanded_trim(k))[1] - k.u_trim
        assert np.allclose(damped, -k.K_D * [0.2, 0.3, 0.1], atol=1e-15)

    def test_integral_grows_by_gain_error_and_tick(self, kernel_of):
        k = kernel_of("pid")
        state = initial_law_state(k)
        r3 = commanded_trim(k) + 0.02
        for _ in range(100):
            fly(k, state, k.x_trim, r3)
        assert np.allclose(state[INTEGRAL : INTEGRAL + 3], k.K_I * 0.02, rtol=1e-9)


def test_template_is_a_law(kernel_of):
    k = kernel_of("pid")
    u3 = np.empty(3)
    user_law(k.x_trim, commanded_trim(k), k, np.zeros(N_LAW_STATE), u3)
    assert np.allclose(u3, k.u_trim)
    x9 = k.x_trim.copy()
    x9[0] -= 0.1
    user_law(x9, commanded_trim(k), k, np.zeros(N_LAW_STATE), u3)
    assert u3[0] - k.u_trim[0] == pytest.approx(0.1 * k.K_P[0])
