# SPDX-License-Identifier: Apache-2.0
"""Critical bank of an aircraft that pivots about one skid: static and dynamic rollover.

Without lift the aircraft falls back until its mass centre stands over the skid: the static rollover
angle, atan(half width / height). Lift and what moves the disc to the side turn it about the skid
too, so that the angle at which no righting moment is left falls to nothing as the lift nears the
weight (FAA-H-8083-21B, Helicopter Flying Handbook, 2019, ch. 11, "Dynamic Rollover").
"""

import math

from heli_dynamics_sim.parameters import HelicopterParameters


def critical_bank(
    aircraft: HelicopterParameters, lift_n: float, moment_nm: float = 0.0, side_n: float = 0.0
) -> float:
    """Bank at which nothing rights an aircraft at rest on its right skid.

    The moment about the skid, `M + h Y - b (W cos phi - T) + h W sin phi`, is zero there; b is half
    the width of the gear, h the height of the mass centre.

    Parameters
    ----------
    aircraft : HelicopterParameters
    lift_n : float
        T: force of the air against body z, N.
    moment_nm, side_n : float
        M and Y: its moment about body x through the mass centre, N m, and its force along body y,
        N.

    Returns
    -------
    float
        rad; negative: it tips at rest on level ground. NaN if it stands at no bank.
    """
    width, height = aircraft.gear_half_width_m, aircraft.gear_height_m
    weight = aircraft.mass_kg * aircraft.gravity_mps2
    arm = math.hypot(width, height)
    share = (moment_nm + height * side_n + width * lift_n) / (weight * arm)
    return math.acos(share) - math.atan2(height, width) if abs(share) <= 1.0 else math.nan
