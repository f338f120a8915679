# SPDX-License-Identifier: Apache-2.0
"""Mathematics that every package of the stack shares: kernels, named rows, ticks, rotations."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "jit": ["njit"],
        "multisine": ["Multisine", "design_multisine"],
        "state_space": ["hover_system"],
        "trajectory": ["Trajectory", "TrajectoryError"],
    },
    modules=[
        "arrays",
        "atmosphere",
        "central_controller",
        "climb",
        "grid_search",
        "linear_systems",
        "paper_metrics",
        "rotations",
        "rows",
        "state_names",
        "ticks",
        "trajectory",
    ],
)
