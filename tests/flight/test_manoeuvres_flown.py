# SPDX-License-Identifier: Apache-2.0
"""The scored manoeuvres, flown by the autopilot as they are defined, refused where beyond it."""

import numpy as np
import pytest

from heli_analysis.handling.definitions import MANOEUVRES
from heli_analysis.handling.scoring import HandlingLevel
from heli_core.rcl_yaml import ParameterError
from heli_core.rows import REFERENCE
from heli_flight.layers import scenario_names
from heli_flight.loop import simulate
from heli_flight.scenario import table_of, target_of
from heli_flight.settings import resolve
from heli_studies.handling import score_flown

SCENARIOS = {name: f"mte_{name.replace('-', '_')}" for name in MANOEUVRES}


def test_every_manoeuvre_has_a_scenario():
    assert set(SCENARIOS.values()) == {n for n in scenario_names() if n.startswith("mte_")}


@pytest.mark.parametrize("name", MANOEUVRES)
def test_a_manoeuvre_is_flown_as_it_is_defined(name):
    """With RTK in the paper's world, at the scale of the rotor; the target is the reference's."""
    settings = resolve(SCENARIOS[name], "rtk", 1, world="paper")
    flight = simulate(settings)
    assert not flight.status
    rating = score_flown(settings, flight.record)
    assert rating.complete, rating.conditions
    assert rating.level is not HandlingLevel.NEITHER, [
        (r.criterion.name, r.value) for r in rating.results
    ]
    assert rating.scale.ratio == pytest.approx(1.41 / 16.36)


def test_at_full_size_the_same_file_flies_the_published_lengths():
    overrides = {"scenario": {"path.scale": "full"}}
    settings = resolve("mte_vertical", "rtk", 1, world="paper", overrides=overrides)
    heights = -settings.scenario.reference.points[:, REFERENCE.pos][:, 2]
    assert np.ptp(heights) == pytest.approx(25.0 * 0.3048, abs=1e-6)
    rating = score_flown(settings, simulate(settings).record)
    assert rating.level is HandlingLevel.DESIRED and rating.complete


def test_the_centre_of_the_pirouette_is_ahead():
    settings = resolve("mte_pirouette", "rtk", 1)
    p, reference = settings.scenario_parameters, settings.scenario.reference
    radius = table_of(p)["radius_m"]
    away = reference.points[:, REFERENCE.pos] - target_of(reference, p)
    assert np.hypot(away[:, 0], away[:, 1]) == pytest.approx(radius, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("slalom", {"path.scale": "full"}, ["at least 20.6 m/s", "3.11.9", "path.speed_mps 6.5"]),
        ("depart-abort", {"path.scale": "full"}, ["at least 20.6 m/s", "8.0 m/s are reached"]),
        ("lateral-reposition", {"path.scale": "full"}, ["at least 15.4 m/s"]),
        ("lateral-reposition", {"path.acceleration_mps2": 1.0}, ["at least 4.5 m/s",
                                                                 "path.acceleration_mps2 1"]),
        ("hover", {"path.speed_mps": 0.5}, ["at least 0.9 m/s"]),
        ("pirouette", {"path.speed_mps": 0.5}, ["at least 0.9 m/s", "path.speed_mps 0.5"]),
        ("slalom", {"path.acceleration_mps2": 3.0}, ["bend of", "allowed: 3 m/s2"]),
        ("hover", {"path.manoeuvre": "howver"}, ["path.manoeuvre", "howver", "slalom"]),
        ("hover", {"path.rotor_diameter_m": 0.0}, ["path.rotor_diameter_m", "0.05"]),
        ("hover", {"duration_s": 20.0}, ["duration_s is 20", "27.19 s"]),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_one_sentence(name, keys, words):
    with pytest.raises(ParameterError) as error:
        resolve(SCENARIOS[name], "rtk", 1, overrides={"scenario": keys})
    assert all(word in str(error.value) for word in words), error.value
    assert len(str(error.value).splitlines()) == 1
