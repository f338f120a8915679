# SPDX-License-Identifier: Apache-2.0
"""Send the aircraft that flies to a point: goto.py EAST NORTH UP, in m, nose to the north."""

import sys

from heli_actions import Pilot

with Pilot() as pilot:
    print(pilot.goto(*map(float, sys.argv[1:]), heading_deg=0.0))
