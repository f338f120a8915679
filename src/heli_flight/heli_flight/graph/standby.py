# SPDX-License-Identifier: Apache-2.0
"""A process that stands by in a flight, known to all, until a node dies: then it becomes that node.

Processes that meet anew in DDS need seconds on loaded cores. This one has met the others before.
"""

import os
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection

from heli_flight.graph.composed import CLASSES
from heli_msgs_bridge.lifecycle_node import ManagedNode
from heli_msgs_bridge.node_process import NodeCommandLine, stand_by

STANDBY = "standby"
_LOOK_S = 0.2
_CLASSES: dict[str, type[ManagedNode]] = {cls.SPEC.name: cls for cls in CLASSES}


def _next(orders: Connection, leaving: Callable[[], bool]) -> NodeCommandLine | None:
    """Wait for the name of a node, its log, and words of its command line; None: not needed."""
    while not orders.poll(_LOOK_S):
        if leaving():
            return None
    try:
        name, log, words = orders.recv()
    except EOFError:
        return None
    with open(log, "ab", buffering=0) as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    return _CLASSES[name], words


def main(arguments: Sequence[str], orders: Connection) -> int:
    """Stand by until an order comes; returns the exit code."""
    return stand_by(STANDBY, arguments, partial(_next, orders))
