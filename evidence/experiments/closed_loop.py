# SPDX-License-Identifier: Apache-2.0
"""The loop in one process beside rotorpy's, and the parts of a flight.

`benchmarks/closed_loop.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

produces(
    "closed_loop",
    "./heli python benchmarks/closed_loop.py --json",
    "The loop in one process beside rotorpy's, and the parts of a flight.",
    loose={
        key: NOT_COMPARED
        for key in (
            "resolve_s",
            "build_s",
            "fly_s",
            "score_s",
            "times_real_time",
            "command_s",
            "command_with_report_s",
            "imports_s",
            "command_over_imports",
            "peer_times_real_time",
            "times_peer",
        )
    },
)


_PARTS = {
    "resolve_s": "files, layers and checks",
    "build_s": "trim, design, set-up of the loop",
    "fly_s": "flight",
    "score_s": "scoring",
}


_CHUNKS = (1, 10, 100)


# Cores of one node of a cluster, for the table of what a scheduler carries.
_NODE_CORES = 32


@table("closed_loop")
def closed_loop(results: Results) -> str:
    """Speed of the loop in one process beside its peer, and the parts of a flight."""
    record = results["closed_loop"]
    rows = [
        ["closed loop", f"{record['times_real_time']:.0f} times real time", "600"],
        [f"peer, {record['peer']}", f"{record['peer_times_real_time']:.1f} times real time", ""],
        ["ratio", f"{record['times_peer']:.0f}", ""],
        *([name, f"{1e3 * record[key]:.1f} ms", ""] for key, name in _PARTS.items()),
        ["`heli hover --one-process --duration 1 --no-report`", f"{record['command_s']:.2f} s", ""],
        ["the same with a report", f"{record['command_with_report_s']:.2f} s", "1.5 s"],
        ["importing numpy, scipy and numba alone", f"{record['imports_s']:.2f} s", ""],
    ]
    return (
        f"{grid(['', 'measured', 'goal'], rows)}\n\nMedians of {record['rounds']} rounds; flights "
        f"of {record['duration_s']:g} s; processor time, the commands wall time."
    )


@table("tasks")
def tasks(results: Results) -> str:
    """Flights per second that one scheduler carries, and what that keeps busy."""
    empty, flown = results["scaling"]["empty_tasks"], results["closed_loop"]
    flight_s = sum(flown[key] for key in _PARTS)
    most = 1.0 / empty["scheduler_s_per_task"]
    rows = [
        [
            str(chunk),
            f"{most * chunk:.0f}",
            f"{most * chunk * flight_s:.0f}",
            f"{most * chunk * flight_s / _NODE_CORES:.1f}",
        ]
        for chunk in _CHUNKS
    ]
    head = ["flights a task", "flights per s", "cores kept busy", f"nodes of {_NODE_CORES} cores"]
    return (
        f"{grid(head, rows)}\n\nReckoned from {1e6 * empty['scheduler_s_per_task']:.0f} us of "
        f"scheduler and client for an empty task ({empty['tasks']} of them, "
        f"{empty['tasks_per_s']:.0f} per second came back from two workers on two cores) and "
        f"{1e3 * flight_s:.0f} ms for a flight of {flown['duration_s']:g} s."
    )
