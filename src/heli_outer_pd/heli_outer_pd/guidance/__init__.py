# SPDX-License-Identifier: Apache-2.0
"""Paths that an aircraft can follow: legs within limits, curves, turns. Mathematics, no ROS."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "curves": ["Circle", "Curve", "Lemniscate", "Slalom"],
        "diversion": ["Cruise", "divert", "Goal"],
        "errors": ["Cause", "PathError"],
        "flight_path": ["FlightPath"],
        "limits": ["MotionLimits"],
        "transfer": ["Motion", "Transfer"],
        "turning": ["turned"],
    },
)
