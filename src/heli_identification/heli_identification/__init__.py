# SPDX-License-Identifier: Apache-2.0
"""Identification of eq. (10) from flight data; pure mathematics, no ROS, no simulator."""

from heli_identification.actuators import (
    IdentifiedAB,
    fit_actuators,
    refit_actuators,
)
from heli_identification.collective import (
    IdentifiedCollective,
    RotorGeometry,
    fit_collective,
    relative_air_w,
)
from heli_identification.errors import Cause, IdentificationError
from heli_identification.experiment import CHANNELS, Experiment
from heli_identification.gusts import IdentifiedE, fit_gusts
from heli_identification.measured import MeasuredResponse, measured_response
from heli_identification.trim import IdentifiedTrim, trim_of

__all__ = [
    "CHANNELS",
    "Cause",
    "Experiment",
    "IdentificationError",
    "IdentifiedAB",
    "IdentifiedCollective",
    "IdentifiedE",
    "IdentifiedTrim",
    "MeasuredResponse",
    "RotorGeometry",
    "fit_actuators",
    "fit_collective",
    "fit_gusts",
    "measured_response",
    "refit_actuators",
    "relative_air_w",
    "trim_of",
]
