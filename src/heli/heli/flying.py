# SPDX-License-Identifier: Apache-2.0
"""`heli.fly`: a flight flown now."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli.arguments import in_python, refused
from heli.flight import Flight
from heli_core.errors import FlightError, PartError
from heli_core.faults import NONE, faults_of
from heli_core.parameters import Parameter, suggestion
from heli_core.python_controller import GIVEN, PARAMETER, LawError, PythonLaw, find, source_of
from heli_core.rcl_yaml import ParameterError
from heli_flight.flight_file import NAME, fault_overrides
from heli_flight.fly import FlightOrder, fly_and_write, fly_one_process
from heli_flight.layers import LOCKSTEP, ONE_PROCESS, TABLES
from heli_flight.parts import Parts
from heli_flight.report.write import BagChoice, RecordedFlight, recorded
from heli_flight.settings import LAW_NODES, Settings, sources_commit
from heli_flight.terminal import console, silent, told_when_long

# -------------------------------------------------------------------------------------------------
# What a caller says of parameters, in the form in which the stack reads them.
# -------------------------------------------------------------------------------------------------

Over = dict[str, dict[str, Any]]


def split(params: Any) -> tuple[list[Path], Over]:
    """Files and changes of an argument `params`.

    Parameters
    ----------
    params : None, path, mapping, object with `parameters`, or a sequence of these
        A mapping says per node (plant, observer, inner_loop, outer_loop, scenario, world) which
        parameters have which values: by dotted name, or nested. Files are weaker than mappings, and
        later ones are stronger.

    Raises
    ------
    ParameterError
        Names node, parameter, value and what is allowed.
    """
    files: list[Path] = []
    over: Over = {}
    for part in _parts(params):
        if isinstance(part, (str, os.PathLike)):
            if not Path(part).is_file():
                raise refused("params", os.fspath(part), "a file that is there")
            files.append(Path(part))
            continue
        for node, values in _mapping(part).items():
            over.setdefault(node, {}).update(_of_node(node, values))
    return files, over


def _parts(params: Any) -> list[Any]:
    if params is None:
        return []
    return list(params) if isinstance(params, (list, tuple)) else [params]


def _mapping(part: Any) -> Mapping[str, Any]:
    """A mapping of nodes; of a design that which it decides."""
    nodes = getattr(part, "parameters", part)
    if isinstance(nodes, Mapping):
        return nodes
    raise refused(
        "params", part, "a file, {node: {parameter: value}}, a design, or a list of these"
    )


def _of_node(node: str, values: Any) -> dict[str, Any]:
    if node not in TABLES:
        near = difflib.get_close_matches(str(node), TABLES, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(TABLES)}"
        raise ParameterError(f"params: {node!r} is no node; {hint}")
    if not isinstance(values, Mapping):
        raise ParameterError(
            f"params: {node}: {values!r} is not allowed; allowed: {{parameter: value}}"
        )
    rows = {row.name: row for row in TABLES[node]}
    checked = {}
    for name, value in _flat(values):
        if name not in rows:
            raise ParameterError(f"params: {node}: {name}: {suggestion(rows, name)}")
        try:
            checked[name] = rows[name].check(_as_kind(rows[name], value))
        except ParameterError as error:
            raise ParameterError(f"params: {node}: {name}: {error}") from None
    return checked


def _flat(values: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _as_kind(row: Parameter, value: Any) -> Any:
    """A number as Python and numpy write it, where a parameter file would want 1.0."""
    if isinstance(value, np.generic):
        value = value.item()
    whole = isinstance(value, int) and not isinstance(value, bool)
    if row.kind == "double" and whole:
        return float(value)
    if row.kind == "double[]" and isinstance(value, (list, tuple, np.ndarray)):
        try:
            return np.asarray(value, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            return value
    return value


def faults_over(faults: Any) -> Over:
    """What faults set, by node: of a file, or of mappings as its entries are (of the plant alone).

    Raises
    ------
    ParameterError
        One sentence.
    """
    if faults is None:
        return {}
    if isinstance(faults, (str, os.PathLike)):
        if not Path(faults).is_file():
            raise refused("faults", os.fspath(faults), "a file that is there")
        return fault_overrides(Path(faults)) or {}
    try:
        # JSON is YAML: a mapping is judged as an entry of a file.
        fault_texts = tuple(
            fault.text for fault in faults_of([json.dumps(dict(f)) for f in faults])
        )
    except (TypeError, ValueError):
        raise refused("faults", faults, "a file, or a list of mappings") from None
    return {"plant": {"faults": fault_texts or (NONE,)}}


def merged(*parts: Over) -> Over:
    """Changes one over the other, the later stronger."""
    over: Over = {}
    for part in parts:
        for node, values in part.items():
            over.setdefault(node, {}).update(values)
    return over


# -------------------------------------------------------------------------------------------------
# `heli.load`: a flight that was recorded.
# -------------------------------------------------------------------------------------------------


@in_python
def load(
    path: str | os.PathLike[str],
    scenario: str | None = None,
    gps: str | None = None,
    seed: int | None = None,
    params: Any = None,
    flight: int | None = None,
) -> Flight:
    """Read a flight: the folder of one (`heli hover`, `heli.fly(...).save()`), or a bag alone.

    Parameters
    ----------
    path : path
        Folder of a flight, of the graph or of one process, or a rosbag2 folder.
    scenario, gps, seed : optional
        What was flown, where it is not recorded beside the bag.
    params : path or sequence of paths, optional
        Parameter files it was flown with, where they are not beside the bag.
    flight : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Returns
    -------
    Flight

    Raises
    ------
    ParameterError, FlightError
        Each with one sentence that names the file.

    Examples
    --------
    >>> flight = heli.load("flights/my_flight")
    >>> flight.truth.altitude_m.max()
    """
    folder = Path(path)
    if not folder.exists():
        error = FlightError(f"path {folder}: there is no such flight")
        error.argument = "path"
        raise error
    files, over = split(params)
    if over:
        raise ParameterError("params: of a recorded flight; allowed: files")
    with told_when_long("heli.load") as tell:
        tell(f"reads {folder}")
        record = recorded(folder, BagChoice(scenario, gps, seed, files, flight))
    return Flight(record, record.folder if (record.folder / NAME).is_file() else None)


# -------------------------------------------------------------------------------------------------
# Flying.
# -------------------------------------------------------------------------------------------------


@in_python
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
    plant: Any = None,
    wind: Any = None,
    sensors: Sequence[Any] = (),
    estimator: Any = None,
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
        Attitude controller: hinf_output, hinf, lqg, lqr, pid, indi.
    duration_s : float, optional
    params : optional
        {node: {parameter: value}}, dotted or nested (`{"inner_loop": {"gamma": 0.056}}`), a
        parameter file, a `heli.Design`, or a list of these.
    faults : path or list of mappings, optional
        Sensors and actuators that fail: [{"what": "gps", "kind": "loss", "start_s": 20.0}].
    law : callable, class, or str, optional
        A controller of your own in place of the attitude controller: a function (x, r, t) that
        gives d_lat, d_lon, d_ped, or a class with `step(self, x, r, t)` and `reset(self, x, r, u)`;
        x: the nine states (places `heli.NINE`), r: commanded phi, theta, psi, rad; t: s. With the
        attribute `loop = "outer"` in place of the position controller: x: navigation (places
        `heli.NAV`), r: the reference (places `heli.SHAPED`), both with positions and velocities
        north, east, **down**; gives phi, theta, psi, collective. A
        str is MODULE:NAME or FILE.py:NAME. A list: one of each. See the package's README.
    plant, wind, estimator : object, optional
        A part of your own in place of the packaged one, with `reset(rng, tick_s, nodes)` and
        `step(...)`, as the protocols `Plant`, `Wind` and `Estimator` in `heli_flight.parts` say. In
        this process only. `heli.Observer` is the packaged estimator, to build upon.
    sensors : sequence of objects
        Sensors besides the packaged ones, or that spoil them (protocol `Sensor`).
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
    ParameterError, TrimError, SynthesisError, FlightError, PartError
        Each with one sentence.

    Examples
    --------
    >>> flight = heli.fly(seed=3, gps="rtk")
    >>> flight.metrics["altitude"].value
    """
    python_laws = laws_of(law)
    parts = Parts(
        plant=plant, wind=wind, sensors=sensors, estimator=estimator, controllers=python_laws
    )
    if graph and parts.named():
        raise PartError(
            f"{parts.named()[0][0]}: the graph's nodes cannot have an object, they are other "
            "processes; allowed: without graph=True",
            "graph",
        )
    order = ordered(
        python_laws, graph, out, scenario=scenario, seed=seed, gps=gps, world=world, laws=laws,
        controller=controller, duration_s=duration_s, params=params, faults=faults,
        rate_hz=rate_hz,
    )  # fmt: skip
    say = silent() if quiet else console(stderr=True)
    if graph:
        return load(fly_and_write(order, say).folder)
    return _in_this_process(order, parts, say)


def ordered(
    python_laws: Sequence[PythonLaw],
    graph: bool = False,
    out: str | os.PathLike[str] | None = None,
    *,
    params: Any = None,
    faults: Any = None,
    **options: Any,
) -> FlightOrder:
    """The order of a flight; arguments as of `fly`."""
    files, over = split(params)
    return FlightOrder(
        mode=LOCKSTEP if graph else ONE_PROCESS,
        params=files,
        out=None if out is None else Path(out),
        report=False,
        over=merged(over, faults_over(faults), _named(python_laws, graph)),
        **options,
    )


def laws_of(law: Any) -> list[PythonLaw]:
    """The controllers of an argument `law`.

    Raises
    ------
    LawError
    """
    laws = law if isinstance(law, (list, tuple)) else [] if law is None else [law]
    try:
        return [
            find(one) if isinstance(one, str) else PythonLaw(one, source=source_of(one))
            for one in laws
        ]
    except LawError as error:
        error.argument, error.value, error.where = "law", law, "law"
        raise


def _named(laws: Sequence[PythonLaw], graph: bool) -> Over:
    """The parameters that name the controllers."""
    for law in laws:
        if graph and law.source.startswith(f"{GIVEN}:"):
            raise LawError(
                f"controller {law.name}: the graph's nodes cannot have it, they are other "
                "processes; put it into a file: law='my_law.py:NAME'"
            )
    return {LAW_NODES[law.loop]: {PARAMETER: law.source} for law in laws}


def _in_this_process(order: FlightOrder, parts: Parts, say: Console) -> Flight:
    if order.out is not None and order.out.exists():
        raise ParameterError(f"out {order.out}: exists already; name a new folder")
    settings = order.resolved()
    for remark in settings.remarks:
        say.print(remark, highlight=False, soft_wrap=True, markup=False)
    flight = flown(settings, say, parts)
    if order.out is not None:
        flight.save(order.out)
    return flight


def flown(settings: Settings, say: Console, parts: Parts | None = None) -> Flight:
    """Fly resolved settings in this process; `say` gets what is compiled, and progress."""
    outcome = fly_one_process(settings, say, parts=parts)
    recorded = RecordedFlight(
        outcome.record, settings, outcome.result, Path("."), ONE_PROCESS, commit=sources_commit()
    )
    return Flight(recorded)
