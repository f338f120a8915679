# SPDX-License-Identifier: Apache-2.0
"""The position loop: PD law for position and altitude, eq. (20)(21), and its reference."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "axis_analysis": ["AxisReport"],
        "config": ["outer_kernel"],
        "position_law": ["OuterKernel", "OuterStatus"],
        "thrust_map": ["RotorMap"],
    },
    modules=["axis_analysis", "gain_search", "position_law", "reference", "thrust_map"],
)
