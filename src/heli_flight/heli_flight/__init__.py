# SPDX-License-Identifier: Apache-2.0
"""Composes the other packages: loop, graph, report, studies and commands."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "errors": ["FlightError"],
        "loop.settings": ["Settings", "resolve"],
        "loop.closed_loop": ["Flight", "simulate"],
        "loop.record": ["FlightRecord"],
        "loop.scoring": ["score"],
        "graph.bag_record": ["flight_from_bag"],
        "report.from_bag": ["report_of_bag"],
        "studies.flight": ["FlightOrder", "fly_and_write"],
        "studies.campaign": ["fly_seeds"],
        "studies.design.make": ["Design", "make_design"],
    },
    modules=["cli", "graph", "loop", "report", "studies"],
)
