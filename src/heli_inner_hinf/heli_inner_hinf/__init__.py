# SPDX-License-Identifier: Apache-2.0
"""Attitude laws: H-infinity synthesis with its certificate, LQR, PID, and the proof of loops."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "synthesis": ["Certificate", "Synthesis", "synthesize"],
        "gamma_star": ["GammaStar"],
        "errors": [
            "CertificateError",
            "FeedforwardError",
            "InfeasibleGammaError",
            "InvariantZeroError",
            "MarginError",
            "NotStabilizableError",
            "ShapeError",
            "SynthesisError",
            "UnstableLoopError",
        ],
        "design": ["AttitudeConfig", "LiveDesign", "UnknownControllerError"],
        "law_state": ["CONTROLLERS", "AttitudeStatus"],
        "pid_tuning": ["tune_pid"],
        "observer_gain": ["choose_observer_gain"],
        "margins": ["DiskMargin", "disk_margin"],
        "system_norm": ["hinf_norm"],
    },
    modules=[
        "analysis",
        "as_flown",
        "attitude_law",
        "attitude_search",
        "gamma_star",
        "loops",
        "lqr",
        "margins",
        "output_law",
        "weights",
    ],
)
