# SPDX-License-Identifier: Apache-2.0
"""Modes of a flight from the ground to the ground: a table, what it allows, why not. No ROS."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "machine": ["Refusal", "allowed", "command_named", "decide"],
        "table": ["TABLE", "Command", "Fact", "Guard", "Phase", "Transition", "Refused"],
    },
)
