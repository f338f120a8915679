# SPDX-License-Identifier: Apache-2.0
"""The flight's climb as the live page gives it, by the function that makes the report's. No ROS."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from heli_math.climb import OVERSHOOT_S, climb_figures
from heli_math.rows import REFERENCE

Array = NDArray[np.float64]
# A height that is not reached so long after the reference's arrival is not waited for any longer.
_LONGEST_S = 60.0
Figures = dict[str, float | None]


@dataclass
class _Kept:
    """Samples of one record from the climb's start on, batch by batch."""

    time_s: list[Array] = field(default_factory=list)
    height_m: list[Array] = field(default_factory=list)
    reference: list[Array] = field(default_factory=list)
    over: bool = False


class ClimbSoFar:
    """Figures of the first commanded climb, per record, once the reference has arrived."""

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._found: dict[str, Figures] = {}

    def hold(self, record: str, time_s: Array, height_m: Array, reference: Array) -> None:
        """Samples (N,) of a record, times rising, with the reference (N, 7) at each."""
        kept = self._kept.setdefault(record, _Kept())
        if kept.over:
            return
        moving = np.flatnonzero(reference[:, REFERENCE.down_vel])
        first = 0 if kept.time_s else (int(moving[0]) if moving.size else time_s.size)
        if first == time_s.size:
            return
        kept.time_s.append(time_s[first:])
        kept.height_m.append(height_m[first:])
        kept.reference.append(reference[first:])
        if moving.size and moving[-1] == time_s.size - 1:
            return
        self._measure(record, kept)

    def _measure(self, record: str, kept: _Kept) -> None:
        time_s, reference = np.concatenate(kept.time_s), np.concatenate(kept.reference)
        figures = climb_figures(time_s, np.concatenate(kept.height_m), reference, record)
        self._found[record] = {
            figure.metric.key: None if figure.value is None else round(figure.value, 4)
            for figure in figures
        }
        still = np.flatnonzero(reference[:, REFERENCE.down_vel] == 0.0)
        since_s = time_s[-1] - time_s[still[0]]
        known = None not in self._found[record].values()
        if since_s > OVERSHOOT_S and (known or since_s > _LONGEST_S):
            kept.over = True
            kept.time_s, kept.height_m, kept.reference = [], [], []

    def row(self) -> dict[str, Figures]:
        """Per record the figures by key; a value that was not reached is None."""
        return self._found
