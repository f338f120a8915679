# SPDX-License-Identifier: Apache-2.0
"""Laws designed for published linear aircraft, flown on them."""

from types import SimpleNamespace

import numpy as np
import pytest

import heli
from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.linear_plant import LinearPlant
from heli_dynamics_sim.plant import PlantStatus
from heli_flight.report.charts import flown_design
from heli_flight.report.spectra import rotor_lines
from heli_flight.result import random_gusts
from heli_flight.settings import resolve
from heli_studies.published import designed, flown, names_of

pytestmark = pytest.mark.slow

LAW = "hinf_output"


def fly(plant=None, seed=1, duration_s=8.0, **plant_values):
    values = {node: dict(of) for node, of in designed("blade360", LAW).values.items()}
    values["plant"] = {} if plant is not None else values["plant"]
    values["plant"] |= plant_values
    return heli.fly(
        "hover", world="paper", gps="rtk", seed=seed, controller=LAW, params=values, plant=plant,
        duration_s=duration_s, quiet=True,
    )  # fmt: skip


def test_a_design_is_below_its_bound_and_names_its_plant():
    for law in (LAW, "hinf"):
        made = designed("blade360", law)
        assert made.gamma > made.gamma_star > 0.0
        assert made.disk_input > 0.5 and made.disk_output > 0.5
        assert made.values["plant"] == {"linear_model": "blade360"}


def test_it_hovers_where_its_law_is_from_its_own_numbers():
    found = flown("blade360", LAW, "honest", 1)
    assert not found["lost"] and max(found["lateral"], found["longitudinal"]) < 0.5


def test_named_and_given_it_flies_the_same_flight():
    named, given = fly(), fly(LinearPlant("blade360"))
    assert named.truth.pos_ned_m.tobytes() == given.truth.pos_ned_m.tobytes()
    assert named.truth.pos_ned_m.tobytes() != fly(seed=2).truth.pos_ned_m.tobytes()


def test_stepped_it_flies_the_same_flight():
    values = {node: dict(of) for node, of in designed("blade360", LAW).values.items()}
    sim = heli.Simulation(
        scenario="hover", world="paper", gps="rtk", seed=1, controller=LAW, params=values,
        quiet=True,
    )  # fmt: skip
    sim.reset()
    for _ in range(100):
        obs = sim.step()
    assert not obs.lost
    assert obs.truth.pos_ned_m == pytest.approx(fly(duration_s=3.0).truth.pos_ned_m[100], abs=1e-9)
    with pytest.raises(ParameterError):
        sim.linearize()


def test_a_plant_that_is_lost_ends_the_flight():
    class Falling(LinearPlant):
        def step(self, tick, u):
            super().step(tick, np.array([0.0, 0.0, 0.0, 0.95]))

    flight = fly(Falling("blade360"), duration_s=20.0)
    assert flight.lost == PlantStatus.HIT_GROUND.sentence


def test_an_unknown_aircraft_is_named():
    with pytest.raises(ParameterError, match="blade360"):
        names_of("blade36")
    assert names_of("all")[0] == "blade360"


def test_what_is_written_of_a_flight_needs_no_nonlinear_plant():
    """In honest gusts are drawn; a report has neither the rotor's lines nor a nominal design."""
    settings, other = (
        resolve(
            "hover", "standalone", 1, world="honest", overrides={"plant": {"linear_model": name}}
        )
        for name in ("blade360", "")
    )
    assert random_gusts(settings) == random_gusts(other) and flown_design(settings) is None
    assert (
        rotor_lines(SimpleNamespace(settings=settings))
        == []
        != rotor_lines(SimpleNamespace(settings=other))
    )
