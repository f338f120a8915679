# SPDX-License-Identifier: Apache-2.0
"""The weights of `hinf_output`: what the search ends at, and how far beyond the set they hold."""

import numpy as np
import pytest

from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.robust.uncertain import Uncertain
from heli_studies.design.attitude_search import (
    beyond_the_box,
    output_family,
    searched_output,
    yardstick,
)
from heli_studies.robust import AircraftSet, exact, feedback_flown, read_ranges

SETTINGS = resolve(laws="hinf_output")
INNER = SETTINGS.nodes["inner_loop"]
AIRCRAFT = HelicopterParameters.from_yaml(SETTINGS.nodes["plant"]["aircraft_file"])


@pytest.fixture(scope="module")
def measure():
    return beyond_the_box(yardstick(AIRCRAFT, Actuation()), AIRCRAFT, Actuation())


@pytest.mark.slow
def test_what_is_shipped_no_single_number_betters(measure):
    searched = searched_output(INNER, measure)
    for key, value in searched.items():
        assert np.array_equal(np.ravel(value), np.ravel(INNER[key])), key


def test_weights_without_the_floor_of_its_own_are_refused(measure):
    """Those that shipped before it: the common floors hold, 12 % beyond the box the law ends."""
    before = {
        "output.effort": [0.56, 3.3, 0.43],
        "output.integral": [47.0, 22.0, 36.0],
        "output.load": [0.0075, 0.082, 0.15],
        "output.noise": [0.00013, 0.00013, 0.03, 0.03, 0.03, 0.00039],
        "output.command_effort": 0.27,
    }
    family = output_family({**INNER, **before})
    law = family.law(family.starts[0])
    assert yardstick(AIRCRAFT, Actuation()).shortfall(law) == 0.0
    assert measure.shortfall(law) > 10.0


@pytest.mark.parametrize("ticks", [0, 1, 2, 3])
def test_beyond_the_set_it_is_stable_sampled_exactly(ticks):
    """Second model, with the horizontal velocity: the corners at which it ends, 10 % outside."""
    asked = read_ranges([])
    no_model = Uncertain.constant(np.zeros((0, 0)))
    aircraft, law = AircraftSet(AIRCRAFT, asked.ranges, no_model, 0.0), feedback_flown(SETTINGS)
    names = ("mass", "inertia_xx", "inertia_yy", "inertia_zz", "rotor_stiffness", "flapping",
             "servo_speed", "flap_back")  # fmt: skip
    for signs in ((1, 1, -1, -1, 1, 1, -1, 1), (1, -1, -1, -1, 1, -1, 1, -0.9),
                  (1, -1, -1, 1, 1, 1, -1, 1), (-1, 1, 1, -1, -1, -1, 1, 1)):  # fmt: skip
        worst = {name: 1.1 * sign for name, sign in zip(names, signs, strict=True)}
        assert exact(aircraft, worst, law, ticks) < 0.0, signs
