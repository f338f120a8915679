# SPDX-License-Identifier: Apache-2.0
"""Servos: second order, with limited rate and end stops.

The derivative is that of a linear servo whose speed is cut at the rate limit; `apply_stops`, called
after every integration step, holds position and rate inside their limits.
"""

from typing import NamedTuple

from heli_math.jit import njit
from heli_math.rows import ACTUATOR, PLANT


class ServoKernel(NamedTuple):
    """One kind of servo for all four channels."""

    omega_sq: float  # square of the natural frequency, 1/s2
    two_zeta_omega: float  # 1/s
    rate_limit: float  # 1/s
    travel: float  # end stops at +- this


@njit
def servo_rates(position, rate, command, k):
    """(d position/dt, d rate/dt) of a servo that follows a command, in 1/s and 1/s2."""
    target = min(max(command, -k.travel), k.travel)
    speed = min(max(rate, -k.rate_limit), k.rate_limit)
    return speed, k.omega_sq * (target - position) - k.two_zeta_omega * rate


@njit
def apply_stops(x, k):
    """Hold the servos' positions and rates of a plant state inside their limits, in place."""
    for i in range(ACTUATOR.size):
        at, rate = PLANT.servo.start + i, PLANT.servo_rate.start + i
        x[rate] = min(max(x[rate], -k.rate_limit), k.rate_limit)
        if x[at] >= k.travel:
            x[at] = k.travel
            x[rate] = min(x[rate], 0.0)
        elif x[at] <= -k.travel:
            x[at] = -k.travel
            x[rate] = max(x[rate], 0.0)
