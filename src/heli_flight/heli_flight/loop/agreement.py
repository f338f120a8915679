# SPDX-License-Identifier: Apache-2.0
"""Whether the parameters of a flight's nodes fit together, and its faults are some."""

import math
from collections.abc import Mapping
from typing import Any

from heli_bags import parameter_table as recorder_table
from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import faults_of
from heli_flight.loop.layers import NODES
from heli_math.rows import ACTUATOR, SETPOINT
from heli_msgs_bridge.link_faults import link_faults_of
from heli_outer_pd.config import outer_kernel
from heli_outer_pd.thrust_map import collective_for_thrust
from heli_parameters.parameters import ParameterError

# Pairs that two nodes must agree on: what one sends is what the other waits for.
_AGREEMENTS = (
    ("outer_loop", "period_ticks", "inner_loop", "outer_period_ticks"),
    ("plant", "start.on_ground", "outer_loop", "start.on_ground"),
    ("plant", "ground.idle_collective", "outer_loop", "takeoff.idle_collective"),
    ("plant", "sensors.imu2.enabled", "observer", "imu2.enabled"),
    ("plant", "sensors.mag.period_ticks", "observer", "schedule.mag_period_ticks"),
    ("plant", "sensors.baro.period_ticks", "observer", "schedule.baro_period_ticks"),
    ("plant", "sensors.gps.period_ticks", "observer", "schedule.gps_period_ticks"),
    ("plant", "sensors.gps.latency_ticks", "observer", "schedule.gps_latency_ticks"),
    ("plant", "sensors.rotor_speed.period_ticks", "outer_loop", "rotor_speed_period_ticks"),
    *(
        ("plant", key, name, key)
        for name in ("observer", "inner_loop", "outer_loop")
        for key in ("start_time_s", "rate_hz", "origin.latitude_deg", "origin.longitude_deg",
                    "origin.altitude_m")
    ),
    ("plant", "rate_hz", recorder_table.NODE_NAME, "rate_hz"),
)  # fmt: skip


def check_agreement(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError, naming both sides, where two nodes would wait for different things."""
    for first, key, second, other in _AGREEMENTS:
        a, b = nodes[first][key], nodes[second][other]
        if a != b:
            raise ParameterError(
                f"{first}: {key}: {a} does not agree with {second}: {other}: {b}; "
                "change both together"
            )


def check_ground(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError where the outer loop may command what is standing to the inner one."""
    outer, law = outer_kernel(nodes["outer_loop"]), nodes["inner_loop"]
    least, sinking = float(outer.thrust_limits[0]), nodes["outer_loop"]["goto.climb_mps"]
    level = math.cos(outer.trim[SETPOINT.phi]) * math.cos(outer.trim[SETPOINT.theta])
    hover, col = outer.mass * outer.g / level, outer.trim[SETPOINT.col]
    lowest = collective_for_thrust(least * outer.mass * outer.g, sinking, hover, col, outer.rotor)
    stands, side = law["ground_collective"], law["ground_collective"] - law["trim.u"][ACTUATOR.col]
    if (lowest - stands) * side >= 0.0:
        raise ParameterError(
            f"inner_loop: ground_collective: {stands:g} is one that is flown: outer_loop: "
            f"thrust_limits: {least:g} of the weight is collective {lowest:.3g} in descent at "
            f"{sinking:g} m/s; raise thrust_limits or move ground_collective away from hover"
        )


def check_faults(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError before anything is started where a fault is none."""
    try:
        faults_of(nodes["plant"]["faults"])
    except PlantConfigError as error:
        raise ParameterError(f"plant: {error}") from None
    for node in NODES:
        try:
            link_faults_of(nodes[node.name]["link_faults"])
        except ParameterError as error:
            raise ParameterError(f"{node.name}: {error}") from None
