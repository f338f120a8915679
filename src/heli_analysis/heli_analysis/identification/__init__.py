# SPDX-License-Identifier: Apache-2.0
"""Identification of eq. (10) from flight data; pure mathematics, no ROS, no simulator."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["IdentificationCause", "IdentificationError"],
        "actuators": [
            "IdentifiedAB",
            "IdentifiedCollective",
            "IdentifiedE",
            "IdentifiedTrim",
            "RotorGeometry",
            "fit_actuators",
            "fit_collective",
            "fit_gusts",
            "fit_record",
            "identified_system",
            "refit_actuators",
            "relative_air_w",
            "trim_of",
        ],
        "aperiodic": ["AperiodicRecord", "JointResponse", "joint_response"],
        "model": ["MeasuredResponse", "measured_response"],
        "spectra": ["CHANNELS", "Experiment", "Spectra", "spectra_of"],
    },
)
