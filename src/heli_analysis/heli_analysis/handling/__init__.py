# SPDX-License-Identifier: Apache-2.0
"""Handling qualities from recorded flights; pure mathematics, no ROS, no aircraft."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["HandlingCause", "HandlingError"],
        "definitions": ["FULL_SCALE", "MANOEUVRES", "Scale", "froude", "manoeuvre"],
        "manoeuvres": ["MotionTrack", "track_of"],
        "scoring": [
            "AXES",
            "AttitudeChange",
            "FrequencyResponse",
            "HandlingLevel",
            "Measure",
            "ManoeuvreScore",
            "bandwidth",
            "changes",
            "frequency_response",
            "of_bandwidth",
            "of_rejection",
            "rejection",
            "score",
        ],
    },
)
