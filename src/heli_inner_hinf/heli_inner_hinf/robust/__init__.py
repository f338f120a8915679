# SPDX-License-Identifier: Apache-2.0
"""Proofs about linear loops and their uncertainty; pure mathematics, no ROS, no aircraft."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "blocks": ["Block", "real"],
        "certificate": ["Certificate", "System", "certify"],
        "errors": ["Cause", "RobustError"],
        "lifting": ["HeldPlant", "SampledLaw", "sampled_norm"],
        "norms": ["discrete_norm"],
        "reduction": ["balancing", "truncated"],
        "scalings": ["Structure"],
        "shared_bound": ["CommonBound", "common_bound", "contraction_of"],
        "synthesis": ["MuLaw", "dk_iteration"],
        "uncertain": ["Range", "Uncertain"],
        "worst_case": ["Family", "Onset"],
        "worst_gain": ["GainFamily", "WorstGain", "worst_gain"],
    },
)
