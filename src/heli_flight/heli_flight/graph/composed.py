# SPDX-License-Identifier: Apache-2.0
"""The four nodes of a flight in one process and one executor; they still speak by DDS topics.

What is sent within a process needs no other thread to wake up, so a flight takes half as long. Each
node is what it is alone: name, services, parameters, life cycle, /diagnostics. The plant is the
last of them, so that of what is ready at once the others' work is done first.
"""

import sys
from collections.abc import Sequence

from heli_dynamics_sim.node import PlantNode
from heli_inner_hinf.node import InnerLoopNode
from heli_msgs_bridge.node_process import run_together
from heli_observer.node import ObserverNode
from heli_outer_pd.node import OuterLoopNode

COMPOSED = "composed"
"""Of the process, among those of a flight."""
CLASSES = (ObserverNode, InnerLoopNode, OuterLoopNode, PlantNode)


def main(args: Sequence[str] | None = None) -> int:
    """Run them until one ends; arguments as of one node, which all get. Returns the exit code."""
    return run_together(CLASSES, list(sys.argv[1:] if args is None else args), COMPOSED)
