# SPDX-License-Identifier: Apache-2.0
"""Fly, load, design and compare from a script or a notebook.

    import heli

    flight = heli.fly(seed=3, gps="rtk")     # the hover test, in this process
    flight.metrics["altitude"]               # value, unit, the paper's figure
    flight.truth.phi_rad, flight.u.delta_lat # arrays over flight.time_s
    flight.plot()                            # a figure of matplotlib
    flight.report("my_flight")               # the commands' HTML report

Inside everything is NED and FRD, SI and rad; names say frame and unit. A name is loaded when it is
first used. What cannot be is one of the exceptions here, with one sentence.
"""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "errors": [
            "AircraftError",
            "BagError",
            "FlightError",
            "IdentificationError",
            "LawError",
            "ParameterError",
            "SynthesisError",
            "TrimError",
        ],
        "campaigns": ["Campaign", "campaign"],
        "comparing": ["Diff", "diff"],
        "designing": ["Design", "design"],
        "flight": ["Flight"],
        "flying": ["fly"],
        "identifying": ["Identified", "identify"],
        "loading": ["load"],
        "places": ["NAV", "NINE", "SHAPED"],
        "metrics": ["Metric", "Metrics"],
        "modelling": ["Trim", "linearize", "trim"],
        "signals": ["Signal", "Signals"],
    },
)
