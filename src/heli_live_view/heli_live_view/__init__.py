# SPDX-License-Identifier: Apache-2.0
"""Shows a flying graph in a browser and in Foxglove; sends commands behind a token."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "replay": ["FlightRecording", "Replay", "Viewer"],
        "scene": ["FoxgloveServer"],
        "access": ["Access"],
        "server": ["PageServer"],
        "state": ["LiveState"],
    },
    modules=["commands", "scene"],
)
