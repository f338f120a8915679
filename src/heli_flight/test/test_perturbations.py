# SPDX-License-Identifier: Apache-2.0
"""Perturbed aircraft: bounds, one part at a time, the same draw for every law; a lost one."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.config import PlantConfig
from heli_flight.settings import resolve
from heli_studies import compare as robustness
from heli_studies.compare import LAWS, SPREAD, TOGETHER, parse_laws, perturbed, with_law

RANDOM = (
    "inertia_xx_kgm2",
    "inertia_yy_kgm2",
    "inertia_zz_kgm2",
    "hub_stiffness_nmprad",
    "flap_time_constant_s",
)


@pytest.fixture(scope="module")
def settings():
    return resolve("attitude_gusts", duration_s=8.0)


@pytest.fixture(scope="module")
def nominal(settings):
    return PlantConfig.from_parameters(settings.nodes["plant"])


def ratios(config, nominal):
    return [getattr(config.helicopter, n) / getattr(nominal.helicopter, n) for n in RANDOM]


def test_draws_fill_the_range_and_stay_inside(nominal):
    drawn = np.array([ratios(perturbed(nominal, TOGETHER, seed), nominal) for seed in range(300)])
    assert drawn.min() >= 1.0 - SPREAD and drawn.max() <= 1.0 + SPREAD
    assert np.all(drawn.min(axis=0) < 0.75) and np.all(drawn.max(axis=0) > 1.25)
    assert np.all(np.abs(drawn[:, 3:].mean(axis=0) - 1.0) < 0.05)


def test_a_part_alone_is_drawn_as_in_company(nominal):
    together = ratios(perturbed(nominal, TOGETHER, 7), nominal)
    alone = ratios(perturbed(nominal, ("rotor",), 7), nominal)
    assert alone[3] == together[3] != 1.0
    assert alone[:3] == [1.0, 1.0, 1.0] and alone[4] == 1.0


def test_delay_and_servo(nominal):
    changed = perturbed(nominal, ("delay", "servo"), 3)
    assert changed.delay_ticks == nominal.delay_ticks + 1
    assert changed.helicopter.servo_bandwidth_radps == pytest.approx(
        0.7 * nominal.helicopter.servo_bandwidth_radps
    )
    assert perturbed(nominal, (), 3) == replace(nominal, helicopter=nominal.helicopter)


def test_a_law_that_cannot_hold_it_loses_it(settings):
    """A law whose sign is wrong: its aircraft counts as not kept and does not stop the rest."""
    laws = parse_laws("hinf,pid")
    good = robustness.RobustnessSetup(settings, laws)
    good.kernels["pid"] = good.kernels["pid"]._replace(
        K_P=-good.kernels["pid"].K_P, K_D=-good.kernels["pid"].K_D
    )
    errors = good.fly((), 101)
    assert np.isinf(errors["pid"]) and errors["hinf"] < robustness.LIMIT_DEG
    outcome = robustness._outcome(robustness.PERTURBATIONS[1], laws[1], [errors["pid"]])
    assert (outcome.kept, outcome.lost, outcome.fraction) == (0, 1, 0.0)


def test_laws_change_only_the_inner_loop(settings):
    for law in LAWS:
        other = with_law(settings, law)
        assert all(other.nodes[n] is settings.nodes[n] for n in other.nodes if n != "inner_loop")
        for key, value in law.changes.items():
            assert other.nodes["inner_loop"][key] == value


def test_unknown_law_is_named():
    with pytest.raises(ParameterError, match=f"'mpc' .* {', '.join(law.key for law in LAWS)}$"):
        parse_laws("mpc")
