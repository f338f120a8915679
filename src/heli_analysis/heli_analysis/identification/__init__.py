# SPDX-License-Identifier: Apache-2.0
"""Identification of eq. (10) from flight data; pure mathematics, no ROS, no simulator."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "actuators": ["IdentifiedAB", "fit_actuators", "refit_actuators"],
        "collective": [
            "IdentifiedCollective",
            "RotorGeometry",
            "fit_collective",
            "relative_air_w",
        ],
        "errors": ["Cause", "IdentificationError"],
        "experiment": ["CHANNELS", "Experiment"],
        "gusts": ["IdentifiedE", "fit_gusts"],
        "measured": ["MeasuredResponse", "measured_response"],
        "spectra": ["Spectra", "spectra_of"],
        "system": ["identified_system"],
        "trim": ["IdentifiedTrim", "trim_of"],
    },
)
