# SPDX-License-Identifier: Apache-2.0
"""Take off, fly to a point, land: takeoff_goto_land.py EAST NORTH UP, in m (--scenario by_hand)."""

import sys

from heli_actions import Pilot

with Pilot() as pilot:
    print(pilot.takeoff(), flush=True)
    print(pilot.goto(*map(float, sys.argv[1:])), flush=True)
    print(pilot.land(), flush=True)
