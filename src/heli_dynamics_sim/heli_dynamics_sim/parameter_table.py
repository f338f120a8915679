# SPDX-License-Identifier: Apache-2.0
"""The plant's parameters; their values stand in config/plant.yaml."""

from heli_dynamics_sim.parameter_row import real, row, ticks
from heli_dynamics_sim.sensor_table import SENSORS
from heli_dynamics_sim.terms import MEANINGS, Terms
from heli_dynamics_sim.wind_table import WIND
from heli_math.ticks import TICK_S
from heli_parameters.parameters import Parameter

NODE_NAME = "plant"

_NODE = (
    row("aircraft_file", "string", "Aircraft: a path, or a bare name in config/aircraft"),
    row("seed", "int", "Seed of wind and sensors", lower=0, upper=2**31 - 1),
    row("lockstep", "bool", "Wait for each command (true) or follow the wall clock (false)"),
    real("duration_s", "Length of the flight", "s", TICK_S, 86400.0),
    ticks("delay_ticks", "Transport delay of the commands", 0, 50),
    row("clock", "string", "Who sends /clock", choices=("own", "world")),
)

_FALLBACK = (
    real("actuator_timeout_s", "Real time: without a command for so long the fallback flies", "s",
         0.02, 10.0),
    real("fallback.mean_s", "Time over which commands are averaged to the trim it flies", "s",
         0.1, 60.0),
    real("fallback.blend_s", "Time in which a command takes over from another", "s", 0.01, 5.0),
    real("fallback.rate", "Gains on the measured p, q, r, of d_lat, d_lon, d_ped", "s/rad",
         -2.0, 2.0, (3,)),
    real("fallback.angle", "Gains on how far it has turned, of d_lat, d_lon, d_ped", "1/rad",
         -5.0, 5.0, (3,)),
)  # fmt: skip

_SCENE = (
    real("initial.pos_ned_m", "Position at the start", "m", -1e5, 1e5, (3,)),
    real("initial.psi_deg", "Heading at the start", "deg", -360.0, 360.0),
    row(
        "initial.trim",
        "string",
        "Air in which the start is in equilibrium",
        choices=("mean_wind", "still_air"),
    ),
    ticks("initial.pilot_ticks", "So long the controls rest in the trim of the start", 0, 1000),
    real("initial.wind_onset_s", "Time over which the air begins to move", "s", 0.0, 60.0),
    row("start.on_ground", "bool", "The flight begins on the skids, not in hover"),
    real("start.spool_up_s", "Time that the rotor takes from rest; 0: it turns", "s", 0.0, 120.0),
    real("ground.slope", "Rise of the ground per metre, to north and east", "1", -0.5, 0.5, (2,)),
    real(
        "ground.idle_collective",
        "Collective at which the aircraft stands at the start",
        "",
        -1.0,
        1.0,
        lower_open=True,
        upper_open=True,
    ),
    real("limits.distance_m", "Distance from the start that counts as lost", "m", 1.0, 1e5),
    real("limits.tilt_deg", "Tilt that counts as rolled over", "deg", 10.0, 180.0),
)


def _scale(name: str, description: str) -> Parameter:
    return real(f"scale.{name}", description, "1", 0.2, 5.0)


_SCALE = (
    _scale("mass", "Mass that flies over that of the aircraft file"),
    _scale("inertia", "Inertias that fly over those of the file"),
    _scale("rotor_stiffness", "Hub stiffness that flies over that of the file"),
    _scale("thrust", "Main rotor thrust per blade pitch over that of the file"),
    _scale("servo_speed", "Bandwidth and rate limit of the servos over those of the file"),
    _scale("drag", "Drag areas of the fuselage that fly over those of the file"),
)

_TERMS = (
    *(row(f"terms.{name}", "bool", MEANINGS[name]) for name in Terms._fields),
    real(
        "engine.fail_time_s",
        "Flight time at which the engine fails; negative: never",
        "s",
        -1.0,
        86400.0,
    ),
)

_FAULTS = (row("faults", "string[]", "Faults of sensors and actuators, gusts; none: no fault"),)

TABLE: tuple[Parameter, ...] = (
    _NODE + _FALLBACK + _SCENE + _SCALE + _TERMS + WIND + SENSORS + _FAULTS
)
