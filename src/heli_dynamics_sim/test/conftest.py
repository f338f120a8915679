# SPDX-License-Identifier: Apache-2.0
"""What the plant's tests share: the default aircraft, the same in vacuum, plant configurations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_core.parameters import load, with_common
from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import CLIMB_POWER_OFF, HelicopterParameters
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.helicopter import WORK_ROWS, rk4_step, same_air
from heli_dynamics_sim.parameters import TABLE

CONFIG = Path(__file__).resolve().parents[1] / "config"


@pytest.fixture(scope="session")
def helicopter():
    return HelicopterParameters.from_yaml("helion.yaml")


@pytest.fixture(scope="session")
def vacuum(helicopter):
    """Kernel of the aircraft without air and hub spring: nothing but rigid body, servos, gyro."""
    bare = replace(helicopter, air_density_kgpm3=1e-30, hub_stiffness_nmprad=0.0)
    return bare.params._replace(climb_power=CLIMB_POWER_OFF)


@pytest.fixture(scope="session")
def fly():
    """fly(x, u, kernel, seconds, dt_s, wind): integrate a copy of x and return it."""

    def run(x, u, kernel, seconds, dt_s=0.002, wind=(0.0, 0.0, 0.0)):
        x = np.array(x)
        work = np.zeros((WORK_ROWS, PLANT.size))
        command, air = np.array(u, dtype=float), same_air(wind)
        for _ in range(round(seconds / dt_s)):
            rk4_step(x, command, air, kernel, dt_s, work)
        return x

    return run


@pytest.fixture(scope="session")
def parameters():
    """parameters(**changes): the packaged values of the plant, `__` in a name stands for a dot."""
    files = [config_folder("heli_core") / "common.yaml", CONFIG / "plant.yaml"]
    values = load(with_common(TABLE), files, "plant")

    def build(**changes):
        named = {key.replace("__", "."): value for key, value in changes.items()}
        assert named.keys() <= values.keys()
        return {**values, **named}

    return build


@pytest.fixture(scope="session")
def plant_config(parameters):
    """plant_config(**changes): a PlantConfig from the packaged values with changes."""
    return lambda **changes: PlantConfig.from_parameters(parameters(**changes))
