# SPDX-License-Identifier: Apache-2.0
"""The attitude loop's plants against the cost and the margins that the searches go by."""

from pathlib import Path

import numpy as np
import pytest

from heli_core.parameters import load
from heli_inner_hinf.attitude_goals import (
    flyable,
    loop_plant,
    margin_plant,
    output_start,
    output_structure,
    pid_structure,
    state_structure,
    surroundings_plant,
)
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.fixed_structure import Goal, GoalKind, TuningProblem, h2
from heli_inner_hinf.loops import feedback_of_law, judge, pid_as_output_law
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_inner_hinf.tuning import CostScales, LawBenchmark, SampledAircraft, Surroundings

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


def test_state_feedback_has_F_and_G():
    """u = F x + G r, eq. (17)."""
    structure = state_structure(9)
    law = structure.law(np.arange(36.0))
    assert law.A.size == 0 and law.D.shape == (3, 12)


def test_commands_are_no_errors_of_a_loop_that_follows(nominal):
    plant = loop_plant(nominal, ["command"], ["attitude"])
    problem = TuningProblem(pid_structure(), (Goal("follow", GoalKind.H2, plant, 1.0),))
    closed = problem.closed(0, pid_structure().matrix(GAINS))
    at_rest = closed.D + closed.C @ np.linalg.solve(np.eye(closed.A.shape[0]) - closed.A, closed.B)
    assert np.max(np.abs(at_rest)) < 1e-9
    assert h2(closed, plant.dt_s).value > 0.0
