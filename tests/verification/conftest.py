# SPDX-License-Identifier: Apache-2.0
"""What the verification cases share: the default aircraft, its kernel in vacuum, plant records."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_core.jit import njit
from heli_core.parameters import load, with_common
from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim import plant
from heli_dynamics_sim.aircraft import CLIMB_POWER_OFF, HelicopterParameters
from heli_dynamics_sim.helicopter import WORK_ROWS, rk4_step, same_air
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.parameters import TABLE


@pytest.fixture(scope="session")
def helicopter():
    return HelicopterParameters.from_yaml("helion.yaml")


@pytest.fixture(scope="session")
def in_vacuum(helicopter):
    """in_vacuum(**changes): kernel of the aircraft with changed parameters, the air set aside.

    By parameters alone: air density and hub spring vanish, and with them every force of the air;
    the climb power, which is per weight, is switched to its branch without climb.
    """

    def build(**changes):
        bare = {"air_density_kgpm3": 1e-30, "hub_stiffness_nmprad": 0.0}
        kernel = replace(helicopter, **(bare | changes)).params
        return kernel._replace(climb_power=CLIMB_POWER_OFF)

    return build


@pytest.fixture(scope="session")
def vacuum(in_vacuum):
    """The default aircraft as a rigid body with servos and gyro."""
    return in_vacuum()


@njit
def _integrate(x, u, air, kernel, dt_s, steps, work):
    for _ in range(steps):
        rk4_step(x, u, air, kernel, dt_s, work)


@pytest.fixture(scope="session")
def fly():
    """fly(x, u, kernel, seconds, dt_s, wind): integrate a copy of x and return it."""

    def run(x, u, kernel, seconds, dt_s=0.002, wind=(0.0, 0.0, 0.0)):
        x = np.array(x)
        work = np.zeros((WORK_ROWS, PLANT.size))
        command, air = np.array(u, dtype=float), same_air(wind)
        _integrate(x, command, air, kernel, dt_s, round(seconds / dt_s), work)
        return x

    return run


@pytest.fixture(scope="session")
def plant_config():
    """plant_config(**changes): a PlantConfig from the packaged values; `__` stands for a dot."""
    files = [
        config_folder("heli_core") / "common.yaml",
        config_folder("heli_dynamics_sim") / "plant.yaml",
    ]
    values = load(with_common(TABLE), files, "plant")

    def build(**changes):
        named = {key.replace("__", "."): value for key, value in changes.items()}
        assert named.keys() <= values.keys()
        return plant.PlantConfig.from_parameters({**values, **named})

    return build


@njit
def _measure_at(state, first, rows, velocity, kernel, out):
    for i in range(rows.shape[0]):
        for j in range(3):
            state.x[j] += velocity[j] * 0.01 * (first + i > 0)
        plant.measure(state, first + i, rows[i], kernel, out[i])


@pytest.fixture(scope="session")
def record():
    """record(config, ticks, seed, velocity_ned, state, kernel): (ticks, 23) measurements.

    The aircraft is carried, not flown: held in its initial state and moved at velocity_ned (m/s).
    """

    def run(config, ticks, seed=1, velocity_ned=(0.0, 0.0, 0.0), state=None, kernel=None):
        state = plant.initial_state(config, seed) if state is None else state
        streams, out = NoiseStreams(seed), np.zeros((ticks, MEAS.size))
        velocity = np.array(velocity_ned)
        kernel = config.params if kernel is None else kernel
        for first in range(0, ticks, 50_000):
            rows = streams.rows(min(50_000, ticks - first))
            part = out[first : first + rows.shape[0]]
            _measure_at(state, first, rows, velocity, kernel, part)
        return out

    return run
