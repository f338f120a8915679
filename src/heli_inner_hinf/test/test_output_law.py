# SPDX-License-Identifier: Apache-2.0
"""The kernel of output feedback: recursion, limits, heading, NaN, start; what is refused."""

import numpy as np
import pytest

from heli_core.errors import MarginError, ShapeError, UnstableLoopError
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_inner_hinf.controller_state import (
    MAX_ORDER,
    MEMORY,
    N_V,
    OFFSET,
    OUTPUT_FEEDBACK,
    Actuation,
    AttitudeStatus,
    initial_law_state,
    output_law,
    read_inputs,
    state_at_rest,
)
from heli_inner_hinf.controllers import attitude_law, swap_bumpless
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import closed_loop, feedback_of, flown_plant, pid_as_output_law

ORDER = 5


@pytest.fixture
def pid(parameters):
    return pid_as_output_law(*(parameters[f"pid.K_{part}"] for part in "PID"))


def asked(parameters, law, **changes):
    """Parameters that fly this law."""
    values = {f"law.{part}": getattr(law, part) for part in law._fields}
    return {**parameters, "controller": "matrices", **values, **changes}


@pytest.fixture
def kernel(parameters, pid):
    """A kernel with another law than the judged one."""
    k = AttitudeConfig.from_parameters(asked(parameters, pid)).params
    return lambda law: k._replace(law=law)


def some_law(seed=0, order=ORDER):
    g = np.random.default_rng(seed)
    A = g.standard_normal((order, order))
    A *= 0.9 / np.max(np.abs(np.linalg.eigvals(A)))
    shapes = ((order, N_V), (3, order), (3, N_V), (order, 3), (order,))
    return output_law(A, *(0.3 * g.standard_normal(shape) for shape in shapes))


def rows(k, g):
    """x9, r3 near trim, at any heading, and v by names."""
    x9 = k.x_trim + 0.1 * g.standard_normal(9)
    phi, theta, psi = 0.1 * g.standard_normal(3)
    r3 = np.array([k.x_trim[0] + phi, k.x_trim[1] + theta, psi])
    d = x9 - k.x_trim
    v = np.array([d[0], d[1], d[2], d[3], d[6], x9[8] - psi, phi, theta])
    x9[8] += 2.0 * np.pi * g.integers(-2, 3)
    return x9, r3, v


def turned(v):
    """v with the errors of pitch and heading in the axes of q and r at the bank v[0]."""
    c, s = np.cos(v[0]), np.sin(v[0])
    pitch, heading = v[1] - v[7], v[5]
    v = v.copy()
    v[1], v[5] = v[7] + c * pitch + s * heading, c * heading - s * pitch
    return v


def test_errors_are_those_that_the_rates_mend():
    """Second method: the rotation from the wanted attitude to the flown one, as a body vector."""
    g, x_trim = np.random.default_rng(7), np.zeros(9)
    x_trim[0] = 0.04
    for _ in range(10):
        bank, small = g.uniform(-0.7, 0.7), 1e-4 * g.standard_normal(2)
        x9, r3, v = np.zeros(9), np.zeros(3), np.zeros(N_V)
        x9[0], x9[1], x9[8] = x_trim[0] + bank, small[0], small[1]
        read_inputs(x9, r3, x_trim, v)
        wanted, flown = (
            quat_to_R_nb(quat_from_euler(bank, *angles)) for angles in ((0.0, 0.0), small)
        )
        skew = wanted.T @ flown - np.eye(3)
        assert np.allclose([v[1], v[5]], [skew[0, 2], skew[1, 0]], atol=1e-7)


def test_recursion_with_limits_is_the_documented_one(kernel):
    """Against plain matrices, at a limit on some ticks and inside of it on others."""
    law = some_law()
    k = kernel(law)
    g, state, u3 = np.random.default_rng(1), initial_law_state(k), np.zeros(3)
    x, psi_ref, statuses = np.zeros(ORDER), None, set()
    for _ in range(200):
        x9, r3, v = rows(k, g)
        x9, v = (x9, v) if g.random() < 0.7 else (k.x_trim + 30.0 * (x9 - k.x_trim), None)
        if v is None:
            d = x9 - k.x_trim
            turn = (x9[8] - r3[2] + np.pi) % (2.0 * np.pi) - np.pi
            v = np.array([d[0], d[1], d[2], d[3], d[6], turn, *(r3 - k.x_trim[[0, 1, 8]])[:2]])
        if psi_ref is not None:
            x = x - law.turn * (r3[2] - psi_ref)
        psi_ref = r3[2]
        v = turned(v)
        linear = k.u_trim + law.C @ x + law.D @ v
        u = np.clip(linear, -k.limit, k.limit)
        x = law.A @ x + law.B @ v + law.L @ (u - linear)
        status = AttitudeStatus(attitude_law(x9, r3, k, state, u3))
        assert np.allclose(u3, u, atol=1e-11)
        assert np.allclose(state[MEMORY : MEMORY + ORDER], x, atol=1e-10)
        assert (status is AttitudeStatus.SATURATED) == bool(np.any(u != linear))
        statuses.add(status)
    assert statuses == {AttitudeStatus.OK, AttitudeStatus.SATURATED}


def test_pid_as_output_law_is_the_pid(parameters, kernel, pid):
    k = kernel(pid)
    other = AttitudeConfig.from_parameters({**parameters, "controller": "pid"}).params
    g, state, its, u3, u = (
        np.random.default_rng(2),
        *map(initial_law_state, (k, other)),
        *np.zeros((2, 3)),
    )
    for _ in range(100):
        x9, r3, _ = rows(k, g)
        x9[0] = k.x_trim[0]  # without bank: the PID has Euler's angles
        attitude_law(x9, r3, k, state, u3)
        attitude_law(x9, r3, other, its, u)
        assert np.allclose(u3, u, atol=1e-12)


def test_an_observer_inside_does_not_feel_a_new_heading_reference(parameters, kernel):
    """A steady observer of the heading error (psi' = r): with `turn` the step reaches the actuator
    by the feedback alone, at once and for good; without it the observer takes it for a motion."""
    gain, feedback = np.array([0.05, 0.02]), np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.1]])
    model = np.array([[1.0, 0.01], [0.0, 1.0]])
    B = np.zeros((2, N_V))
    B[:, 5] = gain
    see_psi = np.array([[1.0, 0.0]])
    parts = (model - gain[:, None] @ see_psi, B, feedback, np.zeros((3, N_V)), None)
    for turn, steady in (([1.0, 0.0], True), ([0.0, 0.0], False)):
        k = kernel(output_law(*parts, turn))
        state, u3 = initial_law_state(k), np.zeros(3)
        r3 = k.x_trim[[0, 1, 8]].copy()
        attitude_law(k.x_trim, r3, k, state, u3)
        r3[2] -= 0.2
        flown = []
        for _ in range(50):
            attitude_law(k.x_trim, r3, k, state, u3)
            flown.append(u3[2] - k.u_trim[2])
        assert np.allclose(flown, 0.5 * 0.2, atol=1e-12) == steady


@pytest.mark.parametrize("place", range(12))
def test_not_finite_leaves_the_memory_alone(kernel, place):
    k = kernel(some_law())
    state, u3 = initial_law_state(k), np.zeros(3)
    x9, r3, _ = rows(k, np.random.default_rng(3))
    for _ in range(5):
        attitude_law(x9, r3, k, state, u3)
    good, memory = u3.copy(), state.copy()
    (x9 if place < 9 else r3)[place % 9] = np.nan
    assert attitude_law(x9, r3, k, state, u3) == AttitudeStatus.NOT_FINITE
    assert np.array_equal(u3, good) and np.array_equal(state, memory)


class TestStart:
    def test_a_law_that_forgets_rests(self):
        law, g = some_law(), np.random.default_rng(4)
        v = g.standard_normal(N_V)
        exact = np.linalg.solve(np.eye(ORDER) - law.A, law.B @ v)
        assert np.allclose(state_at_rest(law, v, law.C @ exact + law.D @ v), exact)

    def test_integrators_carry_what_is_flown(self, pid):
        v, u = np.array([0, 0, 0.1, -0.2, 0.1, 0, 0, 0]), np.array([0.2, -0.1, 0.3])
        x = state_at_rest(pid, v, u)
        assert np.allclose(pid.C @ x + pid.D @ v, u, atol=1e-12)

    def test_the_rest_fades_as_an_offset(self, kernel):
        k = kernel(some_law())
        state, flown, u3 = initial_law_state(k), np.array([0.2, -0.1, 0.3]), np.zeros(3)
        swap_bumpless(state, k, flown)
        assert np.abs(state[OFFSET : OFFSET + 3]).max() > 0.01
        for tick in range(2000):
            attitude_law(k.x_trim, k.x_trim[[0, 1, 8]], k, state, u3)
            if tick == 0:
                assert np.allclose(u3, flown, atol=1e-12)
        assert np.allclose(u3, k.u_trim, atol=1e-9)


class TestRefused:
    @pytest.mark.parametrize("part", ["A", "B", "C", "D", "L", "turn"])
    def test_a_wrong_size_names_the_matrix(self, parameters, pid, part):
        values = asked(parameters, pid)
        values[f"law.{part}"] = np.append(np.ravel(values[f"law.{part}"]), 0.0)
        with pytest.raises(ShapeError, match=rf"law\.{part} "):
            AttitudeConfig.from_parameters(values)

    @pytest.mark.parametrize("part", ["A", "B", "C", "D", "L", "turn"])
    def test_not_finite(self, parameters, pid, part):
        values = asked(parameters, pid)
        values[f"law.{part}"] = np.full_like(values[f"law.{part}"], np.nan)
        with pytest.raises(ShapeError, match="not finite") as caught:
            AttitudeConfig.from_parameters(values)
        assert caught.value.name == f"law.{part}"

    def test_too_many_states(self):
        n = MAX_ORDER + 1
        with pytest.raises(ShapeError, match="at most 32"):
            output_law(*(np.zeros(shape) for shape in ((n, n), (n, N_V), (3, n), (3, N_V))))

    def test_the_packaged_matrices_hold_nothing(self, parameters):
        with pytest.raises(UnstableLoopError, match=": matrices ") as caught:
            AttitudeConfig.from_parameters({**parameters, "controller": "matrices"})
        assert caught.value.radius >= 1.0

    def test_a_loop_that_the_delay_makes_unstable(self, parameters, pid):
        """The same gains are refused on slow servos with more delay."""
        slow = {"servo.frequency_radps": 8.0, "delay_ticks": 3}
        with pytest.raises(UnstableLoopError):
            AttitudeConfig.from_parameters(asked(parameters, pid, **slow))

    @pytest.mark.parametrize("controller", ["matrices", "pid", "hinf"])
    def test_less_margin_than_the_floor(self, parameters, pid, controller):
        values = {**asked(parameters, pid), "controller": controller}
        margin = AttitudeConfig.from_parameters(values).judgement.disk_output
        with pytest.raises(MarginError) as caught:
            AttitudeConfig.from_parameters({**values, "margin_floor": margin + 1e-6})
        error = caught.value
        assert (error.controller, error.where, error.margin) == (controller, "output", margin)
        AttitudeConfig.from_parameters({**values, "margin_floor": margin - 1e-6})


def test_closed_loop_is_the_recursion(config, pid):
    """The judged matrix against the loop stepped by hand."""
    A, B = flown_plant(config.A, config.B, Actuation())
    kernel = config.params._replace(controller=OUTPUT_FEEDBACK, law=pid)
    step = closed_loop(config.A, config.B, feedback_of(kernel), Actuation())
    g = np.random.default_rng(6)
    x, z = g.standard_normal(A.shape[0]), g.standard_normal(3)
    expected = step @ np.append(x, z)
    v = np.append(x[[0, 1, 2, 3, 6, 8]], [0.0, 0.0])
    plant, memory = A @ x + B @ (pid.C @ z + pid.D @ v), pid.A @ z + pid.B @ v
    assert np.allclose(expected, np.append(plant, memory))
