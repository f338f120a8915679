# SPDX-License-Identifier: Apache-2.0
"""Shows a flying graph in a browser and in Foxglove; sends commands behind a token."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "live_state": ["LiveState"],
        "page_server": ["PageServer"],
        "foxglove_server": ["FoxgloveServer"],
        "access": ["Access"],
        "recording": ["Recording"],
        "replay": ["Replay"],
        "viewer": ["Viewer"],
    },
    modules=["plan", "scene"],
)
