# SPDX-License-Identifier: Apache-2.0
"""How long nodes take to answer, in each state of their lives.

`benchmarks/answers.py` measures it.
"""

from collections.abc import Mapping
from typing import Any

from evidence.files import Results
from evidence.registry import NOT_COMPARED, produces, table
from evidence.tables import grid, machine

_LOOSE = {key: NOT_COMPARED for key in ("states", "nodes", "bare", "ratios", "machine")}

produces(
    "answers",
    "./heli python benchmarks/answers.py --realtime --seconds 60 --json",
    "How long nodes take to answer in each state, in a flight in real time.",
    loose=_LOOSE,
)
produces(
    "answers_cold",
    "./heli python benchmarks/answers.py --cold --seconds 30 --json",
    "How long nodes take to answer in each state, in lockstep, while they compile.",
    loose=_LOOSE,
)


@table("answers")
def answers(results: Results) -> str:
    """Times from a request to its answer by state, beside a bare node of rclpy."""
    rows = [
        row
        for name, said in (("answers", "real time"), ("answers_cold", "lockstep, compiling"))
        for row in _rows(results[name], said)
    ]
    head = ["flight", "state", "answers", "p50, ms", "p99, ms", "longest, ms", "over 200 ms"]
    return (
        f"{grid(head, rows)}\n\nReal time: {machine(results['answers'])}. "
        f"Compiling: {machine(results['answers_cold'])}."
    )


def _rows(measured: Mapping[str, Any], said: str) -> list[list[str]]:
    states = {**measured["states"], "a bare node beside it": measured["bare"]}
    return [
        [said, state, f"{row['answers']}", f"{row['p50_ms']:.1f}", f"{row['p99_ms']:.1f}",
         f"{row['max_ms']:.0f}", f"{row['over_goal']}"]
        for state, row in states.items()
    ]  # fmt: skip
