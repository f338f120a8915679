# SPDX-License-Identifier: Apache-2.0
"""The aircraft on its skids at the start: rotor turning at idle collective, or still to spool up.

The equilibrium of weight, rotor, gear springs and friction is found by letting the aircraft settle
from just above it: with the bristles' friction many states are at rest, and this is the one that
an aircraft comes to that was put there. The c.g. is then moved along the ground to its place.

While the rotor spools up its speed rises in proportion to time, whatever its torques: a soft start
or a clutch does that, not the governor in flight. The fuselage feels the rotor's drag and the
torque that accelerates it. Couplings of flapping, flap-back and dynamic inflow are left out until
the rotor has its speed: they are numbers of full speed, which grow as it falls (`present`).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.aircraft_kernel import HelicopterKernel
from heli_dynamics_sim.helicopter import derivative_kernel, same_air
from heli_dynamics_sim.integrate import WORK_ROWS, rk4_step
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.state import STEP_S
from heli_dynamics_sim.trim import Trim, TrimError, trim
from heli_math.rotations import quat_from_euler
from heli_math.rows import ACTUATOR, PLANT

_SETTLING_S = 10.0
_SPEED_LIMIT_MPS = 1e-4
_TURN_LIMIT_RADPS = 1e-3


@dataclass(frozen=True)
class Stand:
    """Where and how the aircraft stands.

    Attributes
    ----------
    pos_ned_m : (3,) array
        Of the c.g.; down is not used, it follows from the gear.
    psi : float
        Heading, rad.
    wind_ned_mps : (3,) array
    idle_collective : float
    rotor_turns : bool
        At the governed speed, or not at all.
    """

    pos_ned_m: NDArray[np.float64]
    psi: float
    wind_ned_mps: NDArray[np.float64]
    idle_collective: float
    rotor_turns: bool


def spooling(k: HelicopterKernel, acceleration_radps2: float) -> HelicopterKernel:
    """The aircraft while its rotor's speed rises by `acceleration_radps2`, prescribed."""
    return k._replace(
        terms=k.terms._replace(rotor_speed=True, flap_back=False, inflow=False),
        engine=k.engine._replace(spool=acceleration_radps2),
        flapping=k.flapping._replace(a_bs=0.0, b_as=0.0, flap_back=0.0),
    )


def on_ground(helicopter: HelicopterParameters, k: HelicopterKernel, stand: Stand) -> Trim:
    """State and command of the aircraft at rest on its skids.

    Parameters
    ----------
    helicopter : HelicopterParameters
        For the trim of hover in still air, whose cyclic and pedal are held.
    k : HelicopterKernel
        The same aircraft, over the ground that it stands on.
    stand : Stand

    Returns
    -------
    Trim
        At its place; `residual` is the largest derivative of its velocity and rates, SI.

    Raises
    ------
    TrimError
        If it slides or tips over there.
    """
    hover = trim(helicopter, psi=stand.psi)
    u = hover.u.copy()
    u[ACTUATOR.col] = stand.idle_collective
    x = hover.x.copy()
    x[PLANT.servo] = u
    into = k.ground.plane[0]
    sag = k.body.mass * k.body.gravity / (4.0 * k.ground.stiffness)
    x[PLANT.pos] = stand.pos_ned_m
    x[PLANT.down] = _down(x, (sag - k.ground.points[0, 2]), k)
    x[PLANT.quat] = _flat_on(into, stand.psi)
    x = _settled(x, u, stand.wind_ned_mps, k)
    if not stand.rotor_turns:
        # States that rest while it spools up stay as full speed wants them.
        x[PLANT.rotor], x[PLANT.omega] = 0.0, 0.0
        k = spooling(k, 0.0)
        x = _settled(x, u, stand.wind_ned_mps, k)
    depth = float(into @ (x[PLANT.pos] - np.append(k.ground.origin, 0.0)))
    x[PLANT.pos] = stand.pos_ned_m
    x[PLANT.down] = _down(x, depth, k)
    rates = np.empty(PLANT.size)
    derivative_kernel(x, u, same_air(stand.wind_ned_mps), k, rates)
    moving = rates[PLANT.u : PLANT.w + 1].tolist() + rates[PLANT.rate].tolist()
    return Trim(x, u, float(np.abs(moving).max()), stand.wind_ned_mps)


def _down(x: NDArray[np.float64], depth: float, k: HelicopterKernel) -> float:
    """Down (m) of a c.g. over the north and east of x at a depth (m) in the ground."""
    into = k.ground.plane[0]
    along = into[:2] @ (x[PLANT.pos][:2] - k.ground.origin)
    return float((depth - along) / into[2])


def _flat_on(into: NDArray[np.float64], psi: float) -> NDArray[np.float64]:
    """Quaternion of an aircraft whose skids lie on the plane, with heading psi."""
    level = np.array([math.cos(psi), math.sin(psi)])
    nose = np.append(level, -(into[:2] @ level) / into[2])
    nose /= np.linalg.norm(nose)
    right = np.cross(into, nose)
    return quat_from_euler(math.atan2(right[2], into[2]), -math.asin(nose[2]), psi)


def _settled(
    x: NDArray[np.float64], u: NDArray[np.float64], wind: NDArray[np.float64], k: HelicopterKernel
) -> NDArray[np.float64]:
    """The state after `_SETTLING_S` with the command held, with the tank as it was."""
    x, work, air = x.copy(), np.zeros((WORK_ROWS, PLANT.size)), same_air(wind)
    fuel = x[PLANT.fuel]
    for _ in range(round(_SETTLING_S / STEP_S)):
        rk4_step(x, u, air, k, STEP_S, work)
    x[PLANT.fuel] = fuel
    speed, turn = np.linalg.norm(x[PLANT.vel]), np.linalg.norm(x[PLANT.rate])
    if not (speed < _SPEED_LIMIT_MPS and turn < _TURN_LIMIT_RADPS):
        raise TrimError(
            f"no stand on the ground in wind {np.round(wind, 3).tolist()} m/s (NED): after "
            f"{_SETTLING_S:g} s it moves at {speed:.2g} m/s and {turn:.2g} rad/s; slope, wind or "
            "ground.idle_collective are too much for the skids"
        )
    return x
