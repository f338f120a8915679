# SPDX-License-Identifier: Apache-2.0
"""The tick, by which everything counts time: stamps, schedules and flights are whole ticks.

A flight's time is made from its tick anew each time; nothing adds up floats. Parameters count ticks
of 10 ms, and so do analysis and design. A flight may step in shorter ones: `Rate`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

if TYPE_CHECKING:
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


RATES_HZ = (TICKS_PER_S, 2 * TICKS_PER_S, 4 * TICKS_PER_S)
"""Rates at which a flight may step: whole parts of 10 ms, so that every schedule fits. A plant that
is flown by others may step in any whole part of 10 ms: `Rate.at_least`."""


@dataclass(frozen=True)
class Rate:
    """How many ticks a flight makes in 10 ms; nodes and kernels count these.

    Attributes
    ----------
    fold : int
        Ticks of the flight in a tick of 10 ms, 1 by default.
    """

    fold: int = 1

    @classmethod
    def of_hz(cls, rate_hz: int) -> Rate:
        """The rate of so many ticks a second, one of `RATES_HZ`; ValueError for another."""
        if rate_hz not in RATES_HZ:
            allowed = ", ".join(str(known) for known in RATES_HZ)
            raise ValueError(f"rate {rate_hz} Hz is not allowed; allowed: {allowed}")
        return cls(rate_hz // TICKS_PER_S)

    @classmethod
    def at_least(cls, rate_hz: int) -> Rate:
        """The slowest rate in whole parts of 10 ms that is not below so many ticks a second."""
        return cls(max(1, -(-rate_hz // TICKS_PER_S)))

    @classmethod
    def of_parameters(cls, values: Mapping[str, Any]) -> Rate:
        """That of a node's parameter `rate_hz`; 100 Hz of a core that is not told."""
        return cls.of_hz(values.get("rate_hz", TICKS_PER_S))

    @property
    def hz(self) -> int:
        """Ticks of a second."""
        return TICKS_PER_S * self.fold

    @property
    def tick_ns(self) -> int:
        """Length of a tick, ns; where 10 ms cannot be cut so, of the shortest (see `time_ns`)."""
        return TICK_NS // self.fold

    @property
    def tick_s(self) -> float:
        """Length of a tick, s."""
        return TICK_S / self.fold

    def time_ns(self, ticks: int) -> int:
        """Time of a number of the flight's ticks, ns: whole ones of 10 ms are exact at any rate."""
        return ticks * TICK_NS // self.fold

    def of(self, ticks: int) -> int:
        """The flight's ticks in so many of 10 ms, as parameters count them."""
        return ticks * self.fold

    def every(self, ticks: int) -> int:
        """The flight's ticks from one message of a stream to the next, of a period in a table.

        A period of 1 means every tick of the flight; others are counted in 10 ms, 0 is none.
        """
        return ticks if ticks <= 1 else self.of(ticks)

    def ticks_in(self, time_s: float) -> int:
        """Whole number of the flight's ticks that is nearest to a time (s)."""
        return round(time_s * self.hz)

    @overload
    def seconds(self, ticks: int) -> float: ...
    @overload
    def seconds(self, ticks: NDArray[np.int64]) -> NDArray[np.float64]: ...
    def seconds(self, ticks: int | NDArray[np.int64]) -> float | NDArray[np.float64]:
        """Time (s) of a number of the flight's ticks, or of an array of them."""
        return ticks / self.hz


OF_100_HZ = Rate()
"""The rate of a flight that is not told one."""


# -------------------------------------------------------------------------------------------------
# Where on the earth the origin of the NED frame may lie.
# -------------------------------------------------------------------------------------------------

LATITUDE_DEG = 85.0
"""Largest magnitude; near a pole east and north have no meaning."""
LONGITUDE_DEG = 180.0
