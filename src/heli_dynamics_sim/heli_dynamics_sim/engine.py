# SPDX-License-Identifier: Apache-2.0
"""Rotor speed, engine, governor and fuel: the terms `rotor_speed` and `fuel`.

    J dOmega/dt = Q_engine - Q_main - n Q_tail,   Q_engine = eta P / Omega

with all that turns as one inertia J at the main rotor's speed (Gavrilets, Mettler, Feron,
"Nonlinear Model for a Small-Size Acrobatic Helicopter", AIAA 2001-4333; Padfield, Helicopter Flight
Dynamics, 2nd ed., ch. 3, rotor speed and engine). Omega counts from the air, so the fuselage's yaw
does not enter. A freewheel lets the engine push only; with the engine out the main rotor drives the
tail.

The engine's power follows the throttle as a first-order lag, up to its limit, whatever the speed.
The governor is a PI law on the throttle; a share of the power that hover takes per angle of the
collective is fed forward; its integrator rests while the throttle would be beyond its stops.

Power of a rotor by momentum theory, profile and induced with climb (Leishman, Principles of
Helicopter Aerodynamics, ch. 2): `P = P_0 + T (v_i - w_r)`, w_r the air speed through the disc,
positive in descent. It goes negative when the air drives the rotor, so autorotation is part of it.
The source's own power, which flies without this term, takes nothing back in descent.

The fuselage feels what the shaft carries: the main rotor's torque and that of its acceleration.
What else depends on speed and fuel: `present`.

While the rotor spools up on the ground its speed is prescribed, engine and governor rest
(`standing`).
"""

from typing import NamedTuple

from heli_core.jit import by_reference, njit
from heli_core.rows import PLANT

FREE = -1.0
"""`EngineParams.spool` of a rotor whose speed follows its torques."""
_SLOWEST_DRIVEN = 0.3
"""Rotor speed over the governed one below which the engine's torque grows no further."""


@by_reference
class EngineParams(NamedTuple):
    """Engine, governor, drive train and tank."""

    speed: float  # governed speed of the main rotor, rad/s
    inertia: float  # of all that turns, at the main rotor's speed, kg m2
    main_inertia: float  # of the main rotor alone, kg m2
    power: float  # at the main rotor's shaft at full throttle, W
    rate: float  # of the engine's lag, 1/s
    proportional: float  # throttle per rad/s
    integral: float  # throttle per rad
    feed_forward: float  # throttle per rad of collective pitch
    pitch_gain: float  # K_col, rad
    pitch_offset: float  # theta_col0, rad
    tail_profile: float  # as MainRotorParams.profile_power, of the tail rotor
    tail_tip_speed: float  # m/s
    burnt: float  # fuel per energy at the main rotor's shaft, kg/J
    tank: float  # kg; 0: no tank, never empty
    spool: float  # the rotor's prescribed acceleration, rad/s2; FREE: it follows its torques


@njit
def rotor_power(thrust, flow, in_plane_sq, profile, tip_speed):
    """Power (W) that a rotor takes from its shaft, negative where the air drives it.

    Parameters
    ----------
    thrust : float
        N.
    flow : float
        v_i - w_r: speed of the air through the disc, against the thrust, m/s.
    in_plane_sq : float
        Square of the air speed in the disc plane, m2/s2.
    profile : float
        rho Omega R^2 C_D0 b c / 8, kg/s.
    tip_speed : float
        Omega R, m/s.
    """
    return profile * (tip_speed * tip_speed + 4.6 * in_plane_sq) + thrust * flow


@njit
def shaft_powers(thrust, flow, at_main, tail, tail_flow, at_tail, k):
    """Power (W) of main and tail rotor: thrust (N) and flow through the disc (m/s) of each, and its
    air speed (3 floats, m/s); k is that of the rotor's present speed."""
    in_plane = at_main[0] * at_main[0] + at_main[1] * at_main[1]
    behind = at_tail[0] * at_tail[0] + at_tail[2] * at_tail[2]
    engine, ratio = k.engine, k.main.speed / k.engine.speed
    main = rotor_power(thrust, flow, in_plane, k.main.profile_power, k.main.tip_speed)
    profile, tip_speed = ratio * engine.tail_profile, ratio * engine.tail_tip_speed
    return main, rotor_power(tail, tail_flow, behind, profile, tip_speed)


@njit
def running(x, k):
    """Whether the engine runs: it has not failed, and its tank is not empty."""
    return x[PLANT.engine_out] == 0.0 and (k.tank == 0.0 or x[PLANT.fuel] < k.tank)


@njit
def engine_torque(x, k):
    """Torque (N m) of the engine at the main rotor's shaft. k is an EngineParams."""
    if not running(x, k):
        return 0.0
    return k.power * x[PLANT.engine] / max(x[PLANT.omega], _SLOWEST_DRIVEN * k.speed)


@njit
def shaft(x, powers, k):
    """What the main rotor's shaft carries.

    Parameters
    ----------
    x : (42,) array
    powers : 2 floats
        Power of main and tail rotor, W.
    k : HelicopterParams
        At the rotor's present speed, see `present`.

    Returns
    -------
    torque : float
        On the fuselage, against the rotor's turn, N m.
    drive : 2 floats
        dOmega/dt, rad/s2, 0 without the term; the engine's power at this shaft, W.
    """
    power, behind = powers
    if not k.terms.rotor_speed:
        return power / k.main.speed, (0.0, power)
    engine, omega = k.engine, k.main.speed
    if engine.spool >= 0.0:
        return power / omega + engine.main_inertia * engine.spool, (engine.spool, power + behind)
    torque = engine_torque(x, engine)
    spin = (torque - (power + behind) / omega) / engine.inertia
    return power / omega + engine.main_inertia * spin, (spin, torque * omega)


@njit
def throttle(x, k):
    """(throttle in [0, 1], what the governor wants); k is an EngineParams."""
    pitch = k.pitch_gain * x[PLANT.servo_col] + k.pitch_offset
    wanted = k.feed_forward * pitch + k.proportional * (k.speed - x[PLANT.omega])
    wanted += k.integral * x[PLANT.governor]
    return min(max(wanted, 0.0), 1.0), wanted


@njit
def drive_rates(x, drive, k, out):
    """Fill the drive's places of a plant derivative.

    Parameters
    ----------
    x : (42,) array
    drive : 2 floats
        That of `shaft`.
    k : HelicopterParams
    out : (42,) array
    """
    engine = k.engine
    spin, power = drive
    if k.terms.rotor_speed and engine.spool >= 0.0:
        out[PLANT.omega] = spin
    elif k.terms.rotor_speed:
        opening, wanted = throttle(x, engine)
        error = engine.speed - x[PLANT.omega]
        stuck = (wanted > 1.0 and error > 0.0) or (wanted < 0.0 and error < 0.0)
        out[PLANT.omega] = spin
        out[PLANT.engine] = engine.rate * (opening - x[PLANT.engine])
        out[PLANT.governor] = 0.0 if stuck else error
    if k.terms.fuel and running(x, engine):
        out[PLANT.fuel] = engine.burnt * max(power, 0.0)
