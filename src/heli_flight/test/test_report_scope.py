# SPDX-License-Identifier: Apache-2.0
"""What a report says is simulated is what was: by the parameters of the flight."""

import numpy as np
import pytest

from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.wind import mean_speed
from heli_flight.report.charts import _mean_wind_mps
from heli_flight.report.tables import scope
from heli_flight.result import mean_wind
from heli_flight.settings import resolve

# What the paper's world lacks and the others have.
WORLDS_DIFFER = {"Ground effect.", "Vibration of the rotor on the IMU.", "GPS multipath."}


def test_in_the_papers_world_what_its_model_lacks_is_said():
    scopes = scope(resolve(world="paper").nodes["plant"])
    assert WORLDS_DIFFER <= set(scopes["Not simulated"])
    assert not WORLDS_DIFFER & set(scopes["Simulated"])


@pytest.mark.parametrize("world", ["honest", "hard"])
def test_in_another_world_it_is_simulated(world):
    scopes = scope(resolve(world=world).nodes["plant"])
    assert WORLDS_DIFFER <= set(scopes["Simulated"])
    # What no world has stays said.
    assert any("A real flight" in sentence for sentence in scopes["Not simulated"])
    assert not set(scopes["Simulated"]) & set(scopes["Not simulated"])


@pytest.mark.parametrize(
    ("world", "words"),
    [("paper", "3/3/5 m/s at 0/10/20 m"), ("honest", "4 m/s at 20 ft, log profile")],
)
def test_the_mean_wind_is_that_of_the_flight(world, words):
    plant = resolve(world=world).nodes["plant"]
    assert mean_wind(plant) == words
    heights, air = np.linspace(0.0, 40.0, 81), PlantConfig.from_parameters(plant).wind
    flown = [mean_speed(h, air) for h in heights]
    np.testing.assert_allclose(_mean_wind_mps(heights, plant), flown, rtol=1e-12)
