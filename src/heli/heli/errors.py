# SPDX-License-Identifier: Apache-2.0
"""Named causes, each with one sentence, under one roof."""

from heli_bags.folder import BagError
from heli_dynamics_sim.aircraft_file import AircraftError
from heli_dynamics_sim.trim import TrimError
from heli_flight.errors import FlightError
from heli_identification.errors import IdentificationError
from heli_inner_hinf.errors import SynthesisError
from heli_parameters.parameters import ParameterError
from heli_parameters.python_law import LawError

__all__ = [
    "AircraftError",
    "BagError",
    "FlightError",
    "IdentificationError",
    "LawError",
    "ParameterError",
    "SynthesisError",
    "TrimError",
]
