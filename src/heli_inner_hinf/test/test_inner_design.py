# SPDX-License-Identifier: Apache-2.0
"""Parameters to design: the packaged YAML, what is refused, change in flight, writing the YAML."""

import functools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from heli_core.errors import (
    InfeasibleGammaError,
    InvariantZeroError,
    NotStabilizableError,
    ShapeError,
    SynthesisError,
)
from heli_core.parameters import load
from heli_inner_hinf.controller_state import CONTROLLERS, initial_law_state
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import (
    AttitudeConfig,
    LiveDesign,
    UnknownControllerError,
    attitude_params,
    write_model_yaml,
)
from heli_inner_hinf.loops import Model, output_loop, pid_as_output_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE, readers, unread
from heli_inner_hinf.tuning import PEAK, gains_of, tune_pid

YAML = Path(__file__).parent.parent / "config/inner_loop.yaml"


def test_packaged_design_is_feasible_with_room(config):
    summary = config.summary()
    assert summary["gamma"] == 0.0632
    assert summary["gamma_star"] < 0.9 * summary["gamma"]
    assert summary["gamma_star"] <= summary["norm"] < summary["gamma"]


def test_packaged_model_is_close_to_the_published_one(config, published):
    A, B, E, C, D = published
    for ours, theirs in ((config.A, A), (config.B, B)):
        big = np.abs(theirs) > 0.05
        assert np.allclose(ours[big], theirs[big], rtol=0.0065)
    assert np.array_equal(config.C, C) and np.array_equal(config.D, D)


def test_pid_gains_by_the_rule_keep_its_peak_and_a_loop_that_is_stable(config):
    gains = config.synthesis
    model = Model(config.A, config.B, config.E, config.C, config.D, gains.F, gains.G)
    axes = tune_pid(model)
    law = pid_as_output_law(**gains_of(axes))
    assert output_loop(model, law, config.actuation).stability() < -0.1
    assert all(0.85 * PEAK < axis.peak <= PEAK for axis in axes)


def test_flat_and_shaped_arrays_are_the_same(parameters):
    flat = {k: np.ravel(v) if isinstance(v, np.ndarray) else v for k, v in parameters.items()}
    one, other = AttitudeConfig.from_parameters(flat), AttitudeConfig.from_parameters(parameters)
    assert np.array_equal(one.params.F, other.params.F)


def test_the_kernel_of_a_set_of_numbers_is_designed_once_and_of_others_anew(parameters):
    first = attitude_params(parameters)
    assert attitude_params({key: np.copy(v) if isinstance(v, np.ndarray) else v
                            for key, v in reversed(parameters.items())}) is first  # fmt: skip
    made = AttitudeConfig.from_parameters(parameters).params
    assert all(np.array_equal(getattr(first, name), getattr(made, name)) for name in "FHG")
    weighed = {**parameters, "C11": 2.0 * parameters["C11"]}
    assert not np.array_equal(attitude_params(weighed).F, first.F)
    for _ in range(2):
        with pytest.raises(InfeasibleGammaError):
            attitude_params({**parameters, "gamma": 0.001})


BAD = [
    ({"gamma": 0.03}, InfeasibleGammaError, r"gamma = 0\.03 is infeasible.*gamma\* = 0\.051"),
    (
        {"controller": "pdi"},
        UnknownControllerError,
        "'pdi' is unknown; allowed: hinf_output, hinf, lqg",
    ),
    ({"C11": np.ones(15)}, ShapeError, r"C11 must hold 16 numbers \(4 x 4\), but has 15"),
    ({"D11": np.zeros(9)}, ShapeError, "D11 must be invertible"),
    ({"D11": -np.eye(3)}, ShapeError, "D11 has a negative weight"),
    ({"C22": np.zeros(10)}, InvariantZeroError, "invariant zero on the imaginary axis, at 0 rad/s"),
    ({"model.B": np.zeros(27)}, NotStabilizableError, "not stabilisable"),
    ({"model.A": np.full(81, np.nan)}, ShapeError, "model.A holds a value that is not finite"),
    ({"trim.x": np.zeros(8)}, ShapeError, "trim.x must be 9, but is 8"),
    ({"actuator_limit": 1.0}, ShapeError, r"actuator_limit = 1 must be inside \(0, 1\)"),
]


@pytest.mark.parametrize(("changes", "error", "sentence"), BAD)
def test_bad_parameters_are_refused_at_start(parameters, changes, error, sentence):
    with pytest.raises(error, match=sentence):
        AttitudeConfig.from_parameters({**parameters, **changes})


def test_an_adopted_design_waits_for_the_next_tick_and_does_not_jump(parameters):
    live = LiveDesign(AttitudeConfig.from_parameters(parameters))
    k, u3 = live.take(), np.empty(3)
    x9 = k.x_trim + 0.03
    r3 = np.zeros(3)
    for _ in range(20):
        attitude_law(x9, r3, live.take(), live.state, u3)
    flown = u3.copy()
    live.adopt(AttitudeConfig.from_parameters({**parameters, "gamma": 0.08}))
    assert live.config.gamma == 0.0632
    new = live.take()
    assert live.config.gamma == 0.08 and live.take() is new
    assert not np.allclose(new.F, k.F)
    attitude_law(x9, r3, new, live.state, u3)
    assert np.allclose(u3, flown, atol=1e-12)


@pytest.mark.parametrize("controller", ["hinf", "lqr", "pid"])
def test_a_flight_that_was_left_in_the_air_goes_on_from_what_is_flown(parameters, controller):
    """Whatever the law remembers of before, and wherever the aircraft is now: no jump."""
    live = LiveDesign(AttitudeConfig.from_parameters({**parameters, "controller": controller}))
    k, u3 = live.take(), np.empty(3)
    for _ in range(50):
        attitude_law(k.x_trim + 0.05, np.zeros(3), live.take(), live.state, u3)
    x9, r3, flown = k.x_trim - 0.04, np.array([0.02, 0.01, 0.3]), np.array([0.1, -0.2, 0.05])
    live.engage(x9, r3, flown)
    attitude_law(x9, r3, live.take(), live.state, u3)
    # PID: its integrators have moved on for one tick.
    drift = 0.01 * np.abs(k.K_I * (r3 - x9[[0, 1, 8]])) if controller == "pid" else 0.0
    assert np.all(np.abs(u3 - flown) <= drift + 1e-12)


def test_a_new_flight_begins_as_the_first_one_did(parameters):
    live = LiveDesign(AttitudeConfig.from_parameters(parameters))
    first = live.state.copy()
    for _ in range(50):
        attitude_law(live.config.x_trim + 0.05, np.zeros(3), live.take(), live.state, np.empty(3))
    live.start()
    assert np.array_equal(live.state, first)


def test_errors_have_one_base():
    for error in (InfeasibleGammaError, ShapeError, NotStabilizableError, InvariantZeroError):
        assert issubclass(error, SynthesisError)


class TestWriteModel:
    def test_numbers_change_and_the_rest_stays(self, tmp_path):
        copy = tmp_path / "inner.yaml"
        copy.write_text(YAML.read_text())
        rng = np.random.default_rng(1)
        A, B, E = (rng.standard_normal((9, n)) * 10.0 ** rng.uniform(-9, 4) for n in (9, 3, 3))
        x, u = rng.standard_normal(9), 0.1 * rng.standard_normal(4)
        write_model_yaml(copy, A, B, E, x, u, {"K_P": [1.0, 2.0, -3.0]})
        new, old = (load(TABLE, [path], NODE_NAME) for path in (copy, YAML))
        for key, value in (("model.A", A), ("model.B", B), ("model.E", E), ("trim.x", x),
                           ("trim.u", u), ("pid.K_P", [1.0, 2.0, -3.0])):  # fmt: skip
            assert np.allclose(new[key], value, rtol=1e-9, atol=0.0)
        for key in ("gamma", "C11", "D11", "pid.K_I", "prediction_s"):
            assert np.array_equal(new[key], old[key])
        comments = [line for line in YAML.read_text().splitlines() if "#" in line]
        assert comments == [line for line in copy.read_text().splitlines() if "#" in line]

    def test_wrong_shape_is_named_and_nothing_is_written(self, tmp_path):
        copy = tmp_path / "inner.yaml"
        copy.write_text(YAML.read_text())
        with pytest.raises(ShapeError, match="B must be 9x3"):
            write_model_yaml(copy, np.eye(9), np.eye(9), np.eye(9, 3), np.zeros(9), np.zeros(4))
        assert copy.read_text() == YAML.read_text()

    def test_missing_key_is_named(self, tmp_path):
        copy = tmp_path / "inner.yaml"
        copy.write_text("/**/inner_loop:\n  ros__parameters:\n    gamma: 1.0\n")
        with pytest.raises(KeyError, match=" A 0 times"):
            write_model_yaml(copy, np.eye(9), np.eye(9, 3), np.eye(9, 3), np.zeros(9), np.zeros(4))


def test_start_up_imports_are_light():
    """A node must start fast: neither python-control nor matplotlib nor ROS comes with the law."""
    code = (
        "import sys, heli_inner_hinf.design, heli_inner_hinf.parameters\n"
        "bad = {'control', 'matplotlib', 'rclpy', 'cvxpy'} & set(sys.modules)\n"
        "sys.exit(', '.join(bad) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def commanded():
    """The commands (20, 3) of a controller in a row of states and setpoints."""
    draw = np.random.default_rng(4)
    states, setpoints = draw.normal(0.0, 0.02, (20, 9)), draw.normal(0.0, 0.02, (20, 3))

    @functools.cache
    def commands(controller, changed=""):
        values = load(TABLE, [YAML], NODE_NAME)
        law = pid_as_output_law(*(values[f"pid.{gain}"] for gain in ("K_P", "K_I", "K_D")))
        values |= {f"law.{part}": matrix for part, matrix in law._asdict().items()}
        values |= {"controller": controller, "margin_floor": 0.0}
        if changed:
            value = np.asarray(values[changed], dtype=float)
            values[changed] = value * 1.01 if value.any() else value + 0.01
        k, u3 = AttitudeConfig.from_parameters(values).params, np.zeros(3)
        state, rows = initial_law_state(k), []
        for x9, r3 in zip(states, setpoints, strict=True):
            attitude_law(x9, r3, k, state, u3)
            rows.append(u3.copy())
        return np.array(rows)

    return commands


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_who_reads_a_parameter_commands_otherwise_when_it_changes_and_nobody_else(
    controller, commanded
):
    """Of `law` D alone is changed: its other arrays go together."""
    rows = [row.name for row in TABLE if readers(row.name)]
    for name in [name for name in rows if not name.startswith("law.") or name == "law.D"]:
        equal = np.array_equal(commanded(controller, name), commanded(controller))
        assert equal == (controller not in readers(name)), name


def test_what_stands_in_a_parameters_place_is_read():
    for controller in CONTROLLERS:
        for one in unread(controller, [row.name for row in TABLE]):
            assert controller not in one.readers
            assert not one.instead or controller in readers(one.instead)
    (one,) = unread("hinf_output", ["gamma", "C11", "margin_floor"])
    assert (one.parameter, one.readers, one.instead) == ("gamma", ("hinf",), "output.gamma")
    assert unread("hinf", ["output.gamma"])[0].instead == "gamma"


@pytest.mark.parametrize("controller", ["hinf_output", "lqg", "lqr", "pid", "indi"])
def test_a_gamma_that_is_not_read_refuses_nothing(parameters, controller):
    config = AttitudeConfig.from_parameters(
        parameters | {"controller": controller, "gamma": 0.05, "margin_floor": 0.0}
    )
    assert config.synthesis.gamma > config.synthesis.gamma_star.value > 0.05
    assert ("gamma" in config.summary()) == (controller == "hinf_output")
