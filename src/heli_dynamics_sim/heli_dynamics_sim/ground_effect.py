# SPDX-License-Identifier: Apache-2.0
"""Ground effect: the ground turns the wake aside, thrust costs less induced velocity.

Cheeseman and Bennett (The Effect of the Ground on a Helicopter Rotor in Forward Flight, ARC R&M
3021, 1955), at the same power:

    T / T_inf = 1 / (1 - (R / 4z)^2 / (1 + (V / v_i)^2)),

z the hub's height, V the speed in the disc plane. At the same thrust the induced power is
`(T_inf / T)^1.5` of that without ground (Leishman, Principles of Helicopter Aerodynamics, 2nd ed.,
2006, sec. 5.8), and this factor is what the induced velocity at the disc is multiplied by. Hayden
(The Effect of the Ground on Helicopter Hovering Power Required, AHS Forum 32, 1976) fits flight
tests: `1 / (0.9926 + 0.0379 (2R/z)^2)` of the power; his speed dependence is taken from the former.
Both hold for z >= R/2.
"""

import math
from typing import NamedTuple

from heli_math.jit import njit

MODELS = ("cheeseman_bennett", "hayden")


class GroundEffectKernel(NamedTuple):
    """Geometry and law."""

    radius: float  # R, m
    hub_height: float  # of the hub above the c.g., m
    hover_sq: float  # square of the induced velocity of hover, m2/s2
    hayden: bool  # else Cheeseman and Bennett


@njit
def induced_share(altitude_m, in_plane_sq, k):
    """Induced velocity over that without ground, in (0, 1], at an altitude of the c.g. (m)."""
    z = max(altitude_m + k.hub_height, 0.5 * k.radius)
    half = 0.5 * in_plane_sq
    # Glauert's induced velocity in level flight, from that of hover
    v_sq = math.sqrt(half * half + k.hover_sq * k.hover_sq) - half
    near = (k.radius / z) * (k.radius / z) / (1.0 + in_plane_sq / v_sq)
    if k.hayden:
        return min(1.0, 1.0 / (0.9926 + 0.0379 * 4.0 * near))
    return (1.0 - near / 16.0) ** 1.5
