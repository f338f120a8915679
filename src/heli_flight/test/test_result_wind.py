# SPDX-License-Identifier: Apache-2.0
"""What a result says of the wind."""

import json

import numpy as np

from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.plant import initial_state
from heli_flight.result import Result, conditions, random_gusts, write_result
from heli_flight.scoring import Figures
from heli_flight.settings import resolve

GUSTY = {
    "wind.profile": "log",
    "wind.w20_mps": 4.0,
    "wind.random_gusts.rate_per_min": 6.0,
}


def gusty(seed):
    settings = resolve("hover", "rtk", seed)
    settings.nodes["plant"].update(GUSTY)
    return settings


def test_result_holds_the_gusts_that_the_flight_meets(tmp_path):
    settings = gusty(3)
    plant = settings.nodes["plant"]
    flown = initial_state(PlantConfig.from_parameters(plant), 3).turbulence.gusts
    write_result(Result(Figures((), (), ()), "", 0.0, 0.0), settings, tmp_path, {})
    gusts = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["random_gusts"]
    assert len(gusts) > 1
    rows = [[gust["start_s"], gust["duration_s"], *gust["peak_ned_mps"]] for gust in gusts]
    np.testing.assert_array_equal(rows, flown)
    assert rows[-1][0] < plant["duration_s"]


def test_conditions_name_profile_and_gusts():
    assert random_gusts(resolve("hover", "rtk", 1)) == []
    words = conditions(gusty(1)).splitlines()[0]
    assert all(key in words for key in ("4 m/s at 20 ft", "log profile", "225 deg"))
    assert "6 random gusts" in words and "0.2 to 0.5" in words
    usual = conditions(resolve("hover", "rtk", 1))
    assert all(key in usual for key in ("3/3/5 m/s", "0/10/20 m", "225 deg", "MIL-F-8785C"))
