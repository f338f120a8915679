# SPDX-License-Identifier: Apache-2.0
"""Markdown tables, and the world that stands below them."""

import re
from collections.abc import Iterable, Mapping, Sequence


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
            told = re.sub(r"; seed \d+$", "", wind).removeprefix("simulated: ")
            winds.append(f"{test}: {told}")
            receivers.append(receiver.removesuffix("; the paper's numbers are from flight"))
    return f"Simulated. {'; '.join(dict.fromkeys((*winds, *receivers)))}."


def three(values: Sequence[float], digits: int) -> str:
    """Numbers of a cell."""
    return ", ".join(f"{value:.{digits}f}" for value in values)
