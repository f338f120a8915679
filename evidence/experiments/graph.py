# SPDX-License-Identifier: Apache-2.0
"""Speed of the node graph in lockstep beside a bare ring of rclpy nodes.

`benchmarks/graph.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid, machine
from heli_core.ticks import TICK_S

produces(
    "graph",
    "./heli python benchmarks/graph.py --json",
    "Speed of the node graph in lockstep beside a bare ring of rclpy nodes.",
    loose={key: NOT_COMPARED for key in ("rates", "ratios", "machine")},
)


@table("graph")
def graph(results: Results) -> str:
    """Speed of the graph beside the ring, in both shapes."""
    record = results["graph"]
    rows = [
        [
            shape,
            f"{rates['graph']:.0f}",
            f"{rates['graph'] * TICK_S:.1f}",
            f"{rates['objects']:.0f}",
            f"{record['ratios'][shape]['objects']:.2f} ({record['goals'][shape]:g})",
            f"{rates['bytes']:.0f}",
            f"{record['ratios'][shape]['bytes']:.2f}",
        ]
        for shape, rates in record["rates"].items()
    ]
    head = ["nodes in", "graph, ticks/s", "times real time", "ring of objects, cycles/s",
            "ratio (goal)", "ring of bytes, cycles/s", "ratio"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nMedians of {record['rounds']} rounds in turn; flights of "
        f"{record['seconds']:g} s, scenario hover, world paper, seed 1, standalone receiver, "
        f"packaged controllers, recorded; {machine(record)}."
    )
