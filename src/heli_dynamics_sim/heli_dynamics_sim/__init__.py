# SPDX-License-Identifier: Apache-2.0
"""The nonlinear helicopter: dynamics, wind, sensors, trim and linearisation."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "aircraft": ["AircraftError", "HelicopterParameters", "find_aircraft"],
        "config": ["PlantConfig", "PlantConfigError"],
        "helicopter": ["state_derivative"],
        "noise": ["NoiseStreams"],
        "plant": ["PlantStatus"],
        "trim": ["LinearModel", "ReducedModel", "TrimPoint", "TrimError"],
    },
    modules=["airframe", "plant", "sensors", "trim", "wind"],
)
