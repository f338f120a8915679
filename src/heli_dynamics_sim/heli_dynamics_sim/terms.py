# SPDX-License-Identifier: Apache-2.0
"""Terms of the aircraft beyond the source's equations, a switch each.

With all of them off (`Terms()`) the aircraft is the paper's model; constants of terms stand in the
aircraft files whether they are on or not.
"""

from typing import NamedTuple

from heli_math.rows import PLANT


class Terms(NamedTuple):
    """Which terms are on; a kernel takes it as it is."""

    flap_back: bool = False
    inflow: bool = False
    ground_effect: bool = False
    vortex_ring: bool = False
    rotor_speed: bool = False
    tail_authority: bool = False
    fuel: bool = False
    servo_resolution: bool = False
    servo_dead_band: bool = False
    servo_load: bool = False
    swash_servos: bool = False


MEANINGS = {
    "flap_back": "Tilt of the disc by the air's speed across it",
    "inflow": "Dynamic inflow of the main rotor, three states",
    "ground_effect": "Less induced velocity near the ground",
    "vortex_ring": "Induced velocity in steep descent as measured",
    "rotor_speed": "Rotor speed, engine and governor",
    "tail_authority": "Loss of the tail rotor's authority in side wind",
    "fuel": "Mass that is used up in flight",
    "servo_resolution": "Steps of the servos' commands",
    "servo_dead_band": "Dead band of the servos",
    "servo_load": "Rate limit of the collective's servos under the propeller moment",
    "swash_servos": "Three swash servos at 120 deg, one of them slower",
}
"""What each term is, for people."""


class TermState(NamedTuple):
    """A state that a term adds, as trim and linearisation take it."""

    place: int  # of `PLANT`: solved for
    row: int  # of the state's derivative: vanishes in equilibrium
    meaning: str  # of that derivative, with its unit


_STATES = {
    "rotor_speed": (  # the governor keeps its speed: power and integrator are what they must be
        TermState(PLANT.engine, PLANT.omega, "omega_dot (rad/s2)"),
        TermState(PLANT.governor, PLANT.engine, "engine_dot (1/s)"),
    ),
    "flap_back": (
        TermState(PLANT.blade_a, PLANT.blade_a, "blade_a_dot (rad/s)"),
        TermState(PLANT.blade_b, PLANT.blade_b, "blade_b_dot (rad/s)"),
    ),
    "inflow": (
        TermState(PLANT.inflow_mean, PLANT.inflow_mean, "v_0_dot (m/s2)"),
        TermState(PLANT.inflow_right, PLANT.inflow_right, "v_s_dot (m/s2)"),
        TermState(PLANT.inflow_rear, PLANT.inflow_rear, "v_c_dot (m/s2)"),
    ),
}


def states_of(terms: Terms) -> list[TermState]:
    """States that the terms that are on add to the equilibrium."""
    return [state for name, states in _STATES.items() if getattr(terms, name) for state in states]
