# SPDX-License-Identifier: Apache-2.0
"""Paths that an aircraft can follow: legs within limits, curves, turns. Mathematics, no ROS."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["PathCause", "PathError"],
        "paths": [
            "Circle",
            "Cruise",
            "Curve",
            "FlightPath",
            "DiversionGoal",
            "Lemniscate",
            "Slalom",
            "divert",
            "turned",
        ],
        "transfer": ["Motion", "MotionLimits", "Transfer"],
    },
)
