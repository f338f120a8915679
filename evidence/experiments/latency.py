# SPDX-License-Identifier: Apache-2.0
"""The node graph in real time for ten minutes beside a bare ring at its pace.

`benchmarks/latency.py` measures it.
"""

from collections.abc import Mapping
from typing import Any

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid, machine

produces(
    "latency",
    "./heli python benchmarks/latency.py --seconds 600 --json",
    "The node graph in real time for ten minutes beside a bare ring at its pace.",
    loose={key: NOT_COMPARED for key in ("ring", "graph", "ratios", "machine")},
)
produces(
    "latency_400",
    "./heli python benchmarks/latency.py --seconds 60 --rate 400 --json",
    "The node graph at 400 Hz in real time beside a bare ring at its pace.",
    loose={key: NOT_COMPARED for key in ("ring", "graph", "ratios", "machine")},
)


@table("latency")
def latency(results: Results) -> str:
    """From an IMU sample to its actuators in real time, beside the ring."""
    return _in_real_time(results["latency"])


@table("latency_400")
def latency_400(results: Results) -> str:
    """The same with IMU, observer and inner loop at 400 Hz."""
    return _in_real_time(results["latency_400"])


def _in_real_time(results: Mapping[str, Any]) -> str:
    flown, bare, ratios = results["graph"], results["ring"], results["ratios"]
    rows = [
        ["sensor to actuator, p50, us", f"{flown['p50_us']:.0f}", f"{bare['p50_us']:.0f}",
         f"{ratios['p50_us']:.2f}", "1.5"],
        ["sensor to actuator, p99, us", f"{flown['p99_us']:.0f}", f"{bare['p99_us']:.0f}",
         f"{ratios['p99_us']:.2f}", "1.5"],
        ["ticks missed", f"{flown['missed']:.0f} of {flown['ticks']:.0f}",
         f"{bare['missed']:.0f} of {bare['ticks']:.0f}", "", "0"],
        ["load, share of a core", f"{100.0 * flown['load']:.0f} %", "", "", "60 %"],
    ]  # fmt: skip
    return (
        f"{grid(['', 'graph', 'ring', 'ratio', 'goal'], rows)}\n\n{results['seconds']:g} s of "
        f"each, "
        f"one after the other, at {results['rate_hz']} Hz, four processes and recorder; "
        f"{machine(results)}."
    )
