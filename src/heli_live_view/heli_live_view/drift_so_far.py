# SPDX-License-Identifier: Apache-2.0
"""The receiver's drift at engagement, by the function that gives the report's. No ROS."""

import numpy as np
from numpy.typing import NDArray

from heli_math.paper_metrics import ABOUT_S, SETTLED_S, drift_at_engagement
from heli_math.ticks import TICKS_PER_S, seconds

Array = NDArray[np.float64]
_FIRST, _LAST = (round((SETTLED_S + side) * TICKS_PER_S) for side in (-ABOUT_S, ABOUT_S))


class DriftSoFar:
    """What the navigation's position is off by once it has settled.

    Attributes
    ----------
    ned_m : (3,) array or None
        None before, and for good if what is needed was missed.
    """

    def __init__(self) -> None:
        self._pos: dict[str, dict[int, Array]] = {"nav": {}, "truth": {}}
        self._over: set[str] = set()
        self.ned_m: Array | None = None

    def add(self, record: str, tick: int, pos_ned_m: Array) -> None:
        """A sample of a record, "nav" or "truth": position (3,)."""
        if record in self._over:
            return
        if tick <= _LAST:
            self._pos[record][tick] = pos_ned_m
            return
        self._over.add(record)
        if self._over == self._pos.keys():
            self._measure()

    def _measure(self) -> None:
        nav, truth = self._pos["nav"], self._pos["truth"]
        ticks = sorted(nav.keys() & truth.keys())
        if ticks and ticks[0] <= _FIRST:
            pos = (np.array([record[tick] for tick in ticks]) for record in (nav, truth))
            self.ned_m = drift_at_engagement(seconds(np.array(ticks)), *pos)
        nav.clear()
        truth.clear()
