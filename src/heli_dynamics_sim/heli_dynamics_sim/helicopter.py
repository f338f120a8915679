# SPDX-License-Identifier: Apache-2.0
"""The helicopter: all parts put together into one state derivative.

Body axes FRD, airspeed `v_a = v_b - R_nb' w_ned` with w the velocity of the air (blowing towards),
which each of main rotor, tail (rotor and fins) and fuselage has of its own (`rows.AIR`).
Source of the equations: Cai, Chen, Lee, Unmanned Rotorcraft Systems (Springer 2011), ch. 6, and
eq. (1)-(8) of the paper, corrected where the modules say so.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.jit import copy, fill, njit, njit_inlined, referred, scratch
from heli_core.rows import ACTUATOR, AIR, PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters, HelicopterParams
from heli_dynamics_sim.airframe import (
    BodyParams,
    attitude_of,
    fin_force,
    fuselage_force,
    gyro,
    rates_of,
    rigid_body_rates,
    tail_pitch,
    to_body,
    velocity_of,
)
from heli_dynamics_sim.engine import drive_rates, shaft, shaft_powers
from heli_dynamics_sim.ground import apply_slip, ground_loads, stick_rates
from heli_dynamics_sim.main_rotor import (
    FlapBackParams,
    FlappingParams,
    MainRotorParams,
    RotorParams,
    flapping_rates,
    rotor_flow,
    rotor_term_rates,
    tail_rotor,
)
from heli_dynamics_sim.servo import apply_stops, servo_derivatives

# -------------------------------------------------------------------------------------------------
# The aircraft's numbers at the rotor's present speed and with the fuel it has left.
#
# Thrust and induced velocity of both rotors by their blades' speed, the tail's stall by its
# square,
# profile power by momentum theory; 1/tau of the flapping grows with the speed, as gamma Omega / 16
# does; the disc's tilt per air speed falls with it. So do the couplings, eq. (7) over tau, down to
# 0.9 of the governed speed. Below that they keep their ratio to 1/tau: those of `helion.yaml` are
# identified at full speed and of one sign, so that the law would make the disc of a rotor that
# turns
# slower than 0.83 of it diverge, which none does. The tank is near the c.g.: inertia and c.g.
# stay.
# -------------------------------------------------------------------------------------------------

_SLOWEST = 0.05
"""Rotor speed over the governed one below which the numbers are those of this ratio."""
_COUPLED = 0.9
"""That below which the couplings of flapping keep their ratio to its rate."""


@njit_inlined
def _rotor(k, ratio):
    return RotorParams(k.thrust_slope * ratio, k.blade_speed * ratio, k.disc)


@njit_inlined
def _main(k, ratio):
    return MainRotorParams(
        k.hub_stiffness,
        k.hub_height,
        k.speed * ratio,
        k.profile_power * ratio,
        k.tip_speed * ratio,
        k.pitch_gain,
        k.pitch_offset,
    )


@njit_inlined
def _flapping(k, ratio):
    falls = ratio if ratio >= _COUPLED else _COUPLED * _COUPLED / ratio
    return FlappingParams(
        k.rate * ratio,
        k.a_bs / falls,
        k.b_as / falls,
        k.lon_from_lon,
        k.lon_from_lat,
        k.lat_from_lat,
        k.lat_from_lon,
        k.flap_back / ratio,
    )


@njit_inlined
def _flap_back(k, ratio):
    return FlapBackParams(k.blade_rate * ratio, k.coning, k.bar_gain, k.bar_radius_sq, k.bar_inflow)


@njit
def is_off_nominal(k):
    """Whether the HelicopterParams change with rotor speed or fuel."""
    return k.terms.rotor_speed or k.terms.fuel


@njit_inlined
def off_nominal(x, k):
    """The HelicopterParams at a plant state where `is_off_nominal`, by value (see `referred`)."""
    ratio, body = 1.0, k.body
    if k.terms.rotor_speed:
        ratio = max(x[PLANT.omega] / k.engine.speed, _SLOWEST)
    if k.terms.fuel:
        mass = body.mass - x[PLANT.fuel]
        body = BodyParams(mass, body.j_xx, body.j_yy, body.j_zz, body.gravity)
    return HelicopterParams(
        body,
        _rotor(k.rotor, ratio),
        _main(k.main, ratio),
        _flapping(k.flapping, ratio),
        _rotor(k.tail, ratio),
        k.tail_arm,
        k.tail_height,
        k.gyro,
        k.fuselage,
        k.horizontal_fin,
        k.vertical_fin,
        k.servo,
        k.ground,
        k.climb_power,
        k.tail_stall * ratio * ratio,
        k.engine,
        k.terms,
        _flap_back(k.flap_back, ratio),
        k.inflow,
        k.ground_effect,
    )


# -------------------------------------------------------------------------------------------------
# Helicopter.
# -------------------------------------------------------------------------------------------------


_N_STATE, _N_COMMAND = PLANT.size, ACTUATOR.size


@njit
def airspeed(x, wind):
    """Velocity of the c.g. relative to air that moves with wind (3,), body axes (3 floats), m/s."""
    u, v, w = velocity_of(x)
    wx, wy, wz = to_body(attitude_of(x), wind[0], wind[1], wind[2])
    return u - wx, v - wy, w - wz


@njit
def airspeeds(x, air):
    """`airspeed` in the air of main rotor, tail and fuselage; air is a row AIR (12,)."""
    return airspeed(x, air[AIR.main]), airspeed(x, air[AIR.tail]), airspeed(x, air[AIR.fuselage])


@njit
def disc_tilt_of_gust(p_gust, q_gust, speed):
    """Disc tilt (a_s, b_s), rad, towards which air that turns with p, q (rad/s) pulls the rotor.

    A blade at azimuth psi in air that turns about an axis in the disc meets the additional angle of
    attack `(q cos psi - p sin psi) / Omega`, at every radius alike: a cyclic pitch, which the disc
    of a rotor without hinge offset follows a quarter of a turn later (Bramwell, Done, Balmford,
    Bramwell's Helicopter Dynamics, 2nd ed., 2001, ch. 3: the aerodynamic part p/Omega of the tilt
    in a rolling rotor). Seen from above the rotor turns clockwise, as its torque on the body says.
    """
    return p_gust / speed, -q_gust / speed


@njit
def main_rotor_power(at_main, at_body, v_i, thrust, drag, k):
    """Power of the main rotor, W: profile, induced, parasite and climb.

    at_main, at_body: air speeds (3 floats) of rotor and fuselage, m/s.

    P_climb acts in climb only: the model has a kink at w_a = 0, which is where hover without wind
    is. `k.climb_power` replaces it by one of its two smooth branches for linearisation.
    """
    u_a, v_a, w_a = at_main
    u_f, v_f, w_f = at_body
    speed_sq = u_a * u_a + v_a * v_a
    power = k.main.profile_power * (k.main.tip_speed * k.main.tip_speed + 4.6 * speed_sq)
    power += thrust * v_i
    power += abs(drag[0] * u_f) + abs(drag[1] * v_f) + abs(drag[2] * (w_f - v_i))
    if k.climb_power > 0.0 or (k.climb_power == 0.0 and w_a < 0.0):
        power -= k.body.mass * k.body.gravity * w_a
    return power


@njit
def aerodynamic_loads(x, at_main, at_tail, at_body, output, flow, k):
    """Force (N) and moment (N m) of air and shaft on the aircraft, body axes, as two 3-tuples.

    at_main, at_tail, at_body: air speeds (3 floats) of main rotor, tail and fuselage, m/s.
    `output` is that of the yaw-rate gyro, rad, `flow` that of `rotor_flow`. Behind them: the main
    rotor's acceleration, rad/s2, and the engine's power, W.
    """
    u_t, v_t, w_t = at_tail
    u_f, v_f, w_f = at_body
    p, q, r = rates_of(x)
    a_s, b_s = x[PLANT.a_s], x[PLANT.b_s]
    thrust, v_i, w_r, _ = flow
    drag = fuselage_force(u_f, v_f, w_f, v_i, k.fuselage)
    sin_a, sin_b = math.sin(a_s), math.sin(b_s)
    hub = k.main.hub_stiffness + thrust * k.main.hub_height
    pitch, arm, height = tail_pitch(output, k.gyro), k.tail_arm, k.tail_height
    tail, w_tail = tail_rotor(u_t, v_t, w_t, p, q, r, pitch, arm, height, k.tail, k.tail_stall)
    if k.terms.rotor_speed:
        powers = shaft_powers(thrust, v_i - w_r, at_main, tail, w_tail, at_tail, k)
    else:
        powers = main_rotor_power(at_main, at_body, v_i, thrust, drag, k), 0.0
    torque, drive = shaft(x, powers, k)
    side = fin_force(v_t - r * k.vertical_fin.arm, u_t, k.vertical_fin)
    lift = fin_force(w_t + q * k.horizontal_fin.arm - v_i, u_t, k.horizontal_fin)
    force_x = -thrust * sin_a + drag[0]
    force_y = thrust * sin_b + drag[1] - tail + side
    force_z = -thrust * math.cos(a_s) * math.cos(b_s) + drag[2] + lift
    moment_x = hub * sin_b - tail * k.tail_height + side * k.vertical_fin.height
    moment_y = hub * sin_a + lift * k.horizontal_fin.arm
    moment_z = -torque + tail * k.tail_arm - side * k.vertical_fin.arm
    return (force_x, force_y, force_z), (moment_x, moment_y, moment_z), drive


@njit
def derivative_kernel(x, u, air, k, out):
    """State derivative: fills out (42,) for state x (42,), command u (4,), air (12,), a row AIR.

    Pure: the inflow is solved from scratch, nothing is kept between calls. k is a HelicopterParams.
    """
    if is_off_nominal(k):
        k = referred(off_nominal(x, k))
    at_main, at_tail, at_body = airspeeds(x, air)
    d_int_rate, output = gyro(x[PLANT.servo_ped], x[PLANT.r], x[PLANT.d_int], k.gyro)
    flow = rotor_flow(x, at_main, k)
    force, moment, drive = aerodynamic_loads(x, at_main, at_tail, at_body, output, flow, k)
    push, twist = ground_loads(x, k.ground)
    rigid_body_rates(
        x,
        (force[0] + push[0], force[1] + push[1], force[2] + push[2]),
        (moment[0] + twist[0], moment[1] + twist[1], moment[2] + twist[2]),
        k.body,
        out,
    )
    p, q, _ = rates_of(x)
    a_s, b_s, d_lat, d_lon = x[PLANT.a_s], x[PLANT.b_s], x[PLANT.servo_lat], x[PLANT.servo_lon]
    out[PLANT.a_s], out[PLANT.b_s] = flapping_rates(
        a_s, b_s, p, q, at_main[0], at_main[1], d_lat, d_lon, k.flapping
    )
    tilt_a, tilt_b = disc_tilt_of_gust(air[AIR.p], air[AIR.q], k.main.speed)
    out[PLANT.a_s] += k.flapping.rate * tilt_a
    out[PLANT.b_s] += k.flapping.rate * tilt_b
    out[PLANT.d_int] = d_int_rate
    servo_derivatives(x, u, k.servo, out)
    for i in range(PLANT.servo_rate.stop, PLANT.size):  # states of terms that are off stay
        out[i] = 0.0
    rotor_term_rates(x, at_main, flow, k, out)
    drive_rates(x, drive, k, out)
    stick_rates(x, k.ground, out)


@njit
def specific_force(x, air, k, out):
    """Specific force at the c.g., body, m/s2 (what ideal accelerometers read): fills out (3,)."""
    if is_off_nominal(k):
        k = referred(off_nominal(x, k))
    at_main, at_tail, at_body = airspeeds(x, air)
    _, output = gyro(x[PLANT.servo_ped], x[PLANT.r], x[PLANT.d_int], k.gyro)
    flow = rotor_flow(x, at_main, k)
    force, _, _ = aerodynamic_loads(x, at_main, at_tail, at_body, output, flow, k)
    push, _ = ground_loads(x, k.ground)
    for i in range(3):
        out[i] = (force[i] + push[i]) / k.body.mass


@njit
def angular_acceleration(x, air, k, out):
    """Derivatives of the body rates, rad/s2, of the same loads as `specific_force`: fills out (3,).

    No command bears on them: it moves the servos first. k is a HelicopterParams.
    """
    slopes, u = scratch(_N_STATE), scratch(_N_COMMAND)
    fill(u, 0.0)
    derivative_kernel(x, u, air, k, slopes)
    copy(out, slopes[PLANT.rate])


def same_air(wind_ned_mps: ArrayLike) -> NDArray[np.float64]:
    """The row AIR (12,) of air that moves everywhere with wind_ned_mps (3,) and does not turn."""
    air = np.zeros(AIR.size)
    air[AIR.velocity] = np.tile(np.asarray(wind_ned_mps, dtype=np.float64), 3)
    return air


def state_derivative(
    x: ArrayLike, u: ArrayLike, wind_ned_mps: ArrayLike, params: HelicopterParameters
) -> NDArray[np.float64]:
    """Derivative of the plant state.

    Parameters
    ----------
    x : (42,) array
        State, places of `heli_core.rows.PLANT`.
    u : (4,) array
        Servo commands d_lat, d_lon, d_ped, d_col in (-1, 1).
    wind_ned_mps : (3,) or (12,) array
        Velocity of the air, NED, m/s, the same everywhere; or a row `heli_core.rows.AIR`.
    params : HelicopterParameters

    Returns
    -------
    (42,) array

    Raises
    ------
    ValueError
        If an array has the wrong length.
    """
    air = same_air(wind_ned_mps) if np.shape(wind_ned_mps) == (3,) else wind_ned_mps
    arrays = []
    for name, value, size in (
        ("x", x, PLANT.size),
        ("u", u, ACTUATOR.size),
        ("wind_ned_mps", air, AIR.size),
    ):
        array = np.ascontiguousarray(value, dtype=np.float64)
        if array.shape != (size,):
            three = "(3,) or " if name == "wind_ned_mps" else ""
            raise ValueError(f"{name} has shape {array.shape}, expected {three}({size},)")
        arrays.append(array)
    out = np.empty(PLANT.size)
    derivative_kernel(*arrays, params.params, out)
    return out


# -------------------------------------------------------------------------------------------------
# Integration: classical Runge-Kutta of order 4 with fixed steps.
# -------------------------------------------------------------------------------------------------

_STAGES = 4
WORK_ROWS = _STAGES + 1


@njit
def rk4_step(x, u, air, k, dt_s, work):
    """Advance x (42,) by dt_s with command u (4,) and air (12,) held; in place.

    After the step the quaternion is scaled to unit norm, servos are kept inside their stops and the
    skids' bristles inside Coulomb's cone.
    work is scratch, (5, 42).
    """
    n = x.shape[0]
    stage = work[_STAGES]
    for i in range(n):
        stage[i] = x[i]
    for j in range(_STAGES):  # a loop, so that the derivative is compiled into it once
        rate = work[j]
        derivative_kernel(stage, u, air, k, rate)
        ahead_s = 0.5 * dt_s if j < _STAGES - 2 else dt_s
        for i in range(n):
            stage[i] = x[i] + ahead_s * rate[i]
    for i in range(n):
        middle = work[1, i] + work[2, i]
        x[i] += dt_s / 6.0 * (work[0, i] + 2.0 * middle + work[_STAGES - 1, i])
    qw, qx, qy, qz = attitude_of(x)
    norm = (qw * qw + qx * qx + qy * qy + qz * qz) ** 0.5
    for i in range(PLANT.quat.start, PLANT.quat.stop):
        x[i] /= norm
    apply_stops(x, k.servo)
    apply_slip(x, k.ground)
