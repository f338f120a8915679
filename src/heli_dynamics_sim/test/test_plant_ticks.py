# SPDX-License-Identifier: Apache-2.0
"""The plant by ticks: equilibrium, delay, order of operations, reproducibility, lost flights."""

import numpy as np
import pytest

from heli_core.rotations import quat_from_euler
from heli_core.rows import MEAS
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.plant import PlantStatus, advance, initial_state, measure, status

UNIFORM = {"wind__turbulence": False, "wind__profile_speed_mps": [4.0, 4.0, 4.0]}


def fly(config, seed, ticks, command=None):
    """(states, measurements) of a flight with the trim command or command(tick, trim)."""
    state = initial_state(config, seed)
    hover = state.x[16:20].copy()
    streams = NoiseStreams(seed)
    xs, ys = [], []
    for tick in range(ticks):
        y = np.zeros(MEAS.size)
        measure(state, tick, streams.row(), config.params, y)
        advance(state, hover if command is None else command(tick, hover), config.params)
        xs.append(state.x.copy())
        ys.append(y)
    return np.array(xs), np.array(ys), state


def test_it_starts_in_equilibrium_in_the_mean_wind(plant_config):
    config = plant_config(**UNIFORM, initial__psi_deg=30.0)
    start = initial_state(config, 1).x
    xs, ys, _ = fly(config, 1, 50)
    assert xs[-1] == pytest.approx(start, abs=1e-8)
    assert np.linalg.norm(ys[0, MEAS.wind][:2]) == pytest.approx(4.0)
    assert ys[0, MEAS.wind][0] == pytest.approx(4.0 * np.cos(np.radians(225.0)))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_commands_fly_after_the_delay(plant_config, delay):
    config = plant_config(**UNIFORM, delay_ticks=delay)

    def step(tick, hover):
        return hover + [0.0, 0.0, 0.0, 0.1 if tick >= 10 else 0.0]

    xs, _, _ = fly(config, 1, 20, step)
    moved = np.abs(xs[:, 19] - xs[0, 19]) > 1e-6
    # xs[n] is the state at tick n + 1, the end of the tick that flies the command of n - delay
    assert np.flatnonzero(moved)[0] == 10 + delay


def test_measurement_does_not_depend_on_the_command_of_its_tick(plant_config):
    config = plant_config(delay_ticks=0)
    _, a, _ = fly(config, 3, 12)
    _, b, _ = fly(config, 3, 12, lambda tick, hover: hover + (0.2 if tick >= 10 else 0.0))
    assert (a[:11] == b[:11]).all()
    assert not (a[11, 0:6] == b[11, 0:6]).all()


def test_same_seed_same_bits_other_seed_other_flight(plant_config):
    config = plant_config()
    first, second, other = fly(config, 5, 300), fly(config, 5, 300), fly(config, 6, 300)
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1].tobytes() == second[1].tobytes()
    assert not (first[1][:, 0] == other[1][:, 0]).any()
    assert np.isfinite(first[0]).all()


def test_switching_a_sensor_leaves_the_wind_alone(plant_config):
    a = fly(plant_config(), 5, 100)[1][:, 20:23]
    b = fly(plant_config(sensors__gps__white_m=0.0, sensors__imu__gyro_noise_density=0.0), 5, 100)
    assert (a == b[1][:, 20:23]).all()


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda x: x.__setitem__(0, 1e4), PlantStatus.FLEW_AWAY),
        (lambda x: x.__setitem__(slice(6, 10), quat_from_euler(2.0, 0.0, 0.0)),
         PlantStatus.ROLLED_OVER),
        (lambda x: x.__setitem__(13, np.nan), PlantStatus.NOT_FINITE),
        (lambda x: x.__setitem__(11, 0.1), PlantStatus.OK),
    ],
)  # fmt: skip
def test_a_lost_flight_has_a_name_and_a_sentence(plant_config, spoil, expected):
    config = plant_config()
    state = initial_state(config, 1)
    spoil(state.x)
    advance(state, np.zeros(4), config.params)
    named = PlantStatus(status(state, config.params))
    assert named is expected
    assert named.sentence.endswith(".")


def test_first_cause_stays(plant_config):
    config = plant_config()
    state = initial_state(config, 1)
    state.x[0] = 1e4
    advance(state, np.zeros(4), config.params)
    state.x[:] = np.nan
    advance(state, np.zeros(4), config.params)
    assert PlantStatus(status(state, config.params)) is PlantStatus.FLEW_AWAY
