# SPDX-License-Identifier: Apache-2.0
"""What a sensor's place in the aircraft adds: the field of the power, air on the static port.

- Field: currents of the drive make a field fixed to the airframe and proportional to them, so at a
  constant voltage to the power (Biot and Savart; ArduPilot's compass/motor calibration fits the
  same law). The power is the engine's where rotor speed is a term, else the main rotor's.
- Wind: the error of the static pressure is a part of the dynamic pressure along each body axis, of
  its own for either direction: the model that PX4 (EKF2_PCOEF_XP, _XN, _YP, _YN, _Z) and ArduPilot
  (BARO1_WCF_FWD, _BCK, _RGT, _LFT) correct by.
- Wash: behind the disc the pressure of an ideal rotor in hover is 3/2 rho v_i^2 above that of the
  still air and falls to it down the wake (Leishman, Principles of Helicopter Aerodynamics, 2nd ed.
  2006, sec. 2.2, Bernoulli below the disc). A port sees a part of it: a coefficient of
  1/2 rho v_i^2, from 0 to 3.
"""

from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.airframe import fuselage_force
from heli_dynamics_sim.engine import engine_torque
from heli_dynamics_sim.helicopter import airspeed, airspeeds, main_rotor_power
from heli_dynamics_sim.present import present
from heli_dynamics_sim.rotor_flow import rotor_flow
from heli_math.jit import njit
from heli_math.rows import AIR

# Places of the static port's coefficients.
_FRONT, _BACK, _RIGHT, _LEFT, _ALONG_Z = range(5)


class PortKernel(NamedTuple):
    """The barometer's static port."""

    on: bool
    wind: np.ndarray  # (5,) pressure error over dynamic pressure: front, back, right, left, along z
    wash: float  # pressure error over 1/2 rho v_i^2
    half_rho: float  # kg/m3


class PowerFieldKernel(NamedTuple):
    """The field of the drive's currents at the magnetometer."""

    on: bool
    field: np.ndarray  # (3,) body, T/W


@njit
def wash_and_power(x, air, k):
    """Induced velocity of the main rotor (m/s), power of the drive (W); k is a HelicopterKernel."""
    k = present(x, k)
    at_main, _, at_body = airspeeds(x, air)
    u_f, v_f, w_f = at_body
    thrust, v_i, _, _ = rotor_flow(x, at_main, k)
    if k.terms.rotor_speed:
        return v_i, engine_torque(x, k.engine) * k.main.speed
    drag = fuselage_force(u_f, v_f, w_f, v_i, k.fuselage)
    return v_i, main_rotor_power(at_main, at_body, v_i, thrust, drag, k)


@njit
def port_error(x, air, aircraft, k):
    """Pressure (Pa) that air speed and the rotor's wash add at the static port."""
    u_a, v_a, w_a = airspeed(x, air[AIR.fuselage])
    v_i, _ = wash_and_power(x, air, aircraft)
    error = k.wind[_FRONT if u_a >= 0.0 else _BACK] * u_a * u_a
    error += k.wind[_RIGHT if v_a >= 0.0 else _LEFT] * v_a * v_a
    error += k.wind[_ALONG_Z] * w_a * w_a
    return k.half_rho * (error + k.wash * v_i * v_i)


@njit
def add_power_field(x, air, aircraft, k, mag):
    """Add the field of the drive's currents (T) to a reading (3,), in place."""
    _, power = wash_and_power(x, air, aircraft)
    for i in range(3):
        mag[i] += k.field[i] * power
