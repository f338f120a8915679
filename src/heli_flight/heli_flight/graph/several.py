# SPDX-License-Identifier: Apache-2.0
"""A flight of several aircraft in one ROS domain: a graph each, and the clock of their world."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from heli_flight.errors import FlightError
from heli_flight.graph.bag_record import BagFlight
from heli_flight.graph.flight import Graph, ended
from heli_flight.graph.outcome import outcome
from heli_flight.graph.processes import NodeProcess, stop
from heli_flight.graph.running import running
from heli_flight.loop.result import Result
from heli_flight.loop.settings import Settings

_CLOCK = "world_clock"


def _start_clock(names: Sequence[str], folder: Path) -> NodeProcess:
    arguments = ["--ros-args", "-p", f"aircraft:=[{', '.join(names)}]"]
    module = "heli_flight.graph.world_clock_node"
    return NodeProcess(_CLOCK, module, arguments, folder / f"{_CLOCK}.log", dict(os.environ))


def fly_several(
    settings: Mapping[str, Settings],
    folder: Path,
    progress: Callable[[float], None],
    say: Callable[[str], None] = print,
    composed: bool = False,
) -> dict[str, tuple[Result, Mapping[str, Any], BagFlight]]:
    """Fly aircraft side by side with the real graph.

    Parameters
    ----------
    settings : mapping
        Namespace of each aircraft to what it flies.
    folder : Path
        Gets the clock's log; in it a folder per aircraft, which must exist.
    progress : callable
        Called with the flight time (s).
    say : callable
        Takes a line for the user.
    composed : bool
        Whether each aircraft's nodes are in one process.

    Returns
    -------
    dict
        Per aircraft as `fly_graph`.

    Raises
    ------
    FlightError, MissingFileError
        A graph could not be brought up or kept up.
    """
    begun = time.monotonic()
    graphs = {n: Graph(own, folder / n, None, say, n, composed) for n, own in settings.items()}
    first = next(iter(graphs.values()))
    with running(*graphs.values()):
        for graph in graphs.values():
            graph.start()
        clock = _start_clock(list(graphs), folder)
        try:
            for graph in graphs.values():
                others = [other.check_own for other in graphs.values() if other is not graph]
                graph.beside = [*others, lambda: _check(clock)]
                graph.prepare()
            for graph in graphs.values():
                graph.activate()
            up = time.monotonic()
            for graph in graphs.values():
                graph.fly(progress if graph is first else lambda flight_s: None)
        finally:
            stop([clock])
        said = {name: ended(graph) for name, graph in reversed(graphs.items())}
    start_up_s = round(up - begun, 3)
    return {
        n: outcome(own, folder / n, *said[n], start_up_s, n, composed)
        for n, own in settings.items()
    }


def _check(clock: NodeProcess) -> None:
    """It ends with 0 when all flights are over, and otherwise never."""
    if clock.exit_code():
        raise FlightError(f"{_CLOCK}: {clock.last_line()}")
