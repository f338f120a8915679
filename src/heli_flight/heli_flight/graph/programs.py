# SPDX-License-Identifier: Apache-2.0
"""Which processes a flight has, and what runs in each."""

from dataclasses import dataclass

from heli_flight.graph.live import MODULE as LIVE_MODULE
from heli_flight.loop.layers import NODES
from heli_live_view.parameter_table import NODE_NAME as LIVE
from heli_parameters.locate import executable

COMPOSED = "composed"
"""Name of the process that holds all nodes of the loop."""


@dataclass(frozen=True)
class Program:
    """A process of a flight.

    Attributes
    ----------
    name : str
        Of the process and its log: that of its node, or COMPOSED.
    module : str
        Python module whose `main(arguments)` it runs.
    nodes : tuple of str
        The nodes in it.
    """

    name: str
    module: str
    nodes: tuple[str, ...]


def programs(composed: bool, live: bool) -> list[Program]:
    """The processes of a flight, in the order in which they are started.

    Parameters
    ----------
    composed : bool
        Whether the nodes of the loop are in one process; the recorder has one of its own.
    live : bool
        Whether the live view is among them.

    Raises
    ------
    MissingFileError
        The executable of a node is not installed.
    """
    own = [("recorder", "heli_bags", "recorder")]
    own += [(LIVE, "heli_live_view", LIVE)] if live else []
    loop = [(node.name, node.package, node.executable) for node in NODES]
    for _, package, program in (*own, *loop):
        executable(package, program)
    modules = {name: f"{package}.node" for name, package, _ in (*own, *loop)} | {LIVE: LIVE_MODULE}
    alone = own if composed else [*own, *loop]
    found = [Program(name, modules[name], (name,)) for name, _, _ in alone]
    if composed:
        names = tuple(node.name for node in NODES)
        found.append(Program(COMPOSED, "heli_flight.graph.composed", names))
    return found
