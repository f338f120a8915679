# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers: H-infinity synthesis with its certificate, LQR, PID, proof of loops."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": [
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
        "controller_state": ["AttitudeStatus", "CONTROLLERS"],
        "design": ["AttitudeConfig", "LiveDesign", "UnknownControllerError"],
        "loops": ["DiskMargin", "disk_margin"],
        "synthesis": ["Certificate", "GammaStar", "Synthesis", "hinf_norm", "synthesize"],
        "tuning": ["choose_observer_gain", "tune_pid"],
    },
    modules=["controller_state", "controllers", "loops", "robust", "synthesis", "tuning"],
)
