# SPDX-License-Identifier: Apache-2.0
"""Attitude laws: H-infinity synthesis with its certificate, LQR, PID, and the proof of loops."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "synthesis": ["Certificate", "Synthesis", "synthesize"],
        "gamma_star": ["GammaStar"],
        "errors": ["InfeasibleGammaError", "SynthesisError"],
        "design": ["AttitudeConfig"],
        "margins": ["DiskMargin", "disk_margin"],
        "system_norm": ["hinf_norm"],
    },
    modules=["analysis", "gamma_star", "lqr", "weights"],
)
