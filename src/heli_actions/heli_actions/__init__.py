# SPDX-License-Identifier: Apache-2.0
"""Serves the actions takeoff, goto, follow and land of a flying graph, with feedback and cancel."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "desk": ["Desk", "Feedback", "Hands", "Order"],
        "table": ["Code", "Kind", "Outcome"],
        "messages": ["Interfaces"],
    },
)
