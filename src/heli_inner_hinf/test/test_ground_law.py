# SPDX-License-Identifier: Apache-2.0
"""Every law on the ground: nothing winds up, cyclic and pedal rest, it lifts off without a jump."""

import functools
import math
from pathlib import Path

import numpy as np
import pytest

from heli_core.errors import ShapeError
from heli_core.parameters import load
from heli_inner_hinf.controller_state import (
    CONTROLLERS,
    INTEGRAL,
    LAST_U,
    MEMORY,
    OFFSET,
    AttitudeStatus,
    initial_law_state,
    state_at_rest,
)
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.ground_and_manual import law_of_tick, law_or_manual, stands
from heli_inner_hinf.loops import pid_as_output_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE

NAMES = tuple(CONTROLLERS)
YAML = Path(__file__).parents[1] / "config/inner_loop.yaml"
IDLE, FLIES = 0.4, -0.17


@pytest.fixture(scope="module")
def parameters():
    values = load(TABLE, [YAML], NODE_NAME)
    law = pid_as_output_law(*(values[f"pid.K_{part}"] for part in "PID"))
    return {**values, **{f"law.{part}": getattr(law, part) for part in law._fields}}


@pytest.fixture(scope="module")
def kernel_of(parameters):
    @functools.cache
    def make(controller):
        return AttitudeConfig.from_parameters({**parameters, "controller": controller}).params

    return make


def fly(k, state, x9, r3, collective):
    u3 = np.full(3, np.nan)
    status = law_of_tick(np.asarray(x9), np.asarray(r3), collective, k, state, u3)
    return AttitudeStatus(status), u3


def on_a_slope(k):
    """5 deg of bank and pitch, 10 deg off in heading: what skids hold against any law."""
    r3 = k.x_trim[[0, 1, 8]].copy()
    x9 = k.x_trim.copy()
    x9[[0, 1, 8]] += np.radians([5.0, -5.0, 10.0])
    return x9, r3


@pytest.mark.parametrize("controller", NAMES)
def test_nothing_winds_up_on_the_skids(kernel_of, controller):
    """Ten seconds of an attitude that skids hold: at rest the law is as new; active it is not."""
    k = kernel_of(controller)
    x9, r3 = on_a_slope(k)
    state, wound = initial_law_state(k), initial_law_state(k)
    for _ in range(1000):
        status, u3 = fly(k, state, x9, r3, IDLE)
        attitude_law(x9, r3, k, wound, np.empty(3))
    assert status is AttitudeStatus.ON_GROUND and status.sentence
    assert np.array_equal(u3, k.u_trim)
    assert not state[MEMORY:].any() and not state[INTEGRAL : OFFSET + 3].any()
    assert np.abs(wound[LAST_U : LAST_U + 3] - k.u_trim).max() > 0.05


@pytest.mark.parametrize("controller", NAMES)
def test_it_lifts_off_without_a_jump(kernel_of, controller):
    """The first command of flight is the last on the ground, the next one no further than the law
    itself moves in a tick; and the difference between both fades."""
    k = kernel_of(controller)
    x9, r3 = on_a_slope(k)
    x9 = k.x_trim + 0.1 * (x9 - k.x_trim)  # so little that no law comes to its limits
    state = initial_law_state(k)
    for _ in range(100):
        _, rest = fly(k, state, x9, r3, IDLE)
    first = fly(k, state, x9, r3, FLIES)[1]
    # PID's integrator has made its first step.
    assert np.abs(first - rest).max() <= 0.01 * np.abs(k.K_I * np.radians(1.0)).max() + 1e-12
    last = first
    for _ in range(500):
        _, u3 = fly(k, state, x9, r3, FLIES)
        assert np.abs(u3 - last).max() < 0.005
        last = u3
    assert np.abs(state[OFFSET : OFFSET + 3]).max() < 1e-4
    assert np.abs(u3 - k.u_trim).max() > 0.005  # it acts


@pytest.mark.parametrize("controller", NAMES)
def test_in_trim_it_lifts_off_in_trim(kernel_of, controller):
    k = kernel_of(controller)
    state, r3 = initial_law_state(k), k.x_trim[[0, 1, 8]].copy()
    for collective in (IDLE, IDLE, FLIES, FLIES, FLIES):
        _, u3 = fly(k, state, k.x_trim, r3, collective)
        assert u3 == pytest.approx(k.u_trim, abs=1e-12)


@pytest.mark.parametrize("controller", NAMES)
def test_after_touch_down_the_command_fades_to_trim(kernel_of, controller):
    k = kernel_of(controller)
    x9, r3 = on_a_slope(k)
    state = initial_law_state(k)
    for _ in range(50):
        _, flown = fly(k, state, x9, r3, FLIES)
    away = flown - k.u_trim
    for n in range(1, 201):
        _, u3 = fly(k, state, x9, r3, IDLE)
        assert u3 - k.u_trim == pytest.approx(away * math.exp(-0.01 * n / 0.5), abs=1e-12)


@pytest.mark.parametrize("controller", NAMES)
def test_in_the_air_it_is_the_law_bit_for_bit(kernel_of, controller):
    k, rng = kernel_of(controller), np.random.default_rng(3)
    state, state_alone = initial_law_state(k), initial_law_state(k)
    alone = np.empty(3)
    for _ in range(200):
        x9, r3 = k.x_trim + 0.1 * rng.standard_normal(9), 0.1 * rng.standard_normal(3)
        # Up to the least thrust of the outer loop, in descent at 5 m/s.
        _, u3 = fly(k, state, x9, r3, rng.uniform(-0.98, 0.24))
        attitude_law(x9, r3, k, state_alone, alone)
        assert np.array_equal(u3, alone) and np.array_equal(state, state_alone)


def test_on_the_ground_it_needs_no_estimate_but_says_so(kernel_of):
    k = kernel_of("hinf_output")
    state, nan = initial_law_state(k), np.full(9, np.nan)
    status, u3 = fly(k, state, nan, np.zeros(3), IDLE)
    assert status is AttitudeStatus.NOT_FINITE and np.array_equal(u3, k.u_trim)
    # Without an estimate it does not go on either: the rest is held.
    status, u3 = fly(k, state, nan, np.zeros(3), FLIES)
    assert status is AttitudeStatus.NOT_FINITE and np.array_equal(u3, k.u_trim)
    x9, r3 = on_a_slope(k)
    status, u3 = fly(k, state, x9, r3, FLIES)
    assert status is AttitudeStatus.OK and u3 == pytest.approx(k.u_trim, abs=1e-12)


def test_the_ground_is_on_the_side_away_from_hover(parameters, kernel_of):
    k = kernel_of("pid")
    places = (-0.9, FLIES, 0.35, 0.37, math.nan)
    assert [stands(c, k) for c in places] == [False, False, False, True, False]
    other = {**parameters, "controller": "pid", "ground_collective": -0.5}
    k = AttitudeConfig.from_parameters(other).params
    assert [stands(c, k) for c in (-0.9, FLIES, 0.9)] == [True, False, False]


def test_rest_in_hover_is_refused(parameters):
    with pytest.raises(ShapeError) as caught:
        AttitudeConfig.from_parameters({**parameters, "ground_collective": -0.1})
    assert caught.value.name == "ground_collective"


@pytest.mark.parametrize("controller", ["hinf_output", "lqg", "indi", "matrices", "hinf"])
def test_the_map_of_rest_is_that_of_a_swap(kernel_of, controller):
    k, rng = kernel_of(controller), np.random.default_rng(5)
    v, u = rng.standard_normal(8), rng.standard_normal(3)
    assert k.rest @ np.append(v, u) == pytest.approx(state_at_rest(k.law, v, u), abs=1e-9)


def manual(k, state, x9, r3, manual3, collective=FLIES):
    u3 = np.full(3, np.nan)
    status = law_or_manual(x9, r3, collective, np.asarray(manual3, float), k, state, u3)
    return AttitudeStatus(status), u3


@pytest.mark.parametrize("controller", NAMES)
def test_by_hand_the_sticks_are_flown_and_the_law_goes_on_from_them(kernel_of, controller):
    """Out of 10 deg of bank, turning: no actuator jumps, neither to the hand nor to the law."""
    k = kernel_of(controller)
    state, x9 = initial_law_state(k), k.x_trim.copy()
    r3 = x9[[0, 1, 8]].copy()
    _, before = manual(k, state, x9, r3, [np.nan] * 3)
    stick = np.array([0.1, -0.05, 0.08])
    status, first = manual(k, state, x9, r3, stick)
    assert status == AttitudeStatus.BY_HAND
    np.testing.assert_allclose(first, before, atol=1e-12)
    x9[0] += np.radians(10.0)
    x9[[2, 6]] = 0.1, -0.05
    for _ in range(600):
        _, flown = manual(k, state, x9, x9[[0, 1, 8]], stick)
    np.testing.assert_allclose(flown, k.u_trim + stick, atol=1e-4)
    # The law again, at the attitude that is flown: from the hand's command on.
    status, taken = manual(k, state, x9, x9[[0, 1, 8]], [np.nan] * 3)
    assert status != AttitudeStatus.BY_HAND
    np.testing.assert_allclose(taken, flown, atol=2e-3)
    assert np.isfinite(state).all()


def test_a_hand_needs_no_estimate_and_stays_within_the_limits(kernel_of):
    k = kernel_of("hinf_output")
    state = initial_law_state(k)
    nothing = np.full(9, np.nan)
    for _ in range(600):
        status, u3 = manual(k, state, nothing, np.zeros(3), [2.0, 0.0, -2.0])
    assert status == AttitudeStatus.SATURATED
    np.testing.assert_allclose(u3, [k.limit, k.u_trim[1], -k.limit], atol=1e-4)
    assert (
        manual(k, state, nothing, np.zeros(3), [0.1, np.nan, 0.0])[0] == AttitudeStatus.NOT_FINITE
    )


def test_by_hand_a_collective_of_standing_does_not_rest_the_cyclic(kernel_of):
    """On the skids, too, the pilot has the cyclic."""
    k = kernel_of("hinf_output")
    state = initial_law_state(k)
    for _ in range(600):
        _, u3 = manual(k, state, k.x_trim, np.zeros(3), [0.1, 0.0, 0.0], IDLE)
    assert u3[0] == pytest.approx(k.u_trim[0] + 0.1, abs=1e-4)
