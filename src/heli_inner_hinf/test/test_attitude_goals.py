# SPDX-License-Identifier: Apache-2.0
"""The attitude loop's plants against the cost and the margins that the searches go by."""

from pathlib import Path

import numpy as np
import pytest

from heli_core.parameters import load
from heli_inner_hinf.attitude_goals import (
    StateFeedbackLaw,
    flyable,
    loop_plant,
    margin_plant,
    output_start,
    output_structure,
    pid_structure,
    surroundings_plant,
)
from heli_inner_hinf.controller_state import ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.fixed_structure import Goal, GoalKind, TuningProblem, h2
from heli_inner_hinf.loops import as_output_law, feedback_of_law, judge, pid_as_output_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_inner_hinf.tuning import (
    CostScales,
    LawBenchmark,
    SampledAircraft,
    Surroundings,
    diagonal_gain,
)

GAINS = np.array([0.82, 0.75, -2.07, 0.91, 0.75, -9.7, 1.5e-5, 1.5e-4, -0.111])


@pytest.fixture(scope="module")
def nominal():
    file = Path(__file__).parent.parent / "config/inner_loop.yaml"
    config = AttitudeConfig.from_parameters({**load(TABLE, [file], NODE_NAME), "controller": "pid"})
    return SampledAircraft("nominal", config.A, config.B, config.E, config.actuation)


def test_the_h2_norm_is_the_root_of_the_searches_cost(nominal):
    wanted, air = CostScales(), Surroundings()
    goal = Goal("cost", GoalKind.H2, surroundings_plant(nominal, wanted, air), 1.0)
    problem = TuningProblem(pid_structure(), (goal,))
    value = problem.reached(GAINS)[0].value
    cost = LawBenchmark(nominal, (), wanted, air).cost(pid_as_output_law(*np.split(GAINS, 3)))
    assert value**2 == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("at", ["input", "output"])
def test_a_margin_with_a_constant_scaling_is_a_lower_bound(nominal, at):
    goal = Goal("margin", GoalKind.DISK_MARGIN, margin_plant(nominal, at), 0.4)
    problem = TuningProblem(pid_structure(), (goal,))
    value = problem.reached(problem.scaled_start(GAINS))[0].value
    law = pid_as_output_law(*np.split(GAINS, 3))
    exact = judge(nominal.A, nominal.B, feedback_of_law(law), nominal.actuation)
    true = exact.disk_input if at == "input" else exact.disk_output
    assert 0.7 * true < value <= true * (1.0 + 1e-3)


def test_output_feedback_begins_as_the_pid(nominal):
    """Its integrators forget in 10 s, its further state is not listened to."""
    goal = Goal("cost", GoalKind.H2, surroundings_plant(nominal, CostScales(), Surroundings()), 1.0)
    pid = TuningProblem(pid_structure(), (goal,)).reached(GAINS)[0].value
    start = output_start(GAINS, 4)
    assert TuningProblem(output_structure(4), (goal,)).reached(start)[0].value == pytest.approx(
        pid, rel=0.3
    )


def test_a_law_is_flown_with_its_own_matrices():
    law = output_structure(4).law(output_start(GAINS, 4))
    flown = flyable(law)
    assert all(np.array_equal(getattr(flown, k), getattr(law, k)) for k in "ABCD")
    assert flown.L.shape == (4, 3)


@pytest.fixture(scope="module")
def synthesised(nominal):
    """F of the synthesis as numbers, its G, and what they stand behind."""
    file = Path(__file__).parent.parent / "config/inner_loop.yaml"
    config = AttitudeConfig.from_parameters({**load(TABLE, [file], NODE_NAME), "controller": "pid"})
    K = diagonal_gain(nominal.A, (-15.0, -15.0, -10.0))
    law = StateFeedbackLaw(nominal, K, config.prediction_s, ObserverInput())
    return law, config.synthesis.F.ravel(), config.synthesis.G


def test_state_feedback_is_tuned_behind_its_observer_and_prediction(nominal, synthesised):
    """u = F x + G r, eq. (17), with G of eq. (15): affine in F, and the loop as it flies."""
    law, numbers, G_of_synthesis = synthesised
    tuned = law.structure.law(numbers)
    F, G = law.gains(numbers)
    assert np.allclose(G, G_of_synthesis, rtol=1e-6, atol=1e-9)
    flown = as_output_law(law._model(F, G), law.K, law.prediction_s, law.feed)
    assert np.allclose(tuned.A, flown.A) and np.allclose(tuned.B, flown.B)
    assert np.max(np.abs(flown.turn)) < 1e-9
    exact = judge(nominal.A, nominal.B, feedback_of_law(flown), nominal.actuation)
    goal = Goal("margin", GoalKind.DISK_MARGIN, margin_plant(nominal, "input"), 0.4)
    problem = TuningProblem(law.structure, (goal,))
    value = problem.reached(problem.scaled_start(numbers))[0].value
    assert 0.7 * exact.disk_input < value <= exact.disk_input * (1.0 + 1e-3)
    assert law.scale.shape == numbers.shape


def test_the_observer_of_state_feedback_hears_what_is_cut_off(synthesised):
    """What comes out of the limits enters the memory as the command itself does."""
    law, numbers, _ = synthesised
    flown, u = law.flyable(numbers), np.array([0.1, -0.2, 0.3])
    x = np.random.default_rng(0).normal(size=flown.A.shape[0])
    wanted = flown.C @ x
    # the same state with all of the command cut off, and with F and G of zero
    cut_off = flown.A @ x + flown.L @ (u - wanted)
    silent = law.flyable(np.zeros_like(numbers))
    assert np.max(np.abs(flown.L)) > 0.0
    assert np.allclose(cut_off, silent.A @ x + silent.L @ u)


def test_commands_are_no_errors_of_a_loop_that_follows(nominal):
    plant = loop_plant(nominal, ["command"], ["attitude"])
    problem = TuningProblem(pid_structure(), (Goal("follow", GoalKind.H2, plant, 1.0),))
    closed = problem.closed(0, pid_structure().matrix(GAINS))
    at_rest = closed.D + closed.C @ np.linalg.solve(np.eye(closed.A.shape[0]) - closed.A, closed.B)
    assert np.max(np.abs(at_rest)) < 1e-9
    assert h2(closed, plant.dt_s).value > 0.0
