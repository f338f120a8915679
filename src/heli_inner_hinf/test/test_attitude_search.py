# SPDX-License-Identifier: Apache-2.0
"""The cost, the floors and the search of attitude laws."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.linear import with_servos
from heli_core.rows import MEASURED
from heli_core.search import on_grid, place_of
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import (
    closed,
    feedback_of_law,
    further_delay_s,
    judge,
    linear_law_of,
    output_loop,
    pid_as_output_law,
)
from heli_inner_hinf.tuning import (
    CostScales,
    LawBenchmark,
    LawFamily,
    NoLawError,
    SampledAircraft,
    Surroundings,
    model_of,
    variances,
)

TICKS, FLIGHTS = 2400, 200


@pytest.fixture(scope="module")
def nominal(config):
    return SampledAircraft("nominal", config.A, config.B, config.E, config.actuation)


@pytest.fixture(scope="module")
def pid(config):
    return pid_as_output_law(config.K_P, config.K_I, config.K_D)


def flown(law, one, air):
    """Errors (ticks, 3, flights) and commands of many flights at once, tick by tick from the parts.

    The aircraft goes by the steps of Runge and Kutta.
    """
    rng = np.random.default_rng(1)
    A, B = with_servos(one.A, one.B, one.actuation.servo_radps, one.actuation.servo_damping)
    x, late, k = np.zeros((15, FLIGHTS)), np.zeros((3, FLIGHTS)), np.zeros((len(law.A), FLIGHTS))
    first = second = load = kick = wrong = np.zeros((3, FLIGHTS))
    wanted, heading, errors, commands = np.zeros((2, FLIGHTS)), np.zeros(FLIGHTS), [], []

    def drift(x, sigma, time_s):
        keep = np.exp(-TICK_S / time_s)
        drawn = np.reshape(sigma, (-1, 1)) * rng.standard_normal(x.shape)
        return keep * x + np.sqrt(1.0 - keep**2) * drawn

    def slope(x):
        acting = one.E @ (scale[:, None] * second) + one.B @ (load + kick)
        return A @ x + B @ late + np.vstack([acting, np.zeros((6, FLIGHTS))])

    # of two equal lags in series, driven by a drift of variance 1
    a = np.exp(-TICK_S / air.gust_s)
    scale = np.asarray(air.gust_mps) * np.sqrt((1.0 + a) ** 2 / (1.0 + a**2))
    for tick in range(TICKS):
        v = np.vstack([x[list(MEASURED)], wanted])
        v[[0, 1, 5]] += wrong
        v[5] -= heading
        v[2:5] += air.rate_radps * rng.standard_normal((3, FLIGHTS))
        u, k = law.C @ k + law.D @ v, law.A @ k + law.B @ v
        if tick > TICKS // 2:
            errors.append([x[0] - wanted[0], x[1] - wanted[1], x[8] - heading])
            commands.append(u)
        for h in (TICK_S / 2, TICK_S / 2):
            s1 = slope(x)
            s2 = slope(x + 0.5 * h * s1)
            s3 = slope(x + 0.5 * h * s2)
            x = x + h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + slope(x + h * s3))
        late = u
        second, first = a * second + (1.0 - a) * first, drift(first, np.ones(3), air.gust_s)
        load, wrong = drift(load, air.load, air.load_s), drift(wrong, air.angle_rad, air.angle_s)
        kick = drift(kick, air.kick, air.kick_s)
        wanted = drift(wanted, air.command_rad, air.command_s)
        turned = air.heading_radps05 * np.sqrt(TICK_S) * rng.standard_normal(FLIGHTS)
        heading, k = heading + turned, k - np.outer(law.turn, turned)
    return np.array(errors), np.array(commands)


@pytest.mark.parametrize("controller", ["pid", "hinf_output"])
def test_variances_are_those_of_flights(nominal, parameters, controller):
    """200 of them of the same loop, put together tick by tick from its parts."""
    air = Surroundings(load_s=1.0, angle_s=0.5)
    config = AttitudeConfig.from_parameters({**parameters, "controller": controller})
    law = linear_law_of(config.params)
    errors, commands = flown(law, nominal, air)
    predicted = variances(law, nominal, air)
    assert np.mean(errors**2, axis=(0, 2)) == pytest.approx(predicted.angle, rel=0.05)
    assert np.mean(np.diff(commands, axis=0) ** 2, axis=(0, 2)) == pytest.approx(
        predicted.step, rel=0.03
    )


def test_cost_is_the_mean_in_units(nominal, pid):
    wanted = CostScales((1e-3, 2e-3, 4e-3), 1e-3)
    both = LawBenchmark(nominal, (nominal.later(1),), wanted)
    terms = []
    for one in (nominal, replace(nominal, actuation=Actuation(delay_s=0.02))):
        v = variances(pid, one, both.air)
        terms.append(v.angle @ [1e6, 0.25e6, 1e6 / 16.0] + v.step.sum() * 1e6)
    assert both.cost(pid) == pytest.approx(np.mean(terms), rel=1e-12)


def test_shortfall_is_what_the_judge_misses(config, nominal, pid):
    margins = judge(config.A, config.B, feedback_of_law(pid), config.actuation)
    alone = LawBenchmark(nominal, (), CostScales(disk_margin=0.9))
    missed = 0.9 - margins.disk_input + 0.9 - margins.disk_output
    assert alone.shortfall(pid) == pytest.approx(missed, abs=0.03)
    assert LawBenchmark(nominal, (), CostScales(disk_margin=0.4)).shortfall(pid) == 0.0
    # another aircraft counts by its own floor, at the input alone
    heavy = LawBenchmark(nominal, (replace(nominal, disk_margin=1.0),), CostScales(disk_margin=0.4))
    assert heavy.shortfall(pid) == pytest.approx(1.0 - margins.disk_input, abs=0.02)


def stable(one, law):
    A = closed(*one.flown, feedback_of_law(law))
    return np.max(np.abs(np.linalg.eigvals(A))) < 1.0


def test_delay_that_breaks_the_loop_is_seen(config, nominal, pid):
    model = model_of(config)
    loop = output_loop(model, pid, config.actuation)
    survived = int(further_delay_s(loop, model, config.actuation) / TICK_S)
    assert survived > 0
    for ticks, broken in ((survived, False), (survived + 1, True)):
        wanted = CostScales(disk_margin=0.1, delay_ticks=ticks)
        assert (LawBenchmark(nominal, (), wanted).shortfall(pid) > 10.0) == broken


def test_an_aircraft_held_stable_counts_by_its_stability_alone(nominal, pid):
    wanted = CostScales(disk_margin=0.4)
    alone = LawBenchmark(nominal, (), wanted)
    survived = next(n for n in range(30) if not stable(nominal.later(n + 1), pid))
    last, lost = nominal.later(survived), nominal.later(survived + 1)
    held = replace(alone, held_stable=(last,))
    assert held.price(pid) == alone.price(pid)
    assert replace(alone, held_stable=(last, lost)).shortfall(pid) > 10.0


def test_best_is_the_best_of_its_neighbours(config, nominal):
    """Roll's gains alone; a start without a law, and one that is unstable, end there as well."""

    def law(numbers):
        K_P, K_I = config.K_P.copy(), config.K_I.copy()
        K_P[0], K_I[0] = numbers
        return pid_as_output_law(K_P, K_I, config.K_D)

    wanted = LawBenchmark(nominal, (), CostScales(disk_margin=0.4))
    best = wanted.best(LawFamily("pid", law, ((0.1, 0.02), (30.0, 3.0))))
    least = wanted.price(law(best))
    assert wanted.shortfall(law(best)) == 0.0
    for i in range(2):
        for way in (-1, 1):
            beside = list(best)
            beside[i] = on_grid(place_of(best[i]) + way)
            assert wanted.price(law(beside)) > least * (1.0 - 1e-4)
    with pytest.raises(NoLawError, match="^pid: "):
        strict = replace(wanted, wanted=CostScales(disk_margin=1.9))
        strict.best(LawFamily("pid", law, ((0.5, 0.4),)), strides=(1,), pairs=False)
