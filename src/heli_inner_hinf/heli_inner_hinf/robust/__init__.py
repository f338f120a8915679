# SPDX-License-Identifier: Apache-2.0
"""Proofs about linear loops and their uncertainty; pure mathematics, no ROS, no aircraft."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["RobustCause", "RobustError"],
        "heli_inner_hinf.mu": ["discrete_norm"],
        "certificate": [
            "Block",
            "RobustCertificate",
            "CommonBound",
            "Structure",
            "UncertainSystem",
            "certify",
            "common_bound",
            "contraction_of",
            "real",
        ],
        "mu_synthesis": ["MuLaw", "dk_iteration"],
        "parts": ["ProvedPart", "prove_in_parts"],
        "sampled_norm": ["HeldPlant", "SampledLaw", "sampled_norm"],
        "uncertain": ["Range", "Uncertain", "balancing", "truncated"],
        "worst_case": [
            "UncertainFamily",
            "GainFamily",
            "InstabilityOnset",
            "WorstGain",
            "worst_gain",
        ],
    },
)
