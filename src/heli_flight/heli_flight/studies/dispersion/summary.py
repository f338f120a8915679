# SPDX-License-Identifier: Apache-2.0
"""What a campaign has found: causes, how many are outside, quantiles of each figure."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from heli_flight.studies.dispersion.row import CAUSE, FIGURE, Cause
from heli_flight.studies.dispersion.worst import cases, worst
from heli_flight.studies.share import Share

_WORST = 10
QUANTILES = (0.5, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class Summary:
    """Of a campaign.

    Attributes
    ----------
    flights : int
    causes : dict
        Cause to number of flights.
    failed : int
        Flights lost, refused or outside of what is judged.
    interval : (float, float)
        95 % interval of their share (Clopper, Pearson 1934).
    survived : Share
        Flights that came to their end in the air, inside or outside.
    quantiles : dict
        Figure to its quantiles (`QUANTILES`) over the flights that ended in the air.
    worst : list of int
        Numbers of the flights that failed, at most ten: the lost ones first, then those farthest
        outside.
    """

    flights: int
    causes: dict[str, int]
    failed: int
    interval: tuple[float, float]
    survived: Share
    quantiles: dict[str, list[float]]
    worst: list[int]


def summary_of(table: pa.Table, gps: str) -> Summary:
    """Summarise rows as of `Store.table`, flown with a receiver that says what is judged."""
    count = table.num_rows
    if not count:
        return Summary(0, {}, 0, (0.0, 1.0), Share(0, 0), {}, [])
    failing = [case for case in cases(table, gps) if case.failed]
    quantiles = {
        name.removeprefix(FIGURE): _quantiles(table[name])
        for name in table.column_names
        if name.startswith(FIGURE)
    }
    causes = Counter(table[CAUSE].to_pylist())
    return Summary(
        count,
        dict(causes),
        len(failing),
        Share(len(failing), count).interval,
        Share(causes[Cause.FLOWN], count),
        quantiles,
        [case.number for case in worst(failing, _WORST)],
    )


def _quantiles(column: Any) -> list[float]:
    values = np.array([v for v in column.to_pylist() if v is not None], dtype=float)
    return [] if not values.size else [float(q) for q in np.quantile(values, QUANTILES)]
