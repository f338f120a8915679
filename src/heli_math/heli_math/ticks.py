# SPDX-License-Identifier: Apache-2.0
"""The tick, by which everything counts time: stamps, schedules and flights are whole ticks.

A flight's time is made from its tick anew each time; nothing adds up floats.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:  # the command line counts ticks, too, and its help shall not wait for numpy
    import numpy as np
    from numpy.typing import NDArray

NS_PER_S = 1_000_000_000
TICK_NS = 10_000_000
"""Length of a tick, ns."""
TICKS_PER_S = NS_PER_S // TICK_NS
"""Ticks of a second, an int."""
TICK_S = TICK_NS / NS_PER_S
"""Length of a tick, s."""


def ticks_in(time_s: float) -> int:
    """Whole number of ticks that is nearest to a time (s)."""
    return round(time_s * TICKS_PER_S)


def stamp_at(time_s: float) -> int:
    """Stamp (ns) of the tick at a time (s): of the last one that is not later."""
    return round(time_s * NS_PER_S) // TICK_NS * TICK_NS


@overload
def seconds(ticks: int) -> float: ...
@overload
def seconds(ticks: NDArray[np.int64]) -> NDArray[np.float64]: ...
def seconds(ticks: int | NDArray[np.int64]) -> float | NDArray[np.float64]:
    """Time (s) of a number of ticks, or of an array of them: the float nearest to it."""
    return ticks / TICKS_PER_S
