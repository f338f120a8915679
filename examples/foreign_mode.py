# SPDX-License-Identifier: Apache-2.0
"""A mode of your own: circle the place where it begins, by velocities, then land.

foreign_mode.py RADIUS SPEED, in m and m/s (--scenario by_hand --realtime). It requires little wind,
height and a place well inside the fence, and ends in a hover where that fails.
"""

import math
import sys

from heli_actions import ForeignMode, GoalError, Pilot, Velocity

LEAST_HEIGHT_M = 3.0
MOST_DISTANCE_M = 60.0
BACK_PER_S = 0.5  # of the distance from the circle that is flown back in a second


class Circle(ForeignMode):
    """One lap to the left, seen from above; the nose stays as it is."""

    name = "circle"

    def __init__(self, radius_m, speed_mps):
        self.radius_m, self.speed_mps = radius_m, speed_mps
        self.centre = None  # east and north of it, m
        self.angle_rad, self.turned_rad = 0.0, 0.0

    def refuses(self, now):
        """Requirements of its own, checked before and while it flies."""
        east, north, up = now.pos_enu_m
        if up < LEAST_HEIGHT_M:
            return f"it is {up:.1f} m high; allowed: from {LEAST_HEIGHT_M:g} m on"
        if math.hypot(east, north) > MOST_DISTANCE_M:
            return f"it is farther than {MOST_DISTANCE_M:g} m from the origin"
        return ""

    def update(self, now):
        """The velocity of now; None when the lap is done."""
        east, north, _ = now.pos_enu_m
        if self.centre is None:
            self.centre = east - self.radius_m, north
        x, y = east - self.centre[0], north - self.centre[1]
        angle = math.atan2(y, x)
        self.turned_rad += math.remainder(angle - self.angle_rad, 2.0 * math.pi)
        self.angle_rad = angle
        if self.turned_rad > 2.0 * math.pi:
            return None
        back_mps = BACK_PER_S * (self.radius_m - math.hypot(x, y))
        return Velocity(
            back_mps * math.cos(angle) - self.speed_mps * math.sin(angle),
            back_mps * math.sin(angle) + self.speed_mps * math.cos(angle),
        )


with Pilot() as pilot:
    try:
        print(pilot.takeoff(6.0), flush=True)
        print(pilot.fly(Circle(*map(float, sys.argv[1:]))), flush=True)
    except GoalError as error:
        print(f"{error.cause}: {error}", flush=True)
    print(pilot.land(), flush=True)
