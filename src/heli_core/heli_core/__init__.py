# SPDX-License-Identifier: Apache-2.0
"""What every package shares: kernels, rows, ticks, rotations, linear systems, parameters."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "command_line": ["MissingFileError", "config_folder", "executable", "share_folder"],
        "errors": ["ParameterCause", "ParameterError"],
        "jit": ["njit"],
        "linear": ["hover_system"],
        "parameters": ["Parameter", "why_refused", "load", "with_common"],
        "rcl_yaml": ["dump_all"],
        "signals": ["Multisine", "design_multisine"],
        "trajectory": ["Trajectory", "TrajectoryError"],
    },
    modules=[
        "central_controller",
        "command_line",
        "jit",
        "linear",
        "metrics",
        "rcl_yaml",
        "rotations",
        "rows",
        "search",
        "ticks",
        "trajectory",
    ],
)
