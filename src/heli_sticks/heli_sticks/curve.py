# SPDX-License-Identifier: Apache-2.0
"""From the deflection of a stick to what it asks for: dead zone, expo.

Both as in PX4 (`math::deadzone`, `math::expo` in src/lib/mathlib/math/Functions.hpp), whose users
know what the numbers do.
"""

import math


def without_dead_zone(x: float, dead_zone: float) -> float:
    """Deflection beyond the dead zone, stretched so that full deflection stays full.

    Parameters
    ----------
    x : float
        Deflection, -1 to 1.
    dead_zone : float
        Deflection below which it is none, 0 to less than 1.

    Returns
    -------
    float
        (x - sign(x) d) / (1 - d), 0 for ``|x| <= d``: continuous, no step at the edge.
    """
    if abs(x) <= dead_zone:
        return 0.0
    return (x - math.copysign(dead_zone, x)) / (1.0 - dead_zone)


def expo(x: float, e: float) -> float:
    """Softer about the centre: (1 - e) x + e x^3.

    Parameters
    ----------
    x : float
        Deflection, -1 to 1.
    e : float
        0 (a straight line) to 1 (x^3). The slope is 1 - e in the centre, 1 + 2 e at the stops.
    """
    return (1.0 - e) * x + e * x * x * x
