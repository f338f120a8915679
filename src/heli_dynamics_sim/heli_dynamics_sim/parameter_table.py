# SPDX-License-Identifier: Apache-2.0
"""The plant's parameters; their values stand in config/plant.yaml."""

from typing import Any

from heli_dynamics_sim.sensor_table import SENSORS
from heli_dynamics_sim.terms import MEANINGS, Terms
from heli_dynamics_sim.wind_table import WIND
from heli_math.ticks import TICK_S
from heli_parameters.parameters import Parameter

NODE_NAME = "plant"


def _row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    # Read when the plant is configured.
    return Parameter(name, kind, description, unit, read_only=True, **rest)


def _ticks(name: str, description: str, lower: int, upper: int) -> Parameter:
    return _row(name, "int", description, "ticks", lower=lower, upper=upper)


_NODE = (
    _row("aircraft_file", "string", "Aircraft: a path, or a bare name in config/aircraft"),
    _row("seed", "int", "Seed of wind and sensors", lower=0, upper=2**31 - 1),
    _row("lockstep", "bool", "Wait for each command (true) or follow the wall clock (false)"),
    _row("duration_s", "double", "Length of the flight", "s", lower=TICK_S, upper=86400.0),
    _ticks("delay_ticks", "Transport delay of the commands", 0, 50),
    _row("clock", "string", "Who sends /clock", choices=("own", "world")),
)

_SCENE = (
    _row(
        "initial.pos_ned_m",
        "double[]",
        "Position at the start",
        "m",
        shape=(3,),
        lower=-1e5,
        upper=1e5,
    ),
    _row("initial.psi_deg", "double", "Heading at the start", "deg", lower=-360.0, upper=360.0),
    _row(
        "initial.trim",
        "string",
        "Air in which the start is in equilibrium",
        choices=("mean_wind", "still_air"),
    ),
    _ticks("initial.pilot_ticks", "So long the controls rest in the trim of the start", 0, 1000),
    _row(
        "initial.wind_onset_s",
        "double",
        "Time over which the air begins to move",
        "s",
        lower=0.0,
        upper=60.0,
    ),
    _row(
        "limits.distance_m",
        "double",
        "Distance from the start that counts as lost",
        "m",
        lower=1.0,
        upper=1e5,
    ),
    _row(
        "limits.tilt_deg",
        "double",
        "Tilt that counts as rolled over",
        "deg",
        lower=10.0,
        upper=180.0,
    ),
)


def _scale(name: str, description: str) -> Parameter:
    return _row(f"scale.{name}", "double", description, "1", lower=0.2, upper=5.0)


_SCALE = (
    _scale("mass", "Mass that flies over that of the aircraft file"),
    _scale("inertia", "Inertias that fly over those of the file"),
    _scale("rotor_stiffness", "Hub stiffness that flies over that of the file"),
    _scale("thrust", "Main rotor thrust per blade pitch over that of the file"),
    _scale("servo_speed", "Bandwidth and rate limit of the servos over those of the file"),
)

_TERMS = (
    *(_row(f"terms.{name}", "bool", MEANINGS[name]) for name in Terms._fields),
    _row(
        "engine.fail_time_s",
        "double",
        "Flight time at which the engine fails; negative: never",
        "s",
        lower=-1.0,
        upper=86400.0,
    ),
)

TABLE: tuple[Parameter, ...] = _NODE + _SCENE + _SCALE + _TERMS + WIND + SENSORS
