# SPDX-License-Identifier: Apache-2.0
"""The baselines are searched for as the law that they are held against: `heli design --check`."""

import numpy as np
import pytest

from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import N_V
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import linear_law_of
from heli_studies.compare import loop_as_flown
from heli_studies.design import rivals
from heli_studies.design.attitude_search import yardstick

PLANT = resolve().nodes["plant"]


def flown(controller):
    """Parameters of the nodes as the laws of the controller's name fly them."""
    return resolve(laws=controller).nodes


def law_of(nodes, **changes):
    """The inner loop's law as it flies, behind the observer if it has one; A, B, C, D."""
    inner = {**nodes["inner_loop"], **changes, "margin_floor": 0.0}
    law = linear_law_of(AttitudeConfig.from_parameters(inner).params)
    if law is not None:
        return law[:4]
    as_flown = loop_as_flown({**nodes, "inner_loop": inner}).controller
    return as_flown.A, as_flown.B[:, :N_V], as_flown.C, as_flown.D[:, :N_V]


@pytest.fixture(scope="module")
def measure():
    actuation = AttitudeConfig.from_parameters(resolve().nodes["inner_loop"]).actuation
    return yardstick(HelicopterParameters.from_yaml(PLANT["aircraft_file"]), actuation)


@pytest.mark.parametrize("controller", rivals.KEYS)
def test_a_family_holds_the_law_that_flies(controller):
    """Its numbers are the parameters, and the law of them is the inner loop's own."""
    family = rivals.family(controller, flown(controller))
    law = family.law(family.starts[0])
    for mine, flying in zip(law, law_of(flown(controller)), strict=False):
        np.testing.assert_allclose(mine, flying, rtol=1e-9, atol=1e-12)
    assert np.min(family.starts[0]) > 0.0


@pytest.mark.parametrize("controller", ["pid", "indi", "lqg"])
def test_other_numbers_are_the_law_of_other_parameters(controller):
    family, nodes = rivals.family(controller, flown(controller)), flown(controller)
    # Heading stays but for LQG.
    louder = {key: np.asarray(nodes["inner_loop"][key])
                   * ((1.1, 1.1, 1.0), 1.1)[controller == "lqg"]
              for key in rivals.KEYS[controller]}  # fmt: skip
    law = family.law(1.1 * np.asarray(family.starts[0]))
    np.testing.assert_allclose(law.D, law_of(nodes, **louder)[3], rtol=1e-9)


def test_each_number_of_lqr_is_a_weight():
    """phi, theta, p, q, r, psi, then d_lon and d_ped, then the offset-free target's rate."""
    nodes, factors = flown("lqr"), 1.0 + 0.05 * np.arange(1, 10)
    weights = {key: np.ravel(nodes["inner_loop"][key]).copy()
               for key in ("C11", "C22", "D11")}  # fmt: skip
    weights["C11"][[0, 5, 10, 15]] *= factors[:4]
    weights["C22"][[2, 9]] *= factors[4:6]
    weights["D11"][[4, 8]] *= factors[6:8]
    shift = nodes["inner_loop"]["offset_free_radps"] * factors[8]
    family = rivals.family("lqr", nodes)
    law = family.law(factors * family.starts[0])
    for mine, flying in zip(law, law_of(nodes, **weights, offset_free_radps=shift), strict=False):
        np.testing.assert_allclose(mine, flying, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("controller", rivals.KEYS)
def test_what_is_shipped_no_single_number_betters(controller, measure):
    """A search from it with steps of one place ends where it began (`heli design --check`)."""
    nodes = flown(controller)
    chosen = rivals.chosen(controller, nodes, measure, (1,), pairs=False)
    for key in rivals.KEYS[controller]:
        assert chosen[key].tolist() == np.ravel(nodes["inner_loop"][key]).tolist(), key


@pytest.mark.slow
def test_a_detuned_baseline_is_found_out(measure):
    nodes = flown("pid")
    slack = {"inner_loop": {**nodes["inner_loop"], "pid.K_P": np.array([0.5, 0.3, -2.071912189])},
             "observer": nodes["observer"]}  # fmt: skip
    price_of = rivals.measure_of("pid", measure)
    chosen = rivals.chosen("pid", slack, measure, (2, 1), pairs=False)
    law = rivals.family("pid", {**slack, "inner_loop": {**slack["inner_loop"], **chosen}})
    worse = rivals.family("pid", slack)
    assert price_of.price(law.law(law.starts[0])) < 0.8 * price_of.price(worse.law(worse.starts[0]))
