# SPDX-License-Identifier: Apache-2.0
"""An hour of flight, twenty minutes in real time, a hundred starts, fifty Ctrl-C.

`benchmarks/soak.py` measures it.
"""

from collections.abc import Mapping
from typing import Any

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

produces(
    "soak",
    "./heli python benchmarks/soak.py --json",
    "An hour of flight, twenty minutes in real time, a hundred starts, fifty Ctrl-C.",
    (1,),
    loose={key: NOT_COMPARED for key in ("lockstep", "realtime", "starts", "interrupts")},
)

produces(
    "soak_quarter",
    "./heli python benchmarks/soak.py --seconds 900 --realtime-seconds 900 --starts 10 "
    "--interrupts 10 --json",
    "A quarter of an hour of flight, the same in real time, ten starts, ten Ctrl-C.",
    (1,),
    loose={key: NOT_COMPARED for key in ("lockstep", "realtime", "starts", "interrupts")},
)


@table("soak")
def soak(results: Results) -> str:
    """Memory of long flights, what they left, many starts and many Ctrl-C."""
    record = results["soak"]
    flights = {"lockstep": record["lockstep"], "real time": record["realtime"]}
    rows = [
        [process, *(cell for flight in flights.values() for cell in _memory(flight, process))]
        for process in sorted(record["lockstep"]["memory"])
    ]
    head = ["process"]
    for name, flight in flights.items():
        head += [f"{name} {flight['seconds']:g} s: at its end, MB", "slope, MB per hour"]
    return f"{grid(head, rows)}\n\n{_sentences(record, flights)}"


@table("soak_quarter")
def soak_quarter(results: Results) -> str:
    """What the processes of a flight hold: memory, open files, threads."""
    record = results["soak_quarter"]
    flights = {"lockstep": record["lockstep"], "real time": record["realtime"]}
    head, rows = ["process"], []
    for name, flight in flights.items():
        head += [f"{name} {flight['seconds']:g} s: MB", "slope, MB per hour"]
        head += ["open files", "threads"]
    for process in sorted(record["lockstep"]["memory"]):
        cells = [process]
        for flight in flights.values():
            row = flight["memory"][process]
            cells.append(f"{row['first_mb']:.1f} to {row['last_mb']:.1f}")
            cells.append(f"{row['slope_mb_per_h']:+.1f}")
            cells += [" / ".join(map(str, row[name])) for name in ("files", "threads")]
        rows.append(cells)
    return (
        f"{grid(head, rows)}\n\nThe slope leaves out the first third. Files and threads: at first "
        "/ at most / at last.\n\n"
        f"{_sentences(record, flights)}"
    )


def _sentences(record: Any, flights: Mapping[str, Any]) -> str:
    """What was recorded and left."""
    sentences = [
        f"{name}: messages that are not the schedule's {flight['wrong_counts'] or 'none'}, "
        f"left behind {_left(flight)}, beside it {flight['beside']:.1f} cores were busy"
        for name, flight in flights.items()
    ]
    starts, stops = record["starts"], record["interrupts"]
    sentences.append(
        f"{starts['count']} flights of 1 s one after the other: exit codes other than 0 "
        f"{starts['odd_exit_codes'] or 'none'}, median {starts['median_s']:.1f} s, longest "
        f"{starts['longest_s']:.1f} s, left behind {_left(starts)}, beside them "
        f"{starts['beside']:.1f} cores were busy"
    )
    sentences.append(
        f"{stops['count']} Ctrl-C at random times (seed {stops['seed']}): {stops['hung']} hung, "
        f"exit codes other than 130 {stops['odd_exit_codes'] or 'none'}, ended after "
        f"{stops['median_s']:.1f} s (longest {stops['longest_s']:.1f} s), left behind "
        f"{_left(stops)}, beside them {stops['beside']:.1f} cores were busy"
    )
    return "\n".join(f"- {line}" for line in sentences)


def _memory(flight: Mapping[str, Any], process: str) -> list[str]:
    row = flight["memory"].get(process)
    return [f"{row['last_mb']:.1f}", f"{row['slope_mb_per_h']:+.2f}"] if row else ["", ""]


def _left(results: Mapping[str, Any]) -> str:
    return ", ".join(results["left"]) or "nothing"
