# SPDX-License-Identifier: Apache-2.0
"""Markdown tables, the world that stands below them, and the words that several of them share."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from heli_flight.scenario import GROUND_METRICS

RECEIVERS = {"standalone": "standalone GPS", "rtk": "RTK"}
RECORDS = {
    "navigation": "state estimate",
    "truth": "truth",
    "truth_less_drift": "drift-corrected",
}
LAWS = {
    "hinf_output": "output feedback (default)",
    "hinf": "state feedback",
    "hinf_offset_free": "offset-free 0.5",
    "lqr": "LQR",
    "pid": "PID",
}
GROUND_HEAD = [f"{m.label}, {m.unit} (goal {m.goal:g})" for m in GROUND_METRICS]


def grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def world(flown: Mapping[str, Sequence[Sequence[str]]]) -> str:
    """What was flown in, by test, as the commands' `conditions` say it; without the seed.

    Parameters
    ----------
    flown : mapping of test to sequence of conditions
        Each is two lines, wind and receiver; a line that several tests share is said once.
    """
    winds, receivers = [], []
    for test, conditions in flown.items():
        for wind, receiver in conditions:
            source = re.sub(r"; seed \d+$", "", wind).removeprefix("simulated: ")
            winds.append(f"{test}: {source}")
            receivers.append(receiver.removesuffix("; the paper's numbers are from flight"))
    return f"Simulated. {'; '.join(dict.fromkeys((*winds, *receivers)))}."


def three(values: Sequence[float], digits: int) -> str:
    """Numbers of a cell."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def ground_table(row: Mapping[str, Any]) -> list[str]:
    """Largest figures on the ground; a dash for what was never flown."""
    largest = row["max"]
    return [f"{largest[m.key]:.2f}" if m.key in largest else "–" for m in GROUND_METRICS]


def machine(results: Mapping[str, Any]) -> str:
    """Cores and load of where it was measured."""
    where = results["machine"]
    return f"{where['cores']} cores, load before {where['load_before']:.1f}"
