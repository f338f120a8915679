# SPDX-License-Identifier: Apache-2.0
"""The nonlinear helicopter: dynamics, wind, sensors, trim and linearisation."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "parameters": ["HelicopterParameters"],
        "aircraft_file": ["AircraftError", "find_aircraft"],
        "helicopter": ["state_derivative"],
        "config": ["PlantConfig", "PlantConfigError"],
        "plant": ["PlantStatus"],
        "noise": ["NoiseStreams"],
        "linearize": ["LinearModel", "ReducedModel"],
        "trim": ["Trim", "TrimError"],
    },
    modules=["linearize", "plant", "sensors", "state", "trim", "wind"],
)
