# SPDX-License-Identifier: Apache-2.0
"""Servos: second order, with limited rate and end stops.

The derivative is that of a linear servo whose speed is cut at the rate limit; `apply_stops`, called
after every integration step, holds position and rate inside their limits.

What real servos add is off unless the aircraft's terms ask for it (`Imperfections`):

- resolution: the command is rounded to the steps of the pulse's length;
- dead band: the motor rests while the error is inside the band;
- load: a DC motor's speed falls linearly with its torque (Hughes and Drury, Electric Motors and
  Drives, ch. 3), here the propeller moment of the blades, `b I_f Omega^2 theta` towards flat pitch
  (Johnson, Helicopter Theory, 1980, ch. 9), at the governed speed. It loads the collective: the
  moments of a cyclic pitch cancel its inertia at 1/rev;
- swash: three servos at 120 deg carry the swash plate, and the first, behind or before the mast,
  may be slower than the others, so that every motion leaks into the others. The state keeps the
  channels lat, lon, col; the servos' positions are their mix.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_math.jit import njit
from heli_math.rows import ACTUATOR, PLANT

_SIN_120 = math.sqrt(0.75)


class Imperfections(NamedTuple):
    """What real servos add; a number of 0 and False leave it out."""

    present: bool  # whether there is any of them
    resolution: float  # step of the command
    half_band: float  # half of the dead band
    load_slope: float  # share of the stall torque against a collective servo, per unit of d_col
    load_offset: float  # the same at d_col = 0
    swash: bool  # three swash servos instead of one per channel
    slow: float  # speed of the first of them over that of the others


class ServoKernel(NamedTuple):
    """One kind of servo for all four channels."""

    omega_sq: float  # square of the natural frequency, 1/s2
    two_zeta_omega: float  # 1/s
    rate_limit: float  # 1/s
    travel: float  # end stops at +- this
    real: Imperfections


@njit
def to_motors(lat, lon, col, swash):
    """Positions of the motors behind three channels: the three swash servos, or one each."""
    if not swash:
        return lat, lon, col
    side = _SIN_120 * lat
    return col + lon, col - 0.5 * lon + side, col - 0.5 * lon - side


@njit
def to_channels(first, second, third, swash):
    """Channels (lat, lon, col) of three motors: the inverse of `to_motors`."""
    if not swash:
        return first, second, third
    lat = (second - third) / (2.0 * _SIN_120)
    return lat, (2.0 * first - second - third) / 3.0, (first + second + third) / 3.0


@njit
def loads(col, real):
    """Torque against a positive speed of the three motors, over their stall torque, in [-1, 1]."""
    load = min(max(real.load_offset + real.load_slope * col, -1.0), 1.0)
    if real.swash:
        return load / 3.0, load / 3.0, load / 3.0
    return 0.0, 0.0, load


@njit
def servo_rates(position, rate, command, k):
    """(d position/dt, d rate/dt) of a servo that follows a command, in 1/s and 1/s2."""
    target = min(max(command, -k.travel), k.travel)
    speed = min(max(rate, -k.rate_limit), k.rate_limit)
    return speed, k.omega_sq * (target - position) - k.two_zeta_omega * rate


@njit
def limited(rate, load, pace, k):
    """A rate (1/s) inside the limits that the load leaves, see `real_servo_rates`."""
    limit = pace * k.rate_limit
    return min(max(rate, -limit * (1.0 + load)), limit * (1.0 - load))


@njit
def real_servo_rates(position, rate, target, load, pace, k):
    """The same of a servo with imperfections.

    Parameters
    ----------
    position, rate, target : float
        The target is inside the travel.
    load : float
        Torque against a positive speed, over the stall torque, in [-1, 1].
    pace : float
        Speed of this servo over that of its kind.
    k : ServoKernel
    """
    real = k.real
    if real.resolution > 0.0:
        target = np.rint(target / real.resolution) * real.resolution
    error = target - position
    error = math.copysign(max(abs(error) - real.half_band, 0.0), error)
    return limited(
        rate, load, pace, k
    ), pace * pace * k.omega_sq * error - pace * k.two_zeta_omega * rate


@njit
def _real_derivatives(x, u, k, out):
    """Fill the servos' places of a plant derivative, with all imperfections."""
    at, rate = x[PLANT.servo], x[PLANT.servo_rate]
    speed, push = out[PLANT.servo], out[PLANT.servo_rate]
    swash, travel = k.real.swash, k.travel
    lat, lon = ACTUATOR.lat, ACTUATOR.lon
    ped, col = ACTUATOR.ped, ACTUATOR.col
    t_lat, t_lon = min(max(u[lat], -travel), travel), min(max(u[lon], -travel), travel)
    t_ped, t_col = min(max(u[ped], -travel), travel), min(max(u[col], -travel), travel)
    speed[ped], push[ped] = real_servo_rates(at[ped], rate[ped], t_ped, 0.0, 1.0, k)
    load0, load1, load2 = loads(at[col], k.real)
    at0, at1, at2 = to_motors(at[lat], at[lon], at[col], swash)
    rate0, rate1, rate2 = to_motors(rate[lat], rate[lon], rate[col], swash)
    t0, t1, t2 = to_motors(t_lat, t_lon, t_col, swash)
    speed0, push0 = real_servo_rates(at0, rate0, t0, load0, k.real.slow, k)
    speed1, push1 = real_servo_rates(at1, rate1, t1, load1, 1.0, k)
    speed2, push2 = real_servo_rates(at2, rate2, t2, load2, 1.0, k)
    speed[lat], speed[lon], speed[col] = to_channels(speed0, speed1, speed2, swash)
    push[lat], push[lon], push[col] = to_channels(push0, push1, push2, swash)


@njit
def servo_derivatives(x, u, k, out):
    """Fill the servos' places of a plant derivative for state x and command u (4,)."""
    if k.real.present:
        _real_derivatives(x, u, k, out)
        return
    for i in range(ACTUATOR.size):
        at, rate = PLANT.servo.start + i, PLANT.servo_rate.start + i
        out[at], out[rate] = servo_rates(x[at], x[rate], u[i], k)


@njit
def _limit_real_rates(x, k):
    """Hold the motors' rates of a plant state inside their limits, in place."""
    rate, swash = x[PLANT.servo_rate], k.real.swash
    lat, lon, col = ACTUATOR.lat, ACTUATOR.lon, ACTUATOR.col
    rate[ACTUATOR.ped] = limited(rate[ACTUATOR.ped], 0.0, 1.0, k)
    load0, load1, load2 = loads(x[PLANT.servo_col], k.real)
    rate0, rate1, rate2 = to_motors(rate[lat], rate[lon], rate[col], swash)
    rate[lat], rate[lon], rate[col] = to_channels(
        limited(rate0, load0, k.real.slow, k),
        limited(rate1, load1, 1.0, k),
        limited(rate2, load2, 1.0, k),
        swash,
    )


@njit
def apply_stops(x, k):
    """Hold the servos' positions and rates of a plant state inside their limits, in place."""
    if k.real.present:
        _limit_real_rates(x, k)
    for i in range(ACTUATOR.size):
        at, rate = PLANT.servo.start + i, PLANT.servo_rate.start + i
        if not k.real.present:
            x[rate] = min(max(x[rate], -k.rate_limit), k.rate_limit)
        if x[at] >= k.travel:
            x[at] = k.travel
            x[rate] = min(x[rate], 0.0)
        elif x[at] <= -k.travel:
            x[at] = -k.travel
            x[rate] = max(x[rate], 0.0)
