# SPDX-License-Identifier: Apache-2.0
"""Laws: which attitude law, position law and observer a scenario is flown with.

A file of laws is an rcl parameter file that says only what differs from the packaged parameters of
the three nodes that control the aircraft. It knows nothing of the aircraft, the air or the sensors:
those are the world's.
"""

from heli_flight.loop.named_files import NamedFiles

LAWS = NamedFiles("laws", "laws")
PACKAGED = "packaged"
"""The laws that fly unless others are named: nothing is changed."""
SECTIONS = ("observer", "inner_loop", "outer_loop")
"""What a file of laws may tell."""
