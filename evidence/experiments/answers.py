# SPDX-License-Identifier: Apache-2.0
"""How long nodes take to answer, in each state of their lives.

`benchmarks/answers.py` measures it.
"""

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid, machine

produces(
    "answers",
    "./heli python benchmarks/answers.py --realtime --seconds 60 --json",
    "How long nodes take to answer in each state, in a flight in real time.",
    loose={key: NOT_COMPARED for key in ("states", "nodes", "bare", "ratios", "machine")},
)


@table("answers")
def answers(results: Results) -> str:
    """Times from a request to its answer by state, beside a bare node of rclpy."""
    measured = results["answers"]
    states = {**measured["states"], "a bare node beside it": measured["bare"]}
    rows = [
        [state, f"{row['answers']}", f"{row['p50_ms']:.1f}", f"{row['p99_ms']:.0f}",
         f"{row['max_ms']:.0f}", f"{row['over_goal']}"]
        for state, row in states.items()
    ]  # fmt: skip
    head = ["state", "answers", "p50, ms", "p99, ms", "longest, ms", "over 200 ms (goal: none)"]
    return (
        f"{grid(head, rows)}\n\nFive nodes and the bare one, each asked again and again through a "
        f"flight of {measured['seconds']:g} s in real time; {machine(measured)}."
    )
