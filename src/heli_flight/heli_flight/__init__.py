# SPDX-License-Identifier: Apache-2.0
"""Composes the other packages: loop, graph, report, studies and commands."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {},
    modules=["cli", "graph", "loop", "report", "studies"],
)
