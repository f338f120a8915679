# SPDX-License-Identifier: Apache-2.0
"""What a frame of ArduPilot costs, beside the goal and an echo.

`benchmarks/ardupilot.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid

_PARTS = {"answer": "not recorded", "answer_recorded": "recorded"}
_LOOSE = (
    "mean_us", "p50_us", "p99_us", "cpu_us", "of_goal", "round_trip_over_echo", "times_real_time",
    "load",
)  # fmt: skip
produces(
    "ardupilot_frames",
    "./heli python benchmarks/ardupilot.py --json",
    "Processor time of a frame of ArduPilot, against 100 us, and its round trip beside an echo.",
    loose={key: NOT_COMPARED for key in _LOOSE},
)


@table("ardupilot_frames")
def ardupilot_frames(results: Results) -> str:
    """Microseconds of a processor for each frame, by ArduPilot's rate."""
    record = results["ardupilot_frames"]
    rows = [
        [
            rate_hz,
            *(f"{row[part]['cpu_us']:.0f}" for part in _PARTS),
            f"{row['of_goal']:.2f}",
            f"{row['round_trip_over_echo']:.1f}",
        ]
        for rate_hz, row in record["rates"].items()
    ]
    heads = [f"answer, {words}, us" for words in _PARTS.values()]
    head = ["frames/s", *heads, "recorded, of the goal", "round trip over an echo's"]
    return (
        f"{grid(head, rows)}\n\nAnswer: time of a processor (CPU time of the process) of a frame, "
        f"mean over a flight in world honest, without the socket; goal: {record['goal_us']:g} us. "
        "Round trip over loopback: "
        "medians of wall time, as a ratio to a process that sends as many bytes back at once. The "
        f"machine was loaded by other work: load {record['load']:g}."
    )
