# SPDX-License-Identifier: Apache-2.0
"""Studies over many flights: campaigns, rare events, comparisons, design searches, proofs."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "campaign.run": ["fly_seeds"],
        "design.make": ["FinishedDesign", "make_design"],
    },
)
