# SPDX-License-Identifier: Apache-2.0
"""Identification of eq. (10) from flight data; pure mathematics, no ROS, no simulator."""

from heli_observer.identification.actuators import IdentifiedAB, fit_actuators
from heli_observer.identification.errors import Cause, IdentificationError
from heli_observer.identification.experiment import Experiment
from heli_observer.identification.gusts import IdentifiedE, fit_gusts
from heli_observer.identification.trim import IdentifiedTrim, trim_of

__all__ = [
    "Cause",
    "Experiment",
    "IdentificationError",
    "IdentifiedAB",
    "IdentifiedE",
    "IdentifiedTrim",
    "fit_actuators",
    "fit_gusts",
    "trim_of",
]
