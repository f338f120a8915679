# SPDX-License-Identifier: Apache-2.0
"""Fly, load, design and compare from a script or a notebook.

    import heli

    flight = heli.fly(seed=3, gps="rtk")     # the hover test, in this process
    flight.metrics["altitude"]               # value, unit, the paper's figure
    flight.truth.phi_rad, flight.u.delta_lat # arrays over flight.time_s
    flight.plot()                            # a figure of matplotlib
    flight.report("my_flight")               # the commands' HTML report

Inside everything is NED and FRD, SI and rad; names say frame and unit. A name is loaded when it is
first used. Errors are raised as the exception classes listed below, each with a one-line message.
"""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "heli_bags.writer": ["BagError"],
        "heli_core.errors": ["FlightError", "IdentificationError", "PartError", "SynthesisError"],
        "heli_core.python_controller": ["LawError"],
        "heli_core.rcl_yaml": ["ParameterError"],
        "heli_core.version": ["__version__"],
        "heli_dynamics_sim.aircraft": ["AircraftError"],
        "heli_dynamics_sim.local_model": ["LOCAL", "LocalModel"],
        "heli_dynamics_sim.trim": ["TrimError"],
        "heli_observer.observer": ["Observer"],
        "comparing": ["Diff", "diff"],
        "designing": [
            "Design",
            "Identified",
            "Trim",
            "collective_for_thrust",
            "design",
            "identify",
            "linearize",
            "trim",
        ],
        "flight": ["Flight", "Metric", "Metrics", "NAV", "NINE", "SHAPED", "Signal", "Signals"],
        "campaigns": ["Campaign", "campaign"],
        "flying": ["fly", "load"],
        "simulating": ["Observation", "NamedRow", "Simulation"],
    },
)
