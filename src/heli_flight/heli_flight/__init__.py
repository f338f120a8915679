# SPDX-License-Identifier: Apache-2.0
"""Composes the other packages: loop, graph, report and commands."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_core.errors": ["FlightError"],
        "fly": ["FlightOrder", "fly_and_write"],
        "graph.bag_record": ["flight_from_bag"],
        "loop": ["LoopFlight", "simulate"],
        "record": ["FlightRecord"],
        "report.write": ["report_of_bag"],
        "scoring": ["score"],
        "settings": ["Settings", "resolve"],
    },
    modules=["cli", "graph", "report"],
)
