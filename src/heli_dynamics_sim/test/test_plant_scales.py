# SPDX-License-Identifier: Apache-2.0
"""The aircraft that flies and that of the file are two; a start need not be trimmed for wind."""

from dataclasses import asdict

import numpy as np
import pytest

from heli_core.rows import IMU, MEAS, PLANT
from heli_dynamics_sim.aircraft import AircraftError
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.plant import advance, initial_state, measure
from heli_dynamics_sim.trim import trim

SCALES = {
    "mass": {"mass_kg"},
    "inertia": {"inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2"},
    "rotor_stiffness": {"hub_stiffness_nmprad"},
    "thrust": {"main_lift_slope"},
    "servo_speed": {"servo_bandwidth_radps", "servo_rate_limit_per_s"},
    "drag": {"drag_area_x_m2", "drag_area_y_m2", "drag_area_z_m2", "wash_area_y_m2"},
}


def test_without_scales_the_aircraft_is_that_of_the_file(plant_config, helicopter):
    assert plant_config().helicopter == helicopter


@pytest.mark.parametrize("scale", SCALES)
def test_a_scale_multiplies_its_own_parameters_alone(plant_config, helicopter, scale):
    flown = asdict(plant_config(**{f"scale__{scale}": 1.25}).helicopter)
    unscaled = asdict(helicopter)
    assert {name for name in unscaled if flown[name] != unscaled[name]} == SCALES[scale]
    for name in SCALES[scale]:
        assert flown[name] == pytest.approx(1.25 * unscaled[name], rel=1e-15)


def test_thrust_at_the_same_pitch_and_inflow_is_scaled(plant_config, helicopter):
    """Eq. (2): T = slope (w_bl - v_i), the slope proportional to the blades' lift slope."""
    flown = plant_config(scale__thrust=0.8).params.aircraft.rotor
    assert flown.thrust_slope == pytest.approx(0.8 * helicopter.params.rotor.thrust_slope)
    assert flown.disc == helicopter.params.rotor.disc


def test_drag_at_the_same_air_speed_is_scaled(plant_config, helicopter):
    flown = plant_config(scale__drag=1.3).params.aircraft.fuselage
    np.testing.assert_allclose(flown, 1.3 * np.array(helicopter.params.fuselage), rtol=1e-15)


def test_a_product_out_of_bounds_is_refused_by_name(plant_config):
    with pytest.raises(AircraftError, match=r"main_rotor.lift_slope_per_rad.*11.04"):
        plant_config(scale__thrust=2.0)


def test_a_start_in_still_air_knows_nothing_of_the_wind(plant_config, helicopter):
    wind = {"wind__turbulence": False, "wind__profile_speed_mps": [6.0, 6.0, 6.0]}
    in_wind = initial_state(plant_config(**wind), 1)
    still = initial_state(plant_config(**wind, initial__trim="still_air"), 1)
    np.testing.assert_array_equal(still.x[PLANT.quat], trim(helicopter).x[PLANT.quat])
    np.testing.assert_array_equal(still.commands[0], trim(helicopter).u)
    assert np.abs(still.x[PLANT.quat] - in_wind.x[PLANT.quat]).max() > 1e-3
    # The wind itself is there from the first tick on.
    np.testing.assert_array_equal(still.air, in_wind.air)


def test_the_air_begins_to_move_with_the_flight(plant_config):
    """The first half of MIL-F-8785C's 1-cosine shape: nothing, half of it half-way, all."""
    wind = {"wind__turbulence": False, "wind__profile_speed_mps": [6.0, 6.0, 6.0]}
    config = plant_config(**wind, initial__trim="still_air", initial__wind_onset_s=2.0)
    state, rows = initial_state(config, 1), NoiseStreams(1).rows(301)
    speeds = []
    for tick in range(301):
        y = np.zeros(MEAS.size)
        measure(state, tick, rows[tick], config.params, y)
        speeds.append(float(np.linalg.norm(y[MEAS.wind])))
        if tick == 0:
            level = y[MEAS.imu][IMU.force]
    assert speeds[0] == 0.0 and speeds[100] == pytest.approx(3.0)
    assert speeds[50] == pytest.approx(3.0 * (1.0 - np.cos(0.25 * np.pi)))
    assert speeds[200] == speeds[300] == pytest.approx(6.0)
    assert np.linalg.norm(level) == pytest.approx(config.helicopter.gravity_mps2, abs=0.1)


def test_a_pilot_holds_the_controls_until_the_hand_over(plant_config):
    """In still air the trim that is held is an equilibrium, whatever is commanded."""
    calm = {"wind__turbulence": False, "wind__profile_speed_mps": [0.0, 0.0, 0.0]}
    config = plant_config(**calm, initial__trim="still_air", initial__pilot_ticks=30)
    state = initial_state(config, 1)
    start, command = state.x.copy(), np.array([0.3, -0.3, 0.2, 0.4])
    for _ in range(30):
        advance(state, command, config.params)
    np.testing.assert_allclose(state.x, start, atol=1e-8)
    for _ in range(10):
        advance(state, command, config.params)
    np.testing.assert_allclose(state.x[PLANT.servo], command, atol=0.2)
