# SPDX-License-Identifier: Apache-2.0
"""`heli.fly`: a flight flown now."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from heli.flight import Flight
from heli.loading import load
from heli.options import Over, faults_over, merged, split
from heli_flight.loop.commit import sources_commit
from heli_flight.loop.flight_section import LOCKSTEP, ONE_PROCESS
from heli_flight.loop.laws import NODES
from heli_flight.loop.settings import Settings
from heli_flight.report.from_bag import Recorded
from heli_flight.studies.flight import FlightOrder, fly_and_write
from heli_flight.studies.one_process import fly_one_process
from heli_flight.terminal import console, silent
from heli_parameters.parameters import ParameterError
from heli_parameters.python_law import GIVEN, PARAMETER, LawError, PythonLaw, find, source_of


def fly(
    scenario: str | None = None,
    *,
    seed: int | None = None,
    gps: str | None = None,
    world: str | None = None,
    laws: str | None = None,
    controller: str | None = None,
    duration_s: float | None = None,
    params: Any = None,
    faults: Any = None,
    law: Any = None,
    rate_hz: int | None = None,
    graph: bool = False,
    out: str | os.PathLike[str] | None = None,
    quiet: bool = False,
) -> Flight:
    """Fly a scenario in this process, or through the ROS 2 graph.

    Everything that is not said is as `./hover_test.sh` has it.

    Parameters
    ----------
    scenario : str, optional
        hover, attitude, figure_eight, takeoff_land ... (`heli hover --help` lists them); default:
        that of the files in `params`, else hover.
    seed : int, optional
        Of wind, sensors, and what the world draws of the aircraft.
    gps : {"standalone", "rtk"}, optional
    world : str, optional
        paper, honest, hard, or a file; default: honest for the hover test, else paper.
    laws : str, optional
        packaged, paper, or a file.
    controller : str, optional
        Attitude law: hinf_output, hinf, lqg, lqr, pid, indi.
    duration_s : float, optional
    params : optional
        {node: {parameter: value}}, dotted or nested (`{"inner_loop": {"gamma": 0.056}}`), a
        parameter file, a `heli.Design`, or a list of these.
    faults : path or list of mappings, optional
        Sensors and actuators that fail: [{"what": "gps", "kind": "loss", "start_s": 20.0}].
    law : callable, class, or str, optional
        A law of your own in the place of the attitude law: a function (x, r, t) that gives d_lat,
        d_lon, d_ped, or a class with `step(self, x, r, t)` and `reset(self, x, r, u)`; x: the nine
        states (places `heli.NINE`), r: commanded phi, theta, psi, rad; t: s. With the attribute
        `loop = "outer"` in the place of the position law: x: navigation (places `heli.NAV`), r:
        the reference (places `heli.SHAPED`); gives phi, theta, psi, collective. A str is
        MODULE:NAME or FILE.py:NAME. A list: one of each. See the package's README.
    rate_hz : int, optional
        100, 200 or 400, of IMU, observer and inner loop.
    graph : bool
        True: real processes over DDS topics, as fast as the machine allows, with a bag.
    out : path, optional
        Folder to write, must not exist; of the graph default: a new one under `flights/`. In this
        process nothing is written without.
    quiet : bool
        True: nothing is printed (progress and remarks go to stderr).

    Returns
    -------
    Flight

    Raises
    ------
    ParameterError, TrimError, SynthesisError, FlightError
        Each with one sentence.

    Examples
    --------
    >>> flight = heli.fly(seed=3, gps="rtk")
    >>> flight.metrics["altitude"].value
    """
    own = laws_of(law)
    order = ordered(
        own, graph, out, scenario=scenario, seed=seed, gps=gps, world=world, laws=laws,
        controller=controller, duration_s=duration_s, params=params, faults=faults,
        rate_hz=rate_hz,
    )  # fmt: skip
    say = silent() if quiet else console(stderr=True)
    if graph:
        return load(fly_and_write(order, say).folder)
    return _in_this_process(order, own, say)


def ordered(
    own: Sequence[PythonLaw],
    graph: bool = False,
    out: str | os.PathLike[str] | None = None,
    *,
    params: Any = None,
    faults: Any = None,
    duration_s: float | None = None,
    seed: int | None = None,
    **options: Any,
) -> FlightOrder:
    """The order of a flight; arguments as of `fly`."""
    files, over = split(params)
    return FlightOrder(
        mode=LOCKSTEP if graph else ONE_PROCESS,
        duration_s=None if duration_s is None else float(duration_s),
        seed=None if seed is None else int(seed),
        params=files,
        out=None if out is None else Path(out),
        report=False,
        over=merged(over, faults_over(faults), _named(own, graph)),
        **options,
    )


def laws_of(law: Any) -> list[PythonLaw]:
    """The laws of an argument `law`.

    Raises
    ------
    LawError
    """
    given = law if isinstance(law, (list, tuple)) else [] if law is None else [law]
    return [
        find(one) if isinstance(one, str) else PythonLaw(one, source=source_of(one))
        for one in given
    ]


def _named(laws: Sequence[PythonLaw], graph: bool) -> Over:
    """The parameters that name the laws."""
    for law in laws:
        if graph and law.source.startswith(f"{GIVEN}:"):
            raise LawError(
                f"law {law.name}: the graph's nodes cannot have it, they are other processes; put "
                "it into a file: law='my_law.py:NAME'"
            )
    return {NODES[law.loop]: {PARAMETER: law.source} for law in laws}


def _in_this_process(order: FlightOrder, laws: Sequence[PythonLaw], say: Console) -> Flight:
    if order.out is not None and order.out.exists():
        raise ParameterError(f"out {order.out}: exists already; name a new folder")
    settings = order.resolved()
    for remark in settings.remarks:
        say.print(remark, highlight=False, soft_wrap=True, markup=False)
    flight = flown(settings, say, laws)
    if order.out is not None:
        flight.save(order.out)
    return flight


def flown(settings: Settings, say: Console, laws: Sequence[PythonLaw] = ()) -> Flight:
    """Fly resolved settings in this process; `say` gets what is compiled, and progress."""
    found = fly_one_process(settings, say, laws)
    recorded = Recorded(
        found.record, settings, found.result, Path("."), ONE_PROCESS, commit=sources_commit()
    )
    return Flight(recorded)
