# SPDX-License-Identifier: Apache-2.0
"""What a design for a published linear aircraft is made from: `heli design --aircraft blade360`.

A, B, E, trim and delay are the file's. Its collective is told to the position controller as that of
a rotor whose thrust rises with it as the aircraft's does: K_col is solved for.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import ParameterCause
from heli_core.foreign_files import FileError, read_yaml
from heli_core.linear import hover_system
from heli_core.rows import ACTUATOR
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import AircraftError
from heli_dynamics_sim.linear_aircraft import (
    LINEAR,
    PARAMETER,
    LinearAircraft,
    find_linear,
    linear_models,
)
from heli_inner_hinf.controller_state import Actuation
from heli_outer_pd.state import RotorMap, blade_pitch

_MOST_DELAY_TICKS = 2
"""What the observer's inbox holds; the rest of a delay counts as lag of the servos."""
_DAMPING = 0.7
_FASTEST_SERVO_RADPS = 300.0
_AIR_KGPM3, _LIFT_SLOPE, _SOLIDITY = 1.225, 5.5, 0.05
"""Of the thrust map alone, whose slope is the aircraft's by K_col: usual of this size."""


NO_GROUND = {"ground_collective": 0.98}
"""Parameters of the inner loop: no collective that is flown is one of standing."""
_LEAST_THRUST_COL, _PITCH_FLOOR = 0.95, 0.25


class LinearBasis(NamedTuple):
    """As the fields of `make.Basis`."""

    source: str
    system: Any
    x_trim: np.ndarray
    u_trim: np.ndarray
    actuation: Actuation
    outer: Mapping[str, Any]
    plant: Mapping[str, Any]
    residual: float


def is_linear(aircraft: str | None) -> bool:
    """Whether a name, or a file, is that of a linear aircraft."""
    if aircraft is None:
        return False
    if Path(aircraft).name == aircraft and aircraft.removesuffix(".yaml") in linear_models():
        return True
    try:
        tree = read_yaml(aircraft) if Path(aircraft).is_file() else None
    except FileError:
        return False
    return isinstance(tree, dict) and "states" in tree


def known_actuation(aircraft: LinearAircraft, delay_ticks: int) -> Actuation:
    """A controller's model of servos and delay: at most two ticks, the rest as servo lag."""
    delay_s = delay_ticks * TICK_S + aircraft.delay_s
    ticks = min(int(delay_s / TICK_S + 1e-9), _MOST_DELAY_TICKS)
    if aircraft.servo is not None and delay_s <= _MOST_DELAY_TICKS * TICK_S:
        return Actuation(aircraft.servo[0], aircraft.servo[1], ticks * TICK_S)
    own_s = 0.0 if aircraft.servo is None else 2.0 * aircraft.servo[1] / aircraft.servo[0]
    lag_s = max(delay_s - ticks * TICK_S + own_s, 2.0 * _DAMPING / _FASTEST_SERVO_RADPS)
    return Actuation(2.0 * _DAMPING / lag_s, _DAMPING, ticks * TICK_S)


def flown_actuation(aircraft: LinearAircraft, delay_ticks: int) -> Actuation:
    """What lies between command and rotor of the plant."""
    omega, zeta, _ = aircraft.servo or (1000.0, 1.0, 0.0)
    return Actuation(omega, zeta, delay_ticks * TICK_S + aircraft.delay_s)


def linear_basis(name: str, plant: Mapping[str, Any]) -> LinearBasis:
    """Of a packaged name, or a file; plant: parameters of the node `plant`.

    Raises
    ------
    AircraftError
    """
    aircraft = LinearAircraft.from_yaml(name)
    file = find_linear(name)
    A, B, E, x_trim = aircraft.nine()
    named = name if Path(name).name == name else str(file.resolve())
    return LinearBasis(
        source=f"linear aircraft {name}: {aircraft.citation}",
        system=hover_system(A, B, E, "published"),
        x_trim=x_trim,
        u_trim=aircraft.u_trim,
        actuation=known_actuation(aircraft, int(plant["delay_ticks"])),
        outer=_outer(aircraft),
        plant={PARAMETER: named},
        residual=0.0,
    )


def _outer(aircraft: LinearAircraft) -> dict[str, Any]:
    """Parameters of the position controller: mass, gravity, a thrust map of this slope."""
    radius, blades = aircraft.rotor_radius_m, max(round(aircraft.rotor_blades), 2)
    chord = _SOLIDITY * np.pi * radius / blades
    weight_n = aircraft.mass_kg * aircraft.gravity_mps2
    rotor = RotorMap(
        rho=_AIR_KGPM3,
        omega=aircraft.rotor_speed_radps,
        radius=radius,
        lift_slope=_LIFT_SLOPE,
        blades=float(blades),
        chord=chord,
        K_col=1.0,
    )
    little = 0.01 * weight_n
    pitch_per_n = (
        blade_pitch(weight_n + little, 0.0, rotor) - blade_pitch(weight_n - little, 0.0, rotor)
    ) / (2.0 * little)
    thrust_per_col = -aircraft.mass_kg * aircraft.B[LINEAR.w, ACTUATOR.col]
    K_col = float(pitch_per_n * thrust_per_col)
    if not abs(K_col) < 1.0:
        raise AircraftError(
            f"{aircraft.B[LINEAR.w, ACTUATOR.col]:g} m/s2 of collective is more than a rotor of "
            "its radius and speed gives",
            ParameterCause.BOUNDS, key="B: w: d_col",
        )  # fmt: skip
    # Collective of the least blade pitch stays within what is flown.
    hover_pitch = blade_pitch(weight_n, 0.0, rotor)
    room = _LEAST_THRUST_COL - float(aircraft.u_trim[ACTUATOR.col])
    return {
        "blade_pitch_floor": max(_PITCH_FLOOR, 1.0 + room * K_col / hover_pitch),
        "mass": aircraft.mass_kg,
        "gravity": aircraft.gravity_mps2,
        "rotor.rho": _AIR_KGPM3,
        "rotor.omega": aircraft.rotor_speed_radps,
        "rotor.radius": radius,
        "rotor.lift_slope": _LIFT_SLOPE,
        "rotor.blades": blades,
        "rotor.chord": float(chord),
        "rotor.K_col": K_col,
    }
