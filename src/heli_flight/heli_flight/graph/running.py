# SPDX-License-Identifier: Apache-2.0
"""The ROS domain and the Ctrl-C of graphs that fly together."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from heli_flight.graph.processes import DISCOVERY, DOMAIN, domain_reserved, others_in

if TYPE_CHECKING:
    from heli_flight.graph.flight import Graph

_HERE = "LOCALHOST"


@contextmanager
def running(*graphs: "Graph") -> Iterator[None]:
    """Hold a ROS domain and Ctrl-C for graphs that fly together; nothing of them stays."""
    chosen = not os.environ.get(DOMAIN, "").strip()

    def on_interrupt(*_: Any) -> None:
        # Remembered only; raised inside rclpy it would come out as something else.
        for graph in graphs:
            graph.interrupted = True

    with domain_reserved() as domain:
        if chosen and domain:
            graphs[0].say(
                f"flying in ROS domain {domain}: to listen in, {DOMAIN}={domain} ./heli topics"
            )
        reach = os.environ.get(DISCOVERY, "").strip() or _HERE
        on_this_machine = reach == _HERE
        if not on_this_machine:
            graphs[0].say(
                f"flying in ROS domain {domain} with {DISCOVERY}={reach}, as it is set: other "
                "machines may listen and send"
            )
        company = not on_this_machine or others_in(domain)
        for graph in graphs:
            graph.company = company
        before = signal.signal(signal.SIGINT, on_interrupt)
        try:
            yield
        finally:
            # The first has begun ROS, and ends it.
            for graph in reversed(graphs):
                graph.close()
            interrupted = graphs[0].interrupted
            signal.signal(signal.SIGINT, signal.SIG_IGN if interrupted else before)
    if interrupted:
        raise KeyboardInterrupt
