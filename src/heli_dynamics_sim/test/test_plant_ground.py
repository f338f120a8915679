# SPDX-License-Identifier: Apache-2.0
"""Ground: it carries, it brakes, nothing falls through it, hard impacts are told."""

import numpy as np
import pytest

from heli_core.rotations import euler_from_quat
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.plant import PlantStatus, advance, initial_state, status
from heli_dynamics_sim.trim import critical_bank

GEAR = 0.25


def test_it_stands_on_its_skids(vacuum, fly):
    x = fly(make_state((0.0, 0.0, -GEAR - 0.02)), np.zeros(4), vacuum, 4.0)
    sag = 9.75 * 9.781 / (4 * 5000.0)
    assert x[2] == pytest.approx(-GEAR + sag, abs=1e-6)
    assert np.abs(x[3:6]).max() < 1e-6
    assert euler_from_quat(x[6:10])[:2] == pytest.approx((0.0, 0.0), abs=1e-6)


def test_it_stands_with_the_rotor_turning(helicopter, fly):
    x = make_state((0.0, 0.0, -GEAR + 0.004))
    x[19] = 0.4  # collective down: almost no thrust
    x = fly(x, [0.0, 0.0, 0.0, 0.4], helicopter.params, 5.0, wind=(2.0, -2.0, 0.0))
    assert np.abs(x[3:6]).max() < 0.02
    assert x[2] == pytest.approx(-GEAR, abs=0.01)
    assert np.linalg.norm(x[0:2]) < 0.05


def test_friction_stops_a_slide(vacuum, fly):
    x = make_state((0.0, 0.0, -GEAR + 0.0047))
    x[3] = 1.0
    x = fly(x, np.zeros(4), vacuum, 2.0)
    assert abs(x[3]) < 1e-3
    assert x[0] == pytest.approx(1.0 / (2 * 0.5 * 9.781), rel=0.15)


@pytest.mark.parametrize("roll_deg", [0.0, 40.0, 120.0, 180.0])
@pytest.mark.parametrize("height", [0.5, 3.0])
def test_nothing_falls_through(vacuum, fly, roll_deg, height):
    x = make_state((0.0, 0.0, -GEAR - height), np.radians(roll_deg), 0.1)
    for _ in range(60):
        x = fly(x, np.zeros(4), vacuum, 0.05)
        assert np.isfinite(x).all()
        assert x[2] < 0.05
    assert np.abs(x[3:6]).max() < 1.0


@pytest.mark.parametrize(
    ("sinking", "expected"), [(0.5, PlantStatus.OK), (2.5, PlantStatus.HIT_GROUND)]
)
def test_hard_impact_is_told_and_stays_told(plant_config, sinking, expected):
    config = plant_config(wind__turbulence=False, wind__profile_speed_mps=[0.0, 0.0, 0.0])
    state = initial_state(config, 1)
    state.x[2] = -GEAR - 0.02
    state.x[5] = sinking
    for _ in range(100):
        advance(state, state.commands[0].copy(), config.params)
    assert PlantStatus(status(state, config.params)) is expected
    assert expected.sentence


def test_the_static_rollover_angle_is_that_of_the_textbook(helicopter):
    """Without lift the mass centre stands over the skid; with all of the weight nothing rights."""
    assert critical_bank(helicopter, 0.0) == pytest.approx(np.arctan2(0.20, 0.25))
    weight = 9.75 * 9.781
    assert critical_bank(helicopter, weight) == pytest.approx(0.0, abs=1e-12)
    # A moment to the side, W b / 2, at half of the weight: none is left either.
    assert critical_bank(helicopter, 0.5 * weight, 0.1 * weight) == pytest.approx(0.0, abs=1e-12)
    assert critical_bank(helicopter, 0.0, side_n=-0.5 * weight) > critical_bank(helicopter, 0.0)
    assert np.isnan(critical_bank(helicopter, 2.0 * weight))


@pytest.mark.parametrize(("bank_deg", "falls"), [(38.2, False), (39.2, True)])
def test_it_tips_beyond_the_static_rollover_angle(vacuum, fly, bank_deg, falls):
    """atan(0.20 / 0.25) = 38.7 deg, let go on a right skid that is caught."""
    bank = np.radians(bank_deg)
    k = vacuum._replace(ground=vacuum.ground._replace(friction=100.0))
    low = 0.25 * np.cos(bank) + 0.20 * np.sin(bank)
    x = fly(make_state((0.0, 0.0, 0.0047 - low), bank), np.zeros(4), k, 0.6)
    assert (euler_from_quat(x[6:10])[0] > bank) == falls
