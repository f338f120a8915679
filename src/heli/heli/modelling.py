# SPDX-License-Identifier: Apache-2.0
"""`heli.trim` and `heli.linearize`: the aircraft at rest, and its linear model about that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_dynamics_sim.linearize import LinearModel, reduced_state
from heli_dynamics_sim.linearize import linearize as linearize_about
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.trim import Trim as PlantTrim
from heli_dynamics_sim.trim import trim as find_trim
from heli_flight.loop.settings import resolve
from heli_math.state_names import ACTUATOR_NAMES, STATE_NAMES
from heli_parameters.parameters import ParameterError


@dataclass(frozen=True)
class Trim:
    """An equilibrium.

    Attributes
    ----------
    x : (9,) array
        phi theta p q a_s b_s r d_int psi, rad and rad/s (places `heli.NINE`).
    u : (4,) array
        d_lat d_lon d_ped d_col, -1 to 1.
    residual : float
        Largest derivative that should vanish, SI.
    wind_ned_mps : (3,) array
        Velocity of the air, NED.
    speed_mps : float
        Over the ground, along the heading.
    full : heli_dynamics_sim Trim
        All states, in the frame that moves with the aircraft.
    """

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    residual: float
    wind_ned_mps: NDArray[np.float64]
    speed_mps: float
    full: PlantTrim

    def __repr__(self) -> str:
        wind = np.round(self.wind_ned_mps, 3).tolist()
        states = ", ".join(
            f"{name} {value:.5f}" for name, value in zip(STATE_NAMES, self.x, strict=True)
        )
        inputs = ", ".join(
            f"{name} {value:.5f}" for name, value in zip(ACTUATOR_NAMES, self.u, strict=True)
        )
        return (
            f"Trim at {self.speed_mps:g} m/s in wind {wind} m/s (NED)\n  {states} (rad, rad/s)\n"
            f"  {inputs}\n  residual {self.residual:.1e}"
        )


def aircraft_of(aircraft: Any) -> HelicopterParameters:
    """The aircraft of a name or a file; None: the one that flies unless another is named."""
    file = aircraft or resolve().nodes["plant"]["aircraft_file"]
    return HelicopterParameters.from_yaml(file)


def trim(
    aircraft: Any = None,
    wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0),
    speed_mps: float = 0.0,
    psi_rad: float = 0.0,
) -> Trim:
    """Find the equilibrium of hover, or of level flight at a speed, in steady wind.

    Level flight at a steady speed is hover in the opposite wind: the aircraft feels its motion
    through the air alone.

    Parameters
    ----------
    aircraft : str or path, optional
        A packaged aircraft's name, or an aircraft file; default: the packaged one.
    wind_ned_mps : (3,) array
        Velocity of the air: north, east, down.
    speed_mps : float
        Over the ground, along the heading.
    psi_rad : float
        Heading.

    Returns
    -------
    Trim

    Raises
    ------
    AircraftError, ParameterError, TrimError
        Each with one sentence.

    Examples
    --------
    >>> heli.trim(speed_mps=10.0).x[heli.NINE.theta]
    """
    wind = np.array(wind_ned_mps, dtype=np.float64)
    if wind.shape != (3,) or not np.isfinite([*wind, speed_mps, psi_rad]).all():
        raise ParameterError(
            f"wind_ned_mps {wind.tolist()}, speed_mps {speed_mps}, psi_rad {psi_rad}: not "
            "allowed; allowed: 3 finite numbers, and a finite number each"
        )
    ahead = np.array([math.cos(psi_rad), math.sin(psi_rad), 0.0])
    at = find_trim(aircraft_of(aircraft), wind - speed_mps * ahead, psi_rad)
    return Trim(reduced_state(at.x), at.u, at.residual, wind, float(speed_mps), at)


def linearize(
    aircraft: Any = None,
    wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0),
    speed_mps: float = 0.0,
    psi_rad: float = 0.0,
    side: Literal["descent", "climb"] = "descent",
) -> LinearModel:
    """Linearise about a trim: x' = A x + B u + E w, deviations from it.

    Parameters
    ----------
    aircraft, wind_ned_mps, speed_mps, psi_rad
        As of `heli.trim`.
    side : {"descent", "climb"}
        The branch of the climb power where the air neither rises nor sinks.

    Returns
    -------
    LinearModel
        A (9, 9), B (9, 3), E (9, 3), x_trim, u_trim; `.system` is a control.StateSpace with named
        states, inputs and outputs.

    Raises
    ------
    AircraftError, ParameterError, TrimError
        Each with one sentence.
    """
    if side not in ("descent", "climb"):
        raise ParameterError(f"side {side!r} is not allowed; allowed: descent, climb")
    at = trim(aircraft, wind_ned_mps, speed_mps, psi_rad)
    return linearize_about(aircraft_of(aircraft), at.full, side)
