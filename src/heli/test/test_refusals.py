# SPDX-License-Identifier: Apache-2.0
"""Every public function refuses what cannot be, with an error that names the argument."""

import inspect

import numpy as np
import pytest

import heli

NAN = float("nan")
NO_SEED = ("a", -1, 1.5, True, NAN, [1], 2**80)
NO_NUMBER = ("a", NAN, True, [1.0])
NO_TEXT = (3, NAN, ["x"])
NO_PARAMS = (
    3,
    "no_such_file.yaml",
    {"x": 3},
    {"plant": 3},
    {"plant": {"nokey": 1}},
    {"inner_loop": {"gamma": "a"}},
    {"inner_loop": {"gamma": NAN}},
    [3],
    {3: {}},
    {"plant": {3: 3}},
)
OF_A_FLIGHT = {
    "scenario": ("loop", *NO_TEXT),
    "gps": ("glonass", *NO_TEXT),
    "world": ("mars", *NO_TEXT),
    "laws": ("none", *NO_TEXT),
    "controller": ("lead", *NO_TEXT),
    "params": NO_PARAMS,
    "faults": (3, "no_such_file.yaml", [3], [{"what": "x"}], {"what": "gps"}),
    "law": (3, "no_such_file.py:X", "a", [3], lambda: 0),
    "rate_hz": ("a", 33, NAN, -1, 100.5, True, [100]),
}
OF_A_FLIGHT_HERE = {
    **OF_A_FLIGHT,
    "seed": NO_SEED,
    "plant": (3, "a"),
    "wind": (3,),
    "sensors": (3, [3], "a"),
    "estimator": (3,),
}
NO_SPEED = (*NO_NUMBER, None, 1e6)
OF_A_TRIM = {
    "aircraft": ("no_such", *NO_TEXT),
    "speed_mps": NO_SPEED,
    "psi_rad": (*NO_NUMBER, None),
    "wind_ned_mps": (
        "a", NAN, 3.0, [1, 2], [1, 2, "x"], [1, 2, NAN], None, [[1, 2, 3]], [1e9, 0, 0],
    ),
}  # fmt: skip
NO_PATH = (3, NAN, [1])
TABLE = {
    "fly": OF_A_FLIGHT_HERE
    | {
        "duration_s": (*NO_NUMBER, -1.0, 0.0),
        "out": (3, [1]),
        "graph": ("a", 1),
        "quiet": ("a", None),
    },
    "load": {
        "path": (*NO_PATH, "no_such_flight"),
        "gps": (3,),
        "seed": NO_SEED,
        "flight": (0, "a", 1.5),
    },
    "design": {
        "params": NO_PARAMS,
        "aircraft": ("no_such", *NO_TEXT),
        "gamma": ("a", NAN, -1, 0, True, [1], 1e-3),
        "gamma_factor": ("a", NAN, -1, 0, 0.5, 1.0, True, [1]),
    },
    "trim": OF_A_TRIM,
    "linearize": OF_A_TRIM | {"side": ("up", 3, [1], None)},
    "collective_for_thrust": {
        "thrust_n": (*NO_NUMBER, -1, 0, None),
        "climb_mps": (*NO_NUMBER, None),
        "params": NO_PARAMS,
    },
    "identify": {
        "aircraft": ("no_such", *NO_TEXT),
        "seed": NO_SEED,
        "gps": ("x", 3),
        "params": (3, "no_such_file.yaml", {"plant": {"seed": 1}}),
        "gamma_factor": ("a", NAN, -1, 0.5, [1]),
    },
    "campaign": OF_A_FLIGHT
    | {
        "spec": (*NO_PATH, "no_such.yaml"),
        "seeds": ("a", ["a"], [1.5], 3.5, [-1], [], "5..1", "", NAN, -1),
        "workers": (-1, "a", 1.5, NAN, None, True),
        "duration_s": (*NO_NUMBER, -1.0, 0.0),
        "no_such_option": (3,),
    },
    "Simulation": OF_A_FLIGHT_HERE | {"aircraft": ("no_such", 3, ["x"])},
}
NEEDED = {
    "load": {"path": "."},
    "collective_for_thrust": {"thrust_n": 90.0},
    "campaign": {"seeds": [1]},
}
OF_FLIGHTS = {"diff"}
"""Tested by flights, below."""
REFUSALS = [
    pytest.param(function, name, value, id=f"{function}-{name}-{i}")
    for function, arguments in TABLE.items()
    for name, values in arguments.items()
    for i, value in enumerate(values)
]


def is_of_the_package(error):
    """Whether it is of a class that `heli` lists."""
    classes = [getattr(heli, name) for name in heli.__all__ if name.endswith("Error")]
    return isinstance(error, tuple(classes))


def refused_with(call, name):
    """The error of a call, whose argument of that name cannot be."""
    with pytest.raises(Exception) as caught:  # noqa: PT011
        call()
    error = caught.value
    assert is_of_the_package(error), repr(error)
    assert error.argument == name and name in str(error) and "--" not in str(error)
    return error


@pytest.mark.parametrize(("function", "name", "value"), REFUSALS)
def test_what_cannot_be_is_refused_by_its_name(function, name, value):
    call = getattr(heli, function)
    given = {**NEEDED.get(function, {}), name: value}
    if name == "spec":
        del given["seeds"]
    if "quiet" in inspect.signature(call).parameters and name != "quiet":
        given["quiet"] = True
    error = refused_with(lambda: call(**given), name)
    assert str(error).count(f"{name}: {name}") == 0


def test_every_public_function_is_tried():
    functions = {name for name in heli.__all__ if inspect.isfunction(getattr(heli, name))}
    assert functions == {*TABLE, *OF_FLIGHTS} - {"Simulation"}


def test_two_bounds_are_named_as_the_arguments_are():
    error = refused_with(lambda: heli.design(gamma=4.0, gamma_factor=1.2, quiet=True), "gamma")
    assert "gamma_factor" in str(error)


@pytest.fixture(scope="module")
def flight():
    """The shortest with metrics."""
    return heli.fly(duration_s=21.0, quiet=True)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda f: heli.diff(), "flights"),
        (lambda f: heli.diff(f), "flights"),
        (lambda f: heli.diff(f, 3), "flights"),
        (lambda f: heli.diff(f, f, names=3), "names"),
        (lambda f: heli.diff(f, f, names="ab"), "names"),
        (lambda f: heli.diff(f, f, names=["a", "a"]), "names"),
        (lambda f: heli.diff(f, f).page(3), "path"),
        (lambda f: heli.diff(f, f).page("x.txt"), "path"),
        (lambda f: heli.diff(f, f).metrics.of([3]), "source"),
        (lambda f: heli.diff(f, f).metrics.of(stretch="x"), "stretch"),
        (lambda f: f.metrics.of("x"), "source"),
        (lambda f: f.metrics.of(stretch=[3]), "stretch"),
        (lambda f: f.write(3), "path"),
        (lambda f: f.write("x.txt"), "path"),
        (lambda f: f.save(3), "folder"),
        (lambda f: f.report(3), "folder"),
        (lambda f: f.report("/proc/x/y"), "folder"),
        (lambda f: f.replay("a"), "port"),
        (lambda f: f.replay(70000), "port"),
    ],
)
def test_what_a_flight_is_asked(flight, call, name):
    refused_with(lambda: call(flight), name)


def test_a_metric_that_is_not_there_is_answered_alike_by_key_and_by_name(flight):
    for metrics in (flight.metrics, heli.diff(flight, flight).metrics):
        with pytest.raises(KeyError, match="did you mean altitude"):
            metrics["alt"]
        with pytest.raises(AttributeError, match="did you mean altitude"):
            metrics.alt  # noqa: B018
        assert metrics.altitude is metrics["altitude"]
    for group in (flight.truth, flight.metrics):
        with pytest.raises(KeyError):
            group[3]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("actuators", "a"),
        ("actuators", 3),
        ("actuators", [1, 2]),
        ("actuators", [1, 2, 3, 4]),
        ("actuators", [0, 0, 0, NAN]),
        ("actuators", [[0, 0, 0, 0]]),
        ("attitude", [1]),
        ("attitude", [0, 0, NAN]),
        ("attitude", [0, 0, 0, 2.0]),
        ("velocity", [1]),
        ("velocity", 3),
    ],
)
def test_a_command_of_a_step(name, value):
    sim = heli.Simulation(quiet=True)
    sim.reset()
    refused_with(lambda: sim.step(**{name: value}), name)


def test_what_a_simulation_is_asked():
    sim = heli.Simulation(quiet=True)
    for seed in NO_SEED:
        refused_with(lambda seed=seed: sim.reset(seed), "seed")
    sim.reset()
    refused_with(lambda: sim.restore(3), "state")
    for dt_s in ("a", NAN, -1, 0, None, [1]):
        refused_with(lambda dt_s=dt_s: sim.linearize().held(dt_s), "dt_s")


def test_an_aircraft_is_told_a_velocity_of_three_numbers():
    observer = heli.Observer()
    for vel_ned_mps, sigma_mps, name in (
        ([1.0, 2.0], 0.1, "vel_ned_mps"),
        ("a", 0.1, "vel_ned_mps"),
        ([0.0, 0.0, 0.0], -1.0, "sigma_mps"),
        ([0.0, 0.0, 0.0], "a", "sigma_mps"),
    ):
        refused_with(
            lambda v=vel_ned_mps, s=sigma_mps: observer.fuse_velocity(v, s), name
        )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("task", ("x", [3])),
        ("command", ("x", 3, [1])),
        ("observe", ("x", [1])),
        ("aircraft", ("no_such", 3)),
        ("world", ("mars", 3)),
        ("ticks", ("a", 0, NAN, -1, True, 1.5)),
        ("flights", ("a", 0)),
        ("threads", ("a", 0)),
        ("num_envs", ("a", 0, -1, 1.5, True)),
        ("max_episode_steps", ("a", 0, -1, 1.5, None)),
    ],
)
def test_what_an_environment_is_made_of(name, values):
    environments = pytest.importorskip("heli.gym", exc_type=ImportError)
    for value in values:
        given = {"task": "hover", name: value}
        refused_with(lambda given=given: environments.HeliVectorEnv(**given), name)


def test_what_an_environment_is_asked():
    environments = pytest.importorskip("heli.gym", exc_type=ImportError)
    one, two = environments.HeliEnv("hover"), environments.HeliVectorEnv("hover", 2)
    for env in (one, two):
        with pytest.raises(heli.FlightError):
            env.step([0.0] * 4)
        for seed in ("a", -1, 1.5):
            refused_with(lambda env=env, seed=seed: env.reset(seed=seed), "seed")
        env.reset(seed=1)
    for seed in ([1], [1, "a"], [1, -1]):
        refused_with(lambda seed=seed: two.reset(seed=seed), "seed")
    for action in ("a", [1, 2], [NAN] * 4, 3, None, [[0] * 4]):
        refused_with(lambda action=action: one.step(action), "action")
    for action in ("a", [1, 2], np.full((2, 4), NAN), np.zeros((3, 4)), None):
        refused_with(lambda action=action: two.step(action), "action")
