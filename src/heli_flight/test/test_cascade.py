# SPDX-License-Identifier: Apache-2.0
"""The cascade's plants against the position loop as it is judged: exact, lifted to its period."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from heli_flight.settings import resolve
from heli_inner_hinf.fixed_structure import Goal, GoalKind, Start, Tuned, TuningProblem
from heli_inner_hinf.loops import Model, output_loop, pid_as_output_law
from heli_inner_hinf.regular_form import N_H, N_U, N_X
from heli_outer_pd.analysis import Gains, deviations, law
from heli_outer_pd.parameters import largest_K_D, outer_params
from heli_studies.design.cascade import MARGINS_AT, cascade_aircraft
from heli_studies.design.position_search import WANTED, common_disk_margin, coupled_plant
from heli_studies.tune import (
    TuneOrder,
    aircraft_of,
    cascade_numbers,
    flyable_of,
    packaged_gains,
)


@pytest.fixture(scope="module")
def shipped():
    """The cascade in the world honest, its numbers as shipped, and the coupled plant around it."""
    nodes = resolve(laws="pid", world="honest").nodes
    (one,) = aircraft_of(TuneOrder(worlds=("honest",)))
    gains, attitude = packaged_gains(), (one.A, one.B, one.E)
    made = cascade_aircraft(
        "x", nodes["plant"], nodes["outer_loop"], attitude, gains, one.actuation
    )
    numbers = np.concatenate([gains, made.kernel.K_P, made.kernel.K_D])
    nothing = np.zeros((N_H, N_X)), np.zeros((N_H, N_U))
    model = Model(*attitude, *nothing, np.zeros((N_U, N_X)), np.zeros((N_U, N_U)))
    loop = output_loop(model, pid_as_output_law(*gains.reshape(3, N_U)), one.actuation)
    period = nodes["outer_loop"]["period_ticks"]
    coupled = coupled_plant(made.moving, made.at, loop, made.actuation, made.kernel, period)
    return made, numbers, coupled


def reached(made, numbers, goal):
    problem = TuningProblem(made.structure, (goal,))
    return problem.reached(problem.scaled_start(numbers))[0].value


def test_its_slowest_mode_is_that_of_the_loop_as_flown(shipped):
    made, numbers, coupled = shipped
    laws = [law(Gains.of(made.kernel, i), axis) for i, axis in enumerate(made.axes)]
    A, B, C, D = (block_diag(*(one[part] for one in laws)) for part in range(4))
    closed = np.block([[coupled.A + coupled.B @ D @ coupled.M, coupled.B @ C], [B @ coupled.M, A]])
    radius = np.max(np.abs(np.linalg.eigvals(closed)))
    goal = Goal("decay", GoalKind.DECAY, made.margin_plant("input"), 0.4)
    assert reached(made, numbers, goal) == pytest.approx(-np.log(radius) / coupled.dt_s, rel=5e-3)


def test_its_margin_at_the_commands_is_a_lower_bound_of_the_common_one(shipped):
    made, numbers, coupled = shipped
    gains = tuple(Gains.of(made.kernel, i) for i in range(3))
    exact = common_disk_margin(coupled, made.axes, gains).alpha
    goal = Goal("margin", GoalKind.DISK_MARGIN, made.margin_plant("command"), 0.4)
    assert 0.85 * exact < reached(made, numbers, goal) < exact


@pytest.mark.parametrize("where", MARGINS_AT)
def test_a_loop_that_is_not_closed_gives_half_of_what_is_added(shipped, where):
    """S - I/2 is I/2 with a controller of nothing."""
    made, _, _ = shipped
    goal = Goal("x", GoalKind.HINF, made.margin_plant(where), 1.0)
    problem = TuningProblem(made.structure, (goal,))
    opened = problem.closed(0, np.zeros_like(made.structure.base))
    inside = 1.01 * np.eye(len(opened.A)) - opened.A
    through = opened.D + opened.C @ np.linalg.solve(inside, opened.B)
    assert np.allclose(through, 0.5 * np.eye(len(through)))


def test_place_is_about_what_a_single_axis_says(shipped):
    """Forward: gusts and loads of the attitude loop, which a single axis has not, add little."""
    made, numbers, _ = shipped
    alone_m = deviations(made.axes[0], Gains.of(made.kernel, 0)).position_m
    plant = made.surroundings_plant("position")
    only = np.zeros_like(plant.C1)
    only[0] = plant.C1[0] * WANTED[0].position_m
    goal = Goal("forward", GoalKind.H2, replace(plant, C1=only), 1.0)
    assert alone_m < reached(made, numbers, goal) < 1.6 * alone_m


def test_a_later_aircraft_has_less_margin(shipped):
    made, numbers, _ = shipped
    now, later = (
        reached(made, numbers, Goal("m", GoalKind.DISK_MARGIN, one.margin_plant("command"), 0.4))
        for one in (made, made.later(2))
    )
    assert later < 0.9 * now


def test_what_the_nodes_would_refuse_is_moved_to_what_they_take(shipped):
    """A large K_D down would make the collective swing: the nearest that flies, judged anew."""
    made, numbers, _ = shipped
    goals = tuple(
        Goal(at, GoalKind.DISK_MARGIN, made.margin_plant(at), 0.4, hard=True) for at in ("command",)
    )
    problem = TuningProblem(made.structure, goals)
    starts = []
    for K_D in (numbers[-1], 50.0):
        x = problem.scaled_start(np.append(numbers[:-1], K_D))
        starts.append(Start(0.0, 9.0, 1, 1, 0.0, x))
    tuned = Tuned(problem, starts[1].x, problem.reached(starts[1].x), tuple(starts))
    moved = flyable_of(cascade_numbers(made), tuned)
    nodes = resolve(laws="pid").nodes["outer_loop"]
    K_Ds = [float(end.x[: len(numbers)][-1]) for end in moved.starts]
    assert K_Ds == [numbers[-1], pytest.approx(largest_K_D(nodes), rel=2e-3)]
    for end in moved.starts:
        outer_params({**nodes, "K_D": end.x[: len(numbers)][-3:]})
        assert end.hard == max(one.share for one in problem.reached(end.x))
    assert moved.x is moved.starts[0].x  # the first of equals
