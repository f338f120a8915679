# SPDX-License-Identifier: Apache-2.0
"""Handling qualities from recorded flights; pure mathematics, no ROS, no aircraft."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "boundaries": ["AXES", "Measure", "of_bandwidth", "of_rejection"],
        "definitions": ["FULL", "MANOEUVRES", "Scale", "froude", "manoeuvre"],
        "errors": ["Cause", "HandlingError"],
        "quickness": ["Change", "changes"],
        "response": ["FrequencyResponse", "bandwidth", "frequency_response", "rejection"],
        "scoring": ["Level", "Score", "score"],
        "tracks": ["Track", "track_of"],
    },
)
