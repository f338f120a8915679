# SPDX-License-Identifier: Apache-2.0
"""Which flights of a campaign came worst: those that did not end, then by their distance from the
bounds.
"""

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass

import pyarrow as pa

from heli_flight.loop.scoring import SOURCES, decides
from heli_flight.studies.dispersion.row import (
    CAUSE,
    EXIT_CODE,
    FIGURE,
    NUMBER,
    SEED,
    SENTENCE,
    Cause,
)
from heli_math.paper_metrics import BY_KEY


@dataclass(frozen=True)
class Case:
    """A flight.

    Attributes
    ----------
    number, seed : int
    cause, sentence : str
    failed : bool
        Lost, refused or outside of what is judged.
    figure : str
        Name of the judged figure that is the largest part of its bound; empty without any.
    value, share : float
        That figure, and as a part of its bound; NaN without any.
    """

    number: int
    seed: int
    cause: str
    sentence: str
    failed: bool
    figure: str
    value: float
    share: float


def judged_figures(table: pa.Table, gps: str) -> dict[str, tuple[str, str, float]]:
    """Columns of what decides a verdict: key of the metric, record, bound."""
    names = {
        f"{FIGURE}{key} ({source})": (key, source, metric.paper)
        for key, metric in BY_KEY.items()
        for source in SOURCES
        if decides(source, gps)
    }
    return {name: told for name, told in names.items() if name in table.column_names}


def cases(table: pa.Table, gps: str) -> list[Case]:
    """Every flight of rows as of `Store.table`."""
    judged = judged_figures(table, gps)
    wanted = [NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE, *judged]
    return [_case(row, judged) for row in table.select(wanted).to_pylist()]


def _case(row: dict[str, object], judged: dict[str, tuple[str, str, float]]) -> Case:
    parts = {
        name: float(str(row[name])) / bound
        for name, (_, _, bound) in judged.items()
        if row[name] is not None
    }
    name = max(parts, key=lambda key: parts[key], default="")
    return Case(
        int(str(row[NUMBER])), int(str(row[SEED])), str(row[CAUSE]), str(row[SENTENCE]),
        bool(row[EXIT_CODE]), name.removeprefix(FIGURE),
        float(str(row[name])) if name else math.nan, parts.get(name, math.nan),
    )  # fmt: skip


def worst(found: Sequence[Case], count: int) -> list[Case]:
    """The worst of them, the worst first: what did not end (by number), what failed, the rest."""

    def place(case: Case) -> tuple[bool, bool, float, int]:
        share = 0.0 if math.isnan(case.share) else case.share
        return case.cause == Cause.FLOWN, not case.failed, -share, case.number

    return heapq.nsmallest(count, found, key=place)
