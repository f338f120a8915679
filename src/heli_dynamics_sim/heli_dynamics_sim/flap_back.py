# SPDX-License-Identifier: Apache-2.0
"""Flap-back: what the air's speed across the disc does to its tilt.

The advancing blade meets faster air than the retreating one; the disc tilts until their lifts
agree. For a blade without twist, uniform inflow and small speed ratio mu (Bramwell, Done, Balmford,
Bramwell's Helicopter Dynamics, 2nd ed., 2001, ch. 3; Padfield, Helicopter Flight Dynamics, 2nd ed.,
2007, ch. 3):

    a_1 = 2 mu (4/3 theta_0 - lambda) / (1 - mu^2 / 2),   b_1 = 4/3 mu a_0 / (1 + mu^2 / 2),

lambda the flow down through the disc over the tip speed, a_0 = gamma/8 (theta_0 - 4/3 lambda) /
lambda_beta^2 the coning. a_1 tilts away from the oncoming air, b_1 towards the advancing blade.

A stabiliser bar has the same speed across it but no collective pitch, so it tilts the other way, by
`2 v (w_i - w) / (Omega^2 (r_1^2 + r_2^2))` for paddles from r_1 to r_2 (the flapping balance of a
paddle with theta_0 = 0), and hands `gain` of it to the blades as cyclic pitch: what is left in
steady flow is a fraction. The inflow at the paddles is that of blade-element momentum theory at
their radius (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., 2006, eq. (3.61)), less than
the mean.

The blades follow a gust within 16/(gamma Omega), the bar only within its own, ten times longer,
time: two states keep the blades' part, see `flap_back_rates`.
"""

import math
from typing import NamedTuple

from heli_math.jit import njit
from heli_math.rows import PLANT


class FlapBackKernel(NamedTuple):
    """Numbers of blades and bar."""

    blade_rate: float  # gamma Omega / 16, 1/s
    coning: float  # gamma / (8 lambda_beta^2), rad per rad
    bar_gain: float  # blade pitch per tilt of the bar; 0 without one
    bar_radius_sq: float  # r_1^2 + r_2^2, m2
    bar_inflow: float  # inflow at the paddles over the mean one


def paddle_inflow(thrust_coefficient: float, lift_solidity: float, radius_ratio: float) -> float:
    """Inflow at radius_ratio (r/R) over the mean one, in hover, by blade-element momentum theory.

    lift_solidity is lift slope (1/rad) times solidity.
    """
    mean = math.sqrt(0.5 * thrust_coefficient)
    pitch = 6.0 * thrust_coefficient / lift_solidity + 1.5 * mean
    root = math.sqrt(1.0 + 32.0 * pitch * radius_ratio / lift_solidity)
    return lift_solidity / 16.0 * (root - 1.0) / mean


@njit
def blade_tilts(u_a, v_a, pitch, down, tip_speed, coning):
    """(a, b), rad: steady tilt of the blades alone in the air speed u_a, v_a (m/s).

    The rotor turns clockwise, seen from above. pitch (rad) is theta_0, down (m/s) the flow down
    through the disc.
    """
    flow = down / tip_speed
    mu_sq = (u_a * u_a + v_a * v_a) / (tip_speed * tip_speed)
    back = 2.0 * (4.0 / 3.0 * pitch - flow) / (1.0 - 0.5 * min(mu_sq, 1.0)) / tip_speed
    cone = coning * (pitch - 4.0 / 3.0 * flow)
    aside = 4.0 / 3.0 * cone / (1.0 + 0.5 * mu_sq) / tip_speed
    return back * u_a - aside * v_a, -back * v_a - aside * u_a


@njit
def bar_per_mps(v_i, w_r, speed, k):
    """Pitch that the bar takes off the blades per air speed across it, rad per m/s."""
    return k.bar_gain * 2.0 * (k.bar_inflow * v_i - w_r) / (speed * speed * k.bar_radius_sq)


@njit
def flap_back_rates(x, u_a, v_a, v_i, w_r, pitch, main, rate, k, out):
    """Add the flap-back to the disc's rates in `out`, and fill those of the blades' part.

    The disc is the sum of the blades' own tilt d, `d' = (steady - d) blade_rate`, and of what
    follows with the time 1/rate of blades and bar together: `a' += d' + rate (d - bar)`. Without a
    bar (rate = blade_rate) that is one lag.
    """
    steady_a, steady_b = blade_tilts(u_a, v_a, pitch, v_i - w_r, main.tip_speed, k.coning)
    bar = bar_per_mps(v_i, w_r, main.speed, k)
    own_a, own_b = x[PLANT.blade_a], x[PLANT.blade_b]
    out[PLANT.blade_a] = (steady_a - own_a) * k.blade_rate
    out[PLANT.blade_b] = (steady_b - own_b) * k.blade_rate
    out[PLANT.a_s] += out[PLANT.blade_a] + rate * (own_a - bar * u_a)
    out[PLANT.b_s] += out[PLANT.blade_b] + rate * (own_b + bar * v_a)
