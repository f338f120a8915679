# SPDX-License-Identifier: Apache-2.0
"""A new aircraft from few numbers: similarity, refusals, the file."""

import math

import numpy as np
import pytest
import yaml

from heli_core.errors import ParameterCause
from heli_dynamics_sim.aircraft import AircraftError, HelicopterParameters, file_fields
from heli_dynamics_sim.scaling import (
    Given,
    Origin,
    Rule,
    blade_loading,
    nearest,
    new_aircraft,
    sensitivities,
    yaml_text,
)
from heli_dynamics_sim.trim import linearize, trim


@pytest.fixture(scope="module")
def helion():
    return HelicopterParameters.from_yaml("helion")


def test_the_same_size_is_the_same_aircraft(helion):
    made = new_aircraft(Given(helion.mass_kg, 2.0 * helion.main_radius_m), "helion")
    for item in file_fields(helion):
        value = getattr(helion, item.name)
        if isinstance(value, float):
            assert getattr(made.parameters, item.name) == pytest.approx(value, rel=1e-4)


@pytest.mark.parametrize("length", [0.5, 1.7])
def test_a_similar_aircraft_has_the_modes_of_its_source_in_its_own_time(helion, length):
    given = Given(helion.mass_kg * length**3, 2.0 * length * helion.main_radius_m)
    made = new_aircraft(given, "helion", Rule.FROUDE)
    assert made.blade_loading == pytest.approx(blade_loading(helion), rel=1e-3)
    ours, theirs = made.parameters, helion
    at, source = trim(ours), trim(theirs)
    assert at.u == pytest.approx(source.u, abs=2e-4)
    modes = np.linalg.eigvals(linearize(ours, at).A) * math.sqrt(length)
    assert np.sort_complex(modes) == pytest.approx(
        np.sort_complex(np.linalg.eigvals(linearize(theirs, source).A)), rel=2e-3, abs=2e-3
    )


def test_tip_speed_stays_by_mach_and_goes_with_the_root_of_length_by_froude(helion):
    tip_mps = helion.main_speed_radps * helion.main_radius_m
    given = Given(1.5, helion.main_radius_m)
    assert new_aircraft(given, "helion").tip_speed_mps == pytest.approx(tip_mps, rel=1e-4)
    slow = new_aircraft(given, "helion", Rule.FROUDE)
    assert slow.tip_speed_mps == pytest.approx(tip_mps * math.sqrt(0.5), rel=1e-4)
    own = new_aircraft(Given(1.5, helion.main_radius_m, rotor_speed_radps=300.0), "helion")
    assert own.parameters.main_speed_radps == 300.0


@pytest.mark.parametrize(
    ("given", "key", "cause"),
    [
        (Given(math.nan, 1.4), "mass", ParameterCause.BOUNDS),
        (Given(5.0, -1.4), "rotor diameter", ParameterCause.BOUNDS),
        (Given(5.0, 1.4, math.inf), "rotor speed", ParameterCause.BOUNDS),
        (Given(5.0, 1.4, None, (0.1, 0.1, 0.5)), "body.inertia_*", ParameterCause.CONFLICT),
        (Given(5.0, 1.4, None, (50, 60, 70)), "body.inertia_xx_kgm2", ParameterCause.CONFLICT),
        (Given(50.0, 1.0), "main_rotor.speed_radps", ParameterCause.CONFLICT),
    ],
)
def test_what_cannot_be_is_refused(given, key, cause):
    with pytest.raises(AircraftError) as refused:
        new_aircraft(given, "helion")
    assert (refused.value.key, refused.value.cause) == (key, cause)


def test_the_nearest_in_size_is_scaled():
    assert nearest(Given(9.5, 1.4)) == "helion"
    assert nearest(Given(3.5, 1.5)) == "logo600"


def test_the_file_is_the_aircraft_and_says_where_each_number_is_from(tmp_path):
    made = new_aircraft(Given(5.0, 1.4, None, (0.15, 0.3, 0.4)), "xcell60")
    path = tmp_path / "mine.yaml"
    path.write_text(yaml_text(made, "mine"))
    assert HelicopterParameters.from_yaml(path) == made.parameters
    assert list(yaml.safe_load(path.read_text()))[0] == "body"
    origins = {entry.key: entry.origin for entry in made.keys}
    assert origins["body.mass_kg"] is origins["body.inertia_zz_kgm2"] is Origin.YOURS
    assert origins["main_rotor.chord_m"] is Origin.SCALED
    assert origins["servo.bandwidth_radps"] is Origin.KEPT
    assert origins["main_rotor.collective_offset_rad"] is Origin.SOLVED


def test_inertia_changes_its_row_by_its_share(helion):
    change = dict(sensitivities(helion))
    assert change["body.inertia_xx_kgm2"] == pytest.approx(1.0 - 1.0 / 1.1, rel=1e-3)
    assert change["landing_gear.friction"] == 0.0
    assert "environment.gravity_mps2" not in change
